"""The picture of a manoeuvre: the panels that were declared beside the machine, and its inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bondgraph.errors import OptionError, suggest
from bondgraph.report.diagram.text import plain
from bondgraph.report.figures import LINES, figure_style
from bondgraph.report.series import FloatArray
from bondgraph.simulate.quantities import InputInfo, OutputInfo, StateInfo
from bondgraph.simulate.scenario import Panel
from bondgraph.simulate.trajectory import Trajectory
from bondgraph.units import conversion

_HEIGHT = 1.55


def manoeuvre_figure(trajectory: Trajectory, panels: Sequence[Panel], title: str = "") -> Figure:
    """Declared panels of a simulation over a common time axis, below them the inputs that move.

    Parameters
    ----------
    trajectory
        What was simulated; named signals among its outputs.
    panels
        What to show. A panel of which the model has nothing is left out.
    title
        Stands above the picture.

    Raises
    ------
    OptionError
        If the model has nothing of any panel.
    """
    known = _quantities(trajectory)
    shown = [panel for panel in panels if set(panel.curves.values()) & set(known)]
    if not shown:
        wanted = [name for panel in panels for name in panel.curves.values()]
        raise OptionError(
            f"{trajectory.model.name}: none of {', '.join(wanted)} is a quantity of the model"
            f"{suggest(wanted[0], known) if wanted else ''}"
        )
    moving = [row for row in range(len(trajectory.u)) if np.ptp(trajectory.u[row]) > 0]
    count = len(shown) + bool(moving)
    with figure_style():
        figure = Figure(figsize=(8.5, 0.9 + _HEIGHT * count), layout="constrained")
        axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        for one, panel in zip(axes, shown, strict=False):
            _curves(one, trajectory.time, panel, known)
        if moving:
            _inputs(axes[-1], trajectory, moving)
        figure.suptitle(plain(title or trajectory.model.name), x=0.01, ha="left", fontsize=11.0, fontweight="bold")
        axes[-1].set_xlabel("time [s]")
        axes[-1].set_xlim(float(trajectory.time[0]), float(trajectory.time[-1]))
        figure.align_ylabels(list(axes))
    return figure


def _quantities(trajectory: Trajectory) -> dict[str, tuple[str, FloatArray]]:
    """Unit and values by name; a state comes before an output or signal of the same name."""
    model = trajectory.model
    infos: list[StateInfo | OutputInfo | InputInfo] = [*model.inputs, *model.outputs, *model.states]
    rows = (*trajectory.u, *trajectory.y, *trajectory.x)
    return {info.name: (info.display_unit, info.shown(row)) for info, row in zip(infos, rows, strict=True)}


def _curves(axes: Axes, time: FloatArray, panel: Panel, known: dict[str, tuple[str, FloatArray]]) -> None:
    curves = [(label, *known[name]) for label, name in panel.curves.items() if name in known]
    for (label, unit, values), colour in zip(curves, LINES, strict=False):
        factor, offset = conversion(unit or "1", panel.unit)
        axes.plot(time, values * factor + offset, color=colour, label=label)
    axes.set_ylabel(f"{panel.title}\n[{_plain(panel.unit)}]")
    if len(curves) > 1:
        _legend(axes)


def _inputs(axes: Axes, trajectory: Trajectory, rows: Sequence[int]) -> None:
    for row, colour in zip(rows, LINES, strict=False):
        info = trajectory.model.inputs[row]
        steps = "steps-post" if info.interpolation == "hold" else "default"
        label, values = f"{info.name} [{info.display_unit}]", info.shown(trajectory.u[row])
        axes.plot(trajectory.time, values, color=colour, label=label, drawstyle=steps)
    axes.set_ylabel("inputs")
    _legend(axes)


def _legend(axes: Axes) -> None:
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)


def _plain(unit: str) -> str:
    return "-" if unit == "1" else unit
