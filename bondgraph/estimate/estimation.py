"""Estimate: a global search that hands over to a gradient search, then how well the result is known."""

from __future__ import annotations

import time
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np

from bondgraph.errors import OptionError
from bondgraph.estimate.certify import (
    Certification,
    Check,
    check,
    finer_problems,
    planned_again,
    rounding,
    steps_of,
)
from bondgraph.estimate.checkpoint import Kept, load_checkpoint, problem_digest
from bondgraph.estimate.continuation import ON_THE_WAY, Stage, way
from bondgraph.estimate.deepening import deeper_search
from bondgraph.estimate.derivatives.exact import derivatives, repays_exact
from bondgraph.estimate.derivatives.linearised import is_linearised
from bondgraph.estimate.described import Found, describe, found_after
from bondgraph.estimate.handover import (
    distinct_starts,
    is_shortened,
    spread_starts,
    swarm_starts,
    whole_points,
)
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.objective import Expand, FloatArray, Progress, SearchOutcome, TraceRow, silent
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.result import Estimate
from bondgraph.estimate.settings import Settings as Settings
from bondgraph.estimate.solvers.abstract import AbstractSearch, SearchResult, SearchState, StateT
from bondgraph.estimate.solvers.gauss_newton import GaussNewton, GaussNewtonState, gauss_newton
from bondgraph.estimate.solvers.linearised import LinearisedScoring, LinearisedState
from bondgraph.estimate.solvers.race import race_ends, raced
from bondgraph.estimate.spread import spread, spread_expand
from bondgraph.filter.choice import choose_method

#: How often a search goes on with finer integration steps.
_MOST_REFINEMENTS = 4

#: States are kept under these names.
_EXPLORING, _REFINING = "swarm", "gauss-newton"
_DEEPER, _AGAIN = "differential evolution", "gauss-newton from there"

#: Most steps along the linearised filter, which cost as much as three by exact derivatives: of two starts on a vehicle
#: one was near after fifteen, and the other crept for as long as it was let.
_APPROACH = 20

#: Searches on the way of a continuation, and those along the linearised filter, are kept under these and their number.
_ON_THE_WAY, _LINEARISED = "continuation ", "linearised "


@dataclass
class _Run:
    """What changes while an estimation runs."""

    problem: Problem
    settings: Settings
    progress: Progress
    kept: Kept
    jacobian: Expand
    states: dict[str, SearchState]
    started: float
    executor: Executor | None = None
    way: tuple[Stage, ...] = ()
    asked: int = 0

    @cached_property
    def exploring(self) -> tuple[Problem, AbstractSearch[Any]] | None:
        """What is explored and how."""
        return self.settings.exploring(self.problem)

    @property
    def refining(self) -> GaussNewton:
        """The gradient search."""
        return GaussNewton(self.settings.gradient, spread_expand(self.jacobian, self.problem, self.executor), raced)

    @property
    def seconds(self) -> float:
        """Time spent, with that before an interruption."""
        return time.perf_counter() - self.started

    def keep(self, stage: str, state: SearchState) -> None:
        """Note a new state, on disk too, and tell."""
        self.states[stage] = state
        self.kept.keep(self.states, self.seconds)
        before = sum(other.evaluations for name, other in self.states.items() if name != stage)
        self.progress(self.row(stage, state.trace[-1], before))

    def tell(self, stage: str, found: Estimate | Found) -> None:
        """Say what is being done after a search."""
        self.progress(TraceRow(stage, 0, found.evaluations, found.nll, tuple(found.point.tolist())))

    def told_after(self, found: Estimate) -> Progress:
        """Progress of a search that goes on from an estimate."""
        return lambda row: self.progress(
            replace(row, stage="gauss-newton, other steps", evaluations=row.evaluations + found.evaluations)
        )

    def row(self, stage: str, row: TraceRow, before: int) -> TraceRow:
        """A row of a stage with all coordinates of the problem, and evaluations counted from the first stage."""
        point = row.point
        if stage == _EXPLORING and self.exploring is not None:
            part, search = self.exploring
            point = tuple(whole_points(self.problem, part, np.array(point)[:, np.newaxis])[:, 0].tolist())
            stage = (
                f"{search.stage} on the beginnings of the logs" if is_shortened(self.problem, part) else search.stage
            )
        elif stage.startswith(_LINEARISED):
            several = self.settings.starts > 1
            stage = row.stage + (f" from start {stage.removeprefix(_LINEARISED)}" if several else "")
        return replace(row, stage=stage, point=point, evaluations=row.evaluations + before)


def estimate(
    problem: Problem,
    settings: Settings | None = None,
    *,
    progress: Progress = silent,
    folder: Path | None = None,
    resume: bool = False,
    jacobian: Expand = derivatives,
    executor: Executor | None = None,
) -> Estimate:
    """Estimate the free parameters of a problem.

    Parameters
    ----------
    problem
        What is free, and the logs.
    settings
        Method, seed and stop rules.
    progress
        Called after every iteration. An interruption (Ctrl-C) ends the search with the best point so far.
    folder
        Where the state of the search is kept as it goes on; None keeps nothing.
    resume
        Continue from the state in ``folder``, if there is one; the result is that of an uninterrupted search.
    jacobian
        Gradient and Fisher information for the gradient search; by default exact derivatives of the filter where the
        search is long, central differences where it is short, see :mod:`bondgraph.estimate.derivatives.exact`.
    executor
        Whose workers evaluate members and starts, see :mod:`bondgraph.execute`; it changes no number. None: threads
        of this process do.

    Returns
    -------
    Estimate
        With its outcome; a search that fails is a value, not an exception.

    Raises
    ------
    OptionError
        If ``resume`` is asked for without a folder.
    EstimationError
        If the folder holds the state of another estimation.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(100) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> fit = estimate(pose(swing, log, ["length"]), Settings(method="gradient", starts=1))
    >>> fit.outcome.name, round(fit.values["length"], 1)
    ('CONVERGED', 1.0)
    """
    settings = settings or Settings()
    if resume and folder is None:
        raise OptionError(
            "estimate: resume needs the folder in which the interrupted search was kept", where=("resume",)
        )
    # Only searches by the default derivatives can be repeated from what a digest knows.
    digest = problem_digest(problem, {"settings": settings, "derivatives": jacobian is derivatives})
    found = load_checkpoint(folder, digest) if resume and folder is not None else None
    states = dict(found.states) if found is not None else {}
    started = time.perf_counter() - (found.seconds if found is not None else 0.0)
    run = _Run(problem, settings, progress, Kept(folder, digest), jacobian, states, started, executor)
    return _certified(_described(_search(run), run), run)


def _described(best: Found, run: _Run) -> Estimate:
    """The estimate with its uncertainty; an interruption leaves the quickest."""
    try:
        if best.outcome is not SearchOutcome.INTERRUPTED:
            run.tell("uncertainty", best)
        return describe(run.problem, best, run.jacobian, lambda: run.seconds)
    except KeyboardInterrupt:
        interrupted = replace(best, outcome=SearchOutcome.INTERRUPTED)
        return describe(run.problem, interrupted, run.jacobian, lambda: run.seconds)


def _certified(found: Estimate, run: _Run) -> Estimate:
    """The estimate with its certification, after going on with other steps as often as finer ones move it."""
    for continued in range(_MOST_REFINEMENTS + 1):
        # finer steps are finer than decided ones
        used = [choose_method(part.filter_model, part.logs) for part in found.problem.parts]
        planned = any(one.plan is not None for one in used)
        found = replace(found, problem=found.problem.with_filters(used))
        try:
            checks = _checks(found, run)
            moved = rounding(found.problem, found.point) if checks else None
        except KeyboardInterrupt:
            checks, moved = [], None
        seen = tuple(seen for _, seen in checks)
        certification = Certification(*steps_of(found.problem), seen, continued, moved)
        found = replace(found, certification=certification, seconds=run.seconds)
        # A search that does not get on may have outrun the steps that were planned for its start.
        stuck = found.outcome is SearchOutcome.NO_PROGRESS and planned and continued == 0
        stuck = stuck or certification.is_ill_conditioned
        done = certification.certified if found.outcome.succeeded else not stuck
        if not checks or done or continued == _MOST_REFINEMENTS:
            break
        problem, worst = max(checks, key=lambda pair: pair[1].shift)
        if continued == 0 and planned and worst.method == certification.method:
            problem = planned_again(found.problem, found.point)
        try:
            state = gauss_newton(problem, found.point, run.settings.gradient, run.told_after(found), run.jacobian)
            found = describe(problem, found_after(found, state), run.jacobian, lambda: run.seconds)
        except KeyboardInterrupt:
            break  # what was found with the steps before is an estimate, and says that it is not certified
    if found.certification.is_ill_conditioned:  # rounding errors in derivatives would pass for certainty
        found = replace(found, outcome=SearchOutcome.ILL_CONDITIONED, covariance=np.nan * found.covariance)
    return found


def _checks(found: Estimate, run: _Run) -> list[tuple[Problem, Check]]:
    """What finer filters would change, each with the problem that has them."""
    depth = run.settings.certify
    if depth == "none" or found.outcome is SearchOutcome.INTERRUPTED or not np.isfinite(found.nll):
        return []
    run.tell("certification", found)
    finer = finer_problems(found.problem, found.point, depth)
    spread, converged = found.coordinate_covariance, found.outcome.succeeded
    return [(one, check(found.problem, found.point, spread, one, run.jacobian, converged=converged)) for one in finer]


def _search(run: _Run) -> Found:
    """All stages; Ctrl-C ends them with what is best so far."""
    outcome = SearchOutcome.INTERRUPTED
    try:
        if run.exploring is not None:
            part, search = run.exploring
            outcome = _search_on(run, _EXPLORING, search, part, part.start[:, np.newaxis])[1]
        if run.settings.refines and outcome is not SearchOutcome.NO_FINITE_POINT:
            state, outcome = _search_on(run, _REFINING, run.refining, run.problem, _starts(run))
            outcome = _deepened(run, state) or outcome
    except KeyboardInterrupt:
        outcome = SearchOutcome.INTERRUPTED
    run.kept.write(run.states, run.seconds)
    return _found(run, outcome)


def _deepened(run: _Run, state: GaussNewtonState) -> SearchOutcome | None:
    """How a second exploration and its gradient search ended, None where there was none."""
    if not run.settings.deepens:
        return None
    spent = sum(other.evaluations for name, other in run.states.items() if name not in (_DEEPER, _AGAIN))
    search = deeper_search(run.problem, state, spent, run.settings.seed)
    if search is None:
        return None
    deeper, _ = _search_on(run, _DEEPER, search, run.problem, state.points[:, [state.best]])
    return _search_on(run, _AGAIN, run.refining, run.problem, search.result(deeper).best[:, np.newaxis])[1]


def _starts(run: _Run) -> FloatArray:
    """Where gradient searches start: from what was explored, or spread over the bounds, and then as near as it gets."""
    seen, count = _explored(run), run.settings.starts
    if seen is None:
        starts = spread_starts(run.problem, count, run.settings.seed)
    else:
        starts = swarm_starts(run.problem, seen.points, seen.values, count)
    return _nearer(run, starts) if run.settings.continuation != "none" else _linearised(run, starts)


def _explored(run: _Run) -> SearchResult | None:
    """What was explored so far, at coordinates of the whole problem."""
    state = run.states.get(_EXPLORING)
    if state is None or run.exploring is None:
        return None
    part, search = run.exploring
    found = search.result(state)
    return replace(found, points=whole_points(run.problem, part, found.points))


def _search_on(
    run: _Run, name: str, search: AbstractSearch[StateT], problem: Problem, starts: FloatArray
) -> tuple[StateT, SearchOutcome]:
    """A search to its end, from where it was kept if it was."""
    objective, state = spread(problem, run.executor), cast("StateT | None", run.states.get(name))
    if state is None:
        state = search.init(objective, starts)
        run.keep(name, state)
    while (outcome := search.ended(state)) is None:
        state = search.step(objective, state)
        run.keep(name, state)
    return state, outcome


def _nearer(run: _Run, starts: FloatArray) -> FloatArray:
    """Starts carried towards the optimum through less and less process noise, shape (n, up to starts)."""
    route, scale = way(run.problem), float("inf")
    while True:
        scale, asked = route.next_scale(starts, scale)
        run.asked += asked
        if scale == 0.0:
            return starts
        there = route.at(scale)
        search = GaussNewton(ON_THE_WAY, spread_expand(run.jacobian, there, run.executor), raced)
        state, _ = _search_on(run, f"{_ON_THE_WAY}{len(run.way) + 1}", search, there, starts)
        run.way += (route.stage(scale, state),)
        starts = distinct_starts(run.problem, state.points, state.values, run.settings.starts)
        if not starts.size:
            return state.points


def _linearised(run: _Run, starts: FloatArray) -> FloatArray:
    """Where searches along the linearised filter of a stiff model lead from starts, shape (n, up to starts).

    Its derivatives cost two values of the likelihood and are right to some percent: they lead near an optimum, which
    the search by exact derivatives then finds. A start that cannot overtake a better one ends here.
    """
    if _REFINING in run.states:  # whoever goes on has these behind
        return starts
    problem = run.problem.with_filters([choose_method(part.filter_model, part.logs) for part in run.problem.parts])
    if not (isinstance(problem, EstimationProblem) and is_linearised(problem) and repays_exact(problem)):
        return starts
    ends: list[LinearisedState] = []
    for k, start in enumerate(starts.T):
        best = min((end.value for end in ends), default=np.inf)
        search = LinearisedScoring(iterations=_APPROACH, beat=best)
        ends.append(_search_on(run, f"{_LINEARISED}{k + 1}", search, problem, start[:, np.newaxis])[0])
    going = [end for end in ends if SearchOutcome.GIVEN_UP not in end.outcomes]
    points, values = np.array([end.point for end in going]).T, np.array([end.value for end in going])
    found = distinct_starts(problem, points, values, run.settings.starts)
    return found if found.size else starts


def _found(run: _Run, outcome: SearchOutcome) -> Found:
    """The best point of all stages, and every end of a gradient search."""
    seen, gradient = _explored(run), run.states.get(_AGAIN, run.states.get(_REFINING))
    trace: tuple[TraceRow, ...] = ()
    points, values = [run.problem.start], [float("inf")]
    ends: list[tuple[FloatArray, float]] = []
    evaluations = run.asked + sum(state.evaluations for state in _on_the_way(run))
    if seen is not None and run.exploring is not None:
        state = run.states[_EXPLORING]
        trace = tuple(run.row(_EXPLORING, row, evaluations) for row in state.trace)
        evaluations += state.evaluations
        points.append(seen.best)
        shortened = is_shortened(run.problem, run.exploring[0])
        values.append(float(run.problem.nll(points[-1][:, np.newaxis])[0]) if shortened else seen.best_nll)
    for name, near in _of_type(run, _LINEARISED, LinearisedState):
        trace += tuple(run.row(name, row, evaluations) for row in near.trace)
        evaluations += near.evaluations
        if not isinstance(gradient, GaussNewtonState):
            points.append(near.point)
            values.append(near.value)
    for name in (name for name in (_REFINING, _DEEPER, _AGAIN) if name in run.states):
        later = run.states[name]
        trace += tuple(run.row(name, row, evaluations) for row in later.trace)
        evaluations += later.evaluations
        points.append(np.array(later.trace[-1].point))
        values.append(later.trace[-1].nll)
        ends += race_ends(run.problem, later) if isinstance(later, GaussNewtonState) else ()
    if gradient is None and _on_the_way(run):
        nearest = _on_the_way(run)[-1]
        points.append(nearest.points[:, nearest.best])
        values.append(float(run.problem.nll(points[-1][:, np.newaxis])[0]))
    # Equal values: the later stage counts.
    best = len(values) - 1 - int(np.argmin(values[::-1]))
    steps = gradient.steps[:, gradient.best] if isinstance(gradient, GaussNewtonState) else None
    abandoned = 0 if seen is None else seen.abandoned
    return Found(points[best], values[best], outcome, evaluations, trace, tuple(ends), steps, run.way, abandoned)


def _on_the_way(run: _Run) -> list[GaussNewtonState]:
    """Searches with more process noise, in order."""
    return [state for _, state in _of_type(run, _ON_THE_WAY, GaussNewtonState)]


def _of_type(run: _Run, prefix: str, kind: type[StateT]) -> list[tuple[str, StateT]]:
    """States kept under a name that begins so, in order."""
    return [(name, state) for name, state in run.states.items() if name.startswith(prefix) and isinstance(state, kind)]
