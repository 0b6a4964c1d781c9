"""Notebooks: drawings of graphs, equations as LaTeX, results as short tables; axes for pictures.

A class says here how a notebook shows it, and the notebook calls the method it knows. Drawing and typesetting lie in
rooms above the class; they are imported by name when a cell shows a value, so that no room imports those above it.
"""

from __future__ import annotations

import html
import importlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from bondgraph.text import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Rows of a table that a notebook shows; those beyond are counted.
_ROWS = 40


class Drawn:
    """A graph, which a notebook shows as its drawing."""

    def _repr_svg_(self) -> str | None:
        """The drawing, None of a graph that is not complete yet or has no causality."""
        drawing: str | None = _above("bondgraph.report.drawing", "shown_svg")(self)
        return drawing


class Typeset:
    """Equations, which a notebook shows as LaTeX."""

    def _repr_latex_(self) -> str:
        text: str = _above("bondgraph.derive.latex", "display_latex")(self)
        return text


class Tabulated:
    """A result with a ``table``, which a notebook shows below the line that says what it is."""

    def table(self) -> Table:
        """Header and rows of the result, cell by cell."""
        return (), ()

    def _repr_html_(self) -> str:
        return html_table(repr(self).removeprefix("<").removesuffix(">"), *self.table())


def html_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in HTML under a line of text; the first column flush left, long tables cut.

    Examples
    --------
    >>> print(html_table("fit <a>", ["name", "value"], [["mass", "80"]]))
    <p>fit &lt;a&gt;</p>
    <table>
    <tr><th style="text-align: left">name</th><th>value</th></tr>
    <tr><td style="text-align: left">mass</td><td>80</td></tr>
    </table>
    """
    lines = [f"<p>{html.escape(title)}</p>", "<table>", _row("th", header), *(_row("td", row) for row in rows[:_ROWS])]
    more = f"<p>and {len(rows) - _ROWS} rows more</p>" if len(rows) > _ROWS else ""
    return "\n".join(filter(None, [*lines, "</table>", more]))


def _row(tag: str, cells: Sequence[str]) -> str:
    first = ' style="text-align: left"'
    inside = (f"<{tag}{'' if k else first}>{html.escape(cell)}</{tag}>" for k, cell in enumerate(cells))
    return f"<tr>{''.join(inside)}</tr>"


def _above(module: str, function: str) -> Callable[[Any], Any]:
    """A function of a room above."""
    found: Callable[[Any], Any] = getattr(importlib.import_module(module), function)
    return found


def own_axes(ax: Axes | None, width: float = 5.6, height: float = 3.8) -> Axes:
    """The axes given, or those of a new figure of a width and a height in inches.

    Examples
    --------
    >>> own_axes(None, 3.0, 2.0).figure.get_size_inches().tolist()
    [3.0, 2.0]
    """
    if ax is not None:
        return ax
    from matplotlib.figure import Figure  # a second of its own, which tables do not wait for

    axes: Axes = Figure(figsize=(width, height), layout="constrained").subplots()
    return axes
