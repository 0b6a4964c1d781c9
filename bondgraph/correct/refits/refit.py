"""Refits of the few candidates whose scores promise most: the score says where to look, the refit how much it is worth.

Candidates whose responses are the same to rounding are refitted once. All that are refitted share one model that holds
them with zero coefficients, so that it is compiled once (stiff models go another way: :mod:`.stiff_refits`). Each
starts from the best of several points on the way from the fit without it to where its score points, and the best refit
so far with the coefficients exchanged. One that clearly falls behind an accepted one is given up.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.correct.fits.fit import WITHIN_REACH, Fit, Report, fit
from bondgraph.correct.fits.journal import Journal
from bondgraph.correct.models.candidates import Candidate, Variant, superset
from bondgraph.correct.models.failures import FAILURES, reason
from bondgraph.correct.refits.decide import judge
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.scores.quiet import Quiet, lowered_starts, quiet_starts
from bondgraph.correct.scores.score import CHANCE, SAME, Scores
from bondgraph.correct.scores.scoring import Scored
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.estimate.free import FreeParameter
from bondgraph.filter.filter_model import FilterModel

#: Candidates are compared to this many nats; the chosen one is then estimated to the end.
_TOLERANCE = 0.05
_MOST_ITERATIONS = 25

#: Scores are right to a factor of two: those with less than this share of the best one's gain are not refitted.
WORTH = 0.4
#: Nor are those whose score promises less than this share of what an accepted one gained.
_BEHIND = 0.1
#: With the process noise held low scores tell more: those that reach this share of the best, less so many nats.
_WORTH_QUIET, _NEAR_QUIET = 0.9, 6.0
#: Shares of the step that a score points at where a refit looks for its start.
STRIDES = (1.0, 0.5, 0.1, 0.0)


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

    Bounds of coefficients only scale the search.

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
        scale: Literal["linear", "log"] = "log" if lower > 0.0 else "linear"
        widens = name in candidate.effect.coefficients
        found.append(FreeParameter(name, lower, upper, value, scale=scale, widens=widens))
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
    groups = worth_a_refit(trials, scored, ground, most, WORTH, quiet)
    if not groups:
        return done
    found = [trials[group[0]].candidate for group in groups]
    shared = _shared(found, ground)
    leader: tuple[int, Fit] | None = None
    for count, group in enumerate(groups):
        report("refit the best candidates", count, len(groups))
        index = group[0]
        behind = leader is not None and trials[index].score_gain < _BEHIND * (ground.base.nll - leader[1].nll)
        if behind and quiet is None:
            continue
        try:
            own = build(trials[index].candidate.apply(ground.built.graph))
            together = shared is not None and _holds(shared, trials[index].candidate)
            model = shared if together and shared is not None else _alone(own, ground)
            fitted = _refit(index, trials[index], scored, model, ground, leader, quiet)
            note(done, group, fitted, own, ground)
        except FAILURES as error:  # it diverges wherever its scores point
            done[index] = replace(done[index], failed=reason(error))
            continue
        evidence = done[index].evidence
        accepted = evidence is not None and evidence.accepted(ground.level)
        if accepted and (leader is None or fitted.nll < leader[1].nll):
            leader = (index, fitted)
    report("refit the best candidates", len(groups), len(groups))
    return done


def _shared(found: Sequence[Candidate], ground: Ground) -> FilterModel | None:
    """The filter of the model that holds all candidates, None where they do not fit beside each other."""
    try:
        return _alone(superset(ground.built, found), ground)
    except FAILURES:
        return None


def _holds(filter_model: FilterModel, candidate: Candidate) -> bool:
    """Whether a model has a candidate in it, which may not fit beside the others."""
    return set(candidate.effect.parameters) <= set(filter_model.model.names("parameter"))


def _alone(own: BuiltModel, ground: Ground) -> FilterModel:
    return replace(ground.base.problem.filter_model, model=own.model)


def note(done: list[Trial], group: Sequence[int], fitted: Fit, built: BuiltModel, ground: Ground) -> None:
    """Put a refit into the trials: that of the first of a group, whose evidence is that of all of it."""
    index, twins = group[0], tuple(done[j].candidate.label for j in group[1:])
    evidence = judge(ground.base, fitted, done[index].candidate.effect, ground.tried)
    done[index] = replace(done[index], built=built, fit=fitted, evidence=evidence, stands_for=twins, failed="")
    for other in group[1:]:
        done[other] = replace(done[other], evidence=evidence)


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

    Of several that the sensors cannot tell apart the first is, in this order: one whose coefficients may be as large as
    its score asks for, a law that only takes energy before a source, a place whose flow is that of a storage before one
    that is rigidly tied to it, and the order of declaration.
    A law that is not smooth at zero is told little by its score, which is no reason to pass it over. Nor is one of more
    coefficients the same as one of fewer, though its step may be: a fit may move them apart.
    """
    groups: list[list[int]] = []
    for j in map(int, np.argsort(-found.gain, kind="stable")):
        if found.gain[j] <= least:
            break
        size = len(found.steps[j])
        twin = next(
            (
                group
                for group in groups
                if abs(found.correlation[group[0], j]) > SAME and len(found.steps[group[0]]) == size
            ),
            None,
        )
        if twin is not None:
            twin.append(j)
        elif found.p_value[j] < CHANCE or trials[j].candidate.effect.amplitudes:
            groups.append([j])
    return [
        sorted(group, key=lambda j: (*remoteness(trials[j].candidate, found.steps[j]), j)) for group in groups
    ]  # fmt: skip


def remoteness(candidate: Candidate, step: Sequence[float] | FloatArray = ()) -> tuple[int, bool, bool, bool, bool]:
    """Of several candidates that the sensors cannot tell apart the one with the smallest is preferred.

    ``step`` is what its score asks of each coefficient: a place where effort and flow are small bounds them too closely
    to show what the same law shows elsewhere.
    """
    size = len(candidate.effect.parameters)
    beyond = any(
        not lower <= value <= upper for value, lower, upper in zip(step, candidate.lower, candidate.upper, strict=False)
    )
    return size, beyond, not candidate.passive, bool(candidate.effect.channel), not candidate.beside_storage


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
    starts = [along(ground.base, found, index, own, share) for share in STRIDES]
    starts += [along(ground.base, found, index, own, share) for share in abrupt(trial.candidate, found.steps[index])]
    if quiet is not None:
        starts += quiet_starts(ground.base, quiet, index, own)
    beat = np.inf
    if leader is not None:
        first, fitted = leader
        beat = fitted.nll
        if len(own) == 1 and len(trial.candidate.effect.coefficients) == fitted.point.size - ground.base.point.size:
            told = found.information[first] / found.information[index]
            step = float(found.correlation[first, index] * np.sqrt(told) * fitted.point[-1])
            starts.append(np.append(fitted.point[:-1], inside(own[0], step)))
    return fit(filter_model, ground.train, free, _MOST_ITERATIONS, _TOLERANCE, starts, beat, ground.journal)


def along(base: Fit, found: Scores, index: int, own: Sequence[FreeParameter], share: float) -> FloatArray:
    """The optimum without a candidate, moved as it moves with a share of its step; shapes start where they start."""
    step = found.steps[index]
    reached = np.array([inside(parameter, share * value) for parameter, value in zip(own, step, strict=False)])
    shapes = [parameter.coordinate(parameter.start) for parameter in own[step.size :]]
    cut = min((abs(a / (share * b)) for a, b in zip(reached, step, strict=True) if share * b != 0.0), default=1.0)
    point = base.point.copy()
    kinds = np.array([parameter.target.kind == "parameter" for parameter in base.problem.free])
    point[~base.held] += share * min(cut, 1.0) * np.where(kinds[~base.held], found.follows(index), 0.0)
    return np.concatenate([point, reached, shapes])


def abrupt(candidate: Candidate, step: FloatArray) -> list[float]:
    """Shares of its step at which a law that is not smooth at zero has each of the amplitudes it is tried at."""
    if not step[0]:
        return []
    sizes = sorted({variant.sizes[0] for variant in candidate.variants}) if candidate.effect.amplitudes else []
    return [float(size / step[0]) for size in sizes]


def inside(coefficient: FreeParameter, step: float) -> float:
    """A coefficient where its score points, inside its bounds and by no more than half their width."""
    reach = 0.5 * (coefficient.upper - coefficient.lower)
    margin = 1e-6 * reach
    value = coefficient.start + float(np.clip(step, -reach, reach))
    return float(np.clip(value, coefficient.lower + margin, coefficient.upper - margin))


def refit_alone(
    trial: Trial,
    start: Sequence[float],
    ground: Ground,
    shapes: Variant | None = None,
    tried: int | None = None,
    worth: float | None = None,
    points: Sequence[FloatArray] = (),
    shares: Sequence[float] = STRIDES,
) -> Trial:
    """A vanishing candidate refitted on a model of its own, from a value of each coefficient on.

    ``tried`` counts what it was picked from, if that is not what the round tried. That of a stiff model is given up if
    it will not gain ``worth`` nats. ``points``: where to start instead of the optimum without the candidate, each (n,)
    of what is free there. ``shares`` of ``start`` are tried.
    """
    extended = build(trial.candidate.apply(ground.built.graph))
    filter_model = replace(ground.base.problem.filter_model, model=extended.model)
    own = coefficients(trial.candidate, filter_model, shapes)
    rest = [parameter.coordinate(parameter.start) for parameter in own[len(start) :]]
    usual = [ground.base.point] if filter_model.is_stiff else lowered_starts(ground.base, ground.quiet)
    starts = [
        np.concatenate([point, [inside(one, share * value) for one, value in zip(own, start, strict=False)], rest])
        for point, share in itertools.product(points or usual, shares)
    ]
    free = (*at_optimum(ground.base), *own)
    beat, reach = (ground.base.nll, -worth) if filter_model.is_stiff and worth is not None else (np.inf, WITHIN_REACH)
    fitted = fit(
        filter_model, ground.train, free, _MOST_ITERATIONS, _TOLERANCE, starts, beat, ground.journal, reach=reach
    )  # fmt: skip
    evidence = judge(ground.base, fitted, trial.candidate.effect, tried or ground.tried, trial.gate is not None)
    return replace(trial, built=extended, fit=fitted, evidence=evidence, failed="")
