"""Given constants that are off: they are estimated where they explain as much as any law does.

A constant is declared without bounds because somebody measured it. Where it explains what a law would explain, the law
is not believed, and the constant is no longer taken as it is: it is free around its declared value from there on, and
the search goes on beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bondgraph.correct.constants import INDIFFERENT
from bondgraph.correct.evidence.certified import refined
from bondgraph.correct.evidence.given import moved_text, promising, with_fewest_free
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.progress import Decision, OffConstant, Progress, rounds_done, standing
from bondgraph.correct.round import Round, RoundSettings
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free import FreeParameter
from bondgraph.text import few


def with_off_constants(state: Progress, turn: Round, settings: RoundSettings) -> Progress:
    """The state with given constants free that explain as much as what explains most; the same where none do.

    Laws that are in doubt beside them go.
    """
    best = max((one for one in turn.trials if one.given), key=lambda one: one.gain, default=None)
    if best is None or (turn.chosen is not None and turn.chosen.gain > best.gain):
        return state
    return attempted(lambda: _freed(state, best.candidate.label, settings), lambda why: state)


def _freed(state: Progress, law: str, settings: RoundSettings) -> Progress:
    """The state with the constants free that explain as much as a law, and the decision."""
    tried = promising(state.fit).constants
    found, constants = with_fewest_free(state.fit, tried, settings.journal)
    others = _as_good(state.fit, found, constants, tried, settings)
    fitted, check = refined(found, settings.journal, settings.substeps)
    number, names = rounds_done(state) + 1, [one.name for one in constants]
    gained = state.fit.nll - fitted.nll
    why = f"{moved_text(fitted, constants)}; gains {gained:.1f} nats and explains as much as {law}"
    made = [OffConstant(one.name, one.start, law, others) for one in constants]
    freed = replace(
        state, fit=fitted, check=check, constants=(*state.constants, *made),
        history=(*state.history, Decision(number, "given constant", few(names), why)),
    )  # fmt: skip
    return standing(freed, [], f"beside {few(names)}", number, settings)


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
