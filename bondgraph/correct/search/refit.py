"""A refit: one candidate estimated with everything else that is free, from all the points where it may start.

Successive halving (Jamieson and Talwalkar 2016, AISTATS): all starts by their value on the beginnings of long logs, a
rough search there from the best of them and from little process noise, and the whole logs only for what is not clearly
behind. A model that is not stiff is searched from little process noise after that, where its fit may lead or falls
short of what was predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.correct.constants import MOSTLY
from bondgraph.correct.evidence.context import Context, coefficients, declared_point, inside
from bondgraph.correct.evidence.decide import judge
from bondgraph.correct.evidence.replaced import in_place_of_elements
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.search.storages import sizes, started_anew, storage_problem
from bondgraph.data.log import FloatArray
from bondgraph.estimate.excerpt import excerpt, on_beginnings
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.local import fit, left_open
from bondgraph.estimate.noise_starts import quiet_start
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.searches import ROUGH, ROUGH_ITERATIONS

#: Candidates are compared to this many nats; the chosen one is then estimated to the end.
_TOLERANCE, _MOST_ITERATIONS = 0.05, 25
#: Shares of a predicted step at which a fit may start: expansions are right in direction more than in size.
SHARES = (1.0, 0.5, 0.1)
#: Shares of the way down to its bounds (logarithms) at which process noise starts: what it stood in for is explained.
_LOWERED = (0.0, 0.5, 1.0)
#: Looks at most: each has a quarter of the spacing before, so that six lead from two seconds to a millisecond; as
#: many may move on.
_LOOKS = 12
#: The gain of a law from afar is right to a factor of two, as scores are.
_HALF = 0.5
#: Multiples of a predicted coefficient at which a law may start that is not smooth, or much larger than predicted.
_MULTIPLES = (4.0, 16.0)


@dataclass(frozen=True)
class Prepared:
    """A model with a candidate in it, the problem of its refit, and its rough fit on the beginnings of long logs."""

    built: BuiltModel
    problem: EstimationProblem
    begun: Fit | None = None


def refit(
    trial: Trial,
    starts: Sequence[FloatArray],
    context: Context,
    lead: Fit | None = None,
    ready: Prepared | None = None,
    tried: int | None = None,
    promised: float = 0.0,
) -> Trial:
    """The trial with its fit and its evidence, or with the remark that it is clearly behind.

    Parameters
    ----------
    trial
        The candidate.
    starts
        Points (n,) of everything that is free, the candidate's coefficients and shapes last. Empty: its declared ones.
    context
        What is shared by all refits.
    lead
        The best fit so far: what is clearly behind it on the beginnings of the logs is given up.
    ready
        What :func:`prepared` or :func:`begun` gave for it, if somebody has it.
    tried
        How many candidates it was picked from, if not what the round tried.
    promised
        Nats that it was predicted to gain.

    Raises
    ------
    BondGraphError
        If its model is refused or diverges at every start.
    """
    ready = begun(ready or prepared(trial, context), trial, starts, context)
    built, problem = ready.built, ready.problem
    quiet = _quiet_beginning(problem, context)
    if ready.begun is None:
        points = _spread(starts or [problem.start], problem, trial, context)
        first = quiet if problem.filter_model.is_stiff else None  # their fits are costly, and one must do
    else:
        clearly = context.required + left_open(problem)
        if lead is not None and ready.begun.nll > on_beginnings(lead.problem, lead.point) + clearly:
            gain = context.base.nll - lead.nll
            remark = f"given up on the beginnings of the logs, clearly behind what gains {gain:.1f} nats"
            return replace(trial, built=built, remark=remark)
        points, first = [ready.begun.point, *starts[:1]], None
    beat = context.base.nll - context.required  # what cannot pass the tests need not be finished
    beat = beat if lead is None else min(beat, lead.nll)
    fitted = fit(problem, _MOST_ITERATIONS, _TOLERANCE, points, beat, context.journal, first)
    if not problem.filter_model.is_stiff:
        fitted = _led_on(fitted, beat, quiet, promised, context)
    if trial.candidate.effect.adds_state:
        fitted = started_anew(fitted, context.built, built, trial.candidate.effect.channel, context.journal, beat)
    done = _judged(replace(trial, built=built, failed=""), fitted, context, tried)
    freed = in_place_of_elements(fitted, trial.candidate, context.base, context.built.graph, context.journal)
    if freed is fitted:
        return done
    instead = _judged(done, freed, context, tried)
    assert done.evidence is not None  # it was judged
    passes = instead.evidence is not None and instead.evidence.accepted(context.level)
    return instead if passes or not done.evidence.accepted(context.level) else done


def _led_on(fitted: Fit, beat: float, quiet: FloatArray | None, promised: float, context: Context) -> Fit:
    """Where a fit goes on to that may gain more than it does; ``quiet`` (n,) is where little process noise begins.

    One whose iterations were spent goes on with half of the gain that is to be beaten: dry friction of a trailer was 2
    nats behind that of its car then, and 11 ahead in the end. Little process noise is begun from where a fit gains
    less than most of what was predicted, and where it passes the tests and may lead: of a battery whose noise stood in
    for a resistance that falls with its charge every law ended with 393 nats of 2359.
    """
    gain, required = context.base.nll - beat, context.required
    if fitted.outcome is SearchOutcome.ITERATION_LIMIT and context.base.nll - fitted.nll > _HALF * gain:
        fitted = fit(fitted.problem, _MOST_ITERATIONS, _TOLERANCE, [fitted.point], beat, context.journal)
    gained = context.base.nll - fitted.nll
    leads, short = gained > max(required, _HALF * gain), promised > required and gained < MOSTLY * promised
    if quiet is None or not (leads or short):
        return fitted
    again = attempted(
        lambda: fit(fitted.problem, _MOST_ITERATIONS, _TOLERANCE, (), beat, context.journal, quiet),
        lambda why: fitted,
    )
    return again if again.nll < fitted.nll else fitted


def _judged(trial: Trial, fitted: Fit, context: Context, tried: int | None) -> Trial:
    evidence = judge(context.base, fitted, trial.candidate.effect, tried or context.tried, trial.gate is not None)
    return replace(trial, fit=fitted, evidence=evidence)


def looked_closer(done: Trial, context: Context, lead: Fit | None = None, tried: int | None = None) -> Trial:
    """The trial with its law found again at finer and finer spacings, where it has one, see :class:`Effect`.

    One that gains less than half of what the best fit so far does is left as it is.
    """
    least = max(context.required, 0.0 if lead is None else _HALF * (context.base.nll - lead.nll))
    for _ in range(_LOOKS):
        effect = done.candidate.effect
        if done.fit is None or effect.closer is None or done.gain < least:
            return done
        place = effect.closer(done.fit.values[effect.coefficients[0]])
        if place is None:
            return done
        closer = replace(done, candidate=done.candidate.at(place, context.built.graph))
        point = done.fit.point
        as_declared = np.concatenate([declared_point(context.base), point[context.base.point.size :]])
        done = refit(closer, [point, as_declared], context, ready=prepared(closer, context), tried=tried)
    return done


def prepared(trial: Trial, context: Context) -> Prepared:
    """The model with a candidate in it, and the problem of its refit."""
    built = build(trial.candidate.apply(context.built.graph))
    if trial.candidate.effect.adds_state:
        return Prepared(built, storage_problem(trial, built, context))
    filter_model = replace(context.base.problem.filter_model, model=built.model)
    free = (*at_optimum(context.base), *coefficients(trial.candidate, filter_model))
    return Prepared(built, EstimationProblem(filter_model, context.train, free, context.base.problem.initial))


def begun(ready: Prepared, trial: Trial, starts: Sequence[FloatArray], context: Context) -> Prepared:
    """The same with a rough fit on the beginnings of long logs, from the best start and from little process noise.

    Without one where logs are short, and as it is where it has one.
    """
    part = None if ready.begun is not None else excerpt(ready.problem)
    if part is None:
        return ready
    points = _spread(starts or [ready.problem.start], ready.problem, trial, context)
    first = _quiet_beginning(ready.problem, context) if ready.problem.filter_model.is_stiff else None
    return replace(ready, begun=fit(part, ROUGH_ITERATIONS, ROUGH, points, journal=context.journal, first=first))


def refit_from(trial: Trial, values: Sequence[float], context: Context, tried: int | None = None) -> Trial:
    """The trial refitted from values of its coefficients, and from smaller ones, all else at the fit without it."""
    filter_model = replace(context.base.problem.filter_model, model=trial.candidate.model)
    own = coefficients(trial.candidate, filter_model)
    rest = [one.coordinate(one.start) for one in own[len(values) :]]
    starts = [
        np.concatenate(
            [context.base.point, [inside(one, share * v) for one, v in zip(own, values, strict=False)], rest]
        )
        for share in SHARES
    ]
    return refit(trial, starts, context, tried=tried, promised=trial.score_gain)


def _spread(
    starts: Sequence[FloatArray], problem: EstimationProblem, trial: Trial, context: Context
) -> list[FloatArray]:
    """The starts, and others that owe less to where they come from: with less process noise, with other sizes."""
    shared, effect = context.base.point.size, trial.candidate.effect
    found = list(starts)
    if effect.adds_state:
        found += sizes(problem, trial, context)
    for start in starts[:1]:
        first = start[shared]
        other = [many * first for many in _MULTIPLES] if effect.coefficients else []
        if effect.amplitudes:
            signs = (1.0,) if trial.candidate.lower[0] >= 0.0 else (1.0, -1.0)
            other += [sign * one.sizes[0] for one in trial.candidate.variants for sign in signs]
        for value in dict.fromkeys(other):
            point = np.concatenate([context.base.point, start[shared:]])
            point[shared] = value
            found.append(point)
    process = np.array([one.target.kind == "process" for one in problem.free])
    if process.any():
        found = [point + share * np.where(process, problem.lower - point, 0.0) for share in _LOWERED for point in found]
    return [np.clip(point, problem.lower, problem.upper) for point in found]


def _quiet_beginning(problem: EstimationProblem, context: Context) -> FloatArray | None:
    """Where a search with little process noise begins, parameters as declared; None where noise stands in for nothing.

    A model that lacks something drives its parameters to bounds and its noise up, and from there a long way leads back.
    """
    if context.base.driven < context.required:
        return None
    own = problem.start[context.base.point.size :]
    return quiet_start(problem.free, np.concatenate([declared_point(context.base), own]))
