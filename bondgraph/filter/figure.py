"""Runs of a filter as a figure (matplotlib, without global state, loaded when one is drawn)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, overload

import numpy as np

from bondgraph.errors import OptionError, suggest
from bondgraph.filter.filter_run import FilterRun
from bondgraph.shown import own_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bondgraph.simulate.quantities import OutputInfo

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

    outputs, rows = runs[0].filter_model.model.outputs, _measured(runs)
    figure = Figure(figsize=(_WIDTH * len(runs), _HEIGHT * len(rows) + 0.6), layout="constrained")
    panels = figure.subplots(len(rows), len(runs), squeeze=False, sharex="col", sharey="row")
    for column, run in enumerate(runs):
        for row, output in enumerate(rows):
            _draw_channel(panels[row][column], run, output)
        panels[0][column].set_title(run.log_name)
        panels[-1][column].set_xlabel("time [s]")
    for row, output in enumerate(rows):
        panels[row][0].set_ylabel(_label(outputs[output]))
    panels[0][0].legend(loc="best", fontsize="small")
    return figure


def run_panel(runs: Sequence[FilterRun], output: str = "", log: str = "", ax: Axes | None = None) -> Axes:
    """One panel of :func:`run_figure`: the first measured output, the first log, unless others are named.

    Raises
    ------
    OptionError
        If no log or measured output is called so.
    """
    outputs = runs[0].filter_model.model.outputs
    rows, names = {outputs[row].name: row for row in _measured(runs)}, {run.log_name: run for run in runs}
    for asked, known, what in ((output, rows, "measured output"), (log, names, "log")):
        if asked and asked not in known:
            raise OptionError(
                f"plot: no {what} is called {asked!r}{suggest(asked, known)} - there is {', '.join(known)}", (asked,)
            )
    row, shown = rows[output or next(iter(rows))], names[log or next(iter(names))]
    axes = own_axes(ax)
    _draw_channel(axes, shown, row)
    axes.set(title=shown.log_name, xlabel="time [s]", ylabel=_label(outputs[row]))
    axes.legend(loc="best", fontsize="small")
    return axes


def _label(output: OutputInfo) -> str:
    return f"{output.name} [{output.display_unit or 1}]"


def _measured(runs: Sequence[FilterRun]) -> list[int]:
    """Rows of the outputs that a log measures."""
    return [k for k in range(len(runs[0].y)) if any(np.isfinite(run.y[k]).any() for run in runs)]


def _draw_channel(axes: Axes, run: FilterRun, row: int) -> None:
    """One channel of one run; the first sample is left out, since the prior and not the model expects it."""
    info, time = run.filter_model.model.outputs[row], run.time[1:]
    expected = info.shown(run.output_mean[row, 1:])
    reach = 2.0 * info.shown(np.sqrt(run.output_cov[row, row, 1:]))
    axes.fill_between(time, expected - reach, expected + reach, alpha=0.25, linewidth=0.0, label="two deviations")
    axes.plot(time, expected, label="one step ahead")
    axes.plot(run.time, info.shown(run.y[row]), ".", color="0.4", markersize=2.5, label="measured")


class Panels:
    """Results that hold runs, and draw them."""

    @property
    @abstractmethod
    def runs(self) -> Sequence[FilterRun]:
        """Runs of one filter model."""

    @overload
    def plot(self) -> Figure: ...

    @overload
    def plot(self, output: str = "", log: str = "", *, ax: Axes) -> Axes: ...

    @overload
    def plot(self, output: str, log: str = "", ax: Axes | None = None) -> Axes: ...

    def plot(self, output: str = "", log: str = "", ax: Axes | None = None) -> Figure | Axes:
        """Measured channels and what the model expects one step ahead, with a band of two deviations.

        Parameters
        ----------
        output, log
            One panel alone; the first measured output or the first log where only the other or ``ax`` is given.
        ax
            Where the panel is drawn; None: in a figure of its own.

        Returns
        -------
        Figure or Axes
            Without arguments a row for each channel and a column for each log, else the axes of one panel. All are in
            declared units.

        Raises
        ------
        OptionError
            If no log or measured output is called so.
        """
        return run_panel(self.runs, output, log, ax) if output or log or ax is not None else run_figure(self.runs)
