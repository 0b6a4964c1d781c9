"""The folder of a filter run: states with bands, innovations, consistency, pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.estimate.initial import Initial, initial_states
from bondgraph.estimate.inputs_before import with_inputs_before
from bondgraph.estimate.setup import filter_setup
from bondgraph.files import write_json
from bondgraph.filter.abstract_run import AbstractRun
from bondgraph.filter.consistency import Consistency, consistency, innovation_tests
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.misfit import LEVEL, Misfit, p_text
from bondgraph.filter.noise import Noise
from bondgraph.filter.robust import Robust
from bondgraph.filter.runs import run_bands, run_smoothed
from bondgraph.report.collect import OutputBeliefs, Runs, channel_series, innovation_bands, state_bands
from bondgraph.report.figures import save_figure
from bondgraph.report.html import Provenance, ReportData, write_report
from bondgraph.report.logs import grouped_notes
from bondgraph.report.misfits import band_text, filter_sentences
from bondgraph.report.noise import noise_sentence
from bondgraph.report.numbers import shown
from bondgraph.report.plots import state_figure
from bondgraph.report.series import ChannelSeries, FilteredLog, StateBand, channel_errors
from bondgraph.report.states_table import EXACT_CSV, StatesTable
from bondgraph.report.suspicions import sampling_suspicions, unit_suspicions
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.model import Model

#: Share of refused readings beyond which they are no outliers of a sensor: Hampel et al. (1986), Robust Statistics,
#: section 1.2, have 1 to 10 % of gross errors in routine data.
_MOST_REFUSED = 0.1


@dataclass(frozen=True)
class Filtered:
    """What filtering some logs gave: a summary for the terminal, and the channels that the model does not explain."""

    text: str
    misfits: tuple[Misfit, ...]


def filter_logs(
    model: Model,
    driven: Sequence[str],
    logs: Sequence[MatchedLog],
    folder: Path,
    smoothed: bool = False,
    initial: Initial = "measured",
    noise: Noise | FilterModel | None = None,
    made: Provenance | None = None,
    robust: Robust | None = None,
    table: StatesTable = EXACT_CSV,
) -> Filtered:
    """Filter logs with a model at its declared parameters and write states, innovations and consistency.

    Noises are the declared ones, those of a filter model, or else taken from the logs as for an estimation; ``robust``
    is the loss of outliers.
    Writes ``NAME_states.csv``, or another ``table``, and ``NAME_states.png`` per log, one ``result.json`` and one
    ``report.html``.
    """
    filter_model = _filter_model(model, driven, logs, noise, robust)
    folder.mkdir(parents=True, exist_ok=True)
    lines, result = [], {}
    series: list[ChannelSeries] = []
    filtered: list[FilteredLog] = []
    tests: list[Misfit] = []
    suspected, refused = list[str](), dict[tuple[str, str], str]()
    for log in with_inputs_before(model, logs, model.theta(), initial):
        # simulations of their own, which end before anything is kept of a long log
        suspected += [f"{log.name}: {one}" for one in sampling_suspicions(model, log, initial)]
        suspected += [f"{log.name}: {one}" for one in unit_suspicions(filter_model, log, initial)]
        start = initial_states(model, [log], model.theta(), initial)[0]
        record, shown_run, outputs = _filtered(filter_model, log, start, smoothed)
        lines += table.advice(table.write(folder, shown_run))
        bands = (*state_bands(record, shown_run), *outputs)
        save_figure(state_figure(bands, log.name), folder / f"{log.name}_states.png")
        filtered.append(FilteredLog(log.name, bands, innovation_bands(record)))
        found = consistency(record)
        tested = innovation_tests([record], level=LEVEL / len(logs), guessed=noise is None)
        result[log.name] = _result(record, found, tested)
        tests += tested
        refused |= _too_many_refused(log.name, found)
        series += channel_series(model, log, Runs(record), noise_std=filter_model.measurement_noise)
        lines += _lines(record, found)
    lines.append(noise_sentence(filter_model))
    suspected += refused.values()
    write_json(folder / "result.json", result)
    found_misfits = tuple(one for one in tests if one.contradicts)
    data = ReportData(
        title=model.name,
        verdict="not explained" if found_misfits else "filtered",
        explanation="\n".join(filter_sentences(tests, None, refused) or refused.values()),
        errors=channel_errors(series),
        series=tuple(series),
        filtered=tuple(filtered),
        suspected=tuple(suspected),
        notes=(*lines, *grouped_notes(logs)),
        made=made,
        subtitle=f"The model at its declared parameters, {'smoothing' if smoothed else 'filtering'} its measurements.",
    )
    write_report(data, folder / "report.html")
    said = [*lines, *filter_sentences(tests, folder / "report.html", refused), *suspected, f"written: {folder}"]
    return Filtered("\n".join(said), found_misfits)


def _filter_model(
    model: Model,
    driven: Sequence[str],
    logs: Sequence[MatchedLog],
    noise: Noise | FilterModel | None,
    robust: Robust | None,
) -> FilterModel:
    """The filter with the declared noises, or with those that the logs show."""
    if isinstance(noise, FilterModel):
        return replace(noise, robust=robust)
    declared = noise.filter_model(model) if noise else filter_setup(model, driven, logs).filter_model
    return replace(declared, robust=robust)


def _filtered(
    filter_model: FilterModel, log: MatchedLog, start: FloatArray, smoothed: bool
) -> tuple[AbstractRun, AbstractRun, tuple[StateBand, ...]]:
    """The filter over a log, what is shown of its states, and of outputs that are more than one of them.

    No covariances are kept, however long the log is.
    """
    beliefs = OutputBeliefs(filter_model.model, log.y, inputs_of(filter_model.model, log))
    if smoothed:
        known = run_smoothed(filter_model, log, x0=start, told=beliefs.add)
        bands = known.filtered
        variance = np.maximum(known.smoothed_var, 0.0)  # a difference, which rounding may leave below zero
        shown_run = replace(bands, filtered_mean=known.smoothed_mean, filtered_var=variance)
        return bands, shown_run, beliefs.bands(bands)
    bands = run_bands(filter_model, log, x0=start, told=beliefs.add).raise_if_failed()
    return bands, bands, beliefs.bands(bands)


def _lines(record: AbstractRun, found: Consistency) -> list[str]:
    """What the likelihood and the innovations of a log say, for the terminal."""
    band = [*map(shown, (found.nis_mean, *found.nis_band))]
    emptied = any(c.refused > _MOST_REFUSED * c.count for c in found.channels)
    nis = f"{band[0]}, refused ones as zero" if emptied else band_text(found.nis_mean, found.nis_band, band)
    whole = f"{record.log_name}: NLL {shown(record.nll, 6)}, NIS {nis}"
    channels = (
        f"  {c.name}: innovation rms {shown(c.rmse)} {c.unit}, NIS {shown(c.nis_mean)}, "
        f"whiteness {p_text(c.whiteness_p)}" + (f", {c.refused} of {c.count} refused by the gate" if c.refused else "")
        for c in found.channels
    )
    return [whole, *channels]


def _too_many_refused(log_name: str, found: Consistency) -> dict[tuple[str, str], str]:
    """Sentences on channels of which a gate refused more than a sensor has outliers: then the model is wrong."""
    return {
        (log_name, c.name): (
            f"{log_name}: {c.name}: the gate refused {c.refused} of {c.count} readings, so that the filter hardly "
            "followed them: the model or its noises are wrong rather than the sensor - filter without --robust to see "
            "how"
        )
        for c in found.channels
        if c.refused > _MOST_REFUSED * c.count
    }


def _result(record: AbstractRun, found: Consistency, tested: Sequence[Misfit]) -> dict[str, Any]:
    """Part of ``result.json`` on a log."""
    return {
        "nll": record.nll, "nis_mean": found.nis_mean, "nis_band": list(found.nis_band),
        "channels": _channels(found, tested),
        "misfits": [one.to_dict() for one in tested if one.contradicts],
    }  # fmt: skip


def _channels(found: Consistency, tested: Sequence[Misfit]) -> dict[str, Any]:
    neighbours = {one.channel: one.autocorrelation for one in tested if math.isfinite(one.autocorrelation)}
    return {
        c.name: {
            "unit": c.unit,
            "rmse": c.rmse,
            "nis_mean": c.nis_mean,
            "nis_band": list(c.nis_band),
            "whiteness_p": c.whiteness_p,
            "autocorrelation": neighbours.get(c.name),
            "refused": c.refused,
        }
        for c in found.channels
    }
