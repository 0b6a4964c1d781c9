"""Given constants that are off: they are estimated where they explain as much as a law would.

A constant is declared without bounds because somebody measured it. Where it explains as much as the best law does, the
law is not believed, and the constant is no longer taken as it is: it is free around its declared value from there on,
and the search goes on beside it. It is given again where a law that is found later leaves it as it was.

A law may follow two small faults at once, and beat each of them: of a potter's wheel whose given inertia is 2 % off and
whose sensor is late a drag with a memory gained 111 nats, the inertia 92. So where constants explain most of what a
law does, a round is done beside them, and they come first if what that finds explains more with them than the law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bondgraph.correct.constants import INDIFFERENT, MOSTLY
from bondgraph.correct.evidence.certified import refined
from bondgraph.correct.evidence.given import (
    explained_by_given,
    moved_text,
    needless_constant,
    promising,
    with_fewest_free,
)
from bondgraph.correct.evidence.trials import Evidence, Trial
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.progress import Decision, OffConstant, Progress, rounds_done, standing
from bondgraph.correct.round import Round, RoundSettings, one_round
from bondgraph.declare.effect import EffectFunction
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.local import fit
from bondgraph.text import few, inflected


def with_off_constants(
    state: Progress, turn: Round, functions: Sequence[EffectFunction], settings: RoundSettings
) -> Progress:
    """The state with given constants free that explain as much as the best law of a round; the same where none do.

    So are those that explain more than it with what a round beside them finds. Laws that are in doubt beside them go.
    Of stiff models all constants stay: their rounds are costly.
    """
    best = max((one for one in turn.trials if one.given), key=lambda one: one.gain, default=None)
    if best is not None and (turn.chosen is None or turn.chosen.gain <= best.gain):
        return attempted(lambda: _freed(state, best, settings), lambda why: state)
    if turn.chosen is None or turn.chosen.evidence is None or state.fit.problem.filter_model.is_stiff:
        return state
    law, known = turn.chosen, turn.chosen.evidence
    return attempted(lambda: _ahead(state, law, known, functions, settings), lambda why: state)


def _ahead(
    state: Progress, law: Trial, known: Evidence, functions: Sequence[EffectFunction], settings: RoundSettings
) -> Progress:
    """The state with constants free, if these explain more than a law with what a round beside them finds."""
    told = explained_by_given(state.fit, max(MOSTLY * known.bic_gain, INDIFFERENT), settings.journal)
    if told is None:
        return state
    freed = _freed(state, law, settings)
    beside = one_round(freed.built, freed.fit, freed.train, functions, settings, freed.present, freed.added)
    found = None if beside.chosen is None else beside.chosen.evidence
    more = found is not None and told[2] + found.bic_gain > known.bic_gain + INDIFFERENT
    return freed if more else state


def _freed(state: Progress, law: Trial, settings: RoundSettings) -> Progress:
    """The state with the constants free that explain so much of what a law does, and the decision."""
    tried = promising(state.fit).constants
    found, constants = with_fewest_free(state.fit, tried, settings.journal)
    others = _as_good(state.fit, found, constants, tried, settings)
    fitted, check = refined(found, settings.journal, settings.substeps)
    number, names, gained = rounds_done(state) + 1, [one.name for one in constants], state.fit.nll - fitted.nll
    would = f"{law.candidate.label} would gain {law.gain:.1f}"
    why = f"{moved_text(fitted, constants)}; {inflected(names, 'gains', 'gain')} {gained:.1f} nats, {would}"
    made = [OffConstant(one.name, one.start, gained, would, others) for one in constants]
    freed = replace(
        state, fit=fitted, check=check, constants=(*state.constants, *made),
        history=(*state.history, Decision(number, "given constant", few(names), why)),
    )  # fmt: skip
    return standing(freed, [], f"beside {few(names)}", number, settings)


def without_needless_constants(state: Progress, settings: RoundSettings) -> Progress:
    """The state with constants as given again that the laws found since leave there, within chance."""
    while (spare := _needless(state)) is not None:
        free = tuple(one for one in at_optimum(state.fit) if one.name != spare)
        fitted = fit(replace(state.fit.problem, free=free), journal=settings.journal)
        fitted, check = refined(fitted, settings.journal, settings.substeps)
        left = fitted.nll - state.fit.nll
        why = f"beside what was found since, it gains {left:.1f} nats"
        state = replace(
            state, fit=fitted, check=check, constants=tuple(one for one in state.constants if one.name != spare),
            history=(*state.history, Decision(rounds_done(state), "as given", spare, why)),
        )  # fmt: skip
    return state


def _needless(state: Progress) -> str | None:
    """Name of the constant that is nearest to its given value, if that is within chance."""
    names = {one.name for one in state.constants}
    free = [one for one in state.fit.problem.free if one.name in names]
    given = {one.name: one.given for one in state.constants}
    spare = needless_constant(state.fit, [replace(one, start=given[one.name]) for one in free])
    return None if spare is None else spare.name


def _as_good(
    base: Fit,
    found: Fit,
    constants: Sequence[FreeParameter],
    tried: Sequence[FreeParameter],
    settings: RoundSettings,
) -> tuple[str, ...]:
    """Names of the constants each of which would do as well in the place of the one that is free."""
    if len(constants) != 1:
        return ()
    names = []
    for one in tried:
        if one.name != constants[0].name:
            other, _ = with_fewest_free(base, [one], settings.journal)
            names += [one.name] if other.nll < found.nll + INDIFFERENT else []
    return tuple(names)
