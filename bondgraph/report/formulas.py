"""Formulas in a report: the law with its numbers, its name in other words, which parameters had stood in for it."""

from __future__ import annotations

from dataclasses import replace

from bondgraph.correct.evidence.bounds import value_text
from bondgraph.correct.evidence.trials import Added, Alternative, Trial
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.result import departs, form_text, holds_declared, intervals
from bondgraph.correct.round import Round
from bondgraph.correct.shapes.formula import formula_of
from bondgraph.correct.shapes.words import moved_parameters, other_words
from bondgraph.report.letters import softens
from bondgraph.report.regimes import named
from bondgraph.report.words import law_at, law_title


def headline_name(closed: ClosedLoop, added: Added) -> str:
    """An added law as a headline names it: a formula is written, a law of the dictionary called by its name.

    Of a law that has a form of its own it is said how far that is from its name; of a sum of laws each is named.
    """
    formula, laws = formula_of(added.trial.candidate.function), _laws_of(added.trial)
    if len(laws) > 1:
        return f"the sum of {', '.join(laws[:-1])} and {laws[-1]} at {added.trial.candidate.place.label}"
    turned = ", which softens" if _turns_round(added, closed) else ""
    if added.trial.forms:
        own, away = law_title(named(added, closed.corrected)) + turned, _percent_away(added, closed)
        return f"{own} in a form of its own{f', {away} % from it' if away else ''}"
    if formula is None:
        return law_title(named(added, closed.corrected)) + turned
    return f"formula ({formula.text(closed.corrected.values)}) at {formula.place.label}"


def _turns_round(added: Added, closed: ClosedLoop) -> bool:
    """True for a law that is called stiffening and softens."""
    effect, values = added.trial.candidate.effect, closed.corrected.values
    return bool(effect.coefficients) and softens(effect.name, values.get(effect.coefficients[0], 0.0))


def _laws_of(law: Trial) -> list[str]:
    """Names of the laws of the dictionary that a form is the sum of, each once."""
    parts = [one.candidate for one in law.forms if formula_of(one.candidate.function) is None]
    return list(dict.fromkeys(law_title(one.effect.name) for one in parts))


def _percent_away(added: Added, closed: ClosedLoop) -> int:
    """How far a form of its own is from the law that names it, in percent; none where nobody can say."""
    away = departs(added, closed)
    return 0 if away is None else round(100.0 * away)


def formula_sentences(closed: ClosedLoop) -> list[str]:
    """Sentences for every added effect that is a formula, or has a form of its own."""
    found = [sentence for added in closed.added if (sentence := _sentence(closed, added))]
    return [*found, *(sentence for added in closed.added if (sentence := _own_form(closed, added)))]


def _sentence(closed: ClosedLoop, added: Added) -> str:
    formula = formula_of(added.trial.candidate.function)
    if formula is None or added.trial.forms:
        return ""
    values = closed.corrected.values
    known = other_words(formula, values)
    said = f"Formula at {formula.place.label}: {formula.text(values, intervals(closed.corrected))}"
    said += f", known as {known}" if known else ""
    turn = round_of(closed, added)
    if turn is not None and added.trial.fit is not None:
        after = closed.corrected if len(closed.added) == 1 else added.trial.fit
        moved = moved_parameters(turn.base, after, closed.nominal_built.graph)
        said += "".join(f"; beside it {name} is {now}, {before} without" for name, now, before in moved)
    return f"{said}."


def _own_form(closed: ClosedLoop, added: Added) -> str:
    """Sentence on a form of a law's own, and how far it is from its name; empty without one."""
    law = added.trial
    if not law.forms:
        return ""
    text, share, laws = form_text(added, closed), _percent_away(added, closed), _laws_of(law)
    text = f"{text}; the declared law is a part of it" if text and holds_declared(added, closed) else text
    if len(laws) > 1 and text:
        whole = f"Of {', '.join(laws[:-1])} and {laws[-1]} at {law.candidate.place.label} these logs tell the sum alone"
        return f"{whole}: {text}."
    said = f"{law_title(law.candidate.label)} has a form of its own: "
    said += text or " and ".join(f"{law_title(one.candidate.effect.name)} ({_law(closed, one)})" for one in law.forms)
    first = law.forms[0].candidate.effect.name
    far = f"; over the logs no {law_title(first)} comes nearer to it than {share} %" if share else ""
    return f"{said}{far}."


def _law(closed: ClosedLoop, part: Trial) -> str:
    """The law of a part of a form; of a formula with its numbers, inner ones among them."""
    formula = formula_of(part.candidate.function)
    if formula is None:
        return part.candidate.effect.law
    return formula.text(closed.corrected.values, intervals(closed.corrected))


def round_of(closed: ClosedLoop, added: Added) -> Round | None:
    """The round that chose an effect, None of one that was added otherwise."""
    own = (added.trial.candidate.label, added.trial.simplifies)
    return next((one for one in closed.rounds if one.chosen is not None and one.chosen.candidate.label in own), None)


def twins(closed: ClosedLoop, added: Added) -> list[Alternative]:
    """Effects that the data do not tell from one that was added.

    Where one took the place of a law with more coefficients, it shows wherever that did. The same law between two
    levels, where it was found below one, is none of them: it is the law that was found.
    """
    turn, own, first = round_of(closed, added), added.trial.candidate, added.trial.simplifies.partition(" at ")[0]
    found = [] if turn is None else [one for one in turn.alternatives if one.indistinguishable]
    found = [replace(one, name=own.effect.described) if one.name == first else one for one in found]
    labels = (*(added.trial.stands_for if first else ()), *added.trial.rivals)
    known = {f"{one.name} at {one.junction}" for one in found}
    alike = [label.partition(" at ") for label in labels if label not in known]
    found += [Alternative(name, at, added.trial.gain, True, "it does as well in its place") for name, _, at in alike]
    itself = _without_side(own.effect.described, own.place.label)
    return [one for one in found if _without_side(one.name, one.junction) != itself]


def with_size(closed: ClosedLoop, added: Added, twin: Alternative) -> str:
    """A law that the data do not tell from one that was added, with its numbers where it was refitted in its place."""
    said, turn = law_at(twin.name, twin.junction), round_of(closed, added)
    label = (twin.name, twin.junction)
    for trial in () if turn is None else turn.trials:
        effect = trial.candidate.effect
        if trial.fit is not None and (effect.described, trial.candidate.place.label) == label:
            told = [
                f"{name} = {value_text(trial.fit, name)}" for name in effect.parameters if name not in effect.widths
            ]
            return f"{said} ({', '.join(told)})" if told else said
    return said


def _without_side(name: str, junction: str) -> tuple[str, str, str]:
    """A law, its place and the quantity that says where it acts, by whatever levels."""
    law, _, regime = name.partition(" where ")
    return law, regime.partition(" is ")[0], junction
