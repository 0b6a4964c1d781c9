"""Laws that pass the tests only together: each of them is what colours the errors beside the other.

The scatter of a coefficient over blocks of time, by which a law is told from noise of another colour, stays large as
long as something else is missing. Of a cell that polarises and whose resistance follows its temperature the second
effect gained 716 nats, and was not told from zero in free simulation; so did the first beside an event. So where no law
passes that acts throughout, the one that gains most is taken on trial, and a round is done beside it. Both stay where
each passes every test beside the other, and is told from zero by channels whose innovations could be white then.
Otherwise nothing was learnt. What given constants explain as well is no law, on trial or beside another one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bondgraph.correct.evidence.confirm import is_clear
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import judge, preferred_gain, robust_p_value
from bondgraph.correct.evidence.given import beside_given
from bondgraph.correct.evidence.reasons import alternatives
from bondgraph.correct.evidence.transfer import transfer
from bondgraph.correct.evidence.trials import Evidence, Trial
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.progress import Decision, Progress, advance, reduced_to
from bondgraph.correct.round import Round, RoundSettings, one_round
from bondgraph.correct.shapes.formula import formula_of
from bondgraph.correct.small_rests import weighed
from bondgraph.declare.effect import EffectFunction
from bondgraph.estimate.local import fit


def two_laws(
    state: Progress, turn: Round, functions: Sequence[EffectFunction], settings: RoundSettings
) -> tuple[Progress, tuple[Round, Round]] | None:
    """The state with two laws that pass the tests together, and the rounds that chose them; None without any.

    None where the round chose a law that acts throughout, and of stiff models, whose rounds are costly.
    """
    lead = _on_trial(turn, settings.level)
    if lead is None or state.fit.problem.filter_model.is_stiff or weighed(lead, state.laws, state.fit).small:
        return None
    return attempted(lambda: _together(state, turn, lead, functions, settings), lambda why: None)


def _together(
    state: Progress, turn: Round, lead: Trial, functions: Sequence[EffectFunction], settings: RoundSettings
) -> tuple[Progress, tuple[Round, Round]] | None:
    """The state with a law on trial and the one that a round finds beside it, if both pass."""
    begun = advance(state, replace(turn, chosen=lead), settings)
    if not any(one.candidate.label == lead.candidate.label for one in begun.laws):
        return None
    second = one_round(begun.built, begun.fit, begun.train, functions, settings.beside(1), begun.present, begun.added)
    if second.chosen is None or second.chosen.gate is not None or second.chosen.candidate.effect.channel:
        return None
    both = advance(begun, second, settings)
    labels = (lead.candidate.label, second.chosen.candidate.label)
    for label in labels:
        law = _law(both, label)
        sure = None if law is None else _proven(both, law, settings)
        if law is None or sure is None:
            return None
        both = replace(both, added=tuple(sure if one is law else one for one in both.added))
    first = _law(both, labels[0])
    assert first is not None and first.evidence is not None  # it was proven
    told = Decision(
        begun.history[len(state.history)].round, "added", labels[0],
        f"gains {first.evidence.delta_nll:.1f} nats beside {labels[1]}, p = {first.p_value:.2g} over "
        f"{first.evidence.tried} tried; without that it does not pass",
    )  # fmt: skip
    history = [*both.history]
    history[len(state.history)] = told
    others = alternatives(lead, turn.trials, turn.scored.scores, settings.level)
    return replace(both, history=tuple(history)), (replace(turn, chosen=lead, alternatives=tuple(others)), second)


def _law(state: Progress, label: str) -> Trial | None:
    """A law of a state by its label, or the one of which it became a part."""
    return next((one for one in state.laws if label in {part.candidate.label for part in (one, *one.forms)}), None)


def _on_trial(turn: Round, level: float) -> Trial | None:
    """The law that gains most where no law was chosen, if all that speaks against it is what stays unexplained."""
    if turn.chosen is not None and turn.chosen.gate is None:
        return None
    least = preferred_gain(turn.chosen) if turn.chosen is not None else 0.0
    found = [
        one
        for one in turn.trials
        if one.fit is not None
        and one.built is not None
        and one.gate is None
        and not one.given
        and not one.candidate.effect.channel
        and not one.candidate.effect.regime
        and not formula_of(one.candidate.function)
        and preferred_gain(one) > least
        and one.evidence is not None
        and one.evidence.p_value < level <= one.evidence.p_robust
        and _is_told(one, one.evidence, level)
    ]
    return max(found, key=preferred_gain, default=None)


def _is_told(trial: Trial, evidence: Evidence, level: float) -> bool:
    """True for a law whose own scatter tells it from zero, whatever colours the innovations."""
    assert trial.fit is not None  # it was refitted
    effect = trial.candidate.effect
    return robust_p_value(trial.fit, effect.coefficients, effect.shapes) * evidence.tried < level


def _proven(state: Progress, law: Trial, settings: RoundSettings) -> Trial | None:
    """A law of a state with its evidence beside all others, None where it fails a test there."""
    reduced = reduced_to(state, [one for one in state.added if one is not law])
    if reduced.baseless or law.evidence is None:
        return None
    bare = fit(reduced.problem, journal=settings.journal)
    evidence = judge(bare, state.fit, law.candidate.effect, law.evidence.tried)
    if not (evidence.accepted(settings.level) and is_clear(state.fit, evidence, law.candidate, settings.level)):
        return None
    there = replace(law, evidence=evidence, fit=state.fit, built=state.built)
    if weighed(there, [one for one in state.laws if one is not law], bare).small:
        return None
    moved = transfer(bare, state.fit, law.candidate.effect)
    if not moved.passes:
        return None
    without = Context(
        reduced.built, bare, reduced.problem.logs, evidence.tried, settings.level, 0.0, settings.journal
    )  # fmt: skip
    return None if beside_given(there, without).given else replace(law, evidence=evidence, transfer=moved)
