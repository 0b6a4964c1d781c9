"""What a log holds, seen without a model: channels, rates, gaps, outliers, suspicious units, and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bondgraph.data.checks import check_log
from bondgraph.data.given import GivenLog, as_read
from bondgraph.data.log import FloatArray, Log, LogChannel
from bondgraph.data.pairs import factor_suspicions, offset_suspicions
from bondgraph.data.suspicions import looks_counted_in_milliseconds, time_gaps
from bondgraph.errors import OptionError, require_kind, suggest
from bondgraph.frames import frame
from bondgraph.report.diagram.text import plain
from bondgraph.report.figures import LINES, figure_style
from bondgraph.report.numbers import shown
from bondgraph.report.thinning import thinned
from bondgraph.shown import Tabulated, own_axes
from bondgraph.text import Table, count, few, instant, number, text_table

if TYPE_CHECKING:
    import pandas

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


@dataclass(frozen=True, repr=False)
class Inspection(Tabulated):
    """A log in numbers and sentences.

    ``step`` is the usual, ``steps`` the shortest and the longest time between rows, s; ``began`` the date of the start.
    ``source`` is the log itself, for pictures.
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
    source: Log | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        found = f"{count(len(self.findings), 'note')}, {count(len(self.suspicions), 'suspicion')}"
        return f"<Inspection of {self.log}: {few([one.name for one in self.channels])}; {found}>"

    def summary(self) -> str:
        """The table of channels, then notes and suspicions as sentences."""
        return inspection_text(self)

    def table(self) -> Table:
        """A row for each channel."""
        return channel_table(self)

    def to_dataframe(self) -> pandas.DataFrame:
        """The channels as a data frame, a row for each.

        Columns ``unit``, ``samples``, ``missing``, ``rate`` in 1/s, ``lowest``, ``mean``, ``highest``.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        names = ("unit", "samples", "missing", "rate", "lowest", "mean", "highest")
        columns = {name: [getattr(one, name) for one in self.channels] for name in names}
        return frame(columns, [one.name for one in self.channels], "channel")

    def plot(self, channel: str = "", ax: Axes | None = None) -> Figure | Axes:
        """All channels over time as a figure; one of them on axes where it is named or ``ax`` is given.

        Parameters
        ----------
        channel
            Which one; by default the first.
        ax
            Axes to draw on; None: those of a new figure.

        Raises
        ------
        OptionError
            If there is no such channel, or the log is not at hand.
        """
        if self.source is None:
            raise OptionError(f"plot: the inspection of {self.log} holds no log - use bg.inspect(log)", ("plot",))
        if not channel and ax is None:
            return inspection_figure(self.source)
        known = self.source.channels
        if channel and channel not in known:
            raise OptionError(
                f"plot: no channel is called {channel!r}{suggest(channel, known)} - there is {', '.join(known)}",
                where=(channel,),
            )
        axes = own_axes(ax)
        _draw(axes, self.source, [known[channel or next(iter(known))]])
        axes.set(title=plain(self.log), xlabel="time [s]")
        return axes

    def to_dict(self) -> dict[str, Any]:
        """The same as values of JSON."""
        found = asdict(replace(self, source=None))
        del found["source"]
        return found


def inspect(log: GivenLog) -> Inspection:
    """Channels, rates, gaps and outliers of a log, and what is suspicious in it, before anything is computed.

    Parameters
    ----------
    log
        As read, a file, or a data frame whose columns are called ``name [unit]``.

    Raises
    ------
    OptionError
        If it is no log.
    DataError
        If a file cannot be read, or a channel has a unit that is not one.

    Examples
    --------
    >>> import bondgraph as bg
    >>> time = np.arange(50) * 0.02
    >>> log = bg.Log("run", time, {"v": bg.LogChannel("v", "m/s", 20.0 * time)})
    >>> found = bg.inspect(log)
    >>> found
    <Inspection of run: v; 0 notes, 0 suspicions>
    >>> print(found.summary())
    run: 50 rows from 0 to 0.98 s; a row every 0.02 s
    channel  samples  missing  rate [1/s]  lowest   mean  highest
    v [m/s]       50        0        50.0       0  9.800    19.60
    >>> found.plot("v").get_title()
    'run'
    """
    read = as_read(log, "log")
    require_kind("inspect", read, Log, "log")
    return inspect_log(read)


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
    if looks_counted_in_milliseconds(log.time):
        said = (
            f"times are whole numbers, about {number(usual)} s apart and uneven: are they milliseconds ('time [ms]')?"
        )
        suspicions.insert(0, said)
    found = [finding.message for finding in check_log(log)]
    return Inspection(
        log.name, len(log), float(log.time[0]), float(log.time[-1]), usual, ends, log.metadata.get("start", ""),
        tuple(_summary(log.time, channel) for channel in log.channels.values()),
        (*time_gaps(log.time, log.first_row), *found), tuple(suspicions), log,
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
    if found.rows == 1:
        return f"{found.log}: 1 row at {instant(found.start)} s{began}"
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
            _draw(panel, log, channels)
        axes[0].set_title(plain(log.name))
        axes[-1].set_xlabel("time [s]")
    return figure


def _draw(panel: Axes, log: Log, channels: Sequence[LogChannel]) -> None:
    """Channels of one unit, or one of codes, over time."""
    for channel, colour in zip(channels, LINES, strict=False):
        valid = ~channel.missing
        if channel.is_text:
            panel.plot(log.time[valid], channel.values[valid].tolist(), ".", color=colour, label=channel.name)
            continue
        time, values = thinned(log.time[valid], channel.numbers[valid])
        panel.plot(time, values, color=colour, label=plain(channel.name), linewidth=0.9)
    unit = f"[{channels[0].unit}]"
    panel.set_ylabel(plain(f"{channels[0].name}\n{unit}") if len(channels) == 1 else unit)
    if len(channels) > 1:
        panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)


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
