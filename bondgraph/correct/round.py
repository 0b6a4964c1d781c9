"""One turn of the loop: every place and every candidate scored on a fitted model, the best refitted, a decision.

The scores cost one linearised pass of the filter. What they single out is refitted, since a score is right in direction
but not in size where an effect is large.
"""

from __future__ import annotations

import functools
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bondgraph.build import BuiltModel
from bondgraph.correct.advice import separation
from bondgraph.correct.constants import LEVEL, MOST_REFITS
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import detectable, hurdle
from bondgraph.correct.evidence.reasons import alternatives
from bondgraph.correct.evidence.trials import Alternative, Detectable, Trial
from bondgraph.correct.models.absent import absent_when_zero
from bondgraph.correct.models.candidates import Candidate, Refused, candidates, places
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.models.untried import nothing_to_try, refused_everywhere
from bondgraph.correct.places.located import LocatedAt, locate
from bondgraph.correct.places.probes import Probe, Signal, probes, signals
from bondgraph.correct.scores.gates import gate_samples
from bondgraph.correct.scores.scoring import Linearisation, Scored, linearisation, score_candidates
from bondgraph.correct.search.opening import Scoring, is_driven_still, look_beneath_noise, opened
from bondgraph.correct.search.search import Entry, Search, left_out, searched
from bondgraph.correct.selection import Selection
from bondgraph.correct.shapes.completions import stored_signals
from bondgraph.correct.shapes.offered import Residual, own_forms, with_formulas
from bondgraph.data.log import MatchedLog
from bondgraph.declare.effect import EffectFunction, Place
from bondgraph.errors import DataError
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import Report, no_report
from bondgraph.text import count, few

#: For so many of the effects that are not told from the chosen one it is said what would tell them apart.
_ADVISED = 3


@dataclass(frozen=True)
class RoundSettings:
    """The level of false alarms, how many refits at most, and the work's report and journal.

    ``level`` is that of the first law, see :meth:`beside`. ``substeps`` are the steps from which halvings are counted.
    """

    level: float = LEVEL
    refits: int = MOST_REFITS
    report: Report = no_report
    journal: Journal = field(default_factory=Journal)
    substeps: int | None = None

    def beside(self, laws: int) -> RoundSettings:
        """The settings of a round beside so many laws, k - 1: its level is that of the first round over k^2.

        So the chance of a false alarm in a whole loop stays below 1.65 times that of its first round, however long the
        loop goes on: the sum of 1/k^2. Forms of laws leave something that later rounds see, the more the more laws
        there are. Levels whose sum is bounded: DeMets and Lan (1994), Statistics in Medicine 13(13); the square is a
        convention.
        """
        return replace(self, level=self.level / (1 + laws) ** 2)


@dataclass(frozen=True, repr=False)
class Round:
    """What was tried on a fitted model, what was decided, and what could have been seen.

    ``located`` ranks the places; ``linear``, ``probed`` and ``signals`` are what the scores were made of. ``untried``
    says why no effect could be tried at all; ``left_out`` names candidates that might have been the best, had there
    been refits left.
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
    left_out: tuple[str, ...] = ()

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
    added: Sequence[Trial] = (),
) -> Round:
    """Locate the residual, score every candidate on the fitted model, refit the best, decide.

    ``added`` are the effects that the model has beside its declaration, events among them.

    Raises
    ------
    DataError
        If nothing moves in the logs.
    """
    settings = settings or RoundSettings()
    settings.report("score the candidates", 0, 1)
    linear = linearisation(base, train, [name for one in added for name in one.candidate.effect.parameters])
    where = _moving_places(built, base, linear, train)
    found, refused = candidates(built, functions, where, present)
    found, spoiling = absent_when_zero(built, found, train, linear.runs)
    refused += spoiling
    if not present and not _to_try(found, functions):
        return _nothing_tried(built, base, linear, where, refused, nothing_to_try(where, functions, refused))
    vanishing = [one for one in found if not one.effect.adds_state]
    stateful = [one for one in found if one.effect.adds_state]
    scored = score_candidates(linear, vanishing, gate_samples(train))
    probed, known = probes(built, linear, where), signals(built, linear, where)
    located = locate(linear, probed, known)
    tried = scored.tests + sum(len(one.variants) for one in stateful)
    need = hurdle(train, tried, settings.level)
    settings.report("score the candidates", 1, 1)
    formed = stored_signals(_laws(added), built.graph)
    level, steps = settings.level, settings.substeps
    context = Context(built, base, tuple(train), tried, level, need, settings.journal, None, steps, formed)
    scoring = Scoring(linear, scored, tuple(_trials(scored, tried)), tuple(stateful), tuple(where))
    search = opened(scoring, context, bool(present), settings.report)
    left = Residual(built, linear, probed, known, located, _laws(added))
    search.entries += [Entry(trial) for trial in own_forms(left.laws, scored, left, context, settings.report)]
    trials = with_formulas(_searched(search, scoring, settings), scored, left, search.context, settings.report)
    selection = Selection(search, trials, left, settings.report)
    chosen, trials = selection.chosen(settings.refits), selection.trials
    others = alternatives(chosen, trials, scored.scores, settings.level)
    others = _with_advice(built, base, chosen, others, scored)
    seen = detectable(vanishing, scored.scores, need, train, scored.unseen)
    return Round(
        base,
        tuple(trials),
        tuple(refused),
        scored,
        chosen,
        tuple(others),
        seen,
        located,
        linear,
        probed,
        known,
        tried,
        left_out=tuple(left_out(search)),
    )


def _searched(search: Search, scoring: Scoring, settings: RoundSettings) -> list[Trial]:
    """The trials, refitted as far as they could be the best, also by what shows with little process noise only.

    The fit with little process noise costs little where a model is not stiff; of a stiff model it is the costly part of
    a round, and looked at where what leads still needs noise that drives a state.
    """
    if not search.context.base.problem.filter_model.is_stiff:
        look_beneath_noise(search, scoring, settings.report)
        return searched(search, settings.refits, settings.report)
    trials = searched(search, settings.refits - settings.refits // 3, settings.report)
    if not is_driven_still(search):
        return trials
    look_beneath_noise(search, scoring, settings.report)
    return searched(search, settings.refits, settings.report)


def _with_advice(
    built: BuiltModel, base: Fit, chosen: Trial | None, others: Sequence[Alternative], scored: Scored
) -> list[Alternative]:
    """The alternatives, the first of those that are not told apart with what would tell them apart."""
    order = {(one.effect.name, one.place.label): j for j, one in enumerate(scored.candidates)}
    first = None if chosen is None else order.get((chosen.candidate.effect.described, chosen.candidate.place.label))
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


def _laws(added: Sequence[Trial]) -> list[Trial]:
    """Effects that were added to the declaration: everything but events."""
    return [one for one in added if one.gate is None]


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


def _to_try(found: Sequence[Candidate], functions: Sequence[EffectFunction]) -> bool:
    """True where something can be tried in the machine itself, or at its sensors if nothing else was asked for."""
    of_sensors = all(getattr(one, "for_sensors", False) for one in functions)
    return any(of_sensors or not one.place.output for one in found)


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
    """Effects that the first round of a loop could not try, each once, with its reason."""
    if first.untried:
        return [first.untried]
    known = [one.candidate for one in first.trials]
    tried = {name for one in known for name in (one.effect.name, one.function.__name__)}
    return refused_everywhere([one for one in first.refused if not one.shipped], tried)


def unsearched(rounds: Sequence[Round], refits: int, white: bool = False) -> list[str]:
    """A sentence on each round that ended before all candidates were refitted that might have been the best.

    ``refits`` is how many a round was granted. Where innovations are ``white`` in the end, a round that chose nothing
    missed nothing.
    """
    more = 2 * refits
    return [
        f"round {number} ended with its {count(refits, 'refit')} spent: {few(list(one.left_out))} might have done "
        f"better - grant more with --refits {more}, in Python LoopSettings(refits={more}), or leave others out with "
        "--without"
        for number, one in enumerate(rounds, start=1)
        if one.left_out and not (white and one.chosen is None)
    ]


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
