"""What a search is: hyper-parameters in the search, everything that changes in its states.

After Optimistix (Rader, Lyons, Kidger 2024, Optimistix: modular optimisation in JAX and Equinox, arXiv:2402.09983). A
state is a frozen record of numbers and arrays, so it can be kept on disk, and a search that goes on from it is the same
in every number. A step draws its random numbers from the seed of the search and the number of the step.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Generic, Protocol, TypeVar

from bondgraph.estimate.objective import FloatArray, Objective, Progress, SearchOutcome, TraceRow, silent


class SearchState(Protocol):
    """A search after a step: a frozen dataclass of numbers, arrays, outcomes, and its trace."""

    @property
    def iteration(self) -> int:
        """Steps so far."""

    @property
    def evaluations(self) -> int:
        """Evaluated members so far."""

    @property
    def trace(self) -> tuple[TraceRow, ...]:
        """A row per step, and one for the start."""


StateT = TypeVar("StateT", bound=SearchState)


@dataclass(frozen=True)
class SearchResult:
    """What a search found: points (n, m) with their values (m,), of which some number were given up early."""

    points: FloatArray
    values: FloatArray
    abandoned: int = 0

    @property
    def best(self) -> FloatArray:
        """The best point, shape (n,)."""
        return self.points[:, int(self.values.argmin())]

    @property
    def best_nll(self) -> float:
        """Its value; infinite if none could be evaluated."""
        return float(self.values.min())


class AbstractSearch(ABC, Generic[StateT]):
    """A search over the box of an objective; its fields are hyper-parameters and never change."""

    #: The name of its rows in a trace.
    stage: ClassVar[str]

    @property
    def most_evaluations(self) -> int | None:
        """Most evaluations that the search takes, if it says."""
        return None

    @abstractmethod
    def init(self, objective: Objective, starts: FloatArray) -> StateT:
        """The state before the first step, from starts (n, count) inside the box."""

    @abstractmethod
    def step(self, objective: Objective, state: StateT) -> StateT:
        """The state one step further."""

    @abstractmethod
    def ended(self, state: StateT) -> SearchOutcome | None:
        """Why the search ends here, or None if it goes on."""

    @abstractmethod
    def result(self, state: StateT) -> SearchResult:
        """What the search has found so far."""


def search_to_end(
    search: AbstractSearch[StateT],
    objective: Objective,
    starts: FloatArray,
    progress: Progress = silent,
    state: StateT | None = None,
) -> tuple[StateT, SearchOutcome]:
    """Search until it ends.

    Parameters
    ----------
    search
        How.
    objective
        What to minimise, with its box.
    starts
        Where to start, shape (n,) or (n, count).
    progress
        Called after every step.
    state
        Where to go on; None begins anew.

    Returns
    -------
    tuple[StateT, SearchOutcome]
        The last state, and why it is the last.

    Examples
    --------
    >>> import numpy as np
    >>> from bondgraph.estimate.solvers.differential_evolution import Shade
    >>> class Bowl:
    ...     lower, upper = np.full(2, -5.0), np.full(2, 5.0)
    ...     def nll(self, points):
    ...         return ((points - 1.0) ** 2).sum(axis=0)
    >>> search = Shade(evaluations=2000, tolerance=1e-9)
    >>> state, outcome = search_to_end(search, Bowl(), np.zeros(2))
    >>> search.result(state).best.round(3).tolist(), outcome.name
    ([1.0, 1.0], 'STALLED')
    """
    if state is None:
        state = search.init(objective, starts.reshape(objective.lower.size, -1))
        progress(state.trace[-1])
    while (outcome := search.ended(state)) is None:
        state = search.step(objective, state)
        progress(state.trace[-1])
    return state, outcome
