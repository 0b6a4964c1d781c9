"""Figures of the report (matplotlib, without global state)."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bondgraph.estimate.objective import TraceRow
from bondgraph.report.diagram.text import plain
from bondgraph.report.figures import (
    AFTER,
    BAND,
    BEFORE,
    FOUND,
    LINES,
    MEASURED,
    NARROW,
    PANEL_HEIGHT,
    WIDTH,
    figure_style,
)
from bondgraph.report.numbers import shown
from bondgraph.report.series import ChannelSeries, FloatArray, MissingEffort, Prediction, StateBand
from bondgraph.report.thinning import MOST_NARROW, MOST_POINTS, thinned, with_gaps
from bondgraph.simulate.quantities import InputInfo, OutputInfo, StateInfo
from bondgraph.simulate.trajectory import Trajectory

#: Letters in a line of a legend that fit into 7 inches and into a phone, and the height of such a line in inches.
_LETTERS, _LETTERS_NARROW, _LINE_HEIGHT = 84, 42, 0.16
#: Share of samples whose band a panel shows whole: before its first measurements a filter knows little, and a band of
#: then would press all that follows into a line. A convention.
_SETTLED = 0.95
#: Room above and below what a panel shows, as matplotlib leaves it.
_MARGIN = 0.05
#: Size of a measurement in points: wider than a line, which may run through it.
_DOT = 4.0


def prediction_figure(series: Sequence[ChannelSeries], narrow: bool = False) -> Figure:
    """Measured against predicted, a row per channel: the free simulation on the left, one step ahead on the right.

    Parameters
    ----------
    series
        The channels of one log.
    narrow
        For a phone: all panels one below the other.
    """
    columns = _columns(series)
    with figure_style():
        figure, panels = _grid(len(series), len(columns), share_heights=True, narrow=narrow)
        for row, one in enumerate(series):
            for column, kind in enumerate(columns):
                axes = panels[row][column]
                _dots(axes, one.time, one.measured)
                for predicted, colour in _before_and_after(one, kind):
                    _line(axes, one.time, predicted, colour)
                axes.set_ylabel(plain(f"{one.channel}\n[{one.unit}]") if narrow or column == 0 else "")
            _limit(panels[row][0], one.measured, 0.5)
        _finish(figure, panels, [_TITLES[kind] for kind in columns], series, measured=True)
    return figure


def residual_figure(series: Sequence[ChannelSeries], narrow: bool = False) -> Figure:
    """Measured minus predicted over time, a row per channel, with the noise band of two standard deviations."""
    columns = _columns(series)
    with figure_style():
        figure, panels = _grid(len(series), len(columns), share_heights=False, narrow=narrow)
        for row, one in enumerate(series):
            for column, kind in enumerate(columns):
                axes = panels[row][column]
                if np.isfinite(one.noise_std):
                    axes.axhspan(-2 * one.noise_std, 2 * one.noise_std, color=BAND, linewidth=0, zorder=0.5)
                for predicted, colour in _before_and_after(one, kind):
                    _residual(axes, one, predicted, colour)
                axes.set_ylabel(plain(f"{one.channel}\n[{one.unit}]") if narrow or column == 0 else "")
        _finish(figure, panels, [f"measured minus {_TITLES[kind]}" for kind in columns], series, measured=False)
    return figure


def state_figure(bands: Sequence[StateBand], title: str = "") -> Figure:
    """States with their 95 % bands over time, a panel each, and the measurements where there are any.

    A band may be narrower than a line: its usual half width stands in the panel.
    """
    with figure_style():
        figure, panels = _stacked(len(bands))
        for axes, band in zip(panels, bands, strict=True):
            _band(axes, band, AFTER)
            _dots(axes, band.time, band.measured)
            _line(axes, band.time, band.mean, AFTER)
            axes.set_ylabel(plain(f"{band.name}\n[{band.unit}]"))
            known = band.std[np.isfinite(band.std)]
            if known.size:
                _note(axes, f"95 % band: ± {shown(1.96 * float(np.median(known)))} {band.unit}")
        panels[0].set_title(plain(title))
        panels[-1].set_xlabel("time [s]")
    return figure


def innovation_figure(bands: Sequence[StateBand], title: str = "") -> Figure:
    """Innovations over time, a panel each, in the 95 % band that the filter expects, and how many lie within it."""
    with figure_style():
        figure, panels = _stacked(len(bands))
        for axes, band in zip(panels, bands, strict=True):
            _band(axes, band, MEASURED)
            axes.axhline(0.0, color=MEASURED, linewidth=0.8)
            _dots(axes, band.time, band.measured, AFTER)
            axes.set_ylabel(plain(f"{band.name}\n[{band.unit}]"))
            known = np.isfinite(band.measured)
            if known.any():
                within = np.mean(np.abs(band.measured[known]) <= 1.96 * band.std[known])
                _note(axes, f"{100.0 * within:.0f} % within the 95 % band")
        panels[0].set_title(plain(title))
        panels[-1].set_xlabel("time [s]")
    return figure


def _stacked(count: int) -> tuple[Figure, Sequence[Axes]]:
    figure = Figure(figsize=(8.5, 0.8 + 1.6 * count), layout="constrained")
    return figure, figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0].tolist()


def _band(axes: Axes, band: StateBand, colour: str) -> None:
    """The 95 % band about a mean, its edges drawn so that it is seen where it is narrow."""
    step = max(1, band.time.size // MOST_POINTS)
    low, high = (band.mean + sign * 1.96 * band.std for sign in (-1.0, 1.0))
    for edge in (low, high):
        axes.plot(*thinned(band.time, edge), color=colour, linewidth=0.6, alpha=0.6)
    axes.fill_between(band.time[::step], low[::step], high[::step], color=colour, alpha=0.22, linewidth=0)
    known = np.isfinite(band.std) & np.isfinite(band.mean)
    if known.any():
        settled = known & (band.std <= np.quantile(band.std[known], _SETTLED))
        told = np.concatenate([low[settled], high[settled], band.mean, band.measured])
        lowest, highest = float(np.nanmin(told)), float(np.nanmax(told))
        room = _MARGIN * (highest - lowest)
        if room > 0.0:
            axes.set_ylim(lowest - room, highest + room)


def _note(axes: Axes, text: str) -> None:
    """A remark above the right end of a panel."""
    axes.set_title(plain(text), loc="right", fontsize="small", fontweight="normal", color="#5b636d")


def launch_figure(trajectory: Trajectory, names: Sequence[str] = ()) -> Figure:
    """States, outputs and inputs of a simulation in stacked panels, one per unit.

    Parameters
    ----------
    trajectory
        What was simulated.
    names
        Which quantities to show, in this order; all of them if empty. An output equal to a state is shown once.
    """
    panels = _panels(_quantities(trajectory, names))
    held = {info.name for info in trajectory.model.inputs if info.interpolation == "hold"}
    with figure_style():
        figure = Figure(figsize=(8.5, 0.8 + 1.75 * len(panels)), layout="constrained")
        axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for panel, (unit, group) in zip(axes, panels, strict=True):
            for (name, values), colour in zip(group, LINES, strict=False):
                _line(panel, trajectory.time, values, colour, label=name, steps=name in held)
            panel.set_ylabel(f"{group[0][0]}\n[{unit}]" if len(group) == 1 else f"[{unit}]")
            if len(group) == 1:
                continue
            panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)
        axes[0].set_title(plain(trajectory.model.name))
        axes[-1].set_xlabel("time [s]")
        axes[-1].set_xlim(float(trajectory.time[0]), float(trajectory.time[-1]))
    return figure


def missing_effort_figure(found: MissingEffort, narrow: bool = False) -> Figure:
    """What is missing against what it depends on, with medians and the found law, which is written below the axes."""
    letters = _LETTERS_NARROW if narrow else _LETTERS
    law = "\n".join(textwrap.wrap(f"found: {plain(found.law_text)}", letters))
    with figure_style():
        size = NARROW if narrow else 7.0, 4.4 + _LINE_HEIGHT * law.count("\n")
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots()
        finite = np.isfinite(found.x) & np.isfinite(found.missing)
        x, missing = found.x[finite], found.missing[finite]
        keep = slice(None, None, max(1, x.size // 6000))
        axes.plot(
            x[keep], missing[keep], ".", color=MEASURED, markersize=2.5, alpha=0.35, label="each sample",
            rasterized=True,
        )  # fmt: skip
        centres, low, middle, high = _binned(x, missing)
        axes.errorbar(
            centres, middle, [middle - low, high - middle], fmt="o", color="#3a424b", markersize=4, linewidth=1.0,
            capsize=2.5, label="median and quartiles",
        )  # fmt: skip
        if found.lower is not None and found.upper is not None:
            axes.fill_between(found.law_x, found.lower, found.upper, color=FOUND, alpha=0.15, linewidth=0)
        axes.plot(found.law_x, found.law, color=FOUND, linewidth=2.0, label=law)
        axes.axhline(0.0, color="#8b95a1", linewidth=0.8)
        axes.set_title("\n".join(textwrap.wrap(plain(found.title), letters)))
        axes.set_xlabel("\n".join(textwrap.wrap(plain(found.x_label), letters)) if narrow else plain(found.x_label))
        axes.set_ylabel(plain(found.y_label))
        _limit(axes, np.concatenate((missing, found.law)), 0.1)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower left", ncols=1)
    return figure


def trace_figure(trace: Sequence[TraceRow]) -> Figure:
    """How a search came down: negative log-likelihood above its final value against evaluations, by stage."""
    with figure_style():
        figure = Figure(figsize=(7.0, 3.2), layout="constrained")
        axes = figure.subplots()
        # Not the least of all: a swarm that saw only how the logs begin has a likelihood of its own.
        best = next((row.nll for row in reversed(trace) if np.isfinite(row.nll)), 0.0)
        stages = list(dict.fromkeys(row.stage for row in trace))
        for stage, colour in zip(stages, LINES * len(stages), strict=False):
            rows = [row for row in trace if row.stage == stage and np.isfinite(row.nll)]
            above = [max(row.nll - best, 1e-3) for row in rows]
            axes.plot(
                [row.evaluations for row in rows], above, drawstyle="steps-post", color=colour, marker=".", label=stage
            )
        axes.set_yscale("log")
        axes.set_xlabel("likelihood evaluations")
        axes.set_ylabel("nll above the last [nats]")
        axes.set_title(f"search: last nll {best:.6g}")
        axes.legend(loc="upper right")
    return figure


_TITLES = {"simulated": "free simulation", "one_step": "one step ahead"}


def _columns(series: Sequence[ChannelSeries]) -> list[str]:
    """Which kinds of prediction any of the series has."""
    predictions = [prediction for one in series for prediction in (one.before, one.after) if prediction is not None]
    return [kind for kind in _TITLES if any(getattr(prediction, kind) is not None for prediction in predictions)]


def _before_and_after(one: ChannelSeries, kind: str) -> list[tuple[FloatArray, str]]:
    pairs: list[tuple[Prediction | None, str]] = [(one.before, BEFORE), (one.after, AFTER)]
    lines = [(getattr(prediction, kind), colour) for prediction, colour in pairs if prediction is not None]
    return [(values, colour) for values, colour in lines if values is not None]


def _grid(rows: int, columns: int, share_heights: bool, narrow: bool) -> tuple[Figure, list[list[Axes]]]:
    columns = max(columns, 1)
    if narrow:
        figure = Figure(figsize=(NARROW, 0.9 + PANEL_HEIGHT * rows * columns), layout="constrained")
        stacked = figure.subplots(rows * columns, 1, sharex=True, squeeze=False)[:, 0]
        panels = stacked.reshape(rows, columns)
        for row in panels if share_heights else ():
            for axes in row[1:]:
                axes.sharey(row[0])
        return figure, panels.tolist()
    width = WIDTH if columns > 1 else 0.72 * WIDTH
    figure = Figure(figsize=(width, 0.75 + PANEL_HEIGHT * rows), layout="constrained")
    return figure, figure.subplots(
        rows, columns, sharex=True, sharey="row" if share_heights else False, squeeze=False
    ).tolist()


def _finish(
    figure: Figure,
    panels: list[list[Axes]],
    titles: Sequence[str],
    series: Sequence[ChannelSeries],
    measured: bool,
) -> None:
    narrow = figure.get_size_inches()[0] == NARROW
    for row in panels if narrow else panels[:1]:
        for axes, title in zip(row, titles, strict=False):
            axes.set_title(title)
    for axes in panels[-1][-1:] if narrow else panels[-1]:
        axes.set_xlabel("time [s]")
    corrected = any(one.after is not None for one in series)
    handles = [Line2D([], [], color=BEFORE, label="before" if corrected else "the model")]
    if corrected:
        handles.append(Line2D([], [], color=AFTER, label="after"))
    if measured:
        handles.insert(0, Line2D([], [], color=MEASURED, linestyle="", marker=".", label="measured"))
    figure.legend(handles=handles, loc="outside upper right", ncols=3)


def _line(axes: Axes, time: FloatArray, values: FloatArray, colour: str, label: str = "", steps: bool = False) -> None:
    shown_time, shown_values = thinned(time, values, _most(axes))
    style = "steps-post" if steps else "default"
    axes.plot(shown_time, shown_values, color=colour, label=label or None, drawstyle=style)


def _dots(axes: Axes, time: FloatArray, values: FloatArray, colour: str = MEASURED) -> None:
    finite = np.isfinite(values)
    shown_time, shown_values = thinned(time[finite], values[finite], _most(axes))
    axes.plot(
        shown_time, shown_values, ".", color=colour, markersize=4.0, markeredgewidth=0.0, rasterized=True
    )  # wider than lines


def _residual(axes: Axes, one: ChannelSeries, predicted: FloatArray, colour: str) -> None:
    difference = one.measured - predicted
    finite = np.isfinite(difference)
    time, values = thinned(*with_gaps(one.time[finite], difference[finite]), _most(axes))
    axes.plot(time, values, color=colour, linewidth=0.8, alpha=0.85)


def _most(axes: Axes) -> int:
    """How many points of a line the width of a figure can show."""
    figure = axes.get_figure(root=True)
    return MOST_NARROW if figure is not None and figure.get_size_inches()[0] <= NARROW else MOST_POINTS


def _quantities(trajectory: Trajectory, names: Sequence[str]) -> list[tuple[str, str, FloatArray]]:
    """Name, unit and values of what is to be shown."""
    model = trajectory.model
    found: dict[str, tuple[str, FloatArray]] = {}
    infos: list[StateInfo | OutputInfo | InputInfo] = [*model.states, *model.outputs, *model.inputs]
    for info, row in zip(infos, (*trajectory.x, *trajectory.y, *trajectory.u), strict=True):
        own, values = info.display_unit, info.shown(row)
        known = any(unit == own and np.array_equal(values, old, equal_nan=True) for unit, old in found.values())
        if info.name in names or not (known or (isinstance(info, InputInfo) and info.late_of)):
            found.setdefault(info.name, (own, values))
    return [(name, *found[name]) for name in (names or found)]


def _panels(quantities: Sequence[tuple[str, str, FloatArray]]) -> list[tuple[str, list[tuple[str, FloatArray]]]]:
    """Quantities of one unit together; of very different size or too many, apart."""
    panels: list[tuple[str, list[tuple[str, FloatArray]]]] = []
    for name, unit, values in quantities:
        size = _size(values)
        for panel_unit, group in panels:
            sizes = [_size(other) for _, other in group if _size(other) > 0]
            alike = size == 0 or not sizes or max(*sizes, size) / min(*sizes, size) < 20
            if panel_unit == unit and len(group) < len(LINES) and alike:
                group.append((name, values))
                break
        else:
            panels.append((unit, [(name, values)]))
    return panels


def _size(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.abs(finite).max()) if finite.size else 0.0


def _binned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Centres of up to twelve equally wide intervals with the quartiles in each that holds enough samples."""
    if x.size == 0:
        return (np.empty(0),) * 4
    edges = np.linspace(float(x.min()), float(x.max()), 13)
    where = np.clip(np.digitize(x, edges) - 1, 0, 11)
    rows = []
    for k in range(12):
        inside = where == k
        if inside.sum() >= max(5, x.size // 400):
            rows.append((float(np.median(x[inside])), *np.quantile(y[inside], (0.25, 0.5, 0.75))))
    table = np.array(rows).reshape(-1, 4)
    return table[:, 0], table[:, 1], table[:, 2], table[:, 3]


def _limit(axes: Axes, values: FloatArray, margin: float) -> None:
    """Do not let a few wild samples, or a simulation that ran away, flatten what ``values`` show."""
    finite = values[np.isfinite(values)]
    if finite.size:
        low, high = (float(limit) for limit in np.quantile(finite, (0.002, 0.998)))
        space = margin * ((high - low) or abs(high) or 1.0)
        bottom, top = axes.get_ylim()
        axes.set_ylim(max(bottom, low - space), min(top, high + space))


def by_log(series: Sequence[ChannelSeries]) -> Mapping[str, Sequence[ChannelSeries]]:
    """The series grouped by log, in order of appearance."""
    grouped: dict[str, list[ChannelSeries]] = {}
    for one in series:
        grouped.setdefault(one.log, []).append(one)
    return grouped
