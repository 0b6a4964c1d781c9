"""Formulas in a report: the law with its numbers, its name in other words, what the declared model had taken of it."""

from __future__ import annotations

from bondgraph.correct.loop import Added, ClosedLoop
from bondgraph.correct.round import Round
from bondgraph.correct.shapes.formula import formula_of
from bondgraph.correct.shapes.words import lies_in, other_words


def formula_rows(closed: ClosedLoop, added: Added) -> tuple[tuple[str, str], ...]:
    """Rows of the evidence of an effect that is a formula; none of a law of the dictionary."""
    candidate = added.trial.candidate
    formula = formula_of(candidate.function)
    if formula is None:
        return ()
    rows = [("law with its numbers", formula.text(closed.corrected.values))]
    known = other_words(formula, closed.corrected.values)
    if known:
        rows.append(("in other words", known))
    turn = round_of(closed, added)
    if turn is not None and added.trial.fit is not None:
        parts = lies_in(turn.base, added.trial.fit, closed.nominal_built.graph)
        rows += [(f"of it lay in {where}", amount) for where, amount in parts]
    return tuple(rows)


def round_of(closed: ClosedLoop, added: Added) -> Round | None:
    """The round that chose an effect, None of one that was added otherwise."""
    own = added.trial.candidate
    return next((one for one in closed.rounds if one.chosen is not None and one.chosen.candidate is own), None)
