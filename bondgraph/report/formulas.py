"""Formulas in a report: the law with its numbers, its name in other words, what the declared model had taken of it."""

from __future__ import annotations

from bondgraph.correct.evidence.trials import Added
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.round import Round
from bondgraph.correct.shapes.formula import formula_of
from bondgraph.correct.shapes.words import lies_in, other_words


def formula_sentences(closed: ClosedLoop) -> list[str]:
    """A sentence for every added effect that is a formula."""
    return [sentence for added in closed.added if (sentence := _sentence(closed, added))]


def _sentence(closed: ClosedLoop, added: Added) -> str:
    formula = formula_of(added.trial.candidate.function)
    if formula is None:
        return ""
    known = other_words(formula, closed.corrected.values)
    said = f"Formula at {formula.place.label}: {formula.text(closed.corrected.values)}"
    said += f", known as {known}" if known else ""
    turn = round_of(closed, added)
    if turn is not None and added.trial.fit is not None:
        parts = lies_in(turn.base, added.trial.fit, closed.nominal_built.graph)
        said += "".join(f"; {amount} of it had lain in {where}" for where, amount in parts)
    return f"{said}."


def round_of(closed: ClosedLoop, added: Added) -> Round | None:
    """The round that chose an effect, None of one that was added otherwise."""
    own = added.trial.candidate
    return next((one for one in closed.rounds if one.chosen is not None and one.chosen.candidate is own), None)
