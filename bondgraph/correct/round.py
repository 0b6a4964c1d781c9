"""One turn of the loop: every place and every candidate scored on a fitted model, the best refitted, a decision.

The scores cost one linearised pass of the filter. What they single out is refitted, since a score is right in direction
but not in size where an effect is large.
"""

from __future__ import annotations

import functools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bondgraph.build import BuiltModel
from bondgraph.correct.advice import separation
from bondgraph.correct.fits.fit import Fit, Report, no_report
from bondgraph.correct.fits.journal import Journal
from bondgraph.correct.fits.whiteness import is_white
from bondgraph.correct.models.absent import absent_when_zero
from bondgraph.correct.models.candidates import Candidate, Refused, candidates, places
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.models.untried import nothing_to_try, refused_everywhere
from bondgraph.correct.places.located import LocatedAt, locate
from bondgraph.correct.places.probes import Probe, Signal, probes, signals
from bondgraph.correct.refits.beneath import also_elsewhere, beneath_noise
from bondgraph.correct.refits.confirm import confirmed, transferred
from bondgraph.correct.refits.decide import alternatives, choose, detectable, hurdle
from bondgraph.correct.refits.declared_starts import also_from_declared, declared_scores
from bondgraph.correct.refits.gated_refits import also_throughout, gated_trials
from bondgraph.correct.refits.refit import Ground, refit_best, worth_quiet
from bondgraph.correct.refits.resolved import resolved
from bondgraph.correct.refits.rivals import rivals
from bondgraph.correct.refits.runoff import runoff
from bondgraph.correct.refits.simpler import also_simpler
from bondgraph.correct.refits.stiff_refits import ABREAST, refit_stiff
from bondgraph.correct.refits.storages import Look, look, refit_storage, try_storage
from bondgraph.correct.refits.trials import Alternative, Detectable, Trial
from bondgraph.correct.refits.widths import at_any_width, is_due
from bondgraph.correct.scores.gates import gate_samples
from bondgraph.correct.scores.quiet import Quiet, quiet_scores
from bondgraph.correct.scores.scoring import Linearisation, Scored, linearisation, score_candidates
from bondgraph.correct.shapes.offered import Residual, with_formulas
from bondgraph.data.log import MatchedLog
from bondgraph.declare.effect import EffectFunction, Place
from bondgraph.errors import DataError
from bondgraph.filter.compiled import in_threads

#: For so many of the effects that are not told from the chosen one it is said what would tell them apart.
_ADVISED = 3


@dataclass(frozen=True)
class RoundSettings:
    """The level of false alarms, how many refits at most, and the work's report and journal."""

    level: float = 0.01
    refits: int = 6
    report: Report = no_report
    journal: Journal = field(default_factory=Journal)


@dataclass(frozen=True, repr=False)
class Round:
    """What was tried on a fitted model, what was decided, and what could have been seen.

    ``located`` ranks the places; ``linear``, ``probed`` and ``signals`` are what the scores were made of. ``untried``
    says why no effect could be tried at all.
    """

    base: Fit
    trials: tuple[Trial, ...]
    refused: tuple[Refused, ...]
    scored: Scored
    chosen: Trial | None
    alternatives: tuple[Alternative, ...]
    detectable: tuple[Detectable, ...]
    located: tuple[LocatedAt, ...]
    linear: Linearisation
    probed: tuple[Probe, ...]
    signals: tuple[Signal, ...]
    tried: int
    untried: str = ""

    def __repr__(self) -> str:
        chosen = "nothing" if self.chosen is None else self.chosen.candidate.label
        return f"<Round {self.base.problem.filter_model.model.name}: {self.tried} tried, {chosen} chosen>"


def one_round(
    built: BuiltModel,
    base: Fit,
    train: Sequence[MatchedLog],
    functions: Sequence[EffectFunction],
    settings: RoundSettings | None = None,
    present: Collection[tuple[str, str]] = (),
) -> Round:
    """Locate the residual, score every candidate on the fitted model, refit the best, decide.

    Raises
    ------
    DataError
        If nothing moves in the logs.
    """
    settings = settings or RoundSettings()
    settings.report("score the candidates", 0, 1)
    linear = linearisation(base, train)
    where = _moving_places(built, base, linear, train)
    found, refused = candidates(built, functions, where, present)
    found, spoiling = absent_when_zero(built, found, train, linear.runs)
    refused += spoiling
    if not present and not [one for one in found if not one.place.output]:
        return _nothing_tried(built, base, linear, where, refused, nothing_to_try(where, functions, refused))
    vanishing = [one for one in found if not one.effect.adds_state]
    stateful = [one for one in found if one.effect.adds_state]
    scored = score_candidates(linear, vanishing, gate_samples(train))
    probed, known = probes(built, linear, where), signals(built, linear, where)
    located = locate(linear, probed, known)
    tried = scored.tests + sum(len(one.variants) for one in stateful)
    need = hurdle(train, tried, settings.level)
    settings.report("score the candidates", 1, 1)
    ground = Ground(built, base, tuple(train), tried, settings.level, need, settings.journal)
    trials = _trials(scored, tried)
    stiff = base.problem.filter_model.is_stiff
    quiet = None if stiff else quiet_scores(base, train, vanishing, settings.journal, gate_samples(train))
    ground = replace(ground, quiet=None if quiet is None else quiet.fit)
    looks = _looks(stateful, ground, settings, bool(present))
    first = _refitted_first(looks, trials, ground)
    ahead = 0.0 if first is None or choose([first], settings.level) is None else first.gain
    trials = (
        refit_stiff(trials, scored, ground, settings.refits, settings.report, ahead)
        if stiff
        else _refitted(trials, scored, ground, settings, quiet, bool(present))
    )
    trials = _with_storages(trials, stateful, linear, quiet, ground, settings, looks, first)
    if stiff:
        trials += gated_trials([(linear, scored)], ground, settings.report, ahead, most=1)
        trials, ground = beneath_noise(trials, scored, stateful, ground, settings.report)
        trials = _searched_again(trials, linear, ground, settings.report)
    else:
        looks_at = [(linear, scored), *(() if quiet is None else ((quiet.linear, quiet.scored),))]
        trials += gated_trials(looks_at, ground, settings.report)
    trials = with_formulas(trials, scored, Residual(built, linear, probed, known, located), ground, settings.report)
    trials, chosen = _chosen(rivals(trials, scored, ground), ground)
    others = alternatives(chosen, trials, scored.scores, settings.level)
    others = _with_advice(built, base, chosen, others, scored)
    seen, told = detectable(vanishing, scored.scores, need), (located, linear, probed, known, tried)
    return Round(base, tuple(trials), tuple(refused), scored, chosen, tuple(others), seen, *told)


def _refitted(
    trials: Sequence[Trial], scored: Scored, ground: Ground, settings: RoundSettings, quiet: Quiet | None, named: bool
) -> list[Trial]:
    """The trials, the best refitted from the fit without them, and while no effect is named from declared values."""
    done = refit_best(trials, scored, ground, settings.refits, settings.report, quiet)
    declared = None if named else declared_scores(ground, scored.candidates)
    return also_from_declared(done, declared, ground, settings.refits, settings.report)


def _searched_again(trials: Sequence[Trial], linear: Linearisation, ground: Ground, report: Report) -> list[Trial]:
    """The trials of a stiff model and what its scores underrate: the best law throughout, elsewhere, without a part."""
    found = also_elsewhere(also_throughout(trials, ground), linear, ground, report)
    return runoff(also_simpler(found, ground), ground, ABREAST)


def _chosen(trials: Sequence[Trial], ground: Ground) -> tuple[list[Trial], Trial | None]:
    """The trials, those that would be chosen after a second look at them, and the one that stays the best."""
    done, looked, widened = list(trials), set[int](), set[int]()
    while (best := choose(done, ground.level)) is not None:
        index = next(k for k, trial in enumerate(done) if trial is best)
        if index in looked:
            break
        if index not in widened and is_due(best, done, ground):
            widened.add(index)
            done = at_any_width(best, done, ground)
            continue
        sure = _second_look(best, ground)
        for k, trial in enumerate(done):
            if trial.candidate.label in sure.stands_for and trial.gate == sure.gate:
                done[k] = replace(trial, evidence=sure.evidence, transfer=sure.transfer)
        done[index] = sure
        looked.add(index)
    return done, best


def _second_look(best: Trial, ground: Ground) -> Trial:
    """The trial after a second look at its steps and its noise; where that fails it is not chosen."""
    assert best.evidence is not None  # it would be chosen
    doubted = replace(best, evidence=replace(best.evidence, p_robust=1.0))
    return attempted(lambda: _looked_at(best, ground), lambda why: replace(doubted, failed=why))


def _looked_at(best: Trial, ground: Ground) -> Trial:
    """The trial with steps that resolve it, and as long as it passes, after each costlier look."""
    sure = resolved(best, ground)
    for look_again in (confirmed, transferred):
        if sure.evidence is None or not sure.evidence.accepted(ground.level):
            break
        sure = look_again(sure, ground)
    return sure


def _with_advice(
    built: BuiltModel, base: Fit, chosen: Trial | None, others: Sequence[Alternative], scored: Scored
) -> list[Alternative]:
    """The alternatives, the first of those that are not told apart with what would tell them apart."""
    order = {(one.effect.name, one.place.label): j for j, one in enumerate(scored.candidates)}
    first = None if chosen is None else order.get((chosen.candidate.effect.name, chosen.candidate.place.label))
    done = list(others)
    if first is None:
        return done
    twins = [k for k, other in enumerate(others) if other.indistinguishable and (other.name, other.junction) in order]
    for k in twins[:_ADVISED]:
        second = order[others[k].name, others[k].junction]
        pair = [(scored.candidates[j], scored.variants[j]) for j in (first, second)]
        known = float(scored.scores.correlation[first, second])
        told = functools.partial(separation, built, base, pair[0], pair[1], known)
        done[k] = replace(others[k], separate=attempted(lambda told=told: str(told()), lambda why: ""))  # type: ignore[misc]
    return done


def _trials(scored: Scored, tried: int) -> list[Trial]:
    result = scored.scores
    corrected = np.minimum(1.0, result.p_value * tried)
    return [
        Trial(
            one, float(result.gain[j]), tuple(map(float, result.steps[j])), score_p=float(corrected[j]),
            failed=scored.failed.get(j, ""),
        )
        for j, one in enumerate(scored.candidates)
    ]  # fmt: skip


def _looks(stateful: Sequence[Candidate], ground: Ground, settings: RoundSettings, named: bool) -> dict[str, Look]:
    """By label: storages of a stiff model that nothing but a trial can test, at the size that suits the logs best.

    Only as long as no effect is named, and where innovations are not white: each has to be compiled.
    """
    due = [one for one in stateful if not one.followed]
    if not ground.base.problem.filter_model.is_stiff or named or not due or is_white(ground.base, ground.level):
        return {}
    found: dict[str, Look] = {}

    def work(k: int) -> None:
        trial = Trial(due[k], 0.0)
        found[due[k].label] = attempted(lambda: look(trial, ground), lambda why: Look.failed(trial, why))

    settings.report("look at storages", 0, len(due))
    in_threads(ABREAST, work, range(len(due)))
    settings.report("look at storages", len(due), len(due))
    return {one.label: found[one.label] for one in due}


def _refitted_first(looks: Mapping[str, Look], trials: Sequence[Trial], ground: Ground) -> Trial | None:
    """The storage that promises more than all scores, refitted: if it passes, few others are worth a refit."""
    best = max(looks.values(), key=lambda one: one.trial.score_gain, default=None)
    if best is None or best.trial.score_gain <= max((one.score_gain for one in trials), default=0.0):
        return None
    return best.trial.attempted(lambda: refit_storage(best, ground, np.inf))


def _with_storages(
    trials: list[Trial],
    stateful: Sequence[Candidate],
    linear: Linearisation,
    quiet: Quiet | None,
    ground: Ground,
    settings: RoundSettings,
    looks: Mapping[str, Look],
    first: Trial | None,
) -> list[Trial]:
    """The trials, and those with a state of their own; lags and late sensors only where their score asks for it.

    A sensor that comes late can explain coloured noise by its memory; its score is that of the mean alone. Storages of
    a stiff model go on from ``looks`` if these promise about as much as what is ahead; ``first`` is already refitted.
    """
    done = [*trials, *(() if first is None else (first,))]
    followed = score_candidates(linear, [one for one in stateful if one.followed])
    silent = None if quiet is None else quiet.of(followed.candidates)
    least = np.inf if quiet is None else worth_quiet(quiet.scored.scores, ground.need)
    stiff = ground.base.problem.filter_model.is_stiff
    known = dict(zip((one.label for one in followed.candidates), range(len(followed.candidates)), strict=True))
    for count, one in enumerate(stateful):
        settings.report("try storages", count, len(stateful))
        if first is not None and one.label == first.candidate.label:
            continue
        trial = Trial(one, 0.0)
        best = choose(done, ground.level)
        worth = max(0.5 * ground.need, 0.4 * (0.0 if best is None else best.gain))
        beat = np.inf if best is None or best.fit is None else best.fit.nll
        if one.followed:
            k = known[one.label]
            p_value = min(1.0, float(followed.scores.p_value[k]) * ground.tried)
            trial = Trial(
                one, float(followed.scores.gain[k]), tuple(map(float, followed.scores.steps[k])), score_p=p_value
            )
            loud = trial.score_gain >= worth and p_value <= ground.level
            if not loud and (silent is None or silent.scored.scores.gain[k] < least):
                done.append(trial)
                continue
        elif stiff:
            seen = looks.get(one.label)
            asked = seen is not None and seen.trial.score_gain >= worth
            done.append(trial if seen is None else _refitted_storage(seen, ground, beat) if asked else seen.trial)
            continue
        own = None if silent is None else (silent, known.get(one.label))
        done.append(trial.attempted(functools.partial(try_storage, trial, ground, beat, own)))
    return done


def _refitted_storage(seen: Look, ground: Ground, beat: float) -> Trial:
    return seen.trial.attempted(lambda: refit_storage(seen, ground, beat))


def _moving_places(built: BuiltModel, base: Fit, linear: Linearisation, train: Sequence[MatchedLog]) -> list[Place]:
    """The places at which something moves, see :func:`places`."""
    where = places(built, train, linear.runs, base.theta_of(built.model))
    if not [place for place in where if not place.output]:
        raise DataError(
            f"{built.graph.name}: nothing moves in the training logs at any junction, so no effect could show - take "
            "logs in which the machine works"
        )
    return where


def round_cautions(first: Round) -> list[str]:
    """What the first round of a loop could not try, every effect once, with its reason."""
    if first.untried:
        return [first.untried]
    known = [one.candidate for one in first.trials]
    tried = {name for one in known for name in (one.effect.name, one.function.__name__)}
    return refused_everywhere(first.refused, tried)


def _nothing_tried(
    built: BuiltModel,
    base: Fit,
    linear: Linearisation,
    where: Sequence[Place],
    refused: Sequence[Refused],
    why: str,
) -> Round:
    """A round in which no law has a place: faults of sensors alone would take the blame for what no law could say."""
    probed, known = probes(built, linear, where), signals(built, linear, where)
    located = locate(linear, probed, known)
    none = score_candidates(linear, [])
    return Round(base, (), tuple(refused), none, None, (), (), located, linear, probed, known, 0, why)
