"""What a log holds, seen without a model: channels, rates, gaps, outliers, suspicious units, and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from bondgraph.data.checks import check_log
from bondgraph.data.log import FloatArray, Log, LogChannel
from bondgraph.data.pairs import factor_suspicions, offset_suspicions
from bondgraph.data.suspicions import looks_like_milliseconds, time_gaps
from bondgraph.report.diagram.text import plain
from bondgraph.report.figures import LINES, figure_style
from bondgraph.report.numbers import shown
from bondgraph.report.thinning import thinned
from bondgraph.text import Table, few, instant, number, text_table

#: Steps of time differ where they lie so far apart, as shares of the usual step.
_UNEVEN = 0.01


@dataclass(frozen=True)
class ChannelSummary:
    """A channel in numbers: ``rate`` in 1/s of its own samples; NaN, and codes in ``codes``, for a channel of codes."""

    name: str
    unit: str
    samples: int
    missing: int
    rate: float
    lowest: float
    mean: float
    highest: float
    codes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Inspection:
    """A log in numbers and sentences.

    ``step`` is the usual, ``steps`` the shortest and the longest time between rows, s; ``began`` the date of the start.
    """

    log: str
    rows: int
    start: float
    end: float
    step: float
    steps: tuple[float, float]
    began: str
    channels: tuple[ChannelSummary, ...]
    findings: tuple[str, ...]
    suspicions: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The same as values of JSON."""
        return asdict(self)


def inspect_log(log: Log) -> Inspection:
    """What a log holds and what is suspicious in it.

    Raises
    ------
    DataError
        If a channel has a unit that is not one.

    Examples
    --------
    >>> time = np.arange(50) * 0.02
    >>> log = Log("run", time, {"v": LogChannel("v", "m/s", np.where(np.arange(50) % 2, np.nan, time))})
    >>> found = inspect_log(log)
    >>> round(1.0 / found.step), round(found.channels[0].rate), found.channels[0].missing
    (50, 25, 25)
    """
    steps = np.diff(log.time)
    usual = float(np.median(steps)) if steps.size else float("nan")
    ends = (float(steps.min()), float(steps.max())) if steps.size else (usual, usual)
    suspicions = [*factor_suspicions(log), *offset_suspicions(log)]
    if looks_like_milliseconds(log.time):
        suspicions.insert(0, f"times are whole numbers, {number(usual)} s apart: are they milliseconds ('time [ms]')?")
    found = [finding.message for finding in check_log(log)]
    return Inspection(
        log.name, len(log), float(log.time[0]), float(log.time[-1]), usual, ends, log.metadata.get("start", ""),
        tuple(_summary(log.time, channel) for channel in log.channels.values()),
        (*time_gaps(log.time, log.first_row), *found), tuple(suspicions),
    )  # fmt: skip


def _summary(time: FloatArray, channel: LogChannel) -> ChannelSummary:
    valid = ~channel.missing
    own = time[valid]
    rate = 1.0 / float(np.median(np.diff(own))) if own.size > 1 else float("nan")
    count, missing = int(valid.sum()), int(time.size - valid.sum())
    if channel.is_text or not count:
        codes = tuple(map(str, np.unique(channel.values[valid]))) if channel.is_text else ()
        none = float("nan")
        return ChannelSummary(channel.name, channel.unit, count, missing, rate, none, none, none, codes)
    values = channel.numbers[valid]
    lowest, highest = float(values.min()), float(values.max())
    return ChannelSummary(channel.name, channel.unit, count, missing, rate, lowest, float(values.mean()), highest)


def inspection_text(found: Inspection) -> str:
    """An inspection as a table of channels, then its findings and suspicions as sentences."""
    lines = [times_text(found)]
    header, rows = channel_table(found)
    if rows:
        lines.append(text_table(header, rows))
    return "\n".join([*lines, *inspection_notes(found)])


def times_text(found: Inspection) -> str:
    """Rows and times of a log in a sentence."""
    uneven = found.steps[1] - found.steps[0] > _UNEVEN * found.step
    steps = f", between {number(found.steps[0])} and {number(found.steps[1])} s" if uneven else ""
    began = f", begun {found.began}" if found.began else ""
    return (
        f"{found.log}: {found.rows} rows from {instant(found.start)} to {instant(found.end)} s{began}; a row every "
        f"{number(found.step)} s{steps}"
    )


def channel_table(found: Inspection) -> Table:
    """Header and rows of the table of channels."""
    rows = [[f"{one.name} [{one.unit}]", *_cells(one)] for one in found.channels]
    return ["channel", "samples", "missing", "rate [1/s]", "lowest", "mean", "highest"], rows


def inspection_notes(found: Inspection) -> list[str]:
    """Sentences on what is to be known of the channels."""
    without = [one.name for one in found.channels if one.unit == "?"]
    lines = [f"without units, which --units COLUMN=UNIT gives where a model needs them: {few(without)}"]
    return [
        *(lines if without else ()), *(f"note: {one}" for one in found.findings),
        *(f"suspicious: {one}" for one in found.suspicions),
    ]  # fmt: skip


def _cells(one: ChannelSummary) -> list[str]:
    values = [few(one.codes), "", ""] if one.codes else [shown(each, 4) for each in (one.lowest, one.mean, one.highest)]
    return [str(one.samples), str(one.missing), shown(one.rate), *values]


def inspection_figure(log: Log) -> Figure:
    """All channels of a log over time, a panel for each unit; codes are steps between their names."""
    panels = _panels(list(log.channels.values()))
    with figure_style():
        figure = Figure(figsize=(9.5, 0.8 + 1.5 * max(1, len(panels))), layout="constrained")
        axes = figure.subplots(max(1, len(panels)), 1, sharex=True, squeeze=False)[:, 0]
        for panel, channels in zip(axes, panels, strict=False):
            for channel, colour in zip(channels, LINES, strict=False):
                valid = ~channel.missing
                if channel.is_text:
                    panel.plot(log.time[valid], channel.values[valid].tolist(), ".", color=colour, label=channel.name)
                    continue
                time, values = thinned(log.time[valid], channel.numbers[valid])
                panel.plot(time, values, color=colour, label=plain(channel.name), linewidth=0.9)
            panel.set_ylabel(
                plain(f"{channels[0].name}\n[{channels[0].unit}]") if len(channels) == 1 else f"[{channels[0].unit}]"
            )
            if len(channels) > 1:
                panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)
        axes[0].set_title(plain(log.name))
        axes[-1].set_xlabel("time [s]")
    return figure


def _panels(channels: Sequence[LogChannel]) -> list[list[LogChannel]]:
    """Numeric channels by unit, as many as there are colours in each panel; every channel of codes by itself."""
    panels: list[list[LogChannel]] = []
    open_by_unit: dict[str, list[LogChannel]] = {}
    for channel in channels:
        if channel.missing.all():
            continue
        group = open_by_unit.get(channel.unit)
        if channel.is_text or group is None or len(group) == len(LINES):
            group = []
            panels.append(group)
            if not channel.is_text:
                open_by_unit[channel.unit] = group
        group.append(channel)
    return panels
