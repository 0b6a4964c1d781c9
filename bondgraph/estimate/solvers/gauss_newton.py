"""Damped Gauss-Newton (Fisher scoring) on whitened innovations, in a box, from several starts in lockstep.

Each iteration expands the likelihood at every start (gradient and Fisher information, see ``objective``), solves

    (information + damping scale) step = -gradient

for several dampings at once, with coordinates that would leave the box stopped at its wall, and keeps the best trial.
All trials of all starts are one batch. References: Levenberg (1944); Marquardt (1963), SIAM J. 11(2); More (1978), The
Levenberg-Marquardt algorithm; Bertsekas (1982), Projected Newton methods, SIAM J. Control Optim. 20(2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.objective import (
    Expand,
    Expansion,
    FloatArray,
    Objective,
    Progress,
    SearchOutcome,
    TraceRow,
    silent,
)
from bondgraph.estimate.solvers.abstract import AbstractSearch, SearchResult, search_to_end
from bondgraph.estimate.solvers.steps import bent_steps, damped_step, newton_decrement, promised_gain

IntArray = npt.NDArray[np.int64]

#: Dampings tried at once, as multiples of the current one.
_LADDER = (1e-3, 1e-2, 1e-1, 1.0, 10.0)
_MIN_DAMPING, _MAX_DAMPING = 1e-12, 1e13


@dataclass(frozen=True)
class GaussNewtonSettings:
    """Settings of the gradient search.

    Parameters
    ----------
    iterations
        Most iterations.
    tolerance
        A start has converged when a full step promises less than this many nats; 1e-8 is 1.4e-4 standard deviations.
    damping
        Of the first iteration, relative to the diagonal of the information.
    difference
        First difference step, as a share of a coordinate's bounds; later ones are a tenth of its standard deviation
        where that is smaller.
    patience, least_gain
        A start has stalled when it gained less than ``least_gain`` nats in each of ``patience`` iterations one after
        the other; a patience of 0 never stalls. A likelihood with small kinks lets a search creep along them for ever.

    Raises
    ------
    EstimationError
        If a patience or a least gain is negative.
    """

    iterations: int = 100
    tolerance: float = 1e-8
    damping: float = 1e-2
    difference: float = 1e-4
    patience: int = 0
    least_gain: float = 1e-3

    def __post_init__(self) -> None:
        if self.patience < 0 or not self.least_gain >= 0.0:
            raise EstimationError(
                f"gradient search: patience = {self.patience} and least_gain = {self.least_gain} must not be negative",
                where=("patience", "least_gain"),
            )


@dataclass(frozen=True)
class GaussNewtonState:
    """Several starts after an iteration; points and steps are (n, starts), the others (starts,).

    ``idle`` counts the last iterations that gained next to nothing; ``pace`` is the last gain in nats, or half of what
    it was one iteration before if that is more.
    """

    iteration: int
    points: FloatArray
    values: FloatArray
    damping: FloatArray
    steps: FloatArray
    idle: IntArray
    pace: FloatArray
    outcomes: tuple[SearchOutcome | None, ...]
    evaluations: int
    trace: tuple[TraceRow, ...]

    @property
    def best(self) -> int:
        """Which start has the best value."""
        return int(np.argmin(self.values))


@dataclass(frozen=True)
class _Search:
    """One start in one iteration: what is known there, and its trial points (n, trials) with their values (trials,)."""

    start: int
    value: float
    point: FloatArray
    expansion: Expansion
    dampings: FloatArray
    trials: FloatArray
    values: FloatArray

    @property
    def falls_short(self) -> bool:
        """Whether the best trial gains much less than the full step promises, as where the model is curved."""
        best = int(np.argmin(self.values))
        promise = promised_gain(self.expansion, self.trials[:, best] - self.point)
        return self.value - float(self.values[best]) < 0.9 * promise or best > 0


#: Fate of starts that cannot win, asked after every iteration, see :mod:`bondgraph.estimate.solvers.race`.
Race = Callable[[Objective, GaussNewtonState], GaussNewtonState]


@dataclass(frozen=True)
class GaussNewton(AbstractSearch[GaussNewtonState]):
    """Damped Gauss-Newton from several starts in lockstep.

    Parameters
    ----------
    settings
        Stop rules.
    jacobian
        Gradient and Fisher information.
    race
        Ends starts that cannot win; None: every start goes its way.
    """

    settings: GaussNewtonSettings = field(default_factory=GaussNewtonSettings)
    jacobian: Expand = central_differences
    race: Race | None = None

    stage: ClassVar[str] = "gauss-newton"

    def init(self, objective: Objective, starts: FloatArray) -> GaussNewtonState:
        """All starts evaluated."""
        points = np.clip(starts, objective.lower[:, np.newaxis], objective.upper[:, np.newaxis])
        values = _finite_or_inf(objective.nll(points))
        outcomes = tuple(None if np.isfinite(value) else SearchOutcome.NO_FINITE_POINT for value in values)
        widest = self.settings.difference * (objective.upper - objective.lower)
        steps = np.repeat(widest[:, np.newaxis], values.size, axis=1)
        damping = np.full(values.size, self.settings.damping)
        idle = np.zeros(values.size, dtype=np.int64)
        pace = np.full(values.size, np.inf)
        return _traced(GaussNewtonState(0, points, values, damping, steps, idle, pace, outcomes, values.size, ()))

    def step(self, objective: Objective, state: GaussNewtonState) -> GaussNewtonState:
        """One iteration of every start that still moves."""
        moving = [index for index, outcome in enumerate(state.outcomes) if outcome is None]
        expansions = self.jacobian(objective, state.points[:, moving], state.steps[:, moving])
        evaluations = state.evaluations + sum(expansion.evaluations for expansion in expansions)
        outcomes, steps = list(state.outcomes), state.steps.copy()
        searching: list[_Search] = []
        for index, expansion in zip(moving, expansions, strict=True):
            point = state.points[:, index]
            if not expansion.is_finite:
                outcomes[index] = SearchOutcome.NO_DERIVATIVES
                continue
            steps[:, index] = _difference_steps(objective, expansion, self.settings)
            if newton_decrement(objective, point, expansion) < self.settings.tolerance:
                outcomes[index] = SearchOutcome.CONVERGED
                continue
            dampings = state.damping[index] * np.array(_LADDER)
            trials = np.array([damped_step(objective, point, expansion, float(damping)) for damping in dampings]).T
            value = float(state.values[index])
            searching.append(_Search(index, value, point, expansion, dampings, trials, np.empty(0)))
        state = replace(
            state, iteration=state.iteration + 1, steps=steps, outcomes=tuple(outcomes), evaluations=evaluations
        )
        if searching:
            tried, spent = _evaluated(objective, searching)
            moved = _take_best(objective, replace(state, evaluations=evaluations + spent), tried)
            state = _note_idle(state, moved, self.settings)
        state = _traced(state)
        return state if self.race is None else self.race(objective, state)

    def ended(self, state: GaussNewtonState) -> SearchOutcome | None:
        """The outcome of the best start, once no start moves any more."""
        if state.iteration < self.settings.iterations and None in state.outcomes:
            return None
        return finish_starts(state).outcomes[state.best]

    def result(self, state: GaussNewtonState) -> SearchResult:
        """Where every start is."""
        return SearchResult(state.points, state.values)


def _note_idle(before: GaussNewtonState, after: GaussNewtonState, settings: GaussNewtonSettings) -> GaussNewtonState:
    """Count iterations that gained too little; enough of them in a row end a start."""
    with np.errstate(invalid="ignore"):
        gains = before.values - after.values
    pace = np.fmax(gains, np.where(np.isfinite(before.pace), 0.5 * before.pace, 0.0))
    idle = np.where(gains < settings.least_gain, after.idle + 1, 0)
    stalled = (idle >= settings.patience) & (settings.patience > 0)
    outcomes = tuple(
        SearchOutcome.STALLED if outcome is None and stalls else outcome
        for outcome, stalls in zip(after.outcomes, stalled, strict=True)
    )
    return replace(after, idle=idle, pace=pace, outcomes=outcomes)


def _take_best(objective: Objective, state: GaussNewtonState, tried: list[_Search]) -> GaussNewtonState:
    """Of each start keep the best trial if it improves, else damp more."""
    points, values, damping, outcomes = (
        state.points.copy(),
        state.values.copy(),
        state.damping.copy(),
        [*state.outcomes],
    )
    for search in tried:
        index, choice = search.start, int(np.argmin(search.values))
        if search.values[choice] < values[index]:
            points[:, index], values[index] = search.trials[:, choice], search.values[choice]
            damping[index] = max(float(search.dampings[choice % search.dampings.size]), _MIN_DAMPING)
        else:
            damping[index] *= 10.0 / _LADDER[0]
            outcomes[index] = _stuck(objective, search, float(damping[index]))
    return replace(state, points=points, values=values, damping=damping, outcomes=tuple(outcomes))


def _evaluated(objective: Objective, searching: list[_Search]) -> tuple[list[_Search], int]:
    """Values of all trials as one batch, then of trials bent by the curvature these reveal; and their number."""
    trials = np.concatenate([search.trials for search in searching], axis=1)
    if any(search.expansion.terms is None for search in searching):
        found = np.split(_finite_or_inf(objective.nll(trials)), len(searching))
        return [replace(search, values=row) for search, row in zip(searching, found, strict=True)], trials.shape[1]
    terms = objective.terms(trials)
    tried: list[_Search] = []
    bent: dict[int, FloatArray] = {}
    for search, columns in zip(searching, np.split(np.arange(trials.shape[1]), len(searching)), strict=True):
        seen = terms.members(columns)
        tried.append(replace(search, values=search.value + (seen.sums() - search.expansion.sum)))
        if tried[-1].falls_short:
            bent[len(tried) - 1] = bent_steps(
                objective, search.point, search.expansion, search.trials, search.dampings, seen
            )
    if bent:
        values = _finite_or_inf(objective.nll(np.concatenate(list(bent.values()), axis=1)))
        for (k, points), row in zip(bent.items(), np.split(values, len(bent)), strict=True):
            both = np.concatenate([tried[k].trials, points], axis=1)
            tried[k] = replace(tried[k], trials=both, values=np.concatenate([tried[k].values, row]))
    return tried, trials.shape[1] + sum(points.shape[1] for points in bent.values())


def _finite_or_inf(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.inf)


def _stuck(objective: Objective, search: _Search, damping: float) -> SearchOutcome | None:
    """No trial was better: the optimum to rounding, or a likelihood that does not follow its gradient."""
    promise = newton_decrement(objective, search.point, search.expansion)
    if promise < 1e-14 * (1.0 + abs(search.value)):
        return SearchOutcome.CONVERGED
    if damping <= _MAX_DAMPING:
        return None
    return SearchOutcome.CONVERGED if promise < 1e-4 else SearchOutcome.NO_PROGRESS


def _difference_steps(objective: Objective, expansion: Expansion, settings: GaussNewtonSettings) -> FloatArray:
    """A tenth of each coordinate's standard deviation given the others, at most the first step."""
    widest = settings.difference * (objective.upper - objective.lower)
    told = np.maximum(np.diag(expansion.information), 1e-300)
    return np.clip(0.1 / np.sqrt(told), 1e-5 * widest, widest)


def gauss_newton(
    objective: Objective,
    starts: FloatArray,
    settings: GaussNewtonSettings | None = None,
    progress: Progress = silent,
    jacobian: Expand = central_differences,
) -> GaussNewtonState:
    """Search from several starts at once.

    Parameters
    ----------
    objective
        What to minimise, with its box and its scalar terms.
    starts
        Shape (n, starts) or (n,).
    settings
        Stop rules.
    progress
        Called after every iteration.
    jacobian
        Gradient and Fisher information at given points; by default central differences of the innovations.

    Returns
    -------
    GaussNewtonState
        Final points (n, starts) with their values and outcomes.

    Examples
    --------
    >>> from bondgraph.estimate.objective import Terms
    >>> class Rosenbrock:
    ...     lower, upper = np.full(2, -5.0), np.full(2, 5.0)
    ...     def terms(self, points):
    ...         z = np.array([10.0 * (points[1] - points[0] ** 2), 1.0 - points[0]])
    ...         return Terms(z, np.zeros(z.shape))
    ...     def nll(self, points):
    ...         return 0.5 * (self.terms(points).innovations ** 2).sum(axis=0)
    >>> state = gauss_newton(Rosenbrock(), np.array([-1.2, 1.0]))
    >>> state.points[:, state.best].round(4).tolist(), state.outcomes[0].name
    ([1.0, 1.0], 'CONVERGED')
    """
    search = GaussNewton(settings or GaussNewtonSettings(), jacobian)
    return finish_starts(search_to_end(search, objective, starts, progress)[0])


def finish_starts(state: GaussNewtonState, reason: SearchOutcome = SearchOutcome.ITERATION_LIMIT) -> GaussNewtonState:
    """The state with ``reason`` as the outcome of the starts that still moved."""
    return replace(state, outcomes=tuple(reason if outcome is None else outcome for outcome in state.outcomes))


def _traced(state: GaussNewtonState) -> GaussNewtonState:
    point = tuple(float(value) for value in state.points[:, state.best])
    row = TraceRow(GaussNewton.stage, state.iteration, state.evaluations, float(state.values.min()), point)
    return replace(state, trace=(*state.trace, row))
