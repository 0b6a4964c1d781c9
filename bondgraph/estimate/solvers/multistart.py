"""Gauss-Newton from several starts as a search: those that cannot win are ended on the way."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from bondgraph.estimate.coordinates import AbstractProblem
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.objective import Expand, FloatArray, Objective, SearchOutcome
from bondgraph.estimate.solvers.abstract import AbstractSearch, SearchResult
from bondgraph.estimate.solvers.gauss_newton import (
    GaussNewtonSettings,
    GaussNewtonState,
    finish_starts,
    initial_starts,
    starts_ended,
    step_starts,
)
from bondgraph.estimate.solvers.race import raced


@dataclass(frozen=True)
class GaussNewton(AbstractSearch[GaussNewtonState]):
    """Damped Gauss-Newton from several starts in lockstep.

    Parameters
    ----------
    settings
        Stop rules.
    jacobian
        Gradient and Fisher information.
    """

    settings: GaussNewtonSettings = field(default_factory=GaussNewtonSettings)
    jacobian: Expand = central_differences

    stage: ClassVar[str] = "gauss-newton"

    def init(self, objective: Objective, starts: FloatArray) -> GaussNewtonState:
        """All starts evaluated."""
        return initial_starts(objective, starts, self.settings)

    def step(self, objective: Objective, state: GaussNewtonState) -> GaussNewtonState:
        """One iteration of every start that still moves."""
        moved = step_starts(objective, state, self.settings, self.jacobian)
        return raced(objective, moved) if isinstance(objective, AbstractProblem) else moved

    def ended(self, state: GaussNewtonState) -> SearchOutcome | None:
        """The outcome of the best start, once no start moves any more."""
        if not starts_ended(state, self.settings):
            return None
        return finish_starts(state).outcomes[state.best] or SearchOutcome.ITERATION_LIMIT

    def result(self, state: GaussNewtonState) -> SearchResult:
        """Where every start is."""
        return SearchResult(state.points, state.values)
