"""Refits of the few candidates whose scores promise most: the score says where to look, the refit how much it is worth.

Candidates whose responses are the same to rounding are refitted once. All that are refitted share one model that holds
them with zero coefficients, so that it is compiled once; only stiff models, which take longest to compile, have one
each, which later loops find in the cache, whatever they refit beside it. Each starts from the best of several points on
the way from the fit without it to where its score points, and the best refit so far with the coefficients exchanged.
One that clearly falls behind an accepted one is given up.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from bondgraph.correct.build import BuiltModel, build
from bondgraph.correct.candidates import Candidate, Variant, superset
from bondgraph.correct.decide import judge
from bondgraph.correct.fit import Fit, Report, fit, quiet_start
from bondgraph.correct.journal import Journal
from bondgraph.correct.quiet import Quiet, lowered_starts, quiet_starts
from bondgraph.correct.score import Scores
from bondgraph.correct.scoring import Scored
from bondgraph.correct.trials import Trial
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.free import FreeParameter
from bondgraph.filter.compiled import CompiledFilter, in_threads
from bondgraph.filter.filter_model import FilterModel

#: Candidates are compared to this many nats; the chosen one is then estimated to the end.
_TOLERANCE = 0.05
_MOST_ITERATIONS, _MOST_STIFF = 25, 12
#: Responses more alike than this are one and the same but for rounding.
_SAME = 1.0 - 1e-6
#: A candidate whose score is this likely by chance, even as the only one tried, is not refitted.
_CHANCE = 0.05


class _Limits(NamedTuple):
    """Which candidates are refitted, of those in the order of their scores.

    At most ``most``, with this share of the best score's gain (``worth``) and of what an accepted one gained when it
    was refitted (``behind``); so many side by side (``abreast``), whatever the machine, for a leader decides who
    follows.
    """

    worth: float
    behind: float
    most: int
    abreast: int


#: Scores are right to a factor of two.
_LIMITS = _Limits(worth=0.4, behind=0.1, most=100, abreast=1)
#: The refits of stiff models take longest; the filter of one runs in one thread.
_STIFF_LIMITS = _Limits(worth=0.5, behind=0.6, most=3, abreast=2)
#: What promises less than so many times the least gain that counts is near: its refit need not begin far away.
_NEARBY = 10.0

#: With the process noise held low scores tell more: those that reach this share of the best, less so many nats.
_WORTH_QUIET, _NEAR_QUIET = 0.9, 6.0
#: Shares of the step that a score points at where a refit looks for its start.
_STRIDES = (1.0, 0.5, 0.1, 0.0)
#: Multiples of that step, and by how much (of a logarithm) lower process noise, at which a stiff model is tried too.
_MULTIPLES = (1.0, 4.0, 16.0)
_QUIETER = 2.0


@dataclass(frozen=True)
class Ground:
    """What all refits of a round start from: the fitted model, its logs, how many candidates were tried, the level."""

    built: BuiltModel
    base: Fit
    train: tuple[MatchedLog, ...]
    tried: int
    level: float
    need: float
    journal: Journal = field(default_factory=Journal)
    quiet: Fit | None = None


def coefficients(
    candidate: Candidate, filter_model: FilterModel, variant: Variant | None = None
) -> tuple[FreeParameter, ...]:
    """Coefficients and shapes of a candidate as free parameters; linear where zero is where they begin.

    Raises
    ------
    EstimationError
        If one has no bounds.
    """
    shapes = {} if variant is None else variant.shapes
    model = filter_model.model
    found = []
    for name in candidate.effect.parameters:
        lower, upper = candidate.bounds(name)
        value = shapes.get(name, model.parameters[model.index("parameter", name)].value)
        found.append(FreeParameter(name, lower, upper, value, scale="log" if lower > 0.0 else "linear"))
    return tuple(found)


def at_optimum(base: Fit) -> tuple[FreeParameter, ...]:
    """The free parameters of a fit, starting from its optimum."""
    values = base.values
    return tuple(
        replace(parameter, start=float(np.clip(values[parameter.name], parameter.lower, parameter.upper)))
        for parameter in base.problem.free
    )


def refit_best(
    trials: Sequence[Trial], scored: Scored, ground: Ground, most: int, report: Report, quiet: Quiet | None = None
) -> list[Trial]:
    """The trials of vanishing candidates, the best of them refitted.

    Parameters
    ----------
    trials
        In the order of the scores.
    scored
        Scores of the same candidates.
    ground
        What to start from.
    most
        Most refits.
    report
        Told of each.
    quiet
        Scores of the same candidates with the process noise held low, whose best are refitted too.
    """
    done = list(trials)
    limits = _STIFF_LIMITS if ground.base.problem.filter_model.is_stiff else _LIMITS
    groups = worth_a_refit(trials, scored, ground, min(most, limits.most), limits.worth, quiet)
    if not groups:
        return done
    shared = _shared(ground, [trials[group[0]].candidate for group in groups])
    leader: tuple[int, Fit] | None = None
    waiting, count = list(groups), 0
    while waiting:
        report("refit the best candidates", count, len(groups))
        wave, waiting = waiting[: limits.abreast], waiting[limits.abreast :]
        count += len(wave)
        if leader is not None and quiet is None:
            reached = limits.behind * (ground.base.nll - leader[1].nll)
            wave = [group for group in wave if trials[group[0]].score_gain >= reached]
        found = _abreast([trials[group[0]] for group in wave], [group[0] for group in wave], scored, shared, ground,
                         leader, quiet)  # fmt: skip
        for group, (fitted, own) in zip(wave, found, strict=True):
            if fitted is None:
                continue
            index = group[0]
            twins = tuple(trials[j].candidate.label for j in group[1:])
            done[index] = _judged(trials[index], fitted, own, ground, twins)
            for other in group[1:]:
                done[other] = replace(trials[other], evidence=done[index].evidence)
            evidence = done[index].evidence
            accepted = evidence is not None and evidence.accepted(ground.level)
            if accepted and (leader is None or fitted.nll < leader[1].nll):
                leader = (index, fitted)
        simpler = None if waiting or leader is None else simpler_law(leader[0], done, scored.scores, ground)
        if simpler is not None and not any(simpler in group for group in groups):
            waiting, groups = [[simpler]], [*groups, [simpler]]
    report("refit the best candidates", len(groups), len(groups))
    return done


def simpler_law(leader: int, done: Sequence[Trial], found: Scores, ground: Ground) -> int | None:
    """The best by its score of the laws at the leader's place that need fewer parameters; None where there is none.

    Of a law that is another with a further term both promise the same, and which of them it is takes both refits.
    """
    best = done[leader].candidate
    rivals = [
        j
        for j, trial in enumerate(done)
        if trial.candidate.place.label == best.place.label
        and len(trial.candidate.effect.parameters) < len(best.effect.parameters)
        and found.gain[j] > 0.5 * ground.need
    ]
    if any(done[j].evidence is not None for j in rivals):
        return None
    return max(rivals, key=lambda j: float(found.gain[j]), default=None)


def _abreast(
    trials: Sequence[Trial],
    indices: Sequence[int],
    scored: Scored,
    shared: FilterModel | None,
    ground: Ground,
    leader: tuple[int, Fit] | None,
    quiet: Quiet | None,
) -> list[tuple[Fit | None, BuiltModel]]:
    """Refits side by side in threads, each with the model that it added its effect to; None for one that diverges."""
    own = [build(trial.candidate.apply(ground.built.graph)) for trial in trials]
    base = ground.base.problem.filter_model
    filters = [shared or replace(base, model=one.model) for one in own]
    if len(own) > 1:
        for one in filters:  # compiled before threads start
            CompiledFilter.of(one)
    found: list[Fit | None] = [None] * len(own)

    def refit(k: int) -> None:
        with contextlib.suppress(EstimationError):  # it diverges wherever its scores point
            found[k] = _refit(indices[k], trials[k], scored, filters[k], ground, leader, quiet)

    in_threads(len(own), refit, range(len(own)))
    return list(zip(found, own, strict=True))


def _shared(ground: Ground, found: Sequence[Candidate]) -> FilterModel | None:
    """The filter of a model that holds all candidates; None where each is to have its own."""
    filter_model = ground.base.problem.filter_model
    return None if filter_model.is_stiff else replace(filter_model, model=superset(ground.built, found).model)


def worth_a_refit(
    trials: Sequence[Trial], scored: Scored, ground: Ground, most: int, share: float, quiet: Quiet | None
) -> list[list[int]]:
    """Indices of candidates to be refitted, as of :func:`alike`: the best by their scores, then the best quiet ones.

    At most so many of each; those of a ``share`` of the best score's gain.
    """
    groups = alike(trials, scored.scores, 0.5 * ground.need)
    best = max((trials[group[0]].score_gain for group in groups), default=0.0)
    kept = [group for group in groups if trials[group[0]].score_gain >= share * best][:most]
    if quiet is None:
        return kept
    further = [
        group
        for group in alike(trials, quiet.scored.scores, worth_quiet(quiet.scored.scores, ground.need))
        if not any(index in other for other in kept for index in group)
    ]
    return kept + further[:most]


def worth_quiet(found: Scores, need: float) -> float:
    """The least gain, with the process noise held low, of candidates that are refitted."""
    return max(_WORTH_QUIET * float(found.gain.max(initial=0.0)) - _NEAR_QUIET, need)


def alike(trials: Sequence[Trial], found: Scores, least: float) -> list[list[int]]:
    """Indices of candidates worth a refit, those with the same response together, the preferred one of each first.

    Of several that the sensors cannot tell apart the first is, in this order: a law that only takes energy before a
    source, a place whose flow is that of a storage before one that is rigidly tied to it, and the order of declaration.
    A law that is not smooth at zero is told little by its score, which is no reason to pass it over.
    """
    groups: list[list[int]] = []
    for j in map(int, np.argsort(-found.gain, kind="stable")):
        if found.gain[j] <= least:
            break
        twin = next((group for group in groups if abs(found.correlation[group[0], j]) > _SAME), None)
        if twin is not None:
            twin.append(j)
        elif found.p_value[j] < _CHANCE or trials[j].candidate.effect.amplitudes:
            groups.append([j])
    return [sorted(group, key=lambda j: (*remoteness(trials[j].candidate), j)) for group in groups]


def remoteness(candidate: Candidate) -> tuple[int, bool, bool, bool]:
    """Of several candidates that the sensors cannot tell apart the one with the smallest is preferred."""
    size = len(candidate.effect.parameters)
    return size, not candidate.passive, bool(candidate.effect.channel), not candidate.beside_storage


def _refit(
    index: int,
    trial: Trial,
    scored: Scored,
    filter_model: FilterModel,
    ground: Ground,
    leader: tuple[int, Fit] | None,
    quiet: Quiet | None = None,
) -> Fit:
    own = coefficients(trial.candidate, filter_model, scored.variants[index])
    free = (*at_optimum(ground.base), *own)
    found = scored.scores
    starts = [_along(ground.base, found, index, own, share) for share in _STRIDES]
    beginning = None
    if filter_model.is_stiff and trial.score_gain > _NEARBY * ground.need:
        starts += _afresh(ground.base, own, found.steps[index])
        absent = [parameter.coordinate(parameter.start) for parameter in own]
        beginning = quiet_start(free, np.concatenate([_declared(ground.base), absent]))
    starts += [_along(ground.base, found, index, own, share) for share in _abrupt(trial.candidate, found.steps[index])]
    if quiet is not None:
        starts += quiet_starts(ground.base, quiet, index, own)
    beat = ground.base.nll if filter_model.is_stiff else np.inf
    if leader is not None:
        first, fitted = leader
        beat = fitted.nll
        if len(own) == 1 and len(trial.candidate.effect.coefficients) == fitted.point.size - ground.base.point.size:
            told = found.information[first] / found.information[index]
            step = float(found.correlation[first, index] * np.sqrt(told) * fitted.point[-1])
            starts.append(np.append(fitted.point[:-1], _inside(own[0], step)))
    most = _MOST_STIFF if filter_model.is_stiff else _MOST_ITERATIONS
    return fit(filter_model, ground.train, free, most, _TOLERANCE, starts, beat, ground.journal, beginning)


def _along(base: Fit, found: Scores, index: int, own: Sequence[FreeParameter], share: float) -> FloatArray:
    """The optimum without a candidate, moved as it moves with a share of its step; shapes start where they start."""
    step = found.steps[index]
    reached = np.array([_inside(parameter, share * value) for parameter, value in zip(own, step, strict=False)])
    shapes = [parameter.coordinate(parameter.start) for parameter in own[step.size :]]
    cut = min((abs(a / (share * b)) for a, b in zip(reached, step, strict=True) if share * b != 0.0), default=1.0)
    point = base.point.copy()
    kinds = np.array([parameter.target.kind == "parameter" for parameter in base.problem.free])
    point[~base.held] += share * min(cut, 1.0) * np.where(kinds[~base.held], found.follows(index), 0.0)
    return np.concatenate([point, reached, shapes])


def _abrupt(candidate: Candidate, step: FloatArray) -> list[float]:
    """Shares of its step at which a law that is not smooth at zero has each of the amplitudes it is tried at."""
    if not step[0]:
        return []
    sizes = sorted({variant.sizes[0] for variant in candidate.variants}) if candidate.effect.amplitudes else []
    return [float(size / step[0]) for size in sizes]


def _afresh(base: Fit, own: Sequence[FreeParameter], step: FloatArray) -> list[FloatArray]:
    """Starts that owe less to the fit without a candidate: its parameters or the declared ones, its noise or little.

    A model that lacks something drives its parameters to bounds and its noise up, and from there a long way leads back.
    Coefficients are tried at what their score points at and, since a large effect is underrated, at multiples of it.
    """
    problem = base.problem
    kinds = np.array([parameter.target.kind for parameter in problem.free])
    declared = _declared(base)
    quiet = np.where(kinds == "process", np.clip(base.point - _QUIETER, problem.lower, problem.upper), 0.0)
    found = []
    for point in (base.point, declared):
        for levels in (point, np.where(kinds == "process", quiet, point)):
            for many in _MULTIPLES:
                reached = [_inside(one, many * value) for one, value in zip(own, step, strict=False)]
                shapes = [parameter.coordinate(parameter.start) for parameter in own[step.size :]]
                found.append(np.concatenate([levels, reached, shapes]))
    return found


def _declared(base: Fit) -> FloatArray:
    """The point of a fit with its parameters as declared."""
    model = base.problem.filter_model.model
    point = base.point.copy()
    for k, parameter in enumerate(base.problem.free):
        if parameter.target.kind == "parameter":
            value = model.parameters[model.index("parameter", parameter.target.name)].value
            point[k] = parameter.coordinate(float(np.clip(value, parameter.lower, parameter.upper)))
    return point


def _inside(coefficient: FreeParameter, step: float) -> float:
    """A coefficient where its score points, inside its bounds and by no more than half their width."""
    reach = 0.5 * (coefficient.upper - coefficient.lower)
    margin = 1e-6 * reach
    value = coefficient.start + float(np.clip(step, -reach, reach))
    return float(np.clip(value, coefficient.lower + margin, coefficient.upper - margin))


def _judged(trial: Trial, fitted: Fit, built: BuiltModel, ground: Ground, twins: tuple[str, ...]) -> Trial:
    evidence = judge(ground.base, fitted, trial.candidate.effect, ground.tried)
    return replace(trial, built=built, fit=fitted, evidence=evidence, stands_for=twins)


def refit_alone(
    trial: Trial, start: Sequence[float], ground: Ground, shapes: Variant | None = None, tried: int | None = None
) -> Trial:
    """A vanishing candidate refitted on a model of its own, from a value of each coefficient on.

    ``tried`` counts what it was picked from, if that is not what the round tried.
    """
    extended = build(trial.candidate.apply(ground.built.graph))
    filter_model = replace(ground.base.problem.filter_model, model=extended.model)
    own = coefficients(trial.candidate, filter_model, shapes)
    rest = [parameter.coordinate(parameter.start) for parameter in own[len(start) :]]
    points = [ground.base.point] if filter_model.is_stiff else lowered_starts(ground.base, ground.quiet)
    starts = [
        np.concatenate([point, [_inside(one, share * value) for one, value in zip(own, start, strict=False)], rest])
        for point, share in itertools.product(points, _STRIDES)
    ]
    free = (*at_optimum(ground.base), *own)
    fitted = fit(
        filter_model, ground.train, free, _MOST_ITERATIONS, _TOLERANCE, starts, journal=ground.journal
    )  # fmt: skip
    evidence = judge(ground.base, fitted, trial.candidate.effect, tried or ground.tried, trial.gate is not None)
    return replace(trial, built=extended, fit=fitted, evidence=evidence)
