"""The report of a closed loop as one HTML file that needs nothing else: no network, no other files."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from bondgraph.estimate.objective import TraceRow
from bondgraph.files import write_text
from bondgraph.report.drawing import Drawing, draw_svg
from bondgraph.report.embedding import embed, image_of
from bondgraph.report.numbers import change, shown, with_ends, with_interval
from bondgraph.report.plots import (
    by_log,
    innovation_figure,
    missing_effort_figure,
    prediction_figure,
    residual_figure,
    state_figure,
    trace_figure,
)
from bondgraph.report.saved import NAME, load_data, save_data
from bondgraph.report.series import (
    ChannelError,
    ChannelSeries,
    FilteredLog,
    FoundEffect,
    MissingEffort,
    ParameterChange,
    Power,
    Step,
    Tried,
)
from bondgraph.report.tables import ALL_LOGS, first_sizes, grouped_errors, pooled
from bondgraph.report.thinning import MOST_POINTS
from bondgraph.report.words import Words, law_title

#: Stretches that are drawn of one long log, and of all: each takes half a second and 0.1 MB of the page.
_MOST_STRETCHES, _STRETCHES_OF_ALL = 6, 24


@dataclass(frozen=True)
class Located:
    """A place that the residual points to, with the p-value corrected for all places and its share of the residual."""

    junction: str
    variable: str
    p_value: float
    share: float


@dataclass(frozen=True)
class Provenance:
    """How a report was made: the command with its seed, versions (name, version), and the data files read."""

    command: str
    seed: int | None = None
    versions: tuple[tuple[str, str], ...] = ()
    training: tuple[str, ...] = ()
    held_out: tuple[str, ...] = ()
    duration: float = float("nan")


@dataclass(frozen=True, repr=False)
class ReportData:
    """Everything that stands in a report; parts left empty are left out.

    Parameters
    ----------
    title
        Name of the model.
    verdict
        Such as ``"effect found"``, see :data:`bondgraph.correct.loop.Verdict`.
    explanation
        The verdict in a sentence or two.
    effects
        What was added.
    errors
        Per channel and log, before and after.
    series
        Measurements and predictions, for the figures.
    filtered
        What a filter made of each log.
    drawing, added
        The graph, and the names of the nodes to mark as added.
    missing
        What is missing against what it depends on, with the found law.
    located, alternatives, parameters, trace
        Places, effects considered, parameters before and after, course of the search.
    power
        What the logs would have shown.
    history
        Every decision with its reason.
    structure
        What these sensors can tell apart at all.
    suspected
        What looks wrong with the units, times or sampling of the logs.
    notes
        What else a reader must know: caveats, what cannot be concluded.
    made
        How the report was made.
    subtitle
        What is laid against what.
    """

    title: str
    verdict: str
    explanation: str
    effects: tuple[FoundEffect, ...] = ()
    errors: tuple[ChannelError, ...] = ()
    series: tuple[ChannelSeries, ...] = ()
    filtered: tuple[FilteredLog, ...] = ()
    drawing: Drawing | None = None
    added: frozenset[str] = frozenset()
    missing: tuple[MissingEffort, ...] = ()
    located: tuple[Located, ...] = ()
    alternatives: tuple[Tried, ...] = ()
    parameters: tuple[ParameterChange, ...] = ()
    trace: tuple[TraceRow, ...] = ()
    power: tuple[Power, ...] = ()
    history: tuple[Step, ...] = ()
    structure: tuple[str, ...] = ()
    suspected: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    made: Provenance | None = None
    subtitle: str = "The declared bond graph against its measurements, before and after the correction."

    def __repr__(self) -> str:
        return f"<ReportData {self.title}: {self.verdict}>"


#: Parts of a sentence that are read as one: an option of a command, a number with its deviation.
_UNBROKEN = re.compile(r"(--[a-z][a-z-]*|\S+ ± \S*[^\s,;:.()])")


def report_html(data: ReportData) -> str:
    """The report as the text of one HTML page.

    Examples
    --------
    >>> page = report_html(ReportData("coast_down", "no missing effect", "The residual is white in all channels."))
    >>> "no missing effect" in page and "http" not in page
    True
    """
    environment = Environment(
        loader=PackageLoader("bondgraph.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": shown,
        "p_value": _p_value,
        "percent": _percent,
        "whole": breakable,
        "sentence": unbroken,
        "law_title": law_title,
    }
    environment.globals |= {
        "change": change, "with_interval": with_interval, "better": _better, "between": _between, "ALL_LOGS": ALL_LOGS,
        "explained": Words(),
    }  # fmt: skip
    page = environment.get_template("report.html.jinja").render(
        data=data,
        headline=_headline(data.errors),
        error_groups=grouped_errors(data.errors),
        error_kinds=_error_kinds(data.errors),
        corrected=any(one.after is not None for one in data.series) or not data.series,
        filtered=[_figures_of_filtered(one) for one in data.filtered],
        log_figures=_log_figures(data.series),
        power=first_sizes(data.power),
        missing_figures=[_figure_of_missing(found) for found in data.missing],
        trace=Markup(embed(trace_figure(data.trace), "likelihood over the search")) if data.trace else "",
        graph=_graph(data),
        command=without_folders(data.made.command) if data.made else "",
    )
    return page + "\n"


def write_report(data: ReportData, path: Path) -> None:
    """Write the report to a file, and what stands in it to another beside it, see :func:`rewrite_report`."""
    save_data(data, path.with_name(NAME))
    write_text(path, report_html(data))


def rewrite_report(folder: Path) -> Path:
    """Write ``report.html`` of a finished folder again, as this version writes it.

    Raises
    ------
    OptionError
        If the folder holds no data of a report, or of another version.
    """
    data: ReportData = load_data(ReportData, folder / NAME)
    write_text(folder / "report.html", report_html(data))
    return folder / "report.html"


def without_folders(command: str) -> str:
    """A command line in which absolute paths are reduced to the names of their files.

    Examples
    --------
    >>> without_folders("bondgraph estimate /models/car.py --data=/data/run1.csv runs/run2.csv")
    'bondgraph estimate car.py --data=run1.csv runs/run2.csv'
    """
    return re.sub(r"(?<![\w.~-])(?:[A-Za-z]:)?[/\\](?:[^\s=/\\]+[/\\])*([^\s=/\\]+)", r"\1", command)


def _headline(errors: Sequence[ChannelError]) -> list[ChannelError]:
    """The errors that open the report: free simulation over all held-out logs, or over the training ones."""
    held_out = [row for row in pooled(errors) if row.held_out and not math.isnan(row.simulation_before)]
    training = [row for row in pooled(errors) if not row.held_out and not math.isnan(row.simulation_before)]
    return (held_out or training)[:4]


def _log_figures(series: Sequence[ChannelSeries]) -> list[dict[str, object]]:
    """Per log: its name, whether it was held out, and its two figures."""
    figures: list[dict[str, object]] = []
    logs = by_log(series)
    most = min(_MOST_STRETCHES, _STRETCHES_OF_ALL // max(len(logs), 1))
    for log, channels in logs.items():
        figures.append(
            {
                "log": log,
                "held_out": channels[0].held_out,
                "prediction": _both(prediction_figure, channels, f"{log}: measured against predicted"),
                "residual": _both(residual_figure, channels, f"{log}: measured minus predicted"),
                "stretches": _stretches(log, channels, most),
            }
        )
    return figures


def _both(draw: Callable[..., Figure], channels: Sequence[ChannelSeries], alternative: str) -> Markup:
    """A figure drawn for a screen and for a phone."""
    return Markup(embed(draw(channels), alternative, draw(channels, narrow=True)))


def _stretches(log: str, channels: Sequence[ChannelSeries], most: int) -> list[tuple[str, Markup]]:
    """A log that is thinned in its figure, cut into stretches that are not, or into the most that are drawn."""
    time = channels[0].time
    count = min(-(-time.size // MOST_POINTS), most)
    found = []
    for part in np.array_split(np.arange(time.size), count) if count > 1 else ():
        window = slice(int(part[0]), int(part[-1]) + 1)
        title = f"{time[part[0]]:.6g} to {time[part[-1]]:.6g} s"
        figure = prediction_figure([one.within(window) for one in channels])
        found.append((title, Markup(image_of(figure, f"{log} from {title}: measured against predicted"))))
    return found


def _figures_of_filtered(one: FilteredLog) -> dict[str, object]:
    return {
        "log": one.log,
        "beliefs": Markup(embed(state_figure(one.beliefs), f"{one.log}: states with their bands")),
        "innovations": Markup(embed(innovation_figure(one.innovations), f"{one.log}: innovations in their bands")),
    }


def _error_kinds(errors: Sequence[ChannelError]) -> list[tuple[str, str, list[str]]]:
    """Kinds of errors that any row has: the beginning of their fields, their title, and their columns."""
    found = []
    for kind, title in (("simulation", "free simulation"), ("one_step", "one step ahead")):
        known = [
            when for when in ("before", "after") if any(math.isfinite(getattr(row, f"{kind}_{when}")) for row in errors)
        ]
        if known:
            found.append((kind, title, [*known, "change"] if len(known) > 1 else known))
    return found


def _figure_of_missing(found: MissingEffort) -> Markup:
    alternative = f"{found.title}: {found.y_label} against {found.x_label}"
    return Markup(embed(missing_effort_figure(found), alternative, missing_effort_figure(found, narrow=True)))


def _graph(data: ReportData) -> Markup | str:
    """The drawn graph, without the name space that only stand-alone SVG files need."""
    if data.drawing is None:
        return ""
    return Markup(draw_svg(data.drawing, data.added).replace(' xmlns="http://www.w3.org/2000/svg"', ""))


def breakable(name: str) -> Markup:
    """A name that a narrow column breaks after underscores only.

    Examples
    --------
    >>> breakable("c_loss_<1>")
    Markup('c_<wbr>loss_<wbr>&lt;1&gt;')
    """
    return Markup("_<wbr>").join(name.split("_"))


def unbroken(sentence: str) -> Markup:
    """A sentence whose options and numbers with a deviation stay in one line.

    Examples
    --------
    >>> unbroken("grant more with --refits 24: <1 ± 0.5 K")
    Markup('grant more with <span class="whole">--refits</span> 24: <span class="whole">&lt;1 ± 0.5</span> K')
    """
    parts = _UNBROKEN.split(sentence)  # every second one is what stays whole
    whole = Markup('<span class="whole">{}</span>')
    return Markup("").join(whole.format(part) if k % 2 else part for k, part in enumerate(parts))


def _better(before: float, after: float) -> str:
    """Class of a change: better, worse or none."""
    if not (math.isfinite(before) and math.isfinite(after)) or abs(after - before) < 0.005 * abs(before):
        return "same"
    return "better" if after < before else "worse"


def _between(ends: tuple[float, float]) -> str:
    """An interval in brackets, empty where it is not known."""
    middle = 0.5 * (ends[0] + ends[1])
    return with_ends(middle, ends).partition(" ")[2] if all(map(math.isfinite, ends)) else ""


def _p_value(value: float) -> str:
    return "< 0.0001" if value < 1e-4 else shown(value, 2)


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
