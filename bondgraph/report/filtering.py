"""The folder of a filter run: states with bands, innovations, consistency, pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from bondgraph.correct.fits.setup import filter_setup
from bondgraph.data.log import Log, LogChannel, MatchedLog
from bondgraph.data.write import write_log
from bondgraph.estimate.initial import Initial, initial_states
from bondgraph.filter.consistency import Consistency, consistency
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.noise import Noise
from bondgraph.filter.runs import run
from bondgraph.filter.smoother import smooth
from bondgraph.report.closed_loop import write_json
from bondgraph.report.collect import output_bands, state_bands
from bondgraph.report.figures import save_figure
from bondgraph.report.numbers import shown
from bondgraph.report.plots import state_figure
from bondgraph.simulate.model import Model


def filter_logs(
    model: Model,
    driven: Sequence[str],
    logs: Sequence[MatchedLog],
    folder: Path,
    smoothed: bool = False,
    initial: Initial = "measured",
    noise: Noise | None = None,
) -> str:
    """Filter logs with a model at its declared parameters and write states, innovations and consistency.

    Noises are the declared ones, or else taken from the logs as for an estimation. Writes ``NAME_states.csv`` and
    ``NAME_states.png`` per log and one ``result.json``.

    Returns
    -------
    str
        A summary for the terminal.
    """
    filter_model = noise.filter_model(model) if noise else filter_setup(model, driven, logs).filter_model
    folder.mkdir(parents=True, exist_ok=True)
    lines, result = [], {}
    for log in logs:
        start = initial_states(model, [log], model.theta(), initial)[0]
        record = run(filter_model, log, x0=start).raise_if_failed()
        shown_run = _smoothed(record) if smoothed else record
        write_log(folder / f"{log.name}_states.csv", _states_log(shown_run))
        bands = (*state_bands(record, shown_run), *output_bands(record, shown_run, log.u))
        save_figure(state_figure(bands, log.name), folder / f"{log.name}_states.png")
        found = consistency(record)
        result[log.name] = {"nll": record.nll, "nis_mean": found.nis_mean, "nis_band": list(found.nis_band)}
        result[log.name] |= {"channels": _channels(found)}
        lines.append(
            f"{log.name}: NLL {shown(record.nll, 6)}, NIS {shown(found.nis_mean)} in band "
            f"{shown(found.nis_band[0])} to {shown(found.nis_band[1])}"
        )
        lines += [
            f"  {c.name}: innovation rms {shown(c.rmse)} {c.unit}, NIS {shown(c.nis_mean)}, "
            f"whiteness p {shown(c.whiteness_p)}"
            for c in found.channels
        ]
    write_json(folder / "result.json", result)
    return "\n".join([*lines, f"written: {folder}"])


def _smoothed(record: FilterRun) -> FilterRun:
    """The record with smoothed beliefs in place of the filtered ones."""
    better = smooth(record)
    return replace(record, filtered_mean=better.smoothed_mean, filtered_cov=better.smoothed_cov)


def _states_log(record: FilterRun) -> Log:
    units = {info.name: info.unit for info in record.filter_model.model.states}
    channels: dict[str, LogChannel] = {}
    for name in record.filter_model.state_names:
        unit = units.get(name) or "1"
        for label, values in ((name, record.mean(name)), (f"{name}_std", record.std(name))):
            channels[label] = LogChannel(label, unit, values)
    return Log(record.log_name, record.time, channels)


def _channels(found: Consistency) -> dict[str, Any]:
    return {
        c.name: {"rmse": c.rmse, "nis_mean": c.nis_mean, "nis_band": list(c.nis_band), "whiteness_p": c.whiteness_p}
        for c in found.channels
    }
