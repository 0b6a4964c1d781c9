"""Closing the loop on logs as a user holds them; its result with graph, tables and report."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bondgraph.build import build
from bondgraph.correct.loop import ClosedLoop, LoopSettings
from bondgraph.correct.loop import close_loop as close_matched
from bondgraph.correct.models.resting import without_resting_state
from bondgraph.correct.result import intervals
from bondgraph.data.given import GivenLog, all_matched
from bondgraph.declare.editing import with_inputs_between, without_input_rates
from bondgraph.declare.effect import EFFECTS, EffectFunction, effect_functions
from bondgraph.declare.files import load_graph
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.loading import load_module
from bondgraph.declare.quantities import Interpolation
from bondgraph.errors import OptionError, require_kind, suggest
from bondgraph.estimate.local import Report, no_report
from bondgraph.execute.executors import open_executor
from bondgraph.frames import frame
from bondgraph.report.closed_loop import all_series, report_data, summary, write_closed_loop
from bondgraph.report.collect import parameter_changes, versions
from bondgraph.report.figures import AFTER, BEFORE, MEASURED
from bondgraph.report.html import Provenance
from bondgraph.report.python_lines import correction_lines, write_python
from bondgraph.report.series import channel_errors
from bondgraph.report.tables import pooled
from bondgraph.shown import Tabulated, own_axes
from bondgraph.text import Table, number

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


@dataclass(frozen=True, repr=False)
class Correction(ClosedLoop, Tabulated):
    """A closed loop with its corrected graph and its report; ``made`` says how it came about."""

    made: Provenance = field(default_factory=lambda: Provenance("bondgraph.close_loop"))

    @property
    def graph(self) -> BondGraph:
        """The declaration with the added effects and the estimated values."""
        return self.corrected_graph

    def python_lines(self) -> str:
        """Python lines that make the declared graph, called ``g``, the corrected one; empty where none do so exactly.

        They are pasted before the ``return g`` of a declaration, see
        :func:`bondgraph.report.python_lines.correction_lines`.
        """
        return correction_lines(_declared(self), self.graph)

    def summary(self) -> str:
        """Verdict, effects with their intervals, and errors before and after, as text."""
        return summary(report_data(self, {}, self.made)).strip()

    def to_dataframe(self) -> pandas.DataFrame:
        """The estimates in declared units, of the declared model (``before``) and of the corrected one (``after``).

        A row for each parameter, also of those of added effects, which were nothing before; columns ``before``,
        ``after``, ``lower95`` and ``upper95`` of the interval after, ``unit``.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        ends = intervals(self.corrected)
        changes = parameter_changes(self.corrected_built.model, self.nominal.values, self.corrected.values, ends)
        known = self.nominal_built.model.names("parameter")
        columns = {
            "before": [one.before if one.name in known else math.nan for one in changes],
            "after": [one.after for one in changes],
            "lower95": [one.ci95[0] for one in changes],
            "upper95": [one.ci95[1] for one in changes],
            "unit": [one.unit for one in changes],
        }
        return frame(columns, [one.name for one in changes], "parameter")

    def table(self) -> Table:
        """Errors of each channel in its declared unit, rms before and after: training logs, then held-out ones."""
        rows = [
            [
                "held out" if one.held_out else "training", one.channel, one.unit or "1",
                *map(number, (one.simulation_before, one.simulation_after, one.one_step_before, one.one_step_after)),
            ]
            for one in pooled(channel_errors(all_series(self)))
        ]  # fmt: skip
        return ("logs", "channel", "unit", "simulated before", "after", "one step before", "after"), rows

    def plot(self, channel: str = "", ax: Axes | None = None) -> Axes:
        """A measured channel with the free simulations before and after, of the last held-out log or the last log.

        Parameters
        ----------
        channel
            Which; empty: the first of that log.
        ax
            Axes to draw on; None: new ones. Needs matplotlib.

        Raises
        ------
        OptionError
            If nothing of this name was measured.
        """
        series = all_series(self)
        last = (next((one for one in reversed(series) if one.held_out), series[-1])).log
        known = {one.channel: one for one in series if one.log == last}
        if channel and channel not in known:
            raise OptionError(f"plot {channel}: no such channel{suggest(channel, known)}", where=(channel,))
        one, axes = known[channel or next(iter(known))], own_axes(ax, 7.0, 3.2)
        axes.plot(one.time, one.measured, ".", color=MEASURED, markersize=3.0, label="measured")
        for made, colour, label in ((one.before, BEFORE, "before"), (one.after, AFTER, "after")):
            if made is not None and made.simulated is not None:
                axes.plot(one.time, made.simulated, color=colour, label=label)
        axes.set(title=last, xlabel="time [s]", ylabel=f"{one.channel} [{one.unit or 1}]")
        axes.legend(loc="best", fontsize="small")
        return axes

    def report(self, folder: str | Path) -> Path:
        """Write ``report.html``, ``result.json``, the corrected graph, its module, drawing and lines into a folder.

        Returns
        -------
        Path
            Of ``report.html``.
        """
        write_closed_loop(self, Path(folder), self.made)
        write_python(Path(folder), _declared(self), self.graph)
        return Path(folder) / "report.html"


def close_loop(
    graph: BondGraph | str,
    train: GivenLog | Sequence[GivenLog],
    holdout: GivenLog | Sequence[GivenLog] = (),
    effects: Sequence[EffectFunction] | None = None,
    settings: LoopSettings | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    progress: Report = no_report,
    executor: str | Executor | None = "serial",
) -> Correction:
    """Find what a declared graph lacks, from measured logs.

    Parameters
    ----------
    graph
        The declared graph, or a reference such as ``sled.py:sled``. Parameters with bounds are free unless
        ``settings.free`` names others.
    train, holdout
        Logs as read, matched, files or data frames. Held-out logs are assessed and decide nothing.
    effects
        Effect functions to try; None: those of the toolkit.
    settings
        Levels and limits.
    columns
        Name of a column -> name in the model, where they differ.
    constants
        Values (or letters) of inputs that a log lacks.
    progress
        Called with a stage, its step and the number of its steps.
    executor
        Who computes the fits, ``"processes:2"`` or ``"dask://host:8786"``, see
        :func:`bondgraph.execute.executors.open_executor`; it changes no number.

    Raises
    ------
    BondGraphError
        If the graph is refused, a log does not fit it, or there is too little in the logs to estimate anything.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("sled")
    >>> body = g.one_junction("body", bg.TRANSLATION)
    >>> _ = g.inertance("mass", 80.0, at=body)
    >>> bg.close_loop(g, train=[])
    Traceback (most recent call last):
        ...
    bondgraph.errors.DataError: sled: no training log - give at least one with --data
    """
    started = time.monotonic()
    require_kind("close_loop", graph, (BondGraph, str), "graph")
    declared = load_graph(graph) if isinstance(graph, str) else graph
    model = build(declared).model
    training = all_matched(train, model, columns, constants, "train")
    held_out = all_matched(holdout, model, columns, constants, "holdout")
    functions = effect_functions(load_module(EFFECTS)) if effects is None else effects
    own = settings or LoopSettings()
    with open_executor(executor) as workers:
        journal = own.journal if workers is None else replace(own.journal, executor=workers)
        closed = close_matched(declared, training, held_out, functions, replace(own, journal=journal), progress)
    names = [tuple(log.name for log in logs) for logs in (training, held_out)]
    made = Provenance("bondgraph.close_loop", None, versions(), names[0], names[1], time.monotonic() - started)
    return Correction(**{one.name: getattr(closed, one.name) for one in fields(ClosedLoop)}, made=made)


def _declared(closed: ClosedLoop) -> BondGraph:
    """The graph as it was declared, before the loop gave it rates, a state or inputs that are held."""
    graph = without_resting_state(without_input_rates(closed.nominal_built.graph))
    straight: dict[str, Interpolation] = dict.fromkeys(closed.held, "linear")  # only such inputs are tried as held
    return with_inputs_between(graph, **straight)
