"""Estimate: a global search that hands over to a gradient search, then how well the result is known."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from bondgraph.errors import OptionError, suggest
from bondgraph.estimate.certify import (
    Certification,
    Check,
    Depth,
    check,
    finer_problems,
    planned_again,
    rounding,
    steps_of,
)
from bondgraph.estimate.checkpoint import Checkpoint, load_checkpoint, problem_digest, save_checkpoint
from bondgraph.estimate.continuation import ON_THE_WAY, Continuation, Stage, way
from bondgraph.estimate.described import Found, describe
from bondgraph.estimate.exact import derivatives
from bondgraph.estimate.gauss_newton import (
    GaussNewtonSettings,
    GaussNewtonState,
    finish_starts,
    gauss_newton,
    initial_starts,
    starts_ended,
    step_starts,
)
from bondgraph.estimate.handover import (
    distinct_starts,
    is_shortened,
    spread_starts,
    swarm_search,
    swarm_starts,
    whole_points,
)
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.objective import (
    Expand,
    FloatArray,
    Progress,
    SearchOutcome,
    TraceRow,
    silent,
)
from bondgraph.estimate.particle_swarm import SwarmSettings, SwarmState, initial_swarm, step_swarm, swarm_ended
from bondgraph.estimate.race import race_ends, raced
from bondgraph.estimate.result import Estimate
from bondgraph.filter.choice import choose_method

Method = Literal["both", "pso", "gradient"]

#: How often a search goes on with finer integration steps.
_MOST_REFINEMENTS = 4

#: Searches on the way of a continuation are kept under this name and their number.
_ON_THE_WAY = "continuation "


@dataclass(frozen=True)
class Settings:
    """Settings of an estimation.

    Parameters
    ----------
    method
        ``"both"``: a short swarm over all but the levels of noise, whose best distinct particles and the declared start
        begin gradient searches; ``"pso"``: the swarm alone, over everything; ``"gradient"``: gradient searches from the
        declared start and from points spread over the bounds.
    seed
        The same seed gives the same estimate, on any number of threads.
    starts
        Gradient searches at once. One that comes to where a better one has been, or falls behind by more than it can
        make up, is ended (:mod:`bondgraph.estimate.race`).
    certify
        How the result is looked at again with finer integration steps, see :mod:`bondgraph.estimate.certify`; where it
        would move by more than a tenth of a standard deviation, a gradient search goes on with the finer steps.
    continuation
        ``"process-noise"``: gradient searches first go through filters with more process noise, for starts so far away
        that the likelihood is rugged there, see :mod:`bondgraph.estimate.continuation`.
    swarm, gradient
        Settings of the two searches. None: a swarm as large as the coordinates it searches need, which with ``"both"``
        only has to find the right valleys (:mod:`bondgraph.estimate.handover`).
    """

    method: Method = "both"
    seed: int = 0
    starts: int = 4
    certify: Depth = "step"
    continuation: Continuation = "none"
    swarm: SwarmSettings | None = None
    gradient: GaussNewtonSettings = field(
        default_factory=lambda: GaussNewtonSettings(tolerance=1e-6, patience=4, least_gain=1e-4)
    )

    def __post_init__(self) -> None:
        for name, known in (("method", Method), ("certify", Depth), ("continuation", Continuation)):
            value, choices = getattr(self, name), get_args(known)
            if value not in choices:
                raise OptionError(
                    f"estimate: {name} {value!r} is not known{suggest(value, choices)} - choose {', '.join(choices)}",
                    where=(name, value),
                )
        if self.continuation != "none" and self.method == "pso":
            raise OptionError(
                f"estimate: continuation {self.continuation!r} leads gradient searches, a swarm alone has none"
                " - choose the method both or gradient",
                where=("continuation", self.continuation),
            )
        if self.starts < 1:
            raise OptionError(f"estimate: starts = {self.starts} must be at least 1", where=("starts",))


@dataclass
class _Run:
    """What changes while an estimation runs."""

    problem: Problem
    settings: Settings
    progress: Progress
    folder: Path | None
    digest: str
    jacobian: Expand
    states: dict[str, SwarmState | GaussNewtonState]
    started: float
    way: tuple[Stage, ...] = ()
    asked: int = 0

    @cached_property
    def swarm_search(self) -> tuple[Problem, SwarmSettings]:
        """What the swarm searches, and how."""
        return swarm_search(self.problem, self.settings.swarm, self.settings.method == "pso")

    @property
    def swarmed(self) -> Problem:
        """What the swarm searches."""
        return self.swarm_search[0]

    @property
    def seconds(self) -> float:
        """Time spent, with that before an interruption."""
        return time.perf_counter() - self.started

    def keep(self, stage: str, state: SwarmState | GaussNewtonState) -> None:
        """Note a new state, on disk too, and tell."""
        self.states[stage] = state
        if self.folder is not None:
            save_checkpoint(self.folder, Checkpoint(self.digest, self.seconds, self.states))
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
        if stage == "swarm":
            point = tuple(whole_points(self.problem, self.swarmed, np.array(point)[:, np.newaxis])[:, 0].tolist())
            stage = "swarm on the beginnings of the logs" if is_shortened(self.problem, self.swarmed) else "swarm"
        return replace(row, stage=stage, point=point, evaluations=row.evaluations + before)


def estimate(
    problem: Problem,
    settings: Settings | None = None,
    *,
    progress: Progress = silent,
    folder: Path | None = None,
    resume: bool = False,
    jacobian: Expand = derivatives,
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
        Where the state of the search is kept after every iteration; None keeps nothing.
    resume
        Continue from the state in ``folder``, if there is one; the result is that of an uninterrupted search.
    jacobian
        Gradient and Fisher information for the gradient search; by default exact derivatives of the filter where the
        search is long, central differences where it is short, see :mod:`bondgraph.estimate.exact`.

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
    run = _Run(problem, settings, progress, folder, digest, jacobian, states, started)
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
            found = describe(problem, _continued(found, state), run.jacobian, lambda: run.seconds)
        except KeyboardInterrupt:
            break  # what was found with the steps before is an estimate, and says that it is not certified
    return replace(found, outcome=SearchOutcome.ILL_CONDITIONED) if found.certification.is_ill_conditioned else found


def _checks(found: Estimate, run: _Run) -> list[tuple[Problem, Check]]:
    """What finer filters would change, each with the problem that has them."""
    depth = run.settings.certify
    if depth == "none" or found.outcome is SearchOutcome.INTERRUPTED or not np.isfinite(found.nll):
        return []
    run.tell("certification", found)
    finer = finer_problems(found.problem, found.point, depth)
    spread, converged = found.coordinate_covariance, found.outcome.succeeded
    return [(one, check(found.problem, found.point, spread, one, run.jacobian, converged=converged)) for one in finer]


def _continued(before: Estimate, state: GaussNewtonState) -> Found:
    """The end of a search that went on from an estimate."""
    rows = tuple(replace(row, evaluations=row.evaluations + before.evaluations) for row in state.trace)
    return Found(
        state.points[:, 0],
        float(state.values[0]),
        state.outcomes[0] or SearchOutcome.ITERATION_LIMIT,
        before.evaluations + state.evaluations,
        before.trace + rows,
        ((state.points[:, 0], float(state.values[0])),),
        state.steps[:, 0],
        before.way,
        before.abandoned,
    )


def _search(run: _Run) -> Found:
    """Both stages; Ctrl-C ends them with what is best so far."""
    outcome = SearchOutcome.INTERRUPTED
    try:
        if run.settings.method != "gradient":
            outcome = _swarm(run)
        if run.settings.method != "pso" and outcome is not SearchOutcome.NO_FINITE_POINT:
            outcome = _gradient(run)
    except KeyboardInterrupt:
        outcome = SearchOutcome.INTERRUPTED
    return _found(run, outcome)


def _swarm(run: _Run) -> SearchOutcome:
    (part, settings), seed = run.swarm_search, run.settings.seed
    state = run.states.get("swarm")
    if not isinstance(state, SwarmState):
        state = initial_swarm(part, part.start, settings, seed)
        run.keep("swarm", state)
    while (outcome := swarm_ended(state, settings)) is None:
        state = step_swarm(part, state, settings, seed)
        run.keep("swarm", state)
    return outcome


def _gradient(run: _Run) -> SearchOutcome:
    swarm, count = run.states.get("swarm"), run.settings.starts
    if isinstance(swarm, SwarmState):
        points = whole_points(run.problem, run.swarmed, swarm.personal_best)
        starts = swarm_starts(run.problem, points, swarm.personal_best_nll, count)
    else:
        starts = spread_starts(run.problem, count, run.settings.seed)
    if run.settings.continuation != "none":
        starts = _nearer(run, starts)
    ended = finish_starts(_stage(run, "gauss-newton", run.problem, starts, run.settings.gradient))
    return ended.outcomes[ended.best] or SearchOutcome.ITERATION_LIMIT


def _stage(
    run: _Run, name: str, problem: Problem, starts: FloatArray, settings: GaussNewtonSettings
) -> GaussNewtonState:
    """A gradient search to its end, from where it was kept if it was."""
    state = run.states.get(name)
    if not isinstance(state, GaussNewtonState):
        state = initial_starts(problem, starts, settings)
        run.keep(name, state)
    while not starts_ended(state, settings):
        state = raced(problem, step_starts(problem, state, settings, run.jacobian))
        run.keep(name, state)
    return state


def _nearer(run: _Run, starts: FloatArray) -> FloatArray:
    """Starts carried towards the optimum through less and less process noise, shape (n, up to starts)."""
    route, scale = way(run.problem), float("inf")
    while True:
        scale, asked = route.next_scale(starts, scale)
        run.asked += asked
        if scale == 0.0:
            return starts
        state = _stage(run, f"{_ON_THE_WAY}{len(run.way) + 1}", route.at(scale), starts, ON_THE_WAY)
        run.way += (route.stage(scale, state),)
        starts = distinct_starts(run.problem, state.points, state.values, run.settings.starts)
        if not starts.size:
            return state.points


def _found(run: _Run, outcome: SearchOutcome) -> Found:
    """The best point of all stages, and every end of a gradient search."""
    swarm, gradient = run.states.get("swarm"), run.states.get("gauss-newton")
    trace: tuple[TraceRow, ...] = ()
    points, values = [run.problem.start], [float("inf")]
    ends: list[tuple[FloatArray, float]] = []
    evaluations = run.asked + sum(state.evaluations for state in _on_the_way(run))
    if isinstance(swarm, SwarmState):
        trace = tuple(run.row("swarm", row, evaluations) for row in swarm.trace)
        evaluations += swarm.evaluations
        points.append(whole_points(run.problem, run.swarmed, swarm.swarm_best[:, np.newaxis])[:, 0])
        shortened = is_shortened(run.problem, run.swarmed)
        values.append(float(run.problem.nll(points[-1][:, np.newaxis])[0]) if shortened else swarm.swarm_best_nll)
    if isinstance(gradient, GaussNewtonState):
        trace += tuple(run.row("gauss-newton", row, evaluations) for row in gradient.trace)
        evaluations += gradient.evaluations
        points.append(gradient.points[:, gradient.best])
        values.append(float(gradient.values.min()))
        ends = [*race_ends(run.problem, gradient)]
    elif _on_the_way(run):
        nearest = _on_the_way(run)[-1]
        points.append(nearest.points[:, nearest.best])
        values.append(float(run.problem.nll(points[-1][:, np.newaxis])[0]))
    # Equal values: the later stage counts.
    best = len(values) - 1 - int(np.argmin(values[::-1]))
    steps = gradient.steps[:, gradient.best] if isinstance(gradient, GaussNewtonState) else None
    abandoned = swarm.abandoned if isinstance(swarm, SwarmState) else 0
    return Found(points[best], values[best], outcome, evaluations, trace, tuple(ends), steps, run.way, abandoned)


def _on_the_way(run: _Run) -> list[GaussNewtonState]:
    """Searches with more process noise, in order."""
    named = [state for name, state in run.states.items() if name.startswith(_ON_THE_WAY)]
    return [state for state in named if isinstance(state, GaussNewtonState)]
