"""Differential evolution of scipy as a search: one generation a step, by its public function."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.optimize import Bounds, differential_evolution

from bondgraph.estimate.objective import FloatArray, Objective, SearchOutcome, TraceRow
from bondgraph.estimate.solvers.abstract import AbstractSearch, SearchResult
from bondgraph.estimate.solvers.hypercube import latin_hypercube


@dataclass(frozen=True)
class PopulationState:
    """A population (n, members) with its values (members,) after a generation."""

    iteration: int
    points: FloatArray
    values: FloatArray
    evaluations: int
    trace: tuple[TraceRow, ...]


@dataclass(frozen=True)
class ScipyEvolution(AbstractSearch[PopulationState]):
    """``scipy.optimize.differential_evolution``: Storn and Price (1997), J. of Global Optimization 11, 341-359.

    Parameters
    ----------
    members, generations
        Size of the population, and when the search ends.
    patience, tolerance
        The search ends when the best value fell by less than ``tolerance`` in ``patience`` generations.
    strategy
        As scipy names it.
    seed
        The same seed gives the same search.
    """

    members: int = 40
    generations: int = 100
    patience: int = 25
    tolerance: float = 1e-3
    strategy: str = "best1bin"
    seed: int = 0

    stage: ClassVar[str] = "scipy's differential evolution"

    @property
    def most_evaluations(self) -> int:
        """As its hyper-parameters say."""
        return self.members * (1 + self.generations)

    def init(self, objective: Objective, starts: FloatArray) -> PopulationState:
        """A Latin hypercube over the box, the first of it at the first start."""
        lower, width = objective.lower[:, np.newaxis], (objective.upper - objective.lower)[:, np.newaxis]
        rng = np.random.default_rng([self.seed, 0])
        points = lower + width * latin_hypercube(objective.lower.size, self.members, rng)
        points[:, 0] = starts[:, 0]
        return _traced(PopulationState(0, points, _finite(objective.nll(points)), self.members, ()))

    def step(self, objective: Objective, state: PopulationState) -> PopulationState:
        """One generation."""
        known = [state.values]  # of the population that is given, which scipy asks for first

        def values(points: FloatArray) -> FloatArray:
            return known.pop() if known else _finite(objective.nll(points))

        found = differential_evolution(
            values, Bounds(objective.lower, objective.upper), strategy=self.strategy, maxiter=1, init=state.points.T,
            tol=0.0, atol=0.0, polish=False, updating="deferred", vectorized=True,
            rng=np.random.default_rng([self.seed, state.iteration + 1]),
        )  # fmt: skip
        moved = replace(
            state, iteration=state.iteration + 1, points=found.population.T.copy(),
            values=found.population_energies.copy(), evaluations=state.evaluations + self.members,
        )  # fmt: skip
        return _traced(moved)

    def ended(self, state: PopulationState) -> SearchOutcome | None:
        """Why the search ends here, or None if it goes on."""
        best = float(state.values.min())
        if len(state.trace) > self.patience:
            if not np.isfinite(best):
                return SearchOutcome.NO_FINITE_POINT
            if state.trace[-1 - self.patience].nll - best < self.tolerance:
                return SearchOutcome.STALLED
        return SearchOutcome.ITERATION_LIMIT if state.iteration >= self.generations else None

    def result(self, state: PopulationState) -> SearchResult:
        """The population."""
        return SearchResult(state.points, state.values)


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.inf)


def _traced(state: PopulationState) -> PopulationState:
    best = int(np.argmin(state.values))
    point = tuple(float(v) for v in state.points[:, best])
    row = TraceRow(ScipyEvolution.stage, state.iteration, state.evaluations, float(state.values[best]), point)
    return replace(state, trace=(*state.trace, row))
