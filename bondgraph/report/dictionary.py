"""The dictionary of effects as text, JSON and pictures."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from matplotlib.figure import Figure

from bondgraph.effects.benches import BENCHES
from bondgraph.effects.catalogue import Entry
from bondgraph.effects.curves import Curve
from bondgraph.report.figures import BEFORE, FOUND, figure_style

#: Width of lines of text.
_WIDTH = 120


def table_text(rows: Sequence[Entry]) -> str:
    """A line for each law, by module: name, domains, place, formula, units of coefficients.

    Examples
    --------
    >>> from bondgraph.effects.catalogue import named
    >>> print(table_text(named("relief_valve")))
    losses
      relief_valve          hydraulic   0-junction   flow = c*max(effort - e, 0)   [m^3/s/Pa]
    """
    lines: list[str] = []
    modules = list(dict.fromkeys(row.module for row in rows))
    widths = [max(len(cell) for cell in column) for column in zip(*map(_cells, rows), strict=True)] if rows else []
    for module in modules:
        lines.append(module.rpartition(".")[2])
        for row in (one for one in rows if one.module == module):
            cells = [cell.ljust(width) for cell, width in zip(_cells(row), widths, strict=True)]
            lines.append("  " + "   ".join(cells).rstrip())
    return "\n".join(lines)


def entry_text(row: Entry) -> str:
    """All that is known of a law.

    Examples
    --------
    >>> from bondgraph.effects.catalogue import named
    >>> print(entry_text(named("orifice_loss")[0]).splitlines()[0])
    orifice_loss: effort = c*flow*|flow|
    """
    parts = [
        f"{row.name}: {row.law}",
        *textwrap.wrap(" ".join(row.meaning.split()), _WIDTH - 2),
        f"where: {row.place}, {', '.join(row.domains)}",
        *(
            f"{'shape' if one.shape else 'coefficient'} {one.name} [{one.unit}]: {one.meaning}"
            for one in row.coefficients
        ),
        f"shown by: {row.manoeuvre}",
        f"reference: {row.reference}",
        f"function: {row.module}:{row.function}{'' if row.default else ' (tried where it is asked for by --effects)'}",
    ]
    if row.dissipative:
        parts.insert(3, "it takes energy: a negative coefficient is refused")
    return "\n  ".join(parts)


def table_json(rows: Sequence[Entry]) -> dict[str, Any]:
    """The table for programs and for documentation."""
    return {"schema": "bondgraph-effects/1", "effects": [asdict(row) for row in rows]}


def law_figure(row: Entry, curve: Curve) -> Figure:
    """The law over its variable: what is added alone, or the declared law and the changed one."""
    with figure_style():
        figure = Figure(figsize=(4.6, 3.2), layout="constrained")
        axes = figure.subplots()
        if curve.declared is not None:
            axes.plot(curve.x, curve.declared, color=BEFORE, linestyle="--", label="declared")
        axes.plot(curve.x, curve.law, color=FOUND, linewidth=1.8, label=row.name)
        axes.axhline(0.0, color="#8b95a1", linewidth=0.6)
        axes.set(title=row.name, xlabel=curve.variable, ylabel=curve.gives)
        axes.locator_params(axis="x", nbins=6)  # numbers such as -0.075 need their room
        if curve.declared is not None:
            axes.legend()
    return figure


def _cells(row: Entry) -> tuple[str, str, str, str, str]:
    units = ", ".join(dict.fromkeys(row.units))
    domains = "every" if len(row.domains) == len(BENCHES) else ", ".join(row.domains)
    return (row.name + ("" if row.default else " *"), domains, row.place, row.law, f"[{units}]")
