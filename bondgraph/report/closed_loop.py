"""Values of the report of a closed loop, and the text that a terminal is told of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from bondgraph.correct.cautions import resting
from bondgraph.correct.constants import LEVEL
from bondgraph.correct.evidence.bounds import value_text
from bondgraph.correct.evidence.replaced import beyond_declared
from bondgraph.correct.evidence.transfer import Transfer
from bondgraph.correct.evidence.trials import Added
from bondgraph.correct.fits.assess import Assessment
from bondgraph.correct.fits.rates import with_notes_of_used_rates
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.result import form_text, intervals
from bondgraph.estimate.fitted import Fit
from bondgraph.filter.misfit import p_text
from bondgraph.report.collect import Runs, added_nodes, channel_series, found_effect, parameter_changes
from bondgraph.report.drawing import drawing_of
from bondgraph.report.formulas import formula_sentences, headline_name, twins, with_size
from bondgraph.report.html import Located, Provenance, ReportData
from bondgraph.report.logs import grouped_notes
from bondgraph.report.missing import missing_efforts
from bondgraph.report.noise import idle, noise_sentence
from bondgraph.report.numbers import shown, with_ends
from bondgraph.report.regimes import regime_sentences
from bondgraph.report.series import ChannelSeries, FoundEffect, Power, Step, channel_errors
from bondgraph.report.standing import driven_at_random, held_out, worse_simulated
from bondgraph.report.tables import error_table, power_table, text_of
from bondgraph.report.tried import tried
from bondgraph.report.unknown import shape_sentence
from bondgraph.report.words import law_at, law_title, told_apart_by
from bondgraph.text import few, inflected, number, sentence


def report_data(
    closed: ClosedLoop, result: Mapping[str, Any], made: Provenance, said: Sequence[str] = ()
) -> ReportData:
    """The report of a closed loop as plain values."""
    model = closed.corrected_built.model
    series = all_series(closed)
    ci95 = intervals(closed.corrected)
    return ReportData(
        title=closed.nominal_built.graph.name,
        verdict=closed.verdict,
        explanation=explanation(closed),
        effects=tuple(found_effects(closed)),
        errors=channel_errors(series),
        series=series,
        drawing=drawing_of(closed.corrected_built.causal),
        added=added_nodes(closed.nominal_built.graph, closed.corrected_graph),
        missing=missing_efforts(closed),
        located=tuple(Located(at.junction, at.variable, at.p_value, at.share) for at in closed.rounds[0].located[:8]),
        alternatives=tuple(tried(closed)),
        parameters=parameter_changes(
            model,
            _declared(closed) | dict(closed.nominal.values),
            closed.corrected.values,
            ci95,
            resting(closed.corrected),
        ),
        power=tuple(_power(closed)),
        history=tuple(Step(one.round, one.action, one.what, one.why) for one in closed.history),
        structure=tuple(structure_lines(closed)),
        notes=(*said, *_notes(closed)),
        made=made,
    )


def _declared(closed: ClosedLoop) -> dict[str, float]:
    """Values of all parameters of the declared model."""
    return {info.name: info.value for info in closed.nominal_built.model.parameters}


def all_series(closed: ClosedLoop) -> tuple[ChannelSeries, ...]:
    """Measured and predicted channels of all logs, before and after; their noise with what of it has a memory."""
    pairs = (
        (closed.nominal_train, closed.corrected_train, False),
        (closed.nominal_holdout, closed.corrected_holdout, True),
    )
    coloured = {one.trial.candidate.effect.channel: one.size for one in closed.disturbances if not one.period}
    return tuple(one for before, after, held_out in pairs for one in _series(before, after, held_out, coloured))


def _series(
    before: Assessment, after: Assessment, held_out: bool, coloured: Mapping[str, float]
) -> list[ChannelSeries]:
    found: list[ChannelSeries] = []
    for first, last in zip(before.logs, after.logs, strict=True):
        infos = {info.name: info for info in last.simulated.model.outputs}
        noise = {
            name: math.hypot(error.noise_std, float(infos[name].coherent(coloured.get(name, 0.0))))
            for name, error in last.channels.items()
        }
        runs = Runs(first.filtered, first.simulated), Runs(last.filtered, last.simulated)
        found += channel_series(last.simulated.model, first.log, *runs, noise, held_out)
    return found


def found_effects(closed: ClosedLoop) -> list[FoundEffect]:
    """The added effects with their coefficients and evidence."""
    ci95 = intervals(closed.corrected)
    effects = []
    for added in closed.added:
        candidate, evidence = added.trial.candidate, added.trial.evidence
        assert evidence is not None
        said = (
            ("gain of log-likelihood", f"{shown(evidence.delta_nll)} nats"),
            ("p, likelihood ratio", p_text(evidence.p_value).removeprefix("p ").removeprefix("= ")),
            ("p, block-robust", p_text(evidence.p_robust).removeprefix("p ").removeprefix("= ")),
            ("candidates tried", str(evidence.tried)),
            *_transfer(added.trial.transfer),
            *([("completes the form of", added.completes)] if added.completes else []),
        )
        model, effect = closed.corrected_built.model, candidate.effect
        text = form_text(added, closed) if added.trial.forms else None
        effect = effect if text is None else replace(effect, law=text)
        effects.append(found_effect(effect, candidate.place, model, closed.corrected.values, ci95, said))
    return effects


def _transfer(told: Transfer | None) -> tuple[tuple[str, str], ...]:
    """What an effect gains in parts of the training data that it was not estimated from, as rows of its evidence."""
    if told is None:
        return ()
    folds = "; ".join(f"{name}: {gain:+.3g}" for name, gain in zip(told.folds, told.gains, strict=True))
    whole = f"{shown(told.gain)} ± {shown(told.error)} nats ({p_text(told.p_value)})"
    alone = [("no fold, since it alone tells most of it", "; ".join(told.untested))] if told.untested else []
    return ("transfer to data left out", whole), ("transfer by fold, nats", folds), *alone


#: Advice where something is a function of a signal that nothing explains.
_AS_A_TABLE = " As a table whose points are estimated it can be added: --tables, in Python LoopSettings(tables=True)."


def explanation(closed: ClosedLoop) -> str:
    """The verdict in a few sentences."""
    disturbances = (f"{one}." for one in closed.disturbances)
    simulated = *worse_simulated(closed), *driven_at_random(closed)
    return " ".join((_explained(closed), *_off(closed), *on_bounds(closed), *disturbances, *simulated))


def on_bounds(closed: ClosedLoop) -> list[str]:
    """A sentence on declared parameters that rest on bounds beside what was found, which may stand in for them.

    Of those whose elements a law takes the place of another sentence is told.
    """
    left = beyond_declared(closed.nominal, closed.corrected)
    known = [name for name in closed.nominal.problem.names if name not in left]
    names = [name for name in resting(closed.corrected) if name in known]
    if not (closed.added and names):
        return []
    rests, forbids = inflected(names, "rests on its bound", "rest on their bounds"), inflected(names, "this", "these")
    return [
        f"But {', '.join(names)} {rests} beside it: what was found may make good for what {forbids} "
        f"{inflected(names, 'bound forbids', 'bounds forbid')}."
    ]


def _off(closed: ClosedLoop) -> list[str]:
    """A sentence for each given constant that is off, with those that would do as well in its place."""
    fitted, model, said = closed.corrected, closed.corrected_built.model, []
    for one in closed.constants:
        info = model.parameters[model.index("parameter", one.name)]
        unit = "" if info.display_unit in ("", "1") else f" {info.display_unit}"
        told = f"{value_text(fitted, one.name)} fits better than the given {number(info.shown(one.given))}{unit}"
        others = f" (or {few(list(one.others))} is, which these data do not tell apart)" if one.others else ""
        said.append(f"The given {one.name} seems to be off{others}: {told} ({one.gain:.0f} nats; {one.would}).")
    return said


def _explained(closed: ClosedLoop) -> str:
    """The verdict but for disturbances."""
    tried = closed.rounds[0].tried if closed.rounds else 0
    left = [
        f"an unknown {one.variable} at {one.place.label} as a function of {one.signal}" for one in closed.unexplained
    ]
    if closed.added:
        names = ", then ".join(_or_twins(closed, added) for added in closed.added if not added.completes)
        if closed.verdict == "effect not confirmed":
            assert closed.confirmation is not None  # it is what contradicts
            against = "; ".join(closed.confirmation.contradictions)
            first = f"The training logs ask for {names}, but the logs contradict that correction: {against}."
        elif closed.verdict == "sensor fault suspected":
            faults = [added.trial.candidate.effect for added in closed.added]
            said = " and ".join(
                f"{'an' if fault.kind[0] in 'aeiou' else 'a'} {fault.kind} of the sensor {fault.channel}"
                for fault in faults
            )
            first = f"What the sensors show fits together if there is {said}; no missing effect explains it as well."
        else:
            first = f"The declared model lacks {names}{_and_more(closed)}. The search ended because {closed.reason}."
        first += _completing(closed.added)
        return first + (f" There remains {left[0]} that no known effect explains." if left else "")
    coloured = _coloured(closed)
    if closed.events:
        what = " and ".join(f"{law_title(one.trial.candidate.label)} {one.trial.gate}" for one in closed.events)
        rest = f" There remains {left[0]}." if left else ""
        return f"Something happened in the logs ({what}); no law that holds throughout passes the tests.{rest}"
    if left:
        table = "" if closed.unexplained[0].signal == "time" else _AS_A_TABLE
        return f"There is {left[0]} that none of the {tried} effects and faults tried explains.{table}"
    if closed.verdict == "unexplained residual" and not coloured and closed.unproven is not None:
        told = f"{law_title(closed.unproven.candidate.label)} passes the tests ({closed.unproven.gain:.1f} nats)"
        return f"Something is missing: {told}, but what it is cannot be told; see what was tried for the reason."
    if closed.verdict == "unexplained residual":
        return _correlated(closed, coloured, tried)
    if closed.verdict == "disturbance":
        none = f"none of the {tried} effects and faults tried passes the tests beside a disturbance"
        return f"No law was found: {none}."
    if not tried:
        return "No effect could be tried. All innovations are white: they ask for none."
    enough = " and moves a sensor enough to be told" if any(one.small for one in closed.rounds[-1].trials) else ""
    return f"None of the {tried} effects and faults tried passes the tests{enough}, and all innovations are white."


def _correlated(closed: ClosedLoop, coloured: Sequence[str], tried: int) -> str:
    chance = min(test.p_value for test in closed.whiteness) * len(closed.whiteness)
    return (
        f"The innovations of {', '.join(coloured)} are correlated in time ({p_text(chance)}): something is missing, or "
        f"the noise of the sensor is coloured. None of the {tried} effects and faults tried explains it well enough to "
        "be believed."
    )


def _or_twins(closed: ClosedLoop, added: Added) -> str:
    """An effect with those that the data do not tell from it."""
    own, others = headline_name(closed, added), twins(closed, added)
    if not others:
        return own
    if len(others) == 1:
        return f"{own} or {law_at(others[0].name, others[0].junction)}, which these data do not tell apart"
    return f"{own} or one of {len(others)} others that these data do not tell from it"


def _completing(added: Sequence[Added]) -> str:
    """A sentence for each law that others complete."""
    told = ""
    for first in dict.fromkeys(one.completes for one in added if one.completes):
        names = [law_title(one.trial.candidate.label) for one in added if one.completes == first]
        complete = inflected(names, "completes", "complete")
        told += f" {' and '.join(names)} {complete} the form of {law_title(first)}: the logs tell only their sum."
    return told


def _and_more(closed: ClosedLoop) -> str:
    """That the effects that were found may leave more than noise; the reason of the end names the channels."""
    return ", and perhaps more" if _coloured(closed) else ""


def _coloured(closed: ClosedLoop) -> list[str]:
    return [test.channel for test in closed.whiteness if test.p_value * len(closed.whiteness) < LEVEL]


def structure_lines(closed: ClosedLoop) -> list[str]:
    """What these sensors can tell apart at all, as sentences."""
    told = closed.structure
    sensors = f"the {inflected(told.sensors, 'sensor', 'sensors')} {', '.join(told.sensors)}"
    groups = "; ".join(" = ".join(group) for group in told.classes)
    lines = [
        f"By the structure of the model, before any measurement: with {sensors} an unknown at these places shows in "
        f"the same way, so that only its law can tell them apart: {groups}." if groups
        else f"By the structure of the model, {sensors} can tell an unknown at every place from one at every other"
        f"{'; what these logs tell apart stands beside each effect' if closed.added else ''}."
    ]  # fmt: skip
    if told.invisible:
        lines.append(f"No sensor sees what is missing at {', '.join(told.invisible)}.")
    return [*lines, *(f"{one}." for one in told.sums)]


def _power(closed: ClosedLoop) -> list[Power]:
    return [Power(one.effect, one.junction, one.size, one.unit) for one in closed.detectable]


def _notes(closed: ClosedLoop) -> list[str]:
    notes = []
    if closed.confirmation is not None and closed.corrected_holdout.logs:
        notes.append(held_out(closed, closed.confirmation))
    beside = ", and has what was estimated beside it" if closed.added else ""
    notes += [_event(one, closed.eventful or closed.corrected, beside) for one in closed.events]
    notes += [*_moved_by_events(closed), *_nearest(closed)]
    for added in closed.added:
        others = twins(closed, added)
        if others:
            names = few([with_size(closed, added, twin) for twin in others])
            first = next((twin.separate for twin in others if twin.separate), "")
            advice = f" {told_apart_by(first)}" if first else ""
            notes.append(f"These data do not tell {law_title(added.trial.candidate.label)} from {names}.{advice}")
    notes += [
        *regime_sentences(closed),
        *formula_sentences(closed),
        *(shape_sentence(one) for one in closed.unexplained),
    ]
    notes.append(f"{noise_sentence(closed.corrected.problem.filter_model, idle(closed.corrected))}.")
    own = _names(closed)
    notes += [sentence(one, own) for one in closed.cautions]
    logs = [log.log for part in (closed.nominal_train, closed.nominal_holdout) for log in part.logs]
    return notes + grouped_notes(with_notes_of_used_rates(logs, closed.corrected_built.equations))


def _names(closed: ClosedLoop) -> set[str]:
    """Names of the machine and of its logs, which a sentence may begin with."""
    model, logs = closed.corrected_built.model, [*closed.nominal_train.logs, *closed.nominal_holdout.logs]
    signals = (*model.names("state"), *model.names("input"), *model.names("output"))
    elsewhere = (*closed.nominal_built.graph.flatten().nodes, *(one.log.name for one in logs))
    return {*signals, *model.names("parameter"), *elsewhere}


def _event(event: Added, fitted: Fit, beside: str) -> str:
    """A sentence on what happened in a log, when, and how large it was; ``beside``: what the declaration has of it."""
    trial, (name, *_) = event.trial, event.coefficients
    info = fitted.problem.filter_model.model.parameters[
        fitted.problem.filter_model.model.index("parameter", name)
    ]  # fmt: skip
    low, high = intervals(fitted)[name]
    size = with_ends(info.shown(fitted.values[name]), (info.shown(low), info.shown(high)), info.display_unit)
    return (
        f"Event: {law_title(trial.candidate.label)} acts {trial.gate} ({name} = {size}, {shown(trial.gain)} nats). "
        f"Time is no law: the corrected declaration does not have it{beside}."
    )


def _moved_by_events(closed: ClosedLoop) -> list[str]:
    """A sentence on parameters that a fit without the events has clearly elsewhere than one that knows of them."""
    fitted = closed.eventful
    if not closed.events or closed.added or fitted is None:
        return []
    model, told = closed.nominal.problem.filter_model.model, []
    for name, (low, high) in intervals(fitted).items():
        known = name in closed.nominal.values and name in model.names("parameter")
        if known and not low <= closed.nominal.values[name] <= high:
            info = model.parameters[model.index("parameter", name)]
            ends = (info.shown(low), info.shown(high))
            told.append(f"{name} = {with_ends(info.shown(fitted.values[name]), ends, info.display_unit)}")
    where = inflected(closed.events, "the event", "the events")
    return [f"A fit that knows of {where} has {', '.join(told)}: the other estimates make up for it."] if told else []


def _nearest(closed: ClosedLoop) -> list[str]:
    """A sentence on what comes nearest to an explanation where nothing was believed, and why it was not."""
    if closed.verdict != "unexplained residual" or closed.added or closed.events:
        return []
    turn = closed.rounds[-1]
    worth = [one for one in turn.trials if one.evidence is not None and one.evidence.bic_gain > 0.0]
    best = max(worth, key=lambda one: one.gain, default=None)
    if best is None:
        return []
    name, place = best.candidate.effect.described, best.candidate.place.label
    why = next((one.why for one in turn.alternatives if (one.name, one.junction) == (name, place)), "")
    return [f"Nearest comes {law_title(name)} at {place} ({shown(best.gain)} nats): {why}."] if why else []


def summary(data: ReportData) -> str:
    """Verdict, effects and errors before and after, for a terminal; then what could have been found, if nothing was."""
    lines = [f"\n{data.verdict}: {data.explanation}"]
    for effect in data.effects:
        values = ", ".join(f"{one.name} = {with_ends(one.value, one.ci95, one.unit)}" for one in effect.coefficients)
        lines.append(f"  {law_title(effect.name)} at {effect.junction}: {effect.law}, {values}")
    lines += [f"  {note}" for note in (*data.notes, *data.structure)]
    lines.append(text_of(error_table(data.errors)))
    if not data.effects and data.power:
        lines.append(text_of(power_table(data.power)))
    return "\n".join(lines)


@dataclass(frozen=True)
class Comparison:
    """A closed loop against the truth of a simulation."""

    correct: bool
    text: str


def compare_with_truth(closed: ClosedLoop, effect: str, junction: str, coefficients: Mapping[str, float]) -> Comparison:
    """Whether the first effect found, or one that the data cannot tell from it, is the true one and the only one.

    ``effect`` is ``"none"`` where nothing was missing.
    """
    size = ", ".join(f"{value:g}" for value in coefficients.values())
    if effect == "none":
        return Comparison(not closed.added, "nothing was missing")
    truth = f"{effect} at {junction} ({size})"
    if not closed.added:
        return Comparison(False, f"{truth} was missing")
    chosen = closed.added[0].trial.candidate
    group = {(chosen.effect.name, chosen.place.label)}
    group |= {(a.name, a.junction) for a in closed.rounds[0].alternatives if a.indistinguishable}
    found = (effect, junction) in group
    exactly = (chosen.effect.name, chosen.place.label) == (effect, junction)
    how = (
        "found" if exactly else "found as one of a group that these sensors cannot tell apart" if found else "not found"
    )
    more = inflected(closed.added[1:], "more was added that is", "more were added that are")
    extra = f"; {len(closed.added) - 1} {more} not there" if len(closed.added) > 1 else ""
    return Comparison(found and not extra, f"{truth} was missing: {how}{extra}")
