"""The symbols of a bond graph as drawing primitives: nodes, bonds with half arrow and stroke, signals, frames."""

from __future__ import annotations

import math

from bondgraph.report.diagram.canvas import Lead, Line, Polygon, Primitive, Rectangle, Text
from bondgraph.report.diagram.drawn import JUNCTIONS, DrawnNode, Stroke, local_name
from bondgraph.report.diagram.geometry import Box, Path, Point
from bondgraph.report.diagram.labels import (
    BADGE_SIZE,
    KIND_SIZE,
    LAW_LINE_HEIGHT,
    LAW_SIZE,
    LINE_HEIGHT,
    NAME_SIZE,
    Label,
)
from bondgraph.report.diagram.text import text_width

COLOURS = {
    "electrical": "#a15c00",
    "translation": "#1f5fa8",
    "rotation": "#1b7a43",
    "hydraulic": "#007f8c",
    "thermal": "#b3362b",
    "": "#4a4f57",
}
ADDED, ADDED_FILL = "#c2185b", "#fde8f0"
INK, QUIET, FRAME_LINE = "#1c2126", "#5b636d", "#b6bdc6"
SIGNAL = "#6b5b95"
FRAME_FILLS = ("#f7f8fa", "#eff1f4", "#e8ebef")
GAP = 3.0
BARB = (9.0, 5.0)
STROKE_HALF = 6.5


def domain_colour(domain: str) -> str:
    """Colour of a domain; grey where it is not declared."""
    return COLOURS.get(domain, COLOURS[""])


def frame_parts(name: str, box: Box, depth: int) -> list[Primitive]:
    """The rounded frame of a sub-graph with its title."""
    fill = FRAME_FILLS[min(depth, len(FRAME_FILLS)) - 1]
    title = Text(box.left + 10, box.top + 17, local_name(name), 12.0, QUIET, bold=True, role="frame-title")
    return [Rectangle(box, fill, FRAME_LINE, 1.0, 10.0, role="frame", tooltip=name), title]


def node_parts(node: DrawnNode, label: Label, box: Box, colour: str, added: bool) -> list[Primitive]:
    """The text box of a node: junctions and two-ports with an outline, an added one marked."""
    x, y = box.centre[0], box.top + (box.height - label.height) / 2 + 3
    accent = ADDED if added else colour
    parts: list[Primitive] = [_node_box(node, box, accent, added)]
    if node.kind in JUNCTIONS:
        parts.append(Text(x, y + 14, label.kind, KIND_SIZE + 2, accent, "middle", bold=True))
        parts.append(Text(x, y + 29, label.name, NAME_SIZE, INK, "middle"))
        y += 2 * LINE_HEIGHT
    else:
        lead = Lead(label.kind, KIND_SIZE, accent)
        parts.append(Text(x, y + 13, label.name, NAME_SIZE, INK, "middle", lead=lead))
        y += LINE_HEIGHT
    for line in label.law:
        parts.append(Text(x, y + 10, line, LAW_SIZE, QUIET, "middle"))
        y += LAW_LINE_HEIGHT
    if label.note:
        parts.append(Text(x, y + 10, label.note, LAW_SIZE, accent, "middle", italic=True))
        y += LAW_LINE_HEIGHT
    if label.badge:
        width = text_width(label.badge, BADGE_SIZE, bold=True) + 10
        parts.append(Rectangle(Box(x - width / 2, y + 1, width, 14.0), ADDED, ADDED, 0.5, 6.0, role="badge"))
        parts.append(Text(x, y + 11.3, label.badge, BADGE_SIZE, "#ffffff", "middle", bold=True))
    return parts


def _node_box(node: DrawnNode, box: Box, accent: str, added: bool) -> Rectangle:
    tooltip = f"{node.kind} {node.name}" + (f": {node.law}" if node.law else "")
    if node.kind in JUNCTIONS:
        return Rectangle(box, "#ffffff", accent, 1.5, 9.0, role="node", tooltip=tooltip)
    two_port = node.kind in ("TF", "GY")
    fill = ADDED_FILL if added else "#ffffff" if two_port else "none"
    outline = accent if added or two_port else "none"
    dash = (4.0, 3.0) if added and not two_port else ()
    return Rectangle(box, fill, outline, 1.2, 5.0, dash, role="node", tooltip=tooltip)


def branch_part(point: Point, colour: str) -> Primitive:
    """The dot where a signal branches."""
    x, y = point
    return Rectangle(Box(x - 2.2, y - 2.2, 4.4, 4.4), colour, colour, 0.1, 2.2, role="branch")


def _shortened(path: Path, start: float, end: float) -> Path:
    """The polyline without a little at both ends, so that it does not touch the labels."""
    first, second = path[0], path[1]
    before, last = path[-2], path[-1]
    return (_along(first, second, start), *path[1:-1], _along(last, before, end))


def _along(start: Point, end: Point, distance: float) -> Point:
    length = math.dist(start, end) or 1.0
    return start[0] + (end[0] - start[0]) / length * distance, start[1] + (end[1] - start[1]) / length * distance


def _gap(end: Point, towards: Point) -> float:
    """Distance a bond keeps from its label, so that the stroke of a slanting one stays clear of it as well."""
    dx, dy = abs(towards[0] - end[0]), abs(towards[1] - end[1])
    return min(GAP + 1 + STROKE_HALF * dx / dy, 13.0) if dx and dy else GAP


def _flow_side(direction: Point) -> Point:
    """Unit normal towards the flow side: below the bond, or to its right where it is vertical."""
    dx, dy = direction
    normal = (-dy, dx)
    if normal[1] < -1e-9 or (abs(normal[1]) <= 1e-9 and normal[0] < 0):
        return -normal[0], -normal[1]
    return normal


def bond_parts(path: Path, stroke: Stroke | None, colour: str, width: float) -> list[Primitive]:
    """The line of a bond, the half arrow at its head and the causal stroke."""
    line = _shortened(path, _gap(path[0], path[1]), _gap(path[-1], path[-2]))
    parts: list[Primitive] = [Line(line, colour, width, radius=6.0, role="bond")]
    tip, back = line[-1], line[-2]
    unit = _along((0.0, 0.0), (tip[0] - back[0], tip[1] - back[1]), 1.0)
    side = _flow_side(unit)
    length, breadth = BARB
    barb = (tip[0] - unit[0] * length + side[0] * breadth, tip[1] - unit[1] * length + side[1] * breadth)
    parts.append(Line((tip, barb), colour, width, role="harpoon"))
    if stroke is not None:
        end, towards = (line[-1], line[-2]) if stroke == "target" else (line[0], line[1])
        ux, uy = _along((0.0, 0.0), (towards[0] - end[0], towards[1] - end[1]), 1.0)
        bar = (
            (end[0] - uy * STROKE_HALF, end[1] + ux * STROKE_HALF),
            (end[0] + uy * STROKE_HALF, end[1] - ux * STROKE_HALF),
        )
        parts.append(Line(bar, colour, width + 0.6, role="stroke"))
    return parts


def signal_parts(path: Path, colour: str) -> list[Primitive]:
    """The dashed line of a signal and its full arrow."""
    line = _shortened(path, 1.0, 2.0)
    tip, back = line[-1], line[-2]
    ux, uy = _along((0.0, 0.0), (tip[0] - back[0], tip[1] - back[1]), 1.0)
    base = (tip[0] - 8 * ux, tip[1] - 8 * uy)
    head = (tip, (base[0] - 3.2 * uy, base[1] + 3.2 * ux), (base[0] + 3.2 * uy, base[1] - 3.2 * ux))
    return [Line((*line[:-1], base), colour, 1.0, (4.0, 3.0), 7.0, role="signal"), Polygon(head, colour, role="arrow")]
