"""Corrections as files: what a closed loop found, as plain values that a folder or one file keeps.

A file has the report's values, ``result.json``, and both declarations as graphs of ``bondgraph/1``. Fits, filter runs
and candidates stay in the program that closed the loop.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from bondgraph.build import BuiltModel, build
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.models.resting import without_resting_state
from bondgraph.correct.result import result_json
from bondgraph.declare.editing import with_inputs_between, without_input_rates
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.json_writer import graph_to_json
from bondgraph.declare.quantities import Interpolation
from bondgraph.errors import BondGraphError, NotKeptError, OptionError, suggest
from bondgraph.files import write_json, write_text
from bondgraph.frames import frame
from bondgraph.report.closed_loop import report_data, summary
from bondgraph.report.drawing import draw_svg
from bondgraph.report.figures import AFTER, BEFORE, MEASURED
from bondgraph.report.html import Provenance, ReportData, write_report
from bondgraph.report.python_lines import correction_lines, write_python
from bondgraph.report.saved import NAME, load_data, save_data
from bondgraph.report.series import FoundEffect, ParameterChange
from bondgraph.report.tables import pooled
from bondgraph.shown import Tabulated, own_axes
from bondgraph.simulate.stored import store, stored
from bondgraph.text import Table, few, number

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Suffix of a correction in one file; any other path is a folder.
_ONE_FILE = ".npz"
#: Files of a folder beside the values of its report.
_RESULT, _DECLARED, _CORRECTED = "result.json", "declared_graph.json", "corrected_graph.json"
#: Fields that only the program that closed a loop has.
_OF_THE_LOOP = {one.name for one in dataclasses.fields(ClosedLoop)} | {"unproven", "detectable"}


class AbstractCorrection(Tabulated):
    """A correction as a user holds it, from a loop just closed or from a file: graph, numbers, tables, report."""

    @property
    @abstractmethod
    def kept(self) -> SavedCorrection:
        """The part of it that a file keeps."""

    @property
    def graph(self) -> BondGraph:
        """The declaration with the added effects and the estimated values."""
        return self.kept.corrected_graph

    @property
    def declared(self) -> BondGraph:
        """The graph as it was declared."""
        return graph_from_json(json.loads(self.kept.declared_text), _DECLARED)

    @functools.cached_property
    def model(self) -> BuiltModel:
        """The model of :attr:`graph`, with the estimated values: to simulate, to filter, to estimate further."""
        return build(self.graph)

    @property
    def result(self) -> dict[str, Any]:
        """The content of ``result.json``, see :func:`bondgraph.correct.result.result_json`."""
        found: dict[str, Any] = json.loads(self.kept.result_text)
        return found

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Estimates of the corrected model by name, noise levels among them, in declared units.

        Each has ``value``, ``unit``, ``ci95``, ``bounds`` and ``at_bound``.
        """
        found: dict[str, dict[str, Any]] = self.result["corrected"]["parameters"]
        return found

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """The added effects: name, element, junction, law, coefficients with their intervals, evidence."""
        return self.kept.data.effects

    def python_lines(self) -> str:
        """Python lines that make the declared graph, called ``g``, the corrected one; empty where none do so exactly.

        They are pasted before the ``return g`` of a declaration, see
        :func:`bondgraph.report.python_lines.correction_lines`.
        """
        return correction_lines(self.declared, self.graph)

    def summary(self) -> str:
        """Verdict, effects with their intervals, and errors before and after, as text."""
        return summary(self.kept.data).strip()

    def to_dataframe(self) -> pandas.DataFrame:
        """The estimates in declared units, of the declared model (``before``) and of the corrected one (``after``).

        A row for each parameter, also of those of added effects, which were nothing before; columns ``before``,
        ``after``, ``lower95`` and ``upper95`` of the interval after, ``unit``.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        changes = self.kept.data.parameters
        columns = {
            "before": _before(changes, self.declared),
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
            for one in pooled(self.kept.data.errors)
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
        series = self.kept.data.series
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
        """Write ``report.html``, ``result.json``, both graphs, the module, drawing and lines into a folder.

        :meth:`load` reads the folder.

        Returns
        -------
        Path
            Of ``report.html``.
        """
        page = _write_pages(self.kept, Path(folder), self.graph, self._module)
        contradicted = self.result["verdict"] == "effect not confirmed"
        write_python(Path(folder), self.declared, self.graph, contradicted=contradicted)
        return page

    @property
    def _module(self) -> str:
        return self.model.text

    def save(self, path: str | Path) -> Path:
        """Write what :meth:`load` reads: one file where the path ends in ``.npz``, else a folder, without pages.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        if Path(path).suffix.lower() == _ONE_FILE:
            return store(self.kept, path)
        _write_data(self.kept, Path(path))
        save_data(self.kept.data, Path(path) / NAME)
        return Path(path)

    @classmethod
    def load(cls, path: str | Path) -> SavedCorrection:
        """Read a correction: a file or folder of :meth:`save`, or a folder of :meth:`report` or of ``close-loop``.

        Raises
        ------
        OptionError
            If there is nothing of the kind, or it is damaged or of another version.

        Examples
        --------
        >>> import bondgraph as bg
        >>> bg.Correction.load("loop.npz")
        Traceback (most recent call last):
            ...
        bondgraph.errors.OptionError: loop.npz: there is no such file - check the path
        """
        return _read_folder(Path(path)) if Path(path).is_dir() else stored(SavedCorrection, path)


@dataclass(frozen=True, repr=False)
class SavedCorrection(AbstractCorrection):
    """A correction that was read from a file: every number, table, graph and page, but no fits, runs and candidates.

    Parameters
    ----------
    data
        What stands in the report.
    result_text
        ``result.json``.
    declared_text, corrected_text
        The declared and the corrected graph as ``bondgraph/1``.
    """

    data: ReportData
    result_text: str
    declared_text: str
    corrected_text: str

    def __post_init__(self) -> None:
        """Read every part once, so that what is damaged is refused where it is loaded."""
        result = json.loads(self.result_text)
        if not (isinstance(self.data, ReportData) and isinstance(result, dict) and "corrected" in result):
            raise ValueError("this is no result of a closed loop")
        if self.graph.name != self.declared.name:
            raise ValueError(f"the graphs are of two machines, {self.declared.name} and {self.graph.name}")

    def __repr__(self) -> str:
        added = few([f"{one.name} at {one.junction}" for one in self.effects])
        return f"<{type(self).__name__} {self.data.title}: {self.verdict}; added {added}>"

    def __getattr__(self, name: str) -> NoReturn:
        if name in _OF_THE_LOOP:
            raise NotKeptError(
                f"{name}: fits, runs and candidates are not kept in a file - close the loop again, or go on from "
                ".graph, .model, .parameters, .effects and .result",
                where=(name,),
            )
        raise AttributeError(f"{type(self).__name__} has no attribute {name!r}{suggest(name, dir(self))}")

    @property
    def kept(self) -> SavedCorrection:
        """The record itself."""
        return self

    @property
    def verdict(self) -> str:
        """The verdict of the loop, see :data:`bondgraph.correct.verdict.Verdict`."""
        return self.data.verdict

    @property
    def reason(self) -> str:
        """Why the search ended."""
        return str(self.result["reason"])

    @property
    def cautions(self) -> tuple[str, ...]:
        """Doubts that a reader must know of."""
        return tuple(self.result["cautions"])

    @property
    def corrected_graph(self) -> BondGraph:
        """The declaration with the added effects and the estimated values."""
        return graph_from_json(json.loads(self.corrected_text), _CORRECTED)


def saved_correction(
    closed: ClosedLoop,
    made: Provenance,
    said: Sequence[str] = (),
    extra: Mapping[str, Any] | None = None,
    declared: BondGraph | None = None,
) -> SavedCorrection:
    """The record that a file keeps of a closed loop.

    Parameters
    ----------
    closed
        The finished loop.
    made
        Command, seed, data files.
    said
        What must be said about the logs beside what the loop knows.
    extra
        More keys of ``result.json`` (the truth of a demonstration).
    declared
        The graph as its file gives it, where values or inputs were set otherwise for the loop; None: that of the loop.
    """
    result = result_json(closed) | {"notes": list(said)} | dict(extra or {})
    return SavedCorrection(
        report_data(closed, result, made, said),
        json.dumps(result, allow_nan=False),
        json.dumps(graph_to_json(declared_graph(closed) if declared is None else declared)),
        json.dumps(graph_to_json(closed.corrected_graph)),
    )


def declared_graph(closed: ClosedLoop) -> BondGraph:
    """The graph as it was declared, before the loop gave it rates, a state or inputs that are held."""
    graph = without_resting_state(without_input_rates(closed.nominal_built.graph))
    straight: dict[str, Interpolation] = dict.fromkeys(
        (*closed.held, *closed.limited), "linear"
    )  # others are not tried
    return with_inputs_between(graph, **straight)


def write_closed_loop(
    closed: ClosedLoop,
    folder: Path,
    made: Provenance,
    extra: Mapping[str, Any] | None = None,
    said: Sequence[str] = (),
    declared: BondGraph | None = None,
) -> ReportData:
    """Write everything a closed loop leaves behind; :meth:`AbstractCorrection.load` reads it.

    Parameters
    ----------
    closed, made, extra, said, declared
        As for :func:`saved_correction`.
    folder
        Where the files go; it is made where it is missing.

    Returns
    -------
    ReportData
        What stands in the report.
    """
    kept = saved_correction(closed, made, said, extra, declared)
    _write_pages(kept, folder, closed.corrected_graph, closed.corrected_text)
    return kept.data


def _before(changes: Sequence[ParameterChange], declared: BondGraph) -> list[float]:
    """Values of parameters before, NaN of those that the declared graph does not have."""
    known = {one.name for one in declared.flatten().parameters}
    return [one.before if one.name in known else math.nan for one in changes]


def _write_pages(kept: SavedCorrection, folder: Path, graph: BondGraph, module: str) -> Path:
    """Write the data and what a person reads: module, drawing, report; the path of the report."""
    _write_data(kept, folder)
    write_text(folder / f"{graph.name}.py", module)
    assert kept.data.drawing is not None  # every loop has a graph
    write_text(folder / "corrected_graph.svg", draw_svg(kept.data.drawing, kept.data.added))
    write_report(kept.data, folder / "report.html")
    return folder / "report.html"


def _write_data(kept: SavedCorrection, folder: Path) -> None:
    """Write the result and both graphs; the values of the report are a file of their own."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in _texts(kept).items():
        write_json(folder / name, json.loads(text))


def _texts(kept: SavedCorrection) -> dict[str, str]:
    return {_RESULT: kept.result_text, _DECLARED: kept.declared_text, _CORRECTED: kept.corrected_text}


def _read_folder(folder: Path) -> SavedCorrection:
    missing = [name for name in (NAME, _RESULT, _DECLARED, _CORRECTED) if not (folder / name).is_file()]
    if missing:
        raise OptionError(
            f"{folder}: holds no {few(missing)} - name a folder that close-loop or a correction's report or save of "
            "this version wrote",
            where=(str(folder),),
        )
    data: ReportData = load_data(ReportData, folder / NAME)
    try:
        texts = [(folder / name).read_text(encoding="utf-8") for name in (_RESULT, _DECLARED, _CORRECTED)]
        return SavedCorrection(data, *texts)
    except (OSError, ValueError, KeyError, TypeError, BondGraphError) as error:
        raise OptionError(
            f"{folder}: cannot be read ({error}) - a file of it is damaged or of another version; close the loop again",
            where=(str(folder),),
        ) from None
