"""Estimate: a global search that hands over to a gradient search, then how well the result is known."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from bondgraph.errors import OptionError, suggest
from bondgraph.estimate.certify import Certification, Depth, check, finer_filters
from bondgraph.estimate.checkpoint import Checkpoint, load_checkpoint, problem_digest, save_checkpoint
from bondgraph.estimate.continuation import ON_THE_WAY, Continuation, Stage, way
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
from bondgraph.estimate.objective import (
    Expand,
    FloatArray,
    Progress,
    SearchOutcome,
    TraceRow,
    silent,
)
from bondgraph.estimate.particle_swarm import SwarmSettings, SwarmState, initial_swarm, step_swarm, swarm_ended
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.result import Estimate, Found, describe
from bondgraph.filter.choice import choose_method

Method = Literal["both", "pso", "gradient"]

#: How often a search goes on with finer integration steps.
_MOST_REFINEMENTS = 4

#: Searches on the way of a continuation are kept under this name and their number.
_ON_THE_WAY = "continuation "

#: Points closer than this share of the bounds in every coordinate count as one start.
_DISTINCT = 0.02


@dataclass(frozen=True)
class Settings:
    """Settings of an estimation.

    Parameters
    ----------
    method
        ``"both"``: a short swarm, whose best distinct particles start gradient searches; ``"pso"``: the swarm alone;
        ``"gradient"``: gradient searches from the declared start and from points spread over the bounds.
    seed
        The same seed gives the same estimate, on any number of threads.
    starts
        Gradient searches at once.
    certify
        How the result is looked at again with finer integration steps, see :mod:`bondgraph.estimate.certify`; where it
        would move by more than a tenth of a standard deviation, a gradient search goes on with the finer steps.
    continuation
        ``"process-noise"``: gradient searches first go through filters with more process noise, for starts so far away
        that the likelihood is rugged there, see :mod:`bondgraph.estimate.continuation`.
    swarm, gradient
        Settings of the two searches. With ``"both"`` the swarm only needs to find the right valleys.
    """

    method: Method = "both"
    seed: int = 0
    starts: int = 4
    certify: Depth = "step"
    continuation: Continuation = "none"
    swarm: SwarmSettings = field(default_factory=lambda: SwarmSettings(iterations=30, patience=10, tolerance=1.0))
    gradient: GaussNewtonSettings = field(default_factory=GaussNewtonSettings)

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise OptionError(
                f"estimate: method {self.method!r} is not known{suggest(self.method, get_args(Method))}"
                f" - choose {', '.join(get_args(Method))}",
                where=("method", self.method),
            )
        if self.certify not in get_args(Depth):
            raise OptionError(
                f"estimate: certify {self.certify!r} is not known - choose {', '.join(get_args(Depth))}",
                where=("certify", self.certify),
            )
        if self.continuation not in get_args(Continuation):
            raise OptionError(
                f"estimate: continuation {self.continuation!r} is not known - choose "
                f"{', '.join(get_args(Continuation))}",
                where=("continuation", self.continuation),
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

    problem: EstimationProblem
    settings: Settings
    progress: Progress
    folder: Path | None
    digest: str
    jacobian: Expand
    states: dict[str, SwarmState | GaussNewtonState]
    started: float
    way: tuple[Stage, ...] = ()
    asked: int = 0

    @property
    def seconds(self) -> float:
        """Time spent, with that before an interruption."""
        return time.perf_counter() - self.started

    def keep(self, stage: str, state: SwarmState | GaussNewtonState) -> None:
        """Note a new state, on disk too, and tell."""
        self.states[stage] = state
        if self.folder is not None:
            save_checkpoint(self.folder, Checkpoint(self.digest, self.seconds, self.states))
        self.progress(replace(state.trace[-1], stage=stage))


def estimate(
    problem: EstimationProblem,
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
    return _certified(describe(problem, _search(run), jacobian, lambda: run.seconds), run)


def _certified(found: Estimate, run: _Run) -> Estimate:
    """The estimate with its certification, after going on with finer steps as often as these move it."""
    depth, limit = run.settings.certify, run.settings.gradient
    for continued in range(_MOST_REFINEMENTS + 1):
        used = choose_method(found.problem.filter_model, found.problem.logs)  # finer steps are finer than decided ones
        found = replace(found, problem=replace(found.problem, filter_model=used))
        asked = found.outcome.succeeded and depth != "none"
        filters = list(finer_filters(found.problem, found.point, depth)) if asked else []
        spread = found.coordinate_covariance
        try:
            checks = tuple(check(found.problem, found.point, spread, finer, run.jacobian) for finer in filters)
        except KeyboardInterrupt:
            checks = ()
        certification = Certification(used.method, used.typical_substeps, checks, continued)
        found = replace(found, certification=certification, seconds=run.seconds)
        if not checks or certification.certified or continued == _MOST_REFINEMENTS:
            break
        worst = max(range(len(checks)), key=lambda index: checks[index].shift)
        problem = replace(found.problem, filter_model=filters[worst])
        state = gauss_newton(problem, found.point, limit, run.progress, run.jacobian)
        found = describe(problem, _continued(found, state), run.jacobian, lambda: run.seconds)
    return found


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
    settings, seed = run.settings.swarm, run.settings.seed
    state = run.states.get("swarm")
    if not isinstance(state, SwarmState):
        state = initial_swarm(run.problem, run.problem.start, settings, seed)
        run.keep("swarm", state)
    while (outcome := swarm_ended(state, settings)) is None:
        state = step_swarm(run.problem, state, settings, seed)
        run.keep("swarm", state)
    return outcome


def _gradient(run: _Run) -> SearchOutcome:
    swarm = run.states.get("swarm")
    starts = (
        distinct_starts(run.problem, swarm.personal_best, swarm.personal_best_nll, run.settings.starts)
        if isinstance(swarm, SwarmState)
        else spread_starts(run.problem, run.settings.starts, run.settings.seed)
    )
    if run.settings.continuation != "none":
        starts = _nearer(run, starts)
    ended = finish_starts(_stage(run, "gauss-newton", run.problem, starts, run.settings.gradient))
    return ended.outcomes[ended.best] or SearchOutcome.ITERATION_LIMIT


def _stage(
    run: _Run, name: str, problem: EstimationProblem, starts: FloatArray, settings: GaussNewtonSettings
) -> GaussNewtonState:
    """A gradient search to its end, from where it was kept if it was."""
    state = run.states.get(name)
    if not isinstance(state, GaussNewtonState):
        state = initial_starts(problem, starts, settings)
        run.keep(name, state)
    while not starts_ended(state, settings):
        state = step_starts(problem, state, settings, run.jacobian)
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


def spread_starts(problem: EstimationProblem, count: int, seed: int) -> FloatArray:
    """The declared start and a Latin hypercube over the bounds, shape (n, count)."""
    rng = np.random.default_rng([seed, 1])
    others = max(count - 1, 1)
    strata = np.array([rng.permutation(others) for _ in problem.free])
    shares = (strata + rng.random(strata.shape)) / others
    spread = problem.lower[:, np.newaxis] + (problem.upper - problem.lower)[:, np.newaxis] * shares
    return np.concatenate([problem.start[:, np.newaxis], spread], axis=1)[:, :count]


def distinct_starts(problem: EstimationProblem, points: FloatArray, values: FloatArray, count: int) -> FloatArray:
    """The best of points (n, members) with finite values (members,), none near a better one; shape (n, up to count)."""
    width = problem.upper - problem.lower
    chosen: list[FloatArray] = []
    for member in np.argsort(values, kind="stable"):
        point = points[:, member]
        near = (bool(np.all(np.abs(point - other) < _DISTINCT * width)) for other in chosen)
        if np.isfinite(values[member]) and not any(near):
            chosen.append(point)
        if len(chosen) == count:
            break
    return np.array(chosen).T


def _found(run: _Run, outcome: SearchOutcome) -> Found:
    """The best point of all stages, and every end of a gradient search."""
    swarm, gradient = run.states.get("swarm"), run.states.get("gauss-newton")
    trace: tuple[TraceRow, ...] = ()
    points, values = [run.problem.start], [float("inf")]
    ends: list[tuple[FloatArray, float]] = []
    evaluations = run.asked + sum(state.evaluations for state in _on_the_way(run))
    if isinstance(swarm, SwarmState):
        trace, evaluations = swarm.trace, evaluations + swarm.evaluations
        points.append(swarm.swarm_best)
        values.append(swarm.swarm_best_nll)
    if isinstance(gradient, GaussNewtonState):
        before = evaluations
        trace += tuple(replace(row, evaluations=row.evaluations + before) for row in gradient.trace)
        evaluations += gradient.evaluations
        points.append(gradient.points[:, gradient.best])
        values.append(float(gradient.values.min()))
        ends = [(gradient.points[:, k], float(value)) for k, value in enumerate(gradient.values) if np.isfinite(value)]
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
    return [
        state
        for name, state in run.states.items()
        if name.startswith(_ON_THE_WAY) and isinstance(state, GaussNewtonState)
    ]
