"""Profile likelihood: how far one coordinate can go while the others make the best of it.

Where the likelihood is not a parabola (sloppy directions, bounds nearby) these intervals keep their level and those
from a covariance do not. Reference: Venzon and Moolgavkar (1988), A method for computing profile-likelihood-based
confidence intervals, Applied Statistics 37(1).
"""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.objective import Expand, FloatArray, Objective
from bondgraph.estimate.pinned import ConstrainedMinimum, constrained_minimum
from bondgraph.execute.shared import Shared
from bondgraph.execute.tasks import in_order

_ITERATIONS = 12
_TOLERANCE = 1e-3
#: Points of a curve on each side, as shares of the way to the end of the interval: one beyond it shows how it goes on.
_SHARES = (0.25, 0.5, 0.75, 1.0, 1.25)


@dataclass(frozen=True)
class ProfileInterval:
    """Interval of one coordinate; an end that is a bound was not reached by the likelihood.

    ``lower_point`` and ``upper_point`` (n,) are where the others go at its ends.
    """

    lower: float
    upper: float
    evaluations: int
    lower_point: FloatArray
    upper_point: FloatArray


@dataclass(frozen=True)
class ProfileCurve:
    """Twice the rise of the negative log-likelihood along one coordinate, the others at their best.

    ``coordinates`` (k,) in order with ``deviance`` (k,), and ``points`` (n, k); zero deviance is the optimum.
    """

    coordinates: FloatArray
    deviance: FloatArray
    points: FloatArray
    evaluations: int


def profile_interval(
    objective: Objective,
    point: FloatArray,
    index: int,
    std: float,
    level: float = 0.95,
    *,
    jacobian: Expand = central_differences,
    direction: FloatArray | None = None,
    executor: Executor | None = None,
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
    jacobian
        Gradient and Fisher information of the objective, see :func:`bondgraph.estimate.pinned.constrained_minimum`.
    direction
        How all coordinates move with this one at first, shape (n,), 1 at ``index``; None: the others stay.
    executor
        Whose workers look for the ends, each for one; None: this process.

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
    >>> from bondgraph.estimate.objective import Terms
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
        raise EstimationError(
            f"profile: std {std:g} and level {level:g} - the first must be above zero, the second between 0 and 1"
        )
    reach = NormalDist().inv_cdf(0.5 + 0.5 * level)
    way = _Way(objective, point, index, jacobian, np.eye(point.size)[index] if direction is None else direction)
    shared = Shared.of(way) if executor else None
    lower, upper = in_order(executor, _end, [(shared or way, side * std, reach) for side in (-1.0, 1.0)])
    return ProfileInterval(
        float(lower.point[index]), float(upper.point[index]), lower.evaluations + upper.evaluations,
        lower.point, upper.point,
    )  # fmt: skip


def profile_curve(
    objective: Objective,
    point: FloatArray,
    index: int,
    interval: ProfileInterval,
    jacobian: Expand = central_differences,
    executor: Executor | None = None,
) -> ProfileCurve:
    """Profile of one coordinate over an interval and a quarter beyond each of its ends.

    Parameters
    ----------
    objective, point, index
        As for :func:`profile_interval`.
    interval
        What that gave.
    jacobian
        As there.
    executor
        Whose workers compute the points; None: this process.

    Examples
    --------
    >>> from bondgraph.estimate.objective import Terms
    >>> class Sample:
    ...     lower, upper = np.array([-9.0]), np.array([9.0])
    ...     def terms(self, points):
    ...         return Terms(points.copy(), np.zeros(points.shape))
    ...     def nll(self, points):
    ...         return self.terms(points).sums()
    >>> curve = profile_curve(Sample(), np.zeros(1), 0, profile_interval(Sample(), np.zeros(1), 0, std=1.0))
    >>> bool(np.allclose(curve.deviance, curve.coordinates**2))
    True
    """
    best = float(objective.nll(point[:, np.newaxis])[0])
    given = Shared.of(objective) if executor else objective
    ends = (interval.lower_point, interval.upper_point)
    tasks = [(given, point + share * (end - point), index, jacobian) for end in ends for share in _SHARES]
    minima = in_order(executor, _minimum_at, tasks)
    found = [(point, best), *((one.point, one.value) for one in minima)]
    evaluations = interval.evaluations + 1 + sum(one.evaluations for one in minima)
    found.sort(key=lambda one: float(one[0][index]))
    points = np.array([one for one, _ in found]).T
    deviance = 2.0 * (np.array([value for _, value in found]) - best)
    _, first = np.unique(points[index], return_index=True)
    return ProfileCurve(points[index, first], deviance[first], points[:, first], evaluations)


@dataclass(frozen=True)
class _Way:
    """An optimum (n,), the coordinate that leaves it, and the direction (n,) in which the others follow at first."""

    objective: Objective
    point: FloatArray
    index: int
    jacobian: Expand
    direction: FloatArray

    def minimum(self, value: float, near: FloatArray) -> ConstrainedMinimum:
        """The best point with the coordinate at a value, searched from a straight line through a point near."""
        step = near[self.index] - self.point[self.index]
        direction = self.direction if step == 0.0 else (near - self.point) / step
        start = self.point + (value - self.point[self.index]) * direction
        return constrained_minimum(self.objective, start, {self.index: value}, self.jacobian)


def _minimum_at(
    given: Objective | Shared[Objective], target: FloatArray, index: int, jacobian: Expand
) -> ConstrainedMinimum:
    """The best point where one coordinate has the value of a target (n,), or its bound; searched from there."""
    objective = given.open() if isinstance(given, Shared) else given
    value = float(np.clip(target[index], objective.lower[index], objective.upper[index]))
    return constrained_minimum(objective, target, {index: value}, jacobian)


def _end(given: _Way | Shared[_Way], std: float, reach: float) -> ConstrainedMinimum:
    """Where the root of twice the rise of the profile, nearly a straight line, reaches ``reach``."""
    way = given.open() if isinstance(given, Shared) else given
    objective, index = way.objective, way.index
    bound = float(objective.upper[index] if std > 0.0 else objective.lower[index])
    best = float(objective.nll(way.point[:, np.newaxis])[0])
    centre, evaluations = float(way.point[index]), 1
    near, far = (centre, 0.0), (math.nan, math.nan)
    trial, current = centre + reach * std, way.point
    found = ConstrainedMinimum(way.point, best, 1)
    for _ in range(_ITERATIONS):
        trial = min(trial, bound) if std > 0.0 else max(trial, bound)
        found = way.minimum(trial, current)
        evaluations += found.evaluations
        rise = math.sqrt(max(2.0 * (found.value - best), 0.0))
        if abs(rise - reach) < _TOLERANCE or (trial == bound and rise < reach):
            break
        if rise < reach:
            near, current = (trial, rise), found.point
        else:
            far = (trial, rise)
        trial = 2.0 * trial - centre if math.isnan(far[0]) else _between(near, far, reach)
    return ConstrainedMinimum(found.point, found.value, evaluations)


def _between(near: tuple[float, float], far: tuple[float, float], reach: float) -> float:
    """Where a straight line between two points of the profile reaches ``reach``, kept off its ends."""
    share = (reach - near[1]) / (far[1] - near[1]) if math.isfinite(far[1]) else 0.5
    return near[0] + min(max(share, 0.05), 0.95) * (far[0] - near[0])
