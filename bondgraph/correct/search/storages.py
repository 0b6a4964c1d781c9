"""Storages: candidates that bring a state of their own, and so have no zero at which a score could test them.

A storage is tried at several sizes. Towards no size at all (a rigid shaft, a command that is followed at once) it is
the model without it, only stiffer the closer it gets there; sizes that steps do not resolve are left out and named.
From the best size one expansion says what a fit would gain at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.correct.evidence.context import Context, coefficients
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.followers import at_rest, followers
from bondgraph.data.log import FloatArray
from bondgraph.estimate.derivatives.linearised import filter_runs, is_linearised, linear_expansion, value_of
from bondgraph.estimate.excerpt import excerpt
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.initial import initial_states
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit
from bondgraph.estimate.objective import Expansion
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.searches import expand
from bondgraph.estimate.setup import filter_setup
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings
from bondgraph.estimate.solvers.steps import newton_decrement
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.follows import Follow
from bondgraph.simulate.late import first_inputs

#: Where a storage is tried first, as shares of its bounds on a logarithmic scale.
SIZES = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875)
#: How far from its start each shape of a storage is tried with every size, as shares of its bounds: how fast it follows
#: and how well it is damped decide which size suits the logs. A rope of 60 urad/(N m) was 2000 nats better than none
#: with twenty times the usual damping, and no better with the usual.
_SHAPES = (-0.25, 0.0, 0.25)
#: The steps that a storage is given at most, as a multiple of those of the model without it.
_MOST_STEPS = 4
#: Fits at most whose starts were led anew, and the share of its uncertainty by which a start is elsewhere: less of it
#: costs an eighth of a nat. Conventions.
_AGAIN, _ELSEWHERE = 3, 0.5
#: One that loses this many times what an effect must gain, at every size that is tried, is not refitted: towards no
#: size at all it loses nothing, and those that the data asked for gained at some size with all else as it was.
_LOSES = 5.0
_NO_DERIVATIVES = "the derivatives of the likelihood at the best of its sizes are not finite"


@dataclass(frozen=True)
class TrialSize:
    """A storage at the size that suits the logs best, before anything is fitted.

    ``trial`` holds what a fit would gain at most as its score; ``start`` (n,) is where that fit begins, None where it
    promises nothing.
    """

    trial: Trial
    start: FloatArray | None


def trial_size(trial: Trial, context: Context) -> TrialSize:
    """The best of several sizes of a storage, and the gain in nats that an expansion promises from there."""
    extended = build(trial.candidate.apply(context.built.graph))
    problem = storage_problem(trial, extended, context)
    starts, remark = _worth_a_run(problem, trial, context)
    trial = replace(trial, built=extended, remark=remark)
    if not starts.size:
        return TrialSize(trial, None)
    runs = filter_runs(problem, starts[:, 0]) if is_linearised(problem) and starts.shape[1] == 1 else None
    values = problem.nll(starts) if runs is None else np.array([value_of(problem, starts[:, 0], runs)])
    best = int(np.argmin(np.where(np.isfinite(values), values, np.inf)))
    loss = float(values[best]) - context.base.nll
    trial = replace(
        trial, remark=remark or _remark(problem, starts, values, len(problem.free) - context.base.point.size)
    )
    if not loss < _LOSES * context.required:
        return TrialSize(trial, None)
    further = _further(problem, starts[:, best], context.base, runs)
    if not np.isfinite(further):
        return TrialSize(replace(trial, failed=_NO_DERIVATIVES), None)
    return TrialSize(replace(trial, score_gain=max(further - loss, 0.0)), starts[:, best])


def storage_problem(trial: Trial, extended: BuiltModel, context: Context) -> EstimationProblem:
    """The problem that is fitted: the model with the storage, with steps of its own if it needs finer ones."""
    base = context.base.problem.filter_model
    own = filter_setup(extended.model, extended.driven, context.train, with_nodes=False)
    most = _MOST_STEPS * base.substeps
    alike = own.filter_model.is_stiff == base.is_stiff  # else its steps are those of another method
    filter_model = replace(
        base,
        model=extended.model,
        initial_std={**own.filter_model.initial_std, **base.initial_std},
        substeps=max(min(own.filter_model.substeps, most), base.substeps) if alike else most,
        follows={**base.follows, **_followers(context, extended, trial.candidate.effect.channel)},
    )
    free = (*at_optimum(context.base), *coefficients(trial.candidate, filter_model))
    return EstimationProblem(filter_model, context.train, free, context.base.problem.initial)


def sizes(problem: EstimationProblem, trial: Trial, context: Context) -> list[FloatArray]:
    """Points (n,) with the storage at each of its sizes and shapes, everything else at the fit without it."""
    size, effect = context.base.point.size, trial.candidate.effect
    names, start = problem.names[size:], problem.start[size:]
    lower, upper = problem.lower[size:], problem.upper[size:]
    of_size, shaped = (np.isin(names, list(own)) for own in (effect.coefficients, effect.shapes))
    moved = [start + shift * shaped * (upper - lower) for shift in (_SHAPES if shaped.any() else (0.0,))]
    own = [np.where(of_size, lower + share * (upper - lower), one) for one in moved for share in SIZES]
    return [np.concatenate([context.base.point, np.clip(one, lower, upper)]) for one in own]


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


def started_anew(
    fitted: Fit,
    before: BuiltModel,
    after: BuiltModel,
    channel: str,
    journal: Journal | None = None,
    beat: float = np.inf,
) -> Fit:
    """The fit of a law with a state of its own, again where its own parameters would have that state start elsewhere.

    Starts are lines in other states, by the fit without the law. A thermometer in a well that lags was to begin at
    350 K, by the declared heat capacity of its kiln; with two thirds of that it began at 230 K. ``beat`` as for
    :func:`bondgraph.estimate.local.fit`.
    """
    for _ in range(_AGAIN):
        problem = _led_by(fitted, before, after, channel)
        std = np.array([fitted.problem.filter_model.initial_std.get(name, 0.0) for name in after.model.names("state")])
        moved = [
            np.abs(there - here) > _ELSEWHERE * std
            for here, there in zip(_starts(fitted.problem), _starts(problem), strict=True)
        ]
        if not np.any(moved):
            break
        found = fit(problem, starts=[fitted.point], beat=beat, journal=journal)
        if not found.nll < fitted.nll:
            break
        fitted = found
    return fitted


def _starts(problem: EstimationProblem) -> list[FloatArray]:
    """Where each log begins (n_x,) at the start of a search."""
    return [x0[:, 0] for x0 in problem.batch(problem.start[:, np.newaxis]).x0]


def _led_by(fitted: Fit, before: BuiltModel, after: BuiltModel, channel: str) -> EstimationProblem:
    """The problem of a fit with starts of the states that only ``after`` has by the values of that fit."""
    problem, log = fitted.problem, fitted.problem.logs[0]
    values = dict(zip(after.model.names("parameter"), map(float, fitted.theta), strict=True))
    values |= dict(log.theta_overrides)
    known = {name: value for name, value in values.items() if name in before.model.names("parameter")}
    theta = before.model.theta(**known)
    rule = problem.initial if isinstance(problem.initial, str) else "model"
    (x,) = initial_states(before.model, [log], theta, rule)
    lead = at_rest if channel else followers
    follows = {**problem.filter_model.follows, **lead(before, after, x, first_inputs(after.model, log), values)}
    free = tuple(
        replace(one, start=float(np.clip(value, one.lower, one.upper)))
        for one, value in zip(problem.free, fitted.values.values(), strict=True)
    )
    return replace(problem, filter_model=replace(problem.filter_model, follows=follows), free=free)


def _followers(context: Context, extended: BuiltModel, channel: str) -> dict[str, Follow]:
    """Where the states of a candidate start, by where the first log begins, at the size in the middle of its bounds."""
    base, log = context.base, context.train[0]
    first = base.runs(context.train)[0].filtered_mean[: len(context.built.model.states), 0]
    values = dict(zip(base.problem.filter_model.model.names("parameter"), map(float, base.theta), strict=True))
    values |= dict(log.theta_overrides)
    if channel:  # a sensor has shown the machine for ever
        return at_rest(context.built, extended, first, first_inputs(extended.model, log), values)
    return followers(context.built, extended, first, first_inputs(extended.model, log), values)


def _worth_a_run(problem: EstimationProblem, trial: Trial, context: Context) -> tuple[FloatArray, str]:
    """Points (n, sizes) at which the storage is worth a look at all of the logs, and a remark on sizes left out.

    Of a stiff model the beginnings of long logs choose the size; none is left if all lose too much there.
    """
    added = len(problem.free) - context.base.point.size
    points = np.array(sizes(problem, trial, context)).T
    starts = np.clip(points, problem.lower[:, np.newaxis], problem.upper[:, np.newaxis])
    part = excerpt(problem) if is_linearised(problem) else None
    if part is None:
        return starts, ""
    values = part.nll(starts)
    without = replace(context.base.problem, logs=part.logs)
    lost = values - float(without.nll(context.base.point[:, np.newaxis])[0])
    lost = np.where(np.isfinite(lost), lost, np.inf)
    kept = [int(np.argmin(lost))] if lost.min() < _LOSES * context.required else []
    return starts[:, kept], _remark(problem, starts, values, added)


def _remark(problem: EstimationProblem, points: FloatArray, values: FloatArray, count: int) -> str:
    """Which sizes of a storage its steps do not resolve; points (n, sizes), of which the last ``count`` are its own."""
    left_out = problem.values(points)[-count][~np.isfinite(values)]
    if not left_out.size:
        return ""
    return (
        f"{problem.names[-count]} of {left_out.min():.3g} to {left_out.max():.3g} was not tried, for which "
        f"{problem.filter_model.substeps} steps from sample to sample are too few"
    )
