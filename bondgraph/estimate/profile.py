"""Profile-likelihood intervals: how far one coordinate can go while the others make the best of it.

Where the likelihood is not a parabola (sloppy directions, bounds nearby) these intervals keep their level and those
from a covariance do not. Reference: Venzon and Moolgavkar (1988), A method for computing profile-likelihood-based
confidence intervals, Applied Statistics 37(1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from bondgraph.errors import EstimationError
from bondgraph.estimate.objective import BoolArray, FloatArray, Objective, Terms
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings, gauss_newton
from bondgraph.estimate.solvers.steps import known_noise_levels

_ITERATIONS = 12
_TOLERANCE = 1e-3


@dataclass(frozen=True)
class ProfileInterval:
    """Interval of one coordinate; an end that is a bound was not reached by the likelihood."""

    lower: float
    upper: float
    evaluations: int


@dataclass(frozen=True)
class _Pinned:
    """An objective with one coordinate held."""

    objective: Objective
    index: int
    value: float

    @property
    def lower(self) -> FloatArray:
        """Lower bounds, shape (n,)."""
        return self._held(self.objective.lower)

    @property
    def upper(self) -> FloatArray:
        """Upper bounds, shape (n,)."""
        return self._held(self.objective.upper)

    @property
    def noise_levels(self) -> BoolArray:
        """Coordinates known as noise levels, shape (n,)."""
        return known_noise_levels(self.objective)

    def _held(self, bounds: FloatArray) -> FloatArray:
        held = bounds.copy()
        held[self.index] = self.value
        return held

    def nll(self, points: FloatArray) -> FloatArray:
        """Values at points (n, members)."""
        return self.objective.nll(points)

    def terms(self, points: FloatArray) -> Terms:
        """Scalar terms at points (n, members)."""
        return self.objective.terms(points)


def profile_interval(
    objective: Objective, point: FloatArray, index: int, std: float, level: float = 0.95
) -> ProfileInterval:
    """Interval of one coordinate by its profile likelihood.

    Parameters
    ----------
    objective
        What was minimised.
    point
        Its optimum, shape (n,).
    index
        Which coordinate.
    std
        Its standard deviation from a covariance, or any guess: the first step.
    level
        Coverage.

    Returns
    -------
    ProfileInterval
        In the unit of the coordinate.

    Raises
    ------
    EstimationError
        If ``std`` or ``level`` is out of range.

    Examples
    --------
    >>> class Sample:
    ...     lower, upper = np.array([-9.0, -9.0]), np.array([9.0, 9.0])
    ...     def terms(self, points):
    ...         return Terms(np.array([points[0] + points[1], points[0] - points[1]]), np.zeros(points.shape))
    ...     def nll(self, points):
    ...         return self.terms(points).sums()
    >>> interval = profile_interval(Sample(), np.zeros(2), 0, std=1.0)
    >>> round(interval.lower, 3), round(interval.upper, 3)
    (-1.386, 1.386)
    """
    if not (std > 0.0 and math.isfinite(std) and 0.0 < level < 1.0):
        raise EstimationError(f"profile: std {std:g} must be positive and level {level:g} between 0 and 1")
    reach = NormalDist().inv_cdf(0.5 + 0.5 * level)
    lower, first = _end(objective, point, index, -std, reach)
    upper, second = _end(objective, point, index, std, reach)
    return ProfileInterval(lower, upper, first + second)


def _end(objective: Objective, point: FloatArray, index: int, std: float, reach: float) -> tuple[float, int]:
    """Where the root of twice the rise of the profile, nearly a straight line, reaches ``reach``."""
    bound = float(objective.upper[index] if std > 0.0 else objective.lower[index])
    best = float(objective.nll(point[:, np.newaxis])[0])
    centre, evaluations = float(point[index]), 1
    near, far = (centre, 0.0), (math.nan, math.nan)
    trial, current = centre + reach * std, point
    settings = GaussNewtonSettings(tolerance=1e-5, iterations=30)
    for _ in range(_ITERATIONS):
        trial = min(trial, bound) if std > 0.0 else max(trial, bound)
        state = gauss_newton(_Pinned(objective, index, trial), _with_entry(current, index, trial), settings)
        evaluations += state.evaluations
        rise = math.sqrt(max(2.0 * (float(state.values[0]) - best), 0.0))
        if abs(rise - reach) < _TOLERANCE or (trial == bound and rise < reach):
            break
        if rise < reach:
            near, current = (trial, rise), state.points[:, 0]
        else:
            far = (trial, rise)
        trial = 2.0 * trial - centre if math.isnan(far[0]) else _between(near, far, reach)
    return trial, evaluations


def _between(near: tuple[float, float], far: tuple[float, float], reach: float) -> float:
    """Where a straight line between two points of the profile reaches ``reach``, kept off its ends."""
    share = (reach - near[1]) / (far[1] - near[1]) if math.isfinite(far[1]) else 0.5
    return near[0] + min(max(share, 0.05), 0.95) * (far[0] - near[0])


def _with_entry(vector: FloatArray, index: int, value: float) -> FloatArray:
    """A copy of a vector with one entry replaced."""
    changed = vector.copy()
    changed[index] = value
    return changed
