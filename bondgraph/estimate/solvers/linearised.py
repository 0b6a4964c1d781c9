"""Damped scoring steps on the likelihood of a stiff model, each from one run of the filter that serves the next too.

The expansions are those of the filter linearised along itself (:mod:`bondgraph.estimate.derivatives.linearised`): right
to some percent at the cost of two values. So a search with them comes near an optimum soon, and what is left is for
exact derivatives. References: as for :mod:`bondgraph.estimate.solvers.gauss_newton`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from bondgraph.errors import FilterError
from bondgraph.estimate.derivatives.formed import Formed, Scheme
from bondgraph.estimate.derivatives.linearised import filter_runs, kicks_along, linear_expansion, value_of
from bondgraph.estimate.objective import Expansion, FloatArray, Objective, SearchOutcome, TraceRow
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.abstract import AbstractSearch, SearchResult, search_to_end
from bondgraph.estimate.solvers.steps import damped_step, newton_decrement, promised_gain
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.linear.intervals import Kicks

#: Damping of the first step relative to the information, its limits, and by how much it falls and rises.
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING, _DAMP_LESS, _DAMP_MORE = 1e-2, 1e-6, 1e5, 10.0, 30.0
#: It falls where a step gained more than this share of what it promised.
_AS_PROMISED = 0.5
#: No step is worth less than so many nats: what is left is for exact derivatives.
_FINEST = 1.0
#: Nor are more trials for a step that gains, after so many that did not, where the best promises less than this.
_HARDLY, VAIN = 2.0, 3
#: What kicks of the states leave is the costly part. It depends on the parameters and on the course of the states,
#: which measurements hold: it is asked anew once a parameter has moved by more than this share of its bounds, and far
#: from the optimum, where a step promises more than so many nats.
_UNMOVED, _NEAR = 0.01, 50.0
#: Longest steps: of the logarithm of a noise level, and of other coordinates as a share of their bounds. A level of
#: which the data say nothing is else thrown to where they say a lot.
_LONGEST_LEVEL, _LONGEST = 1.5, 0.3
#: A search gives up when it is behind by more than this many times what a step promises or gains.
HOPELESS = 10.0


@dataclass(frozen=True)
class Reached:
    """Where a search ended: the point (n,), its negative log-likelihood and expansion, what it took and gained.

    ``formed``: how and where the derivatives of the expansion were formed.
    """

    point: FloatArray
    nll: float
    expansion: Expansion
    evaluations: int
    outcome: SearchOutcome
    formed: Formed
    gained: float = 0.0


@dataclass(frozen=True)
class LinearisedState:
    """A search after a step: its point (n,) and value, and the point (n,) where kicks of the states were asked last.

    ``idle`` counts steps that gained next to nothing, ``vain`` trials that gained nothing, both in a row.
    """

    iteration: int
    point: FloatArray
    value: float
    kicked: FloatArray
    damping: float
    idle: int
    vain: int
    outcomes: tuple[SearchOutcome | None, ...]
    evaluations: int
    trace: tuple[TraceRow, ...]


@dataclass(frozen=True)
class _Seen:
    """What is known at the point of a state: runs of the filter, what kicks leave, and the expansion."""

    runs: list[FilterRun]
    kicks: list[Kicks]
    expansion: Expansion


@dataclass(frozen=True)
class LinearisedScoring(AbstractSearch[LinearisedState]):
    """Scoring steps from one start.

    Parameters
    ----------
    iterations, tolerance
        Most steps, and how many nats a further one must promise; one nat at least.
    beat, hopeless
        Give up where the value is behind ``beat`` by more than ``hopeless`` times what a step promises or gains.
    """

    iterations: int = 40
    tolerance: float = _FINEST
    beat: float = float("inf")
    hopeless: float = HOPELESS
    # What was found at the last point serves the next step; an interrupted search finds it again.
    _known: dict[tuple[bytes, bytes], _Seen] = field(default_factory=dict, compare=False, repr=False)

    stage: ClassVar[str] = "linearised scoring"

    def init(self, objective: Objective, starts: FloatArray) -> LinearisedState:
        """The first start evaluated."""
        problem = _posed(objective)
        point = np.clip(starts[:, 0], problem.lower, problem.upper)
        runs = filter_runs(problem, point)
        value = value_of(problem, point, runs)
        outcome = None if np.isfinite(value) else SearchOutcome.NO_FINITE_POINT
        state = LinearisedState(0, point, value, point, _DAMPING, 0, 0, (outcome,), 1, ())
        return _traced(state if outcome else self._looked(problem, state, runs))

    def step(self, objective: Objective, state: LinearisedState) -> LinearisedState:
        """One trial, damped more if it gains nothing."""
        problem = _posed(objective)
        point, expansion = state.point, self.expansion(problem, state)
        state = replace(state, iteration=state.iteration + 1)
        if not expansion.is_finite:
            return _traced(replace(state, outcomes=(SearchOutcome.NO_DERIVATIVES,)))
        promise = newton_decrement(problem, point, expansion)
        if promise < max(self.tolerance, _FINEST) or state.idle == 2 or state.damping > _MOST_DAMPING:
            return _traced(replace(state, outcomes=(SearchOutcome.CONVERGED,)))
        longest = longest_steps(problem)
        step = np.clip(damped_step(problem, point, expansion, state.damping) - point, -longest, longest)
        tried = filter_runs(problem, point + step)
        reached = value_of(problem, point + step, tried)
        state = replace(state, evaluations=state.evaluations + 1)
        if not state.value - reached > 0.0:
            done = SearchOutcome.CONVERGED if promise < _HARDLY and state.vain + 1 == VAIN else None
            damping = state.damping if done else state.damping * _DAMP_MORE
            return _traced(replace(state, vain=state.vain + 1, damping=damping, outcomes=(done,)))
        return self._moved(problem, state, step, (reached, tried), promise, promised_gain(expansion, step))

    def _moved(
        self,
        problem: EstimationProblem,
        state: LinearisedState,
        step: FloatArray,
        found: tuple[float, list[FilterRun]],
        promise: float,
        promised: float,
    ) -> LinearisedState:
        """The state after a step that gained something; its ``promise`` is that of a full one."""
        value, runs = found
        gained = state.value - value
        kept = gained / max(promised, gained, 1e-300)
        damping = max(state.damping / _DAMP_LESS, _LEAST_DAMPING) if kept > _AS_PROMISED else state.damping
        idle = state.idle + 1 if gained < max(self.tolerance, _FINEST) else 0
        point = state.point + step
        again = promise > _NEAR or _distance(problem, point, state.kicked) > _UNMOVED
        behind = value - self.beat > self.hopeless * max(gained, promise)
        after = replace(
            state, point=point, value=value, kicked=point if again else state.kicked, damping=damping, idle=idle,
            vain=0, outcomes=(SearchOutcome.GIVEN_UP if behind else None,),
        )  # fmt: skip
        return _traced(self._looked(problem, after, runs, None if again else self._seen(problem, state).kicks))

    def _looked(
        self,
        problem: EstimationProblem,
        state: LinearisedState,
        runs: list[FilterRun],
        kicks: list[Kicks] | None = None,
    ) -> LinearisedState:
        """A state that was looked at; it ends a search where there is nothing to linearise."""
        try:
            self._look(problem, state, runs, kicks)
        except FilterError:
            return replace(state, outcomes=(SearchOutcome.NO_DERIVATIVES,))
        return state

    def expansion(self, problem: EstimationProblem, state: LinearisedState) -> Expansion:
        """The expansion at the point of a state."""
        return self._seen(problem, state).expansion

    def _seen(self, problem: EstimationProblem, state: LinearisedState) -> _Seen:
        known = self._known.get(_key(state))
        if known is not None:
            return known
        kicks = kicks_along(problem, state.kicked, filter_runs(problem, state.kicked))
        return self._look(problem, state, filter_runs(problem, state.point), kicks)

    def _look(
        self,
        problem: EstimationProblem,
        state: LinearisedState,
        runs: list[FilterRun],
        kicks: list[Kicks] | None = None,
    ) -> _Seen:
        """What is known at a state, remembered in place of the last; ``kicks`` None: they are asked there."""
        kicks = kicks_along(problem, state.point, runs) if kicks is None else kicks
        seen = _Seen(runs, kicks, linear_expansion(problem, state.point, runs, kicks))
        self._known.clear()
        self._known[_key(state)] = seen
        return seen

    def ended(self, state: LinearisedState) -> SearchOutcome | None:
        """Why the search ends here, or None if it goes on."""
        limit = SearchOutcome.ITERATION_LIMIT if state.iteration >= self.iterations else None
        return state.outcomes[0] or limit

    def result(self, state: LinearisedState) -> SearchResult:
        """Where the search is."""
        return SearchResult(state.point[:, np.newaxis], np.array([state.value]))


def linear_search(search: LinearisedScoring, problem: EstimationProblem, start: FloatArray) -> Reached:
    """Where a search from a start (n,) ends, with its expansion there.

    Raises
    ------
    FilterError
        If the filter diverges at the start.
    """
    own = replace(search, _known={})  # searches in several threads do not share what they know
    state, outcome = search_to_end(own, problem, start)
    expansion, gained = own.expansion(problem, state), state.trace[0].nll - state.value
    formed = Formed(Scheme.LINEARISED, state.kicked)
    return Reached(state.point, state.value, expansion, state.evaluations, outcome, formed, gained)


def longest_steps(problem: EstimationProblem) -> FloatArray:
    """How far a step may go in each coordinate, shape (n,)."""
    return np.where(problem.noise_levels, _LONGEST_LEVEL, _LONGEST * (problem.upper - problem.lower))


def _distance(problem: EstimationProblem, point: FloatArray, before: FloatArray) -> float:
    """How far parameters are from where they were, at most, as a share of their bounds."""
    share = np.abs(point - before) / (problem.upper - problem.lower)
    return float(share[~problem.noise_levels].max(initial=0.0))


def _posed(objective: Objective) -> EstimationProblem:
    assert isinstance(objective, EstimationProblem)  # no other has a filter to linearise
    return objective


def _key(state: LinearisedState) -> tuple[bytes, bytes]:
    return state.point.tobytes(), state.kicked.tobytes()


def _traced(state: LinearisedState) -> LinearisedState:
    row = TraceRow(
        LinearisedScoring.stage, state.iteration, state.evaluations, state.value, tuple(map(float, state.point))
    )
    return replace(state, trace=(*state.trace, row))
