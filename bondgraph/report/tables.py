"""Tables for the terminal (rich): errors before and after, parameters, alternatives."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich import box
from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from bondgraph.report.numbers import MISSING, change, shown, with_interval
from bondgraph.report.series import ChannelError, ParameterChange, Power, Tried
from bondgraph.report.words import law_title

ALL_LOGS = "all logs"
#: Lines of a long table that are read first, and from how many lines on it is long: conventions.
_FIRST_SIZES, _FOLDED_FROM = 10, 15


def pooled(errors: Sequence[ChannelError]) -> tuple[ChannelError, ...]:
    """Errors of each channel over all logs of one kind, measurements counting equally, in order of appearance.

    Examples
    --------
    >>> runs = [ChannelError(log, "v", "m/s", False, 0.1, 0.1, error, 0.2, samples=n)
    ...         for log, error, n in (("a", 3.0, 100), ("b", 4.0, 100))]
    >>> (row,) = pooled(runs)
    >>> row.log, round(row.simulation_before, 4), row.samples
    ('all logs', 3.5355, 200)
    """
    groups: dict[tuple[bool, str], list[ChannelError]] = {}
    for error in errors:
        groups.setdefault((error.held_out, error.channel), []).append(error)
    rows = []
    for (held_out, channel), parts in groups.items():
        rows.append(
            ChannelError(
                ALL_LOGS,
                channel,
                parts[0].unit,
                held_out,
                _pool([(part.one_step_before, part.samples) for part in parts]),
                _pool([(part.one_step_after, part.samples) for part in parts]),
                _pool([(part.simulation_before, part.samples) for part in parts]),
                _pool([(part.simulation_after, part.samples) for part in parts]),
                parts[0].noise_std,
                sum(part.samples for part in parts),
            )
        )
    return tuple(rows)


def _pool(parts: Sequence[tuple[float, int]]) -> float:
    """Root of the weighted mean square; logs without a value are left out."""
    known = [(value, weight) for value, weight in parts if not math.isnan(value)]
    total = sum(weight for _, weight in known)
    return math.sqrt(sum(weight * value**2 for value, weight in known) / total) if total else math.nan


def grouped_errors(errors: Sequence[ChannelError]) -> list[tuple[str, tuple[ChannelError, ...]]]:
    """Errors as they are shown: training, then held out; by channel, each log and then all of them together."""
    groups = []
    for title, held_out in (("training", False), ("held out", True)):
        part = [error for error in errors if error.held_out is held_out]
        rows: list[ChannelError] = []
        for total in pooled(part):
            logs = [error for error in part if error.channel == total.channel]
            rows += logs if len(logs) == 1 else [*logs, total]
        if rows:
            groups.append((title, tuple(rows)))
    return groups


def error_table(errors: Sequence[ChannelError], title: str = "error before and after (rms)") -> Table:
    """Errors per channel and log, free simulation and one step ahead, against the noise of the sensor."""
    table = _table(title)
    for name in ("data", "channel", "log"):
        table.add_column(name, overflow="fold")  # the ends of names tell logs apart
    for name in ("simulation\nbefore", "after", "change", "one step\nbefore", "after", "change", "sensor\nnoise"):
        table.add_column(name, justify="right")
    for group, rows in grouped_errors(errors):
        channel = ""
        for index, row in enumerate(rows):
            first = row.channel != channel
            channel = row.channel
            table.add_row(
                group if index == 0 else "",
                Text(f"{channel} [{row.unit}]" if first else ""),
                Text(row.log),
                *_errors(row.simulation_before, row.simulation_after),
                *_errors(row.one_step_before, row.one_step_after),
                shown(row.noise_std),
                style="bold" if row.log == ALL_LOGS else None,
                end_section=index + 1 == len(rows),
            )
    return table


def _table(title: str) -> Table:
    return Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)


def _errors(before: float, after: float) -> tuple[str, str, Text]:
    text = change(before, after)
    style = "dim" if text in (MISSING, "0 %") else "green" if after < before else "red"
    return shown(before), shown(after), Text(text, style=style)


def parameter_table(parameters: Sequence[ParameterChange], title: str = "parameters") -> Table:
    """Free parameters before and after with their 95 % intervals."""
    table = _table(title)
    for name, right in (("name", 0), ("before", 1), ("after", 1), ("95 % interval", 1), ("unit", 0), ("", 0)):
        table.add_column(name, justify="right" if right else "left")
    for row in parameters:
        value, interval = with_interval(row.after, row.ci95)
        note = Text("at its bound", style="yellow") if row.at_bound else Text(row.meaning, style="dim")
        table.add_row(Text(row.name), shown(row.before, 4), value, Text(interval), Text(row.unit), note)
    return table


def alternatives_table(alternatives: Sequence[Tried], title: str = "what was tried") -> Table:
    """Effects that were considered, with their gain of log-likelihood and why each was taken or not."""
    table = _table(title)
    table.add_column("effect")
    table.add_column("at")
    table.add_column(Text("gain [nats]"), justify="right")
    table.add_column("why")
    for row in alternatives:
        style = "bold green" if row.chosen else "yellow" if row.indistinguishable else None
        table.add_row(Text(law_title(row.name)), Text(row.junction), shown(row.delta_nll), Text(row.why), style=style)
    return table


def first_sizes(power: Sequence[Power]) -> tuple[list[Power], list[Power]]:
    """Sizes that are read first and the others: effects that logs would show come first, of every place in turn.

    Examples
    --------
    >>> many = [Power(f"loss_{one}", place, 2.0, "N") for place in ("front", "rear") for one in range(12)]
    >>> first, more = first_sizes([Power("drag", "front", math.inf, "N"), *many])
    >>> [one.junction for one in first[:3]], len(first), more[-1].effect
    (['front', 'rear', 'front'], 10, 'drag')
    """
    places: dict[str, int] = {}
    turns = []
    for one in power:
        known = math.isfinite(one.size)
        places[one.junction] = places.get(one.junction, 0) + known
        turns.append((not known, places[one.junction] if known else 0))
    ordered = [power[index] for index in sorted(range(len(power)), key=turns.__getitem__)]
    count = _FIRST_SIZES if len(power) > _FOLDED_FROM else len(power)
    return ordered[:count], ordered[count:]


def power_table(power: Sequence[Power], title: str = "smallest size found nine times in ten") -> Table:
    """Sizes that the logs would have shown, effect by effect; of many the first that :func:`first_sizes` gives."""
    table = _table(title)
    for name, right in (("effect", 0), ("at", 0), ("size", 1), ("unit", 0)):
        table.add_column(name, justify="right" if right else "left")
    rows, more = first_sizes(power)
    if more:
        table.caption, table.caption_justify = f"{len(more)} more in the report and in result.json", "left"
    for row in rows:
        known = math.isfinite(row.size)
        size = shown(row.size) if known else "not with these logs"
        table.add_row(Text(law_title(row.effect)), Text(row.junction), size, Text(row.unit if known else ""))
    return table


def text_of(table: RenderableType, width: int = 120) -> str:
    """A table as plain text, without colour."""
    # force_jupyter: in a notebook the text would be displayed too, wherever it is asked for
    console = Console(width=width, color_system=None, force_terminal=False, force_jupyter=False)
    with console.capture() as capture:
        console.print(table)
    return "\n".join(line.rstrip() for line in capture.get().splitlines()) + "\n"
