"""The folder of an estimation: result.json, report.html with residuals and trace."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.estimate.initial import Initial
from bondgraph.estimate.innovation_summary import innovation_summary
from bondgraph.estimate.result import Estimate
from bondgraph.files import write_json
from bondgraph.filter.linear.intervals import simulation_steps
from bondgraph.report.collect import Runs, channel_series, parameter_changes
from bondgraph.report.held_out import HeldOutLog
from bondgraph.report.html import Provenance, ReportData, write_report
from bondgraph.report.logs import grouped_notes
from bondgraph.report.misfits import misfit_sentences
from bondgraph.report.noise import noise_sentence
from bondgraph.report.series import ChannelSeries, ParameterChange, channel_errors
from bondgraph.report.suspicions import sampling_suspicions, unit_suspicions
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from bondgraph.simulate.trajectory import Trajectory


def write_estimate(estimate: Estimate, folder: Path, made: Provenance, unseen: Sequence[HeldOutLog] = ()) -> ReportData:
    """Write ``result.json`` and ``report.html`` of an estimate.

    Parameters
    ----------
    estimate
        The finished estimate.
    folder
        Where the files go; it is made where it is missing.
    made
        Command, seed, data files.
    unseen
        How the estimate does on held-out logs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    found = estimate.to_dict(innovation_summary(estimate.runs))
    write_json(folder / "result.json", {**found, "held_out": [one.to_dict() for one in unseen]})
    data = estimate_report(estimate, made, unseen)
    write_report(data, folder / "report.html")
    return data


def estimate_report(estimate: Estimate, made: Provenance, unseen: Sequence[HeldOutLog] = ()) -> ReportData:
    """The report of an estimate as plain values: declared parameters before, estimated after."""
    series = [one for part in estimate.parts for one in _series(part)]
    series += [one for log in unseen for one in log.series]
    changes = [change for part in estimate.parts for change in _changes(part)]
    return ReportData(
        title=estimate.problem.name,
        verdict=_verdict(estimate),
        explanation="\n".join(misfit_sentences(estimate.misfits)) or estimate.end,
        errors=channel_errors(series),
        series=tuple(series),
        parameters=tuple({change.name: change for change in changes}.values()),
        trace=estimate.trace,
        suspected=tuple(one for part in estimate.parts for one in _suspicions(part)),
        notes=(*_notes(estimate), *map(_unseen_note, unseen), *grouped_notes(estimate.problem.logs)),
        made=made,
        subtitle="The model against its measurements, before and after its parameters were estimated.",
    )


def _verdict(estimate: Estimate) -> str:
    if not math.isfinite(estimate.nll):
        return "not estimated"
    return "estimated, but not explained" if estimate.misfits else "estimated"


def _unseen_note(log: HeldOutLog) -> str:
    """What a held-out log says."""
    band = " to ".join(f"{end:.3g}" for end in log.nis_band)
    return (
        f"Held out: on {log.name} the negative log-likelihood is {log.nll:.6g}, at the declared parameters "
        f"{log.declared_nll:.6g}; mean NIS {log.nis_mean:.3g} in its 95 % band {band}."
    )


def _series(estimate: Estimate) -> list[ChannelSeries]:
    """The channels of the logs of one filter model."""
    model = estimate.filter_model.model
    declared = {info.name: info.value for info in model.parameters}
    known = dict(zip(model.names("parameter"), estimate.theta.tolist(), strict=True))
    noise = dict(zip(model.names("output"), estimate.filter_model.noise_std, strict=True))
    series: list[ChannelSeries] = []
    # states that follow parameters, the heat of a body with a capacity, begin elsewhere at the declared ones
    begun = estimate.single.states_begun_at(model.theta())
    for log, start, x0, run in zip(estimate.problem.logs, begun, estimate.x0, estimate.runs, strict=True):
        before, after = _free_run(estimate, log, start, declared), _free_run(estimate, log, x0, known)
        series += channel_series(model, log, Runs(None, before), Runs(run, after), noise)
    return series


def _changes(estimate: Estimate) -> list[ParameterChange]:
    """Free and tied parameters of one filter model; one that single logs have is called by its full name."""
    model = estimate.filter_model.model
    declared = {info.name: info.value for info in model.parameters}
    moved = {t.name: float(value) for t, value in estimate.single.numbers(estimate.point) if t.kind == "parameter"}
    full = {one.target.name: one.name for one in estimate.problem.free if one.target.kind == "parameter"}
    own = {name: estimate.ci95[free] for name, free in full.items()}
    at_bound = [name for name, free in full.items() if free in estimate.at_bound]
    changes = parameter_changes(model, declared, moved, own, at_bound)
    return [replace(change, name=full.get(change.name, change.name)) for change in changes]


def _suspicions(estimate: Estimate) -> list[str]:
    """What is suspected of the units, times and sampling of the logs, at the declared values of the model."""
    model, rule = estimate.filter_model.model, estimate.single.initial
    rules: list[Initial] = [rule if isinstance(rule, str) else (rule[k],) for k in range(len(estimate.problem.logs))]
    return [
        f"{log.name}: {one}"
        for log, initial in zip(estimate.problem.logs, rules, strict=True)
        for one in (
            *sampling_suspicions(model, log, initial),
            *unit_suspicions(estimate.filter_model, log, initial),
        )
    ]


def _notes(estimate: Estimate) -> list[str]:
    """How far the estimate can be trusted: steps, other optima, bounds, what the data do not tell."""
    certification = estimate.certification
    notes = [
        f"The search: {estimate.end}.",
        f"Negative log-likelihood {estimate.nll:.4f} after {estimate.evaluations} evaluations.",
        f"Integrated by {certification.method} with {certification.substeps} steps between samples: "
        f"{certification.verdict}.",
        *([f"There {certification.conditioning}."] if certification.is_ill_conditioned else []),
        *(f"Against {one}." for one in certification.checks),
        *(f"{noise_sentence(part.filter_model)}." for part in estimate.problem.parts),
    ]
    if not estimate.is_smooth:
        notes.append(rough_note(estimate))
    if estimate.optima:
        best, *others = estimate.optima
        starts = f"{best.starts} start{'s' if best.starts > 1 else ''} ended at this optimum"
        elsewhere = ", ".join(f"{other.nll - best.nll:.4g}" for other in others)
        notes.append(
            f"{starts}; others at optima worse by {elsewhere} nats." if others else f"{starts}, none at another."
        )
    return [*notes, *limits(estimate)]


def limits(estimate: Estimate) -> list[str]:
    """Limits of an estimate: what rests on a bound, what the data do not tell, inputs that are likelier otherwise."""
    at_bound = f"At a bound, so that the optimum may lie outside: {', '.join(estimate.at_bound)}."
    notes = [at_bound] if estimate.at_bound else []
    alone = ", ".join(group[0] for group in estimate.not_identifiable if len(group) == 1)
    notes += [f"These data say nothing about: {alone}."] if alone else []
    groups = (", ".join(group) for group in estimate.not_identifiable if len(group) > 1)
    notes += [f"These data do not tell apart: {group}." for group in groups]
    other = estimate.inputs_otherwise
    return [*notes, *([f"{other.sentence[0].upper()}{other.sentence[1:]}."] if other else [])]


def rough_note(estimate: Estimate) -> str:
    """What a likelihood that is not smooth means for an estimate."""
    return (
        f"The likelihood is not smooth here: values around the optimum place it {estimate.roughness:.2g} standard "
        "deviations from where its derivatives do. Kinks of laws do that, and a parameter that the logs hardly tell: "
        "smooth the kinks, fix the parameter, or widen the intervals by that."
    )


def _free_run(estimate: Estimate, log: MatchedLog, x0: FloatArray, values: Mapping[str, float]) -> Trajectory:
    filter_model = estimate.filter_model
    return simulate(
        filter_model.model, log.time, log.u, _theta(filter_model.model, log, values), x0,
        method=filter_model.method, substeps=simulation_steps(filter_model, log.time), compiled=True,
    )  # fmt: skip


def _theta(model: Model, log: MatchedLog, values: Mapping[str, float]) -> FloatArray:
    """Parameters (n_theta,) of a log: what it knows itself, and else the values given by name."""
    names = model.names("parameter")
    known = {name: value for name, value in values.items() if name in names}
    return model.theta(**(known | dict(log.theta_overrides)))
