"""Storages: candidates that bring a state of their own, and so have no zero at which a score could test them.

A storage is tried at several sizes. Towards no size at all (a rigid shaft, a command that is followed at once) it is
the model without it, only stiffer the closer it gets there; sizes that steps do not resolve are left out and named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.correct.fits.excerpts import excerpt
from bondgraph.correct.fits.fit import Fit, expand, fit
from bondgraph.correct.fits.linear_steps import filter_runs, is_linearised, linear_expansion, value_of
from bondgraph.correct.fits.noise_starts import quiet_start
from bondgraph.correct.fits.setup import filter_setup
from bondgraph.correct.models.followers import followers
from bondgraph.correct.refits.decide import judge
from bondgraph.correct.refits.refit import Ground, at_optimum, coefficients
from bondgraph.correct.refits.stiff_entrants import NEARBY, declared_point
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.scores.quiet import Quiet, quiet_starts
from bondgraph.data.log import FloatArray
from bondgraph.estimate.objective import Expansion
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings
from bondgraph.estimate.solvers.steps import newton_decrement
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.follows import Follow

#: Candidates are compared to this many nats; the chosen one is then estimated to the end.
_TOLERANCE, _MOST_ITERATIONS = 0.05, 25
#: Where a storage is tried first, as shares of its bounds on a logarithmic scale.
_SIZES = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875)
#: The steps that a storage is given at most, as a multiple of those of the model without it.
_MOST_STEPS = 4
#: One that loses this many times what an effect must gain, at every size that is tried, is not refitted: towards no
#: size at all it loses nothing, and those that the data asked for gained at some size with all else as it was.
_LOSES = 5.0
_NO_DERIVATIVES = "the derivatives of the likelihood at the best of its sizes are not finite"


@dataclass(frozen=True)
class Look:
    """A storage at the size that suits the logs best, before anything is fitted, and what a fit would gain at most.

    ``trial`` holds that promise as its score; ``start`` (n,) is where a fit of ``problem`` begins, None if it promises
    too little for one.
    """

    trial: Trial
    problem: EstimationProblem | None
    start: FloatArray | None

    @classmethod
    def failed(cls, trial: Trial, why: str) -> Look:
        """A storage that could not even be looked at."""
        return cls(replace(trial, failed=why), None, None)


def try_storage(trial: Trial, ground: Ground, beat: float, quiet: tuple[Quiet, int | None] | None = None) -> Trial:
    """A candidate that brings a state of its own: it has no zero to be tested at, so it is tried at several sizes.

    From the best of them one expansion says what a fit would gain at most; only if that passes is it fitted. ``quiet``:
    scores with the process noise held low and the candidate's place in them, if it has a score.
    """
    return refit_storage(look(trial, ground, quiet), ground, beat)


def look(trial: Trial, ground: Ground, quiet: tuple[Quiet, int | None] | None = None) -> Look:
    """The first half of :func:`try_storage`: several sizes, and an expansion from the best of them."""
    extended = build(trial.candidate.apply(ground.built.graph))
    problem = _problem(trial, ground, extended)
    starts, remark = _sizes(problem, trial, ground, quiet)
    trial = replace(trial, built=extended, remark=remark)
    if not starts.size:
        return Look(trial, problem, None)
    runs = filter_runs(problem, starts[:, 0]) if is_linearised(problem) and starts.shape[1] == 1 else None
    values = problem.nll(starts) if runs is None else np.array([value_of(problem, starts[:, 0], runs)])
    best = int(np.argmin(np.where(np.isfinite(values), values, np.inf)))
    loss = float(values[best]) - ground.base.nll
    trial = replace(
        trial, remark=remark or _remark(problem, starts, values, len(problem.free) - ground.base.point.size)
    )
    if not loss < _LOSES * ground.need:
        return Look(trial, problem, None)
    further = _further(problem, starts[:, best], ground.base, runs)
    if not np.isfinite(further):
        return Look.failed(trial, _NO_DERIVATIVES)
    promise = further - loss
    trial = replace(trial, score_gain=max(promise, 0.0))
    return Look(trial, problem, starts[:, best] if promise >= 0.5 * ground.need else None)


def search_storage(trial: Trial, ground: Ground, quiet: Quiet, index: int) -> Trial:
    """A candidate that brings a state, refitted because it shows with little process noise (of a stiff model).

    It is searched from there as from little noise: with as much as the fit has without it, it looks worse than nothing,
    since what noise drives comes to a sensor behind a lag one sample too late. ``index`` is its place in ``quiet``.
    """
    extended = build(trial.candidate.apply(ground.built.graph))
    problem = _problem(trial, ground, extended)
    own = problem.free[ground.base.point.size :]
    starts = quiet_starts(ground.base, quiet, index, own)
    first = quiet_start(problem.free, np.concatenate([declared_point(ground.base), starts[0][-len(own) :]]))
    beat = ground.base.nll - 0.5 * ground.need
    fitted = fit(
        problem.filter_model, problem.logs, problem.free, _MOST_ITERATIONS, _TOLERANCE, starts, beat, ground.journal,
        first,
    )  # fmt: skip
    evidence = judge(ground.base, fitted, trial.candidate.effect, ground.tried)
    return replace(trial, built=extended, fit=fitted, evidence=evidence, failed="")


def refit_storage(seen: Look, ground: Ground, beat: float) -> Trial:
    """The second half: the refit from there, if it promises enough, given up where it will not reach ``beat``.

    Of a stiff model what promises much is searched anew from little process noise, as other candidates are
    (:mod:`.stiff_refits`): from the fit without it a search of a vehicle's elastic shaft ended 630 nats short.
    """
    if seen.start is None or seen.problem is None:
        return seen.trial
    problem, beat, first = seen.problem, min(beat, ground.base.nll - 0.5 * ground.need), None
    if is_linearised(problem) and seen.trial.score_gain > NEARBY * ground.need:
        own = seen.start[ground.base.point.size :]
        first = quiet_start(problem.free, np.concatenate([declared_point(ground.base), own]))
    fitted = fit(
        problem.filter_model, problem.logs, problem.free, _MOST_ITERATIONS, _TOLERANCE, [seen.start], beat,
        ground.journal, first,
    )  # fmt: skip
    return replace(
        seen.trial, fit=fitted, evidence=judge(ground.base, fitted, seen.trial.candidate.effect, ground.tried)
    )


def _further(
    problem: EstimationProblem, point: FloatArray, base: Fit, runs: Sequence[FilterRun] | None = None
) -> float:
    """What a step from a point (n,) promises beyond what one from the fit without the storage does.

    ``runs`` are those of the filter there, if somebody has them.

    That of a stiff model ends where its likelihood jumps by tenths of a nat, and its linearised filter may promise some
    nats there for ever: those are no gain of the storage's. NaN where derivatives are not finite.
    """
    if not is_linearised(problem):
        steps = GaussNewtonSettings().difference * (problem.upper - problem.lower)
        return _promise(problem, point, expand(problem, point, steps))
    # what an exact expansion costs is for what is refitted
    return _promise(problem, point, linear_expansion(problem, point, runs)) - base.linear_promise


def _promise(problem: EstimationProblem, point: FloatArray, expansion: Expansion) -> float:
    return newton_decrement(problem, point, expansion) if expansion.is_finite else float("nan")


def _problem(trial: Trial, ground: Ground, extended: BuiltModel) -> EstimationProblem:
    """What is fitted: the model with the storage, with steps of its own if it needs finer ones."""
    base, own = ground.base.problem.filter_model, filter_setup(extended.model, extended.driven, ground.train)
    most = _MOST_STEPS * base.substeps
    alike = own.filter_model.is_stiff == base.is_stiff  # else its steps are those of another method
    filter_model = replace(
        base,
        model=extended.model,
        initial_std={**own.filter_model.initial_std, **_estimated_starts(ground.base)},
        substeps=max(min(own.filter_model.substeps, most), base.substeps) if alike else most,
        follows={**base.follows, **_followers(ground, extended)},
    )
    free = (*at_optimum(ground.base), *coefficients(trial.candidate, filter_model))
    return EstimationProblem(filter_model, ground.train, free)


def _followers(ground: Ground, extended: BuiltModel) -> dict[str, Follow]:
    """Where the states of a candidate start, by where the first log begins, at the size in the middle of its bounds."""
    base, log = ground.base, ground.train[0]
    first = base.runs(ground.train)[0].filtered_mean[: len(ground.built.model.states), 0]
    values = dict(zip(base.problem.filter_model.model.names("parameter"), map(float, base.theta), strict=True))
    return followers(ground.built, extended, first, log.u[:, 0], values | dict(log.theta_overrides))


def _sizes(
    problem: EstimationProblem, trial: Trial, ground: Ground, quiet: tuple[Quiet, int | None] | None
) -> tuple[FloatArray, str]:
    """Points (n, sizes) at which the storage is worth a look at all of the logs, and a remark on sizes left out.

    Of a stiff model the beginnings of long logs choose the size; none is left if all lose too much there.
    """
    size, added = ground.base.point.size, problem.free[ground.base.point.size :]
    lower, upper = problem.lower[size:], problem.upper[size:]
    of_size = np.array([one.name in trial.candidate.effect.coefficients for one in added])
    own = [np.where(of_size, lower + share * (upper - lower), problem.start[size:]) for share in _SIZES]
    points = [np.concatenate([ground.base.point, one]) for one in own]
    if quiet is not None and quiet[1] is not None:
        points += quiet_starts(ground.base, quiet[0], quiet[1], added)
    starts = np.clip(np.array(points).T, problem.lower[:, np.newaxis], problem.upper[:, np.newaxis])
    part = excerpt(problem) if is_linearised(problem) else None
    if part is None:
        return starts, ""
    values = part.nll(starts)
    without = replace(ground.base.problem, logs=part.logs)
    lost = values - float(without.nll(ground.base.point[:, np.newaxis])[0])
    lost = np.where(np.isfinite(lost), lost, np.inf)
    kept = [int(np.argmin(lost))] if lost.min() < _LOSES * ground.need else []
    return starts[:, kept], _remark(problem, starts, values, len(added))


def _remark(problem: EstimationProblem, points: FloatArray, values: FloatArray, count: int) -> str:
    """Which sizes of a storage its steps do not resolve; points (n, sizes), of which the last ``count`` are its own."""
    sizes = problem.values(points)[-count][~np.isfinite(values)]
    if not sizes.size:
        return ""
    return (
        f"{problem.names[-count]} of {sizes.min():.3g} to {sizes.max():.3g} was not tried, for which "
        f"{problem.filter_model.substeps} steps from sample to sample are too few"
    )


def _estimated_starts(base: Fit) -> dict[str, float]:
    """How unsure the filter is of states whose starts are estimated."""
    estimated = {one.target.name for one in base.problem.free if one.target.kind == "x0"}
    return {name: std for name, std in base.problem.filter_model.initial_std.items() if name in estimated}
