"""A likelihood with some coordinates held at given values, and its minimum over the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bondgraph.estimate.objective import BoolArray, Expand, Expansion, FloatArray, Objective, Terms
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings, gauss_newton
from bondgraph.estimate.solvers.steps import known_noise_levels

#: Difference step of a held coordinate, as a share of its bounds; its derivative is not used.
_UNUSED_STEP = 1e-6
#: A rise of the likelihood is wanted to 1e-3 nats; a search that promises less than this many more has ended.
_SETTINGS = GaussNewtonSettings(tolerance=1e-5, iterations=30, patience=3, least_gain=1e-5)


@dataclass(frozen=True)
class Pinned:
    """An objective with some coordinates held: ``values`` by index, equal lower and upper bounds there."""

    objective: Objective
    values: Mapping[int, float]

    @property
    def lower(self) -> FloatArray:
        """Lower bounds, shape (n,)."""
        return self.moved(self.objective.lower)

    @property
    def upper(self) -> FloatArray:
        """Upper bounds, shape (n,)."""
        return self.moved(self.objective.upper)

    @property
    def noise_levels(self) -> BoolArray:
        """Coordinates known as noise levels, shape (n,)."""
        return known_noise_levels(self.objective)

    def moved(self, vector: FloatArray) -> FloatArray:
        """A vector (n,) with the held values in their places."""
        held = vector.copy()
        held[list(self.values)] = list(self.values.values())
        return held

    def nll(self, points: FloatArray) -> FloatArray:
        """Values at points (n, members)."""
        return self.objective.nll(points)

    def terms(self, points: FloatArray) -> Terms:
        """Scalar terms at points (n, members)."""
        return self.objective.terms(points)


@dataclass(frozen=True)
class ConstrainedMinimum:
    """The best point (n,) with some coordinates held, its value in nats, and the evaluations that it took."""

    point: FloatArray
    value: float
    evaluations: int


def constrained_minimum(
    objective: Objective, start: FloatArray, held: Mapping[int, float], jacobian: Expand
) -> ConstrainedMinimum:
    """Minimum of an objective over all coordinates but those held.

    Parameters
    ----------
    objective
        A negative log-likelihood over a box.
    start
        Where the search starts, shape (n,).
    held
        Values of the held coordinates, by index.
    jacobian
        Gradient and Fisher information. An exact one must know the objective itself, so it is given that and not the
        pinned one; what it says of held coordinates is not used.

    Examples
    --------
    >>> from bondgraph.estimate.derivatives.differences import central_differences
    >>> class Sample:
    ...     lower, upper = np.array([-9.0, -9.0]), np.array([9.0, 9.0])
    ...     def terms(self, points):
    ...         return Terms(np.array([points[0] + points[1] - 3.0, points[0] - points[1]]), np.zeros(points.shape))
    ...     def nll(self, points):
    ...         return self.terms(points).sums()
    >>> found = constrained_minimum(Sample(), np.zeros(2), {0: 2.0}, central_differences)
    >>> found.point.round(3).tolist(), round(found.value, 6)
    ([2.0, 1.5], 0.25)
    """
    pinned = Pinned(objective, held)
    point = pinned.moved(np.clip(start, objective.lower, objective.upper))
    if len(held) == point.size:
        return ConstrainedMinimum(point, float(objective.nll(point[:, np.newaxis])[0]), 1)
    unused = _UNUSED_STEP * (objective.upper - objective.lower)[:, np.newaxis]

    def expand(_: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
        return jacobian(objective, points, np.where(steps > 0.0, steps, unused))

    state = gauss_newton(pinned, point, _SETTINGS, jacobian=expand)
    return ConstrainedMinimum(state.points[:, 0], float(state.values[0]), state.evaluations)
