"""L-BFGS-B of scipy as a search: each step takes one start to its end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.optimize import Bounds, minimize

from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.objective import (
    Expand,
    FloatArray,
    Objective,
    SearchOutcome,
    TraceRow,
)
from bondgraph.estimate.solvers.abstract import AbstractSearch, SearchResult

#: Difference step where derivatives are not exact, as a share of the box.
_DIFFERENCE = 1e-6


@dataclass(frozen=True)
class StartsState:
    """Starts (n, starts) with their values (starts,), of which so many as ``iteration`` are at their end."""

    iteration: int
    points: FloatArray
    values: FloatArray
    evaluations: int
    trace: tuple[TraceRow, ...]


@dataclass(frozen=True)
class LBFGSB(AbstractSearch[StartsState]):
    """Quasi-Newton with limited memory in a box: Byrd, Lu, Nocedal, Zhu (1995), SIAM J. Sci. Comput. 16(5), 1190-1208.

    Parameters
    ----------
    iterations
        Most iterations of a start.
    tolerance
        A start ends where the largest component of the gradient, over the width of the box, is below this many nats.
    jacobian
        Gives the gradient.
    """

    iterations: int = 200
    tolerance: float = 1e-6
    jacobian: Expand = central_differences

    stage: ClassVar[str] = "L-BFGS-B"

    def init(self, objective: Objective, starts: FloatArray) -> StartsState:
        """All starts evaluated."""
        points = np.clip(starts, objective.lower[:, np.newaxis], objective.upper[:, np.newaxis])
        values = objective.nll(points)
        return _traced(StartsState(0, points, np.where(np.isfinite(values), values, np.inf), values.size, ()))

    def step(self, objective: Objective, state: StartsState) -> StartsState:
        """The next start, to its end, in coordinates that are shares of the box."""
        lower, width = objective.lower, objective.upper - objective.lower
        spent = [0]

        def value_and_slope(share: FloatArray) -> tuple[float, FloatArray]:
            point = (lower + width * share)[:, np.newaxis]
            (expansion,) = self.jacobian(objective, point, (_DIFFERENCE * width)[:, np.newaxis])
            spent[0] += 1 + expansion.evaluations
            value, slope = float(objective.nll(point)[0]), expansion.gradient * width
            return (value, slope) if np.isfinite(value) and expansion.is_finite else (1e300, np.zeros(share.size))

        k = state.iteration
        start = np.divide(state.points[:, k] - lower, width, out=np.zeros(width.size), where=width > 0.0)
        box = Bounds(np.zeros(width.size), np.where(width > 0.0, 1.0, 0.0))
        options = {"maxiter": self.iterations, "gtol": self.tolerance, "ftol": 0.0}
        found = minimize(value_and_slope, start, method="L-BFGS-B", jac=True, bounds=box, options=options)
        points, values = state.points.copy(), state.values.copy()
        if found.fun < values[k]:
            points[:, k], values[k] = lower + width * found.x, found.fun
        return _traced(replace(
            state, iteration=k + 1, points=points, values=values, evaluations=state.evaluations + spent[0]
        ))  # fmt: skip

    def ended(self, state: StartsState) -> SearchOutcome | None:
        """Converged once every start is at its end."""
        if state.iteration < state.values.size:
            return None
        return SearchOutcome.CONVERGED if np.isfinite(state.values).any() else SearchOutcome.NO_FINITE_POINT

    def result(self, state: StartsState) -> SearchResult:
        """Where every start is."""
        return SearchResult(state.points, state.values)


def _traced(state: StartsState) -> StartsState:
    best = int(np.argmin(state.values))
    point = tuple(float(v) for v in state.points[:, best])
    row = TraceRow(LBFGSB.stage, state.iteration, state.evaluations, float(state.values[best]), point)
    return replace(state, trace=(*state.trace, row))
