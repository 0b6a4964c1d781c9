"""The machine-readable result of a closed loop, as ``result.json`` has it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from bondgraph.correct.confirmation import Confirmation
from bondgraph.correct.constants import LEVEL
from bondgraph.correct.evidence.transfer import Transfer
from bondgraph.correct.evidence.trials import Added, Trial
from bondgraph.correct.fits.assess import Assessment, ChannelError
from bondgraph.correct.fits.compared import Compared
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.places.probes import Signal
from bondgraph.correct.places.regimes import level_names, regime_of
from bondgraph.correct.shapes.forms import curve, departure, only_signal, revises, whole_text
from bondgraph.correct.shapes.formula import formula_of
from bondgraph.correct.shapes.words import other_words
from bondgraph.data.log import FloatArray
from bondgraph.estimate.certify import NEGLIGIBLE_SHIFT, Check
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.quantities import quantity_of, unit_of
from bondgraph.simulate.quantities import OutputInfo


def result_json(closed: ClosedLoop) -> dict[str, Any]:
    """The result of a closed loop with the names of the stable interface; numbers that do not exist are None."""
    return {
        "name": closed.nominal_built.graph.name,
        "verdict": closed.verdict,
        "reason": closed.reason,
        "nominal": _state(closed.nominal, closed.nominal_check, closed.nominal_train, closed.nominal_holdout),
        "corrected": _state(closed.corrected, closed.corrected_check, closed.corrected_train, closed.corrected_holdout),
        "confirmation": None if closed.confirmation is None else _confirmation(closed.confirmation, closed),
        **_located(closed),
        "effects": [_effect(added, closed.corrected) | _own_form(added, closed) for added in closed.added],
        "disturbances": [
            {
                "place": one.trial.candidate.place.label, "state": one.state, "std": number(one.size),
                "unit": one.unit, "correlation_time_s": number(one.seconds), "delta_nll": number(one.trial.gain),
                **({"period_s": number(one.period)} if one.period else {}),
            }
            for one in closed.disturbances
        ],
        "given_constants": [
            {"name": one.name, "given": number(one.given), "delta_nll": number(one.gain), "others": list(one.others)}
            for one in closed.constants
        ],
        "events": [_event(added, closed.eventful or closed.corrected) for added in closed.events],
        "alternatives": _alternatives(closed),
        "refused": [
            {"name": no.effect, "junction": no.place, "why": no.why}
            for turn in closed.rounds[:1]
            for no in turn.refused
        ],
        "detectable": [
            {
                "name": d.effect, "junction": d.junction, "coefficient": d.coefficient, "size": number(d.size),
                "unit": d.unit,
            }
            for d in closed.detectable
        ],
        "unexplained": unexplained(closed),
        "history": [
            {"round": one.round, "action": one.action, "what": one.what, "why": one.why} for one in closed.history
        ],
        "cautions": list(closed.cautions),
        "whiteness": {
            test.channel: {"p_value": number(test.p_value), "nis_mean": number(test.nis_mean)}
            for test in closed.whiteness
        },
    }  # fmt: skip


def _confirmation(told: Confirmation, closed: ClosedLoop) -> dict[str, Any]:
    """What the logs say of the correction; ``compared`` holds errors in each channel's own unit."""
    infos = {info.name: info for info in closed.nominal_built.model.outputs}

    def compared(one: Compared) -> dict[str, Any]:
        info = infos[one.channel]
        return {
            "data": one.data, "kind": one.kind, "channel": one.channel, "unit": info.display_unit,
            "before": number(info.shown(one.before)), "after": number(info.shown(one.after)),
            "p_worse": number(one.p_worse), "clearly_worse": one.clearly,
        }  # fmt: skip

    return {
        "standing": told.standing,
        "holdout_gain": number(told.gain),
        "holdout_gain_error": number(told.error),
        "holdout_noise": number(told.noise),
        "holdout_gain_of_laws": None if told.laws is None else number(told.laws.gain),
        "horizon": told.horizon,
        "contradictions": list(told.contradictions),
        "compared": [compared(one) for one in told.compared],
    }


def _located(closed: ClosedLoop) -> dict[str, Any]:
    """Places and sensors by how much of the residual they explain, and what the structure lets one tell apart."""
    places = closed.rounds[0].located if closed.rounds else ()
    return {
        "located_at": [
            {"junction": at.junction, "variable": at.variable, "p_value": at.p_value, "share": at.share}
            for at in places
            if at.variable != "sensor"
        ],
        "sensors": [
            {"channel": at.junction, "p_value": at.p_value, "share": at.share}
            for at in places
            if at.variable == "sensor"
        ],
        "structure": {
            "indistinguishable": [list(group) for group in closed.structure.classes],
            "undetectable": list(closed.structure.invisible),
            "sensors": list(closed.structure.sensors),
            "sums": list(closed.structure.sums),
        },
    }


def _alternatives(closed: ClosedLoop) -> list[dict[str, Any]]:
    return [
        {
            "name": other.name, "junction": other.junction, "delta_nll": number(other.delta_nll),
            "indistinguishable": other.indistinguishable, "why": other.why, "separate": other.separate,
            "round": index + 1,
        }
        for index, turn in enumerate(closed.rounds)
        for other in turn.alternatives
    ]  # fmt: skip


def number(value: float) -> float | None:
    """A finite number, or None, since JSON knows neither infinity nor nan."""
    return float(value) if math.isfinite(value) else None


def intervals(fitted: Fit) -> dict[str, tuple[float, float]]:
    """95 % intervals of the estimates, from the Fisher information, inside their bounds."""
    found = {}
    for parameter, coordinate in zip(fitted.problem.free, fitted.point, strict=True):
        reach = 1.96 * fitted.std[parameter.name]
        ends = [coordinate - reach, coordinate + reach]
        values = [math.exp(min(end, 700.0)) if parameter.scale == "log" else end for end in ends]
        found[parameter.name] = (max(values[0], parameter.lower), min(values[1], parameter.upper))
    return found


def unexplained(closed: ClosedLoop) -> list[dict[str, Any]]:
    """What no known effect explains: its place, what it is a function of, and its shape with the 95 % band.

    Where innovations stay coloured and no function explains it, the place that explains most, without a shape.
    """
    channels = [test.channel for test in closed.whiteness if test.p_value < LEVEL]
    found = [
        {
            "junction": one.place.label, "variable": one.variable, "as_function_of": one.signal,
            "shape": {
                "at": one.knots.tolist(), "unit_at": one.signal_unit, "values": one.values.tolist(),
                "lower": (one.values - 1.96 * one.std).tolist(), "upper": (one.values + 1.96 * one.std).tolist(),
                "unit": one.unit,
            },
            "channels": channels, "p_value": one.p_value, "delta_nll": number(one.gain), "like": list(one.like),
            "taken_by": list(one.taken),
        }
        for one in closed.unexplained
    ]  # fmt: skip
    if found or closed.verdict != "unexplained residual" or not closed.rounds:
        return found
    return [
        {"junction": at.junction, "as_function_of": None, "shape": None, "channels": channels, "p_value": at.p_value}
        for at in closed.rounds[-1].located[:1]
    ]


def _state(fitted: Fit, checked: Check, train: Assessment, holdout: Assessment) -> dict[str, Any]:
    return {
        "train": _assessment(train),
        "holdout": _assessment(holdout),
        "parameters": _parameters(fitted),
        "outcome": fitted.outcome.value,
        "halved_steps": {
            "nats": number(checked.nats),
            "shift": number(checked.shift),
            "parameter": checked.parameter,
            "certified": checked.shift <= NEGLIGIBLE_SHIFT,
        },
    }


def _parameters(fitted: Fit) -> dict[str, Any]:
    ends = intervals(fitted)
    described = {}
    for parameter in fitted.problem.free:
        value = fitted.values[parameter.name]
        span = parameter.upper - parameter.lower
        shown = quantity_of(fitted.problem, parameter).shown
        described[parameter.name] = {
            "value": shown(value),
            "unit": unit_of(fitted.problem, parameter),
            "ci95": [shown(end) for end in ends[parameter.name]],
            "bounds": [shown(parameter.lower), shown(parameter.upper)],
            "at_bound": bool(min(value - parameter.lower, parameter.upper - value) <= 1e-6 * span),
        }
    return described


def _assessment(assessment: Assessment) -> dict[str, Any]:
    infos = {info.name: info for log in assessment.logs[:1] for info in log.simulated.model.outputs}

    def channel(info: OutputInfo, error: ChannelError) -> dict[str, Any]:
        return {
            "unit": info.display_unit,
            "innovation_rmse": number(info.shown(error.innovation_rmse)),
            "simulation_rmse": number(info.shown(error.simulation_rmse)),
            "noise_std": number(info.shown(error.noise_std)),
            "innovation_ci95": [number(info.shown(end)) for end in error.innovation_ci95],
            "simulation_ci95": [number(info.shown(end)) for end in error.simulation_ci95],
        }

    def channels(errors: Mapping[str, ChannelError]) -> dict[str, Any]:
        return {name: channel(infos[name], error) for name, error in errors.items()}

    return {
        "nll": number(assessment.nll),
        "channels": channels(assessment.channels),
        "logs": {log.log.name: {"nll": number(log.nll), "channels": channels(log.channels)} for log in assessment.logs},
    }


def _effect(added: Added, corrected: Fit) -> dict[str, Any]:
    effect, place = added.trial.candidate.effect, added.trial.candidate.place
    ends = intervals(corrected)
    infos = {info.name: info for info in corrected.problem.filter_model.model.parameters}
    fault = {"channel": effect.channel, "kind": effect.kind} if effect.channel else {}
    return {
        "name": effect.name,
        "element": effect.element,
        "law": effect.law,
        "junction": place.label,
        "reference": effect.reference,
        **({"completes": added.completes} if added.completes else {}),
        **fault,
        **({} if added.trial.forms else _formula(added.trial, corrected)),
        **_regime(added),
        "coefficients": {
            name: {
                "value": infos[name].shown(corrected.values[name]),
                "unit": infos[name].display_unit,
                "ci95": [infos[name].shown(end) for end in ends[name]],
            }
            for name in added.coefficients
        },
        "evidence": evidence_json(added.trial),
    }


def _formula(law: Trial, corrected: Fit) -> dict[str, Any]:
    """The formula of an effect that is one: as a law with its numbers, in other words, and as lines of Python."""
    formula = formula_of(law.candidate.function)
    if formula is None:
        return {}
    values, ends = corrected.values, intervals(corrected)
    known = other_words(formula, values)
    return {"formula": {"text": formula.text(values, ends), "known_as": known, "python": formula.python(values, ends)}}


def _own_form(added: Added, closed: ClosedLoop) -> dict[str, Any]:
    """The form of a law that is not its name's: whole, how far it departs from the name, and its parts."""
    law = added.trial
    if not law.forms:
        return {}
    parts = [
        {
            "name": one.candidate.effect.name, "element": one.candidate.effect.element, "law": one.candidate.effect.law,
            "coefficients": list(one.candidate.effect.parameters), "evidence": evidence_json(one),
            **_formula(one, closed.corrected),
        }
        for one in law.forms
    ]  # fmt: skip
    return {"own_form": {"text": form_text(added, closed), "departs": departs(added, closed), "parts": parts}}


def form_text(added: Added, closed: ClosedLoop) -> str | None:
    """The sum of a law's parts as one formula with its numbers; None where the parts do not give the same."""
    values = graph_values(closed)
    return whole_text(added.trial, closed.corrected_graph, values, intervals(closed.corrected))


def holds_declared(added: Added, closed: ClosedLoop) -> bool:
    """True for a law whose formula holds what is declared: it revises an element."""
    return revises(added.trial, closed.corrected_graph, graph_values(closed))


def departs(added: Added, closed: ClosedLoop) -> float | None:
    """How far a law's own form is from the nearest multiple of what it is called; see :func:`departure`."""
    known = closed.rounds[-1].signals
    found = departure(added.trial, closed.corrected_graph, graph_values(closed), known)
    return None if found is None else number(found)


def own_curve(added: Added, closed: ClosedLoop, points: int) -> tuple[Signal, FloatArray, FloatArray] | None:
    """The signal of a law in a form of its own, values of it over what the logs visit, and the law there, both (n,)."""
    graph, known = closed.corrected_graph, closed.rounds[-1].signals
    signal = only_signal(added.trial, graph, known)
    if signal is None:
        return None
    together = np.concatenate(signal.values)
    at = np.linspace(float(together.min()), float(together.max()), points)
    drawn = curve(added.trial, graph, graph_values(closed), signal, at)
    return None if drawn is None else (signal, at, drawn)


def graph_values(closed: ClosedLoop) -> dict[str, float]:
    """The values of all parameters of the corrected declaration."""
    return {one.name: one.value for one in closed.corrected_graph.flatten().parameters}


def _regime(added: Added) -> dict[str, Any]:
    """Where a law acts that acts in part of the operating space; ``level`` and ``upper`` are names of coefficients."""
    regime = regime_of(added.trial.candidate.function)
    if regime is None:
        return {}
    told = {"signal": regime.signal, "quantity": regime.quantity, "is": regime.side}
    levels = level_names(added.trial.candidate.effect, regime)
    return {"regime": {**told, **dict(zip(("level", "upper"), levels, strict=False))}}


def _event(added: Added, fitted: Fit) -> dict[str, Any]:
    """An effect that acts in part of a log: from a time on, or until it; no part of the corrected declaration."""
    gate = added.trial.gate
    assert gate is not None  # else it is none
    return {**_effect(added, fitted), "acts": gate.when, "log": gate.log, "time": gate.time}


def evidence_json(trial: Trial) -> dict[str, Any]:
    """What spoke for a chosen candidate."""
    if trial.evidence is None:
        return {}
    return {
        "delta_nll": number(trial.evidence.delta_nll),
        "p_value": number(trial.evidence.p_value),
        "p_robust": number(trial.evidence.p_robust),
        "bic_gain": number(trial.evidence.bic_gain),
        "tried": trial.evidence.tried,
        "transfer": None if trial.transfer is None else _transfer(trial.transfer),
    }


def _transfer(told: Transfer) -> dict[str, Any]:
    """What an effect gains, in nats, in each part of the training data that it was not estimated from."""
    return {
        "gain": number(told.gain),
        "error": number(told.error),
        "fold_error": number(told.fold_error),
        "p_value": number(told.p_value),
        "folds": [{"fold": name, "delta_nll": number(gain)} for name, gain in zip(told.folds, told.gains, strict=True)],
        "untested": list(told.untested),
        "worse": [str(one) for one in told.compared if one.clearly],
    }
