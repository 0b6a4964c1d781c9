"""A model at given parameters laid over logs: free simulation from the start of each, errors per channel, pictures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bondgraph.data.given import GivenLog, all_matched
from bondgraph.data.log import FloatArray, Log, MatchedLog
from bondgraph.data.write import write_log
from bondgraph.errors import BondGraphError, OptionError, require_kind, suggest
from bondgraph.estimate.initial import Initial, initial_states
from bondgraph.estimate.inputs_before import with_inputs_before
from bondgraph.estimate.setup import filter_setup
from bondgraph.files import write_json
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.linear.intervals import integrator, simulation_steps
from bondgraph.frames import frame
from bondgraph.report.diagram.text import plain
from bondgraph.report.figures import BEFORE, MEASURED, PANEL_HEIGHT, WIDTH, figure_style, save_figure
from bondgraph.report.numbers import shown
from bondgraph.report.series import ChannelSeries, Prediction
from bondgraph.report.simulation import trajectory_log
from bondgraph.report.suspicions import sampling_suspicions, unit_suspicions
from bondgraph.report.thinning import thinned
from bondgraph.shown import Tabulated, own_axes
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from bondgraph.text import Table, few, instant, text_table

if TYPE_CHECKING:
    import pandas

#: A method that chooses its own steps starts anew at every sample, a millisecond each. Logs with more samples than an
#: hour of a machine has, at 40 in a second, are simulated with the fixed steps of their filter, halved.
_LONG = 150_000

_Named = TypeVar("_Named")


@dataclass(frozen=True)
class ChannelMisfit:
    """Measured minus simulated values of a channel, in its declared unit; NaN where the simulation failed.

    ``largest`` is the error of largest size, at ``largest_at`` in s. ``fit`` is 1 - rms error / standard deviation of
    what was measured: 1 is perfect, 0 no better than the mean (Ljung 1999, System Identification, section 16.4).
    """

    channel: str
    unit: str
    samples: int
    rms: float
    mean: float
    largest: float
    largest_at: float
    fit: float


@dataclass(frozen=True, repr=False)
class ComparedLog:
    """A log with the free simulation of it; ``failure`` says why there is none, ``steps`` how a long one was made.

    ``simulated`` holds what was computed, also what the log does not measure.
    """

    log: str
    errors: tuple[ChannelMisfit, ...]
    series: tuple[ChannelSeries, ...]
    simulated: Log | None
    failure: str = ""
    steps: str = ""

    def __repr__(self) -> str:
        return f"<ComparedLog {self.log}: {self.failure or ', '.join(error.channel for error in self.errors)}>"


@dataclass(frozen=True, repr=False)
class Compared(Tabulated):
    """A model laid over logs, and what is suspected of the logs."""

    model: str
    runs: tuple[ComparedLog, ...]
    suspicions: tuple[str, ...]

    def __repr__(self) -> str:
        fits = [f"{run.log}: {one.channel} {shown(100.0 * one.fit)} %" for run in self.runs for one in run.errors]
        return f"<Compared {self.model}: fit of {few(fits)}>"

    def summary(self) -> str:
        """The table of errors, then failures and suspicions as sentences."""
        return comparison_text(self)

    def table(self) -> Table:
        """A row for each channel of each log that was simulated: measured minus simulated values."""
        return _error_table(self)

    def to_dataframe(self) -> pandas.DataFrame:
        """The errors as a data frame, a row for each channel of each log, in declared units; NaN where a run failed.

        Columns ``log``, ``unit``, ``samples``, ``rms``, ``mean``, ``largest``, ``largest_at`` in s, ``fit``.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        each = [(run.log, one) for run in self.runs for one in run.errors]
        names = ("unit", "samples", "rms", "mean", "largest", "largest_at", "fit")
        columns = {name: [getattr(one, name) for _, one in each] for name in names}
        return frame({"log": [log for log, _ in each], **columns}, [one.channel for _, one in each], "channel")

    def plot(self, channel: str = "", log: str = "", ax: Axes | None = None) -> Figure | Axes:
        """Measured and simulated values of one log with their difference as a figure.

        One channel on axes where it is named or ``ax`` is given.

        Parameters
        ----------
        channel, log
            Which ones; by default the first.
        ax
            Axes to draw on; None: those of a new figure.

        Raises
        ------
        OptionError
            If no log or measured channel is called so.
        """
        run = _named(log, {one.log: one for one in self.runs}, "log")
        if not channel and ax is None:
            return comparison_figure(run)
        series = _named(channel, {one.channel: one for one in run.series}, "measured channel")
        axes = own_axes(ax)
        _draw_values(axes, series)
        axes.set(title=plain(run.log), xlabel="time [s]")
        axes.legend(loc="best", fontsize="small")
        return axes


def _named(asked: str, known: Mapping[str, _Named], what: str) -> _Named:
    """The one that is called so, or the first."""
    if not known or (asked and asked not in known):
        raise OptionError(
            f"plot: no {what} is called {asked!r}{suggest(asked, known)} - there is {', '.join(known) or 'none'}",
            where=(asked,),
        )
    return known[asked or next(iter(known))]


def compare(
    model: Model,
    logs: GivenLog | Sequence[GivenLog],
    *,
    initial: Initial = "measured",
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
) -> Compared:
    """Lay a model at its declared values over logs: errors of free simulation, and what is suspected of the logs.

    Parameters
    ----------
    model
        Built from a graph or loaded.
    logs
        One or several logs: as read, matched, files or data frames.
    initial
        Where states start, see :func:`bondgraph.estimate.initial.initial_states`.
    columns
        Name of a column -> name in the model, where they differ.
    constants
        Values (or letters) of inputs that a log lacks.

    Raises
    ------
    BondGraphError
        If a log does not fit the model. A simulation that fails is said in its place.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> time = np.arange(60) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 60)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> compared = bg.compare(pendulum(), log)
    >>> compared
    <Compared pendulum: fit of swing: deflection 92.4 %>
    >>> compared.runs[0].errors[0].rms < 0.1
    True
    >>> compared.plot("deflection").get_title()
    'swing'
    """
    require_kind("compare", model, Model, "model")
    return compare_logs(model, all_matched(logs, model, columns, constants), model.driven, initial)


def compare_logs(
    model: Model, logs: Sequence[MatchedLog], driven: Sequence[str] = (), initial: Initial = "measured"
) -> Compared:
    """Simulate a model over the inputs of logs and compare it with what they measured.

    Parameters
    ----------
    model
        At its declared parameters; those that a log knows have its values.
    logs
        Matched logs.
    driven
        States that noise may drive, for the integration steps of what is suspected.
    initial
        Where states start.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> time = np.arange(60) * 0.05
    >>> measured = simulate(pendulum(), time, theta={"length": 1.2}, x0={"angle": 0.4}).y
    >>> swing = MatchedLog("swing", time, np.zeros((1, 60)), measured)
    >>> compared = compare_logs(pendulum(), [swing])
    >>> error = compared.runs[0].errors[0]
    >>> error.channel, error.samples, error.rms > 0.01
    ('deflection', 60, True)
    """
    suspicions: list[str] = []
    runs = []
    steps = filter_setup(model, driven or model.names("state"), logs).filter_model
    for log in logs:
        found = [*sampling_suspicions(model, log, initial), *unit_suspicions(steps, log, initial)]
        suspicions += [f"{log.name}: {one}" for one in found]
        runs.append(_compared(model, log, initial, steps))
    return Compared(model.name, tuple(runs), tuple(suspicions))


def _compared(model: Model, log: MatchedLog, initial: Initial, filter_model: FilterModel) -> ComparedLog:
    theta = model.theta(**dict(log.theta_overrides))
    run, failure, steps = None, "", ""
    try:
        (log,) = with_inputs_before(model, [log], theta, initial)
        start = initial_states(model, [log], theta, initial)[0]
        method: dict[str, Any] = {}
        if len(log) > _LONG:
            count = simulation_steps(filter_model, log.time)
            method, steps = {"method": integrator(filter_model), "substeps": count}, _said(filter_model, count)
        run = simulate(model, log.time, inputs_of(model, log), theta, start, compiled=True, **method).raise_if_failed()
    except BondGraphError as error:
        run, failure = None, error.message
    channels = []
    for row, info in enumerate(model.outputs):
        if not np.isnan(log.y[row]).all():
            measured = np.asarray(info.shown(log.y[row]))
            simulated = np.full(measured.shape, np.nan) if run is None else np.asarray(info.shown(run.y[row]))
            channels.append((info.name, info.display_unit or "1", measured, simulated))
    return laid_over(log.name, log.time, channels, None if run is None else trajectory_log(run), failure, steps)


def laid_over(
    name: str,
    time: FloatArray,
    channels: Sequence[tuple[str, str, FloatArray, FloatArray]],
    simulated: Log | None,
    failure: str = "",
    steps: str = "",
) -> ComparedLog:
    """A log with what was simulated of it.

    Parameters
    ----------
    name
        Of the log.
    time
        Shape (n,), s.
    channels
        Name, unit, measured and simulated values, shape (n,) each; NaN where there are none.
    simulated
        All that was simulated.
    failure, steps
        Why there is no simulation, and how a long one was made.

    Examples
    --------
    >>> time, measured = np.arange(3.0), np.array([1.0, np.nan, 3.0])
    >>> laid_over("run", time, [("speed", "m/s", measured, time)], None).errors[0].rms
    1.0
    """
    errors = tuple(_misfit(label, unit, time, measured, values) for label, unit, measured, values in channels)
    series = tuple(
        ChannelSeries(name, label, unit, time, measured, Prediction(simulated=values))
        for label, unit, measured, values in channels
    )
    return ComparedLog(name, errors, series, simulated, failure, steps)


def _said(filter_model: FilterModel, count: int) -> str:
    """How a long log is simulated."""
    return f"simulated with {count} steps of {filter_model.method} between samples, twice as many as its filter takes"


def _misfit(name: str, unit: str, time: FloatArray, measured: FloatArray, simulated: FloatArray) -> ChannelMisfit:
    both = np.flatnonzero(np.isfinite(measured) & np.isfinite(simulated))
    samples = int(np.isfinite(measured).sum())
    if not both.size:
        return ChannelMisfit(name, unit, samples, *[math.nan] * 5)
    error = measured[both] - simulated[both]
    rms, spread = float(np.sqrt(np.mean(error**2))), float(np.std(measured[both]))
    worst = int(np.argmax(np.abs(error)))
    fit = 1.0 - rms / spread if spread > 0.0 else math.nan
    return ChannelMisfit(
        name, unit, samples, rms, float(error.mean()), float(error[worst]), float(time[both[worst]]), fit
    )


def write_comparison(compared: Compared, folder: Path) -> None:
    """Write ``result.json`` and for each log ``NAME_compared.png`` and the simulation, ``NAME_simulated.csv``.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    result: dict[str, Any] = {"model": compared.model, "suspicions": list(compared.suspicions), "logs": {}}
    for run in compared.runs:
        result["logs"][run.log] = {
            "channels": {error.channel: _plain(error) for error in run.errors},
            "failure": run.failure or None,
            **({"steps": run.steps} if run.steps else {}),
        }
        if run.simulated is not None:
            save_figure(comparison_figure(run), folder / f"{run.log}_compared.png")
            write_log(folder / f"{run.log}_simulated.csv", run.simulated)
    write_json(folder / "result.json", result)


def comparison_figure(run: ComparedLog) -> Figure:
    """Measured and simulated values of each channel on the left, their difference on the right."""
    rows = len(run.series)
    with figure_style():
        figure = Figure(figsize=(WIDTH, 0.9 + PANEL_HEIGHT * rows), layout="constrained")
        panels = figure.subplots(rows, 2, sharex=True, squeeze=False)
        for (values, error), one in zip(panels, run.series, strict=True):
            assert one.before.simulated is not None
            _draw_values(values, one)
            error.plot(*thinned(one.time, one.measured - one.before.simulated), ".", color=BEFORE, markersize=3.0)
            error.axhline(0.0, color=MEASURED, linewidth=0.8)
        panels[0][0].set_title(plain(run.log))
        panels[0][1].set_title("measured minus simulated")
        panels[0][0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)
        for axes in panels[-1]:
            axes.set_xlabel("time [s]")
    return figure


def _draw_values(axes: Axes, one: ChannelSeries) -> None:
    assert one.before.simulated is not None
    axes.plot(*thinned(one.time, one.measured), ".", color=MEASURED, markersize=3.0, label="measured")
    axes.plot(*thinned(one.time, one.before.simulated), color=BEFORE, label="simulated, as declared")
    axes.set_ylabel(plain(f"{one.channel}\n[{one.unit}]"))


def _plain(error: ChannelMisfit) -> dict[str, Any]:
    numbers = asdict(error)
    del numbers["channel"]
    return {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in numbers.items()}


def comparison_text(compared: Compared) -> str:
    """The errors of all channels as a table, failures and suspicions as sentences."""
    lines = []
    for run in compared.runs:
        if run.failure:
            lines.append(f"{run.log}: the simulation fails: {run.failure}")
        elif run.steps:
            lines.append(f"{run.log}: {run.steps}")
    header, rows = _error_table(compared)
    if rows:
        lines.append(text_table(header, rows))
    return "\n".join([*lines, *compared.suspicions])


def _error_table(compared: Compared) -> Table:
    rows = [
        [
            f"{run.log}: {one.channel} [{one.unit}]", str(one.samples), shown(one.rms), shown(one.mean),
            f"{shown(one.largest)} at {instant(one.largest_at)} s", shown(100.0 * one.fit),
        ]
        for run in compared.runs if not run.failure
        for one in run.errors
    ]  # fmt: skip
    return ["measured minus simulated", "samples", "rms", "mean", "largest", "fit [%]"], rows
