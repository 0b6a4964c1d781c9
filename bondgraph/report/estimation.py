"""The folder of an estimation: result.json, report.html with residuals and trace."""

from __future__ import annotations

import math
from pathlib import Path

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.innovation_summary import innovation_summary
from bondgraph.estimate.result import Estimate
from bondgraph.filter.linear.intervals import simulation_steps
from bondgraph.report.closed_loop import write_json
from bondgraph.report.collect import Runs, channel_series, parameter_changes
from bondgraph.report.html import Provenance, ReportData, write_report
from bondgraph.report.logs import grouped_notes
from bondgraph.report.misfits import misfit_sentences
from bondgraph.report.noise import noise_sentence
from bondgraph.report.series import ChannelSeries, channel_errors
from bondgraph.report.suspicions import sampling_suspicions, unit_suspicions
from bondgraph.simulate.simulation import simulate
from bondgraph.simulate.trajectory import Trajectory


def write_estimate(estimate: Estimate, folder: Path, made: Provenance) -> ReportData:
    """Write ``result.json`` and ``report.html`` of an estimate.

    Parameters
    ----------
    estimate
        The finished estimate.
    folder
        Where the files go; it is made where it is missing.
    made
        Command, seed, data files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "result.json", estimate.to_dict(innovation_summary(estimate.runs)))
    data = estimate_report(estimate, made)
    write_report(data, folder / "report.html")
    return data


def estimate_report(estimate: Estimate, made: Provenance) -> ReportData:
    """The report of an estimate as plain values: declared parameters before, estimated after."""
    model = estimate.filter_model.model
    declared = {info.name: info.value for info in model.parameters}
    series: list[ChannelSeries] = []
    for log, x0, run in zip(estimate.problem.logs, estimate.x0, estimate.runs, strict=True):
        before = _free_run(estimate, log, x0, declared)
        after = _free_run(estimate, log, x0, dict(estimate.values))
        noise = dict(zip(model.names("output"), estimate.filter_model.noise_std, strict=True))
        series += channel_series(model, log, Runs(None, before), Runs(run, after), noise)
    return ReportData(
        title=model.name,
        verdict=_verdict(estimate),
        explanation=" ".join(misfit_sentences(estimate.misfits)) or estimate.end,
        errors=channel_errors(series),
        series=tuple(series),
        parameters=parameter_changes(model, declared, estimate.values, estimate.ci95, estimate.at_bound),
        trace=estimate.trace,
        suspected=tuple(_suspicions(estimate)),
        notes=(*_notes(estimate), *grouped_notes(estimate.problem.logs)),
        made=made,
    )


def _verdict(estimate: Estimate) -> str:
    if not math.isfinite(estimate.nll):
        return "not estimated"
    return "estimated, but not explained" if estimate.misfits else "estimated"


def _suspicions(estimate: Estimate) -> list[str]:
    """What is suspected of the units, times and sampling of the logs, at the declared values of the model."""
    model, initial = estimate.filter_model.model, estimate.problem.initial
    return [
        f"{log.name}: {one}"
        for log in estimate.problem.logs
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
        f"{noise_sentence(estimate.problem.filter_model)}.",
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
    if estimate.at_bound:
        notes.append(f"At a bound, so that the optimum may lie outside: {', '.join(estimate.at_bound)}.")
    alone = ", ".join(group[0] for group in estimate.not_identifiable if len(group) == 1)
    notes += [f"These data say nothing about: {alone}."] if alone else []
    groups = (", ".join(group) for group in estimate.not_identifiable if len(group) > 1)
    return [*notes, *(f"These data do not tell apart: {group}." for group in groups)]


def rough_note(estimate: Estimate) -> str:
    """What a likelihood that is not smooth means for an estimate."""
    return (
        f"The likelihood is not smooth here: values around the optimum place it {estimate.roughness:.2g} standard "
        "deviations from where its derivatives do. Smooth the kinks of the model's laws, take Runge-Kutta steps, or "
        "widen the intervals by that."
    )


def _free_run(estimate: Estimate, log: MatchedLog, x0: object, values: dict[str, float]) -> Trajectory:
    filter_model = estimate.filter_model
    names = filter_model.model.names("parameter")
    theta = {name: value for name, value in values.items() if name in names} | dict(log.theta_overrides)
    return simulate(
        filter_model.model, log.time, log.u, theta, x0,  # type: ignore[arg-type]
        method=filter_model.method, substeps=simulation_steps(filter_model, log.time), compiled=True,
    )  # fmt: skip
