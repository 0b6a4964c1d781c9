"""Runs of a filter as a figure (matplotlib, without global state, loaded when one is drawn)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bondgraph.filter.filter_run import FilterRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Inches of a panel.
_WIDTH, _HEIGHT = 5.0, 1.9


def run_figure(runs: Sequence[FilterRun]) -> Figure:
    """Measured channels over their predictions one step ahead: a row for each channel, a column for each run.

    Parameters
    ----------
    runs
        Of one filter model.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.filter.runs import run
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> [axes.get_ylabel() for axes in run_figure([run(swing, log, compiled=False)]).axes]
    ['deflection [m]']
    """
    from matplotlib.figure import Figure  # here: only those who draw load it

    outputs = runs[0].filter_model.model.outputs
    rows = [k for k in range(len(outputs)) if any(np.isfinite(run.y[k]).any() for run in runs)]
    figure = Figure(figsize=(_WIDTH * len(runs), _HEIGHT * len(rows) + 0.6), layout="constrained")
    panels = figure.subplots(len(rows), len(runs), squeeze=False, sharex="col", sharey="row")
    for column, run in enumerate(runs):
        for row, output in enumerate(rows):
            _draw_channel(panels[row][column], run, output)
        panels[0][column].set_title(run.log_name)
        panels[-1][column].set_xlabel("time [s]")
    for row, output in enumerate(rows):
        panels[row][0].set_ylabel(f"{outputs[output].name} [{outputs[output].display_unit or 1}]")
    panels[0][0].legend(loc="best", fontsize="small")
    return figure


def _draw_channel(axes: Axes, run: FilterRun, row: int) -> None:
    """One channel of one run; the first sample is left out, since the prior and not the model expects it."""
    info, time = run.filter_model.model.outputs[row], run.time[1:]
    expected = info.shown(run.output_mean[row, 1:])
    reach = 2.0 * info.shown(np.sqrt(run.output_cov[row, row, 1:]))
    axes.fill_between(time, expected - reach, expected + reach, alpha=0.25, linewidth=0.0, label="two deviations")
    axes.plot(time, expected, label="one step ahead")
    axes.plot(run.time, info.shown(run.y[row]), ".", color="0.4", markersize=2.5, label="measured")
