"""Bond graphs as pictures: SVG, PNG or PDF.

Half arrows point the way of positive power, with the barb on the flow side (below or to the right). The causal stroke
is the bar across the end of the bond that receives the effort. Dashed full arrows are signals without power. Notation
after D. Karnopp, D. Margolis, R. Rosenberg (2012), System Dynamics, 5th ed., Wiley.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from bondgraph.build import BuiltModel
from bondgraph.declare.files import load_graph
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import CausalGraph, assign_causality
from bondgraph.errors import BondGraphError, DeclarationError, OptionError, require_kind, suggest
from bondgraph.files import write_bytes, write_text
from bondgraph.report.declared import drawing_of
from bondgraph.report.diagram.canvas import Line, Picture, Primitive, Rectangle, Text, figure, svg_text
from bondgraph.report.diagram.drawn import JUNCTIONS, Drawing, DrawnBond, DrawnNode, Kind, Stroke
from bondgraph.report.diagram.geometry import Box, path_from
from bondgraph.report.diagram.layout import Layout, lay_out
from bondgraph.report.diagram.symbols import (
    ADDED,
    ADDED_FILL,
    COLOURS,
    INK,
    QUIET,
    SIGNAL,
    bond_parts,
    branch_part,
    domain_colour,
    frame_parts,
    node_parts,
    signal_parts,
)
from bondgraph.report.diagram.text import break_lines, text_width

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "Drawing",
    "DrawnBond",
    "DrawnNode",
    "Kind",
    "Stroke",
    "draw",
    "draw_figure",
    "draw_svg",
    "drawing_of",
    "picture_of",
    "save_drawing",
]

PAGE_MARGIN, HEADER = 28.0, 56.0
#: Drawings at least so wide have their small print in two columns.
TWO_COLUMNS = 1000.0


def draw_svg(drawing: Drawing, highlight: frozenset[str] = frozenset()) -> str:
    """The drawing as an SVG document.

    Parameters
    ----------
    drawing
        What to draw.
    highlight
        Names of nodes to mark as added.

    Raises
    ------
    DeclarationError
        If a highlighted name is not a node of the drawing.

    Examples
    --------
    >>> rotor = Drawing("rotor", (DrawnNode("shaft", "1", "rotation"), DrawnNode("J", "I")), (DrawnBond("shaft", "J"),))
    >>> draw_svg(rotor).startswith("<svg")
    True
    """
    return svg_text(picture_of(drawing, highlight))


def shown_svg(graph: BondGraph | CausalGraph | Drawing) -> str | None:
    """The drawing that a notebook shows; None of a graph without one, which stands there as text.

    Examples
    --------
    >>> g = BondGraph("rotor")
    >>> shaft = g.one_junction("shaft")
    >>> shown_svg(g) is None  # nothing sits at the junction yet
    True
    >>> _ = g.inertance("J", 0.02, at=shaft)
    >>> shown_svg(g).startswith("<svg")
    True
    """
    if isinstance(graph, Drawing):
        return draw_svg(graph)
    try:
        return draw_svg(drawing_of(graph if isinstance(graph, CausalGraph) else assign_causality(graph)))
    except BondGraphError:
        return None


def draw_figure(drawing: Drawing, highlight: frozenset[str] = frozenset()) -> Figure:
    """The drawing as a matplotlib figure, for formats other than SVG."""
    return figure(picture_of(drawing, highlight))


def draw(
    graph: BondGraph | BuiltModel | str, file: str | FilePath | None = None, highlight: Iterable[str] = ()
) -> Drawing:
    """The drawing of a graph with its causal strokes.

    Parameters
    ----------
    graph
        A declared graph, a model built from one, or a reference such as ``sled.py:sled``.
    file
        Where it is written: ``.svg``, ``.png`` or ``.pdf``; None writes nothing.
    highlight
        Names of nodes to mark.

    Raises
    ------
    CausalityError
        If there is no consistent assignment of strokes.
    OptionError
        If the suffix of the file is another one.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("rotor")
    >>> shaft = g.one_junction("shaft", bg.ROTATION)
    >>> _ = g.inertance("J", 0.02, at=shaft)
    >>> [node.name for node in bg.draw(g).nodes]
    ['shaft', 'J']
    """
    require_kind("draw", graph, (BondGraph, BuiltModel, str), "graph")
    if isinstance(graph, BuiltModel):
        causal = graph.causal
    else:
        causal = assign_causality(load_graph(graph) if isinstance(graph, str) else graph)
    drawing = drawing_of(causal)
    if file is not None:
        save_drawing(drawing, FilePath(file), frozenset(highlight))
    return drawing


def save_drawing(drawing: Drawing, path: FilePath, highlight: frozenset[str] = frozenset()) -> None:
    """Write the drawing to a file whose suffix is ``.svg``, ``.png`` or ``.pdf``.

    Raises
    ------
    OptionError
        If the suffix is another one.
    """
    suffix = path.suffix.lower()
    if suffix == ".svg":
        write_text(path, draw_svg(drawing, highlight))
    elif suffix in (".png", ".pdf"):
        from bondgraph.report.figures import picture  # here: matplotlib is loaded only by those who need it

        options: dict[str, Any] = {"dpi": 192} if suffix == ".png" else {"metadata": {"CreationDate": None}}
        write_bytes(path, picture(draw_figure(drawing, highlight), suffix.lstrip("."), **options))
    else:
        raise OptionError(
            f"{path.name}: a drawing cannot be written as {suffix or 'a file without suffix'} - use .svg, .png or .pdf",
            where=(path.name,),
        )


def picture_of(drawing: Drawing, highlight: frozenset[str] = frozenset()) -> Picture:
    """The primitives of a drawing with title, legend and small print.

    Raises
    ------
    DeclarationError
        If a highlighted name is not a node of the drawing.
    """
    known = [node.name for node in drawing.nodes]
    for name in sorted(highlight):
        if name not in known:
            raise DeclarationError(
                f"{drawing.title}: cannot mark {name!r}, which is not a node of the drawing{suggest(name, known)}",
                where=(name,),
            )
    layout = lay_out(drawing, highlight)
    layout = layout.moved(PAGE_MARGIN - layout.extent.left, HEADER - layout.extent.top)
    extent = layout.extent
    domains = _bond_domains(drawing)
    legend = _legend(drawing, domains, bool(highlight), extent.bottom + 30)
    laws = _small_print(drawing, layout, extent.bottom + 58, max(extent.right, 480.0))
    title = Text(PAGE_MARGIN, 32.0, drawing.title, 17.0, INK, bold=True, role="title")
    widest = max(
        extent.right, *(part.x + text_width(part.text, part.size, part.bold) for part in (title, *legend, *laws)
                        if isinstance(part, Text)),
    )  # fmt: skip
    height = max((line.y for line in laws), default=extent.bottom + 30) + 24
    parts = (*_graph_parts(drawing, layout, domains, highlight), title, *legend, *laws)
    return Picture(math.ceil(widest + PAGE_MARGIN), math.ceil(height), drawing.title, parts)


def _graph_parts(
    drawing: Drawing, layout: Layout, domains: Sequence[str], highlight: frozenset[str]
) -> Iterable[Primitive]:
    """Frames, signals, bonds and nodes, from back to front."""
    for frame in layout.frames:
        yield from frame_parts(frame.name, frame.box, frame.depth)
    branches = dict(layout.branches)
    for k, ((source, target), path) in enumerate(zip(drawing.signals, layout.signals, strict=True)):
        colour = ADDED if source in highlight or target in highlight else SIGNAL
        if k in branches:
            yield branch_part(branches[k], colour)
        yield from signal_parts(path_from(path, branches[k]) if k in branches else path, colour)
    for bond, path, domain in zip(drawing.bonds, layout.bonds, domains, strict=True):
        marked = bond.source in highlight or bond.target in highlight
        yield from bond_parts(path, bond.stroke, ADDED if marked else domain_colour(domain), 2.4 if marked else 1.6)
    node_domains = _node_domains(drawing, domains)
    for node in drawing.nodes:
        colour = domain_colour(node_domains[node.name])
        yield from node_parts(node, layout.labels[node.name], layout.boxes[node.name], colour, node.name in highlight)


def _bond_domains(drawing: Drawing) -> list[str]:
    """Domain of every bond: that of the junction at one of its ends, or else of any end."""
    nodes = {node.name: node for node in drawing.nodes}
    domains = []
    for bond in drawing.bonds:
        ends = sorted((nodes[bond.source], nodes[bond.target]), key=lambda node: node.kind not in JUNCTIONS)
        domains.append(next((node.domain for node in ends if node.domain), ""))
    return domains


def _node_domains(drawing: Drawing, bond_domains: Sequence[str]) -> dict[str, str]:
    """Domain of every node: its own, else that of its bonds where they agree."""
    near: dict[str, set[str]] = {node.name: set() for node in drawing.nodes}
    for bond, domain in zip(drawing.bonds, bond_domains, strict=True):
        near[bond.source].add(domain)
        near[bond.target].add(domain)
    return {
        node.name: node.domain or (next(iter(near[node.name])) if len(near[node.name]) == 1 else "")
        for node in drawing.nodes
    }


def _legend(drawing: Drawing, domains: Sequence[str], added: bool, y: float) -> list[Primitive]:
    """One row that explains colours and marks."""
    parts: list[Primitive] = []
    x = PAGE_MARGIN
    used = [name for name in COLOURS if name in domains] + sorted(set(domains) - set(COLOURS))
    entries = [(name or "no domain", domain_colour(name), "domain") for name in used]
    entries.append(("positive power; the bar marks the end that receives the effort", INK, "bond"))
    if drawing.signals:
        entries.append(("signal", SIGNAL, "signal"))
    if added:
        entries.append(("added to the declared model", ADDED, "added"))
    for text, colour, mark in entries:
        start, end = (x, y - 4), (x + 34, y - 4)
        if mark == "bond":
            parts += bond_parts((start, end), "target", colour, 1.6)
        elif mark == "signal":
            parts += signal_parts((start, end), colour)
        elif mark == "added":
            parts.append(Rectangle(Box(x, y - 12, 34, 15), ADDED_FILL, ADDED, 1.2, 5.0, (4.0, 3.0)))
        else:
            parts.append(Line(((x + 10, y - 4), end), colour, 4.0))
        parts.append(Text(x + 42, y, text, 11.0, QUIET, role="legend"))
        x += 42 + text_width(text, 11.0) + 26
    return parts


def _small_print(drawing: Drawing, layout: Layout, y: float, width: float) -> list[Text]:
    """In full below the graph: the laws that were cut in their labels, and the definitions."""
    entries = [f"{node.name}:  {node.law}" for node in drawing.nodes if layout.labels[node.name].cut]
    entries += [f"{name} {text}" for name, text in drawing.definitions]
    columns = 2 if width >= TWO_COLUMNS and len(entries) > 8 else 1
    letters = max(int(width / columns / 6.2), 60)
    lines = [(i, line) for entry in entries for i, line in enumerate(break_lines(entry, letters, 40)[0])]
    rows = -(-len(lines) // columns)
    while columns == 2 and rows < len(lines) and lines[rows][0]:  # an entry stays in one column
        rows += 1
    return [
        Text(
            PAGE_MARGIN + (16 if i else 0) + (width / 2 if k >= rows else 0.0), y + 15 * (k % max(rows, 1)), line, 10.0,
            QUIET, role="law",
        )
        for k, (i, line) in enumerate(lines)
    ]  # fmt: skip
