"""The text box of each node: what stands in it and how large it is."""

from __future__ import annotations

from dataclasses import dataclass

from bondgraph.report.diagram.drawn import JUNCTIONS, DrawnNode, local_name
from bondgraph.report.diagram.text import break_lines, text_width

KIND_SIZE, NAME_SIZE, LAW_SIZE, BADGE_SIZE = 13.0, 12.0, 10.0, 9.5
LAW_LENGTH, LAW_LINES = 24, 2
LINE_HEIGHT, LAW_LINE_HEIGHT = 17.0, 13.0
PADDING = 7.0
BADGE = "added"


@dataclass(frozen=True)
class Label:
    """Text of one node and the size of its box; ``cut`` tells that the law did not fit in full."""

    kind: str
    name: str
    law: tuple[str, ...]
    note: str
    cut: bool
    badge: str
    width: float
    height: float


def label_of(node: DrawnNode, added: bool) -> Label:
    """The label of a node; an added one carries a badge.

    Examples
    --------
    >>> label_of(DrawnNode("axle.bearing", "R", law="b·flow"), added=False).law
    ('b·flow',)
    """
    name = local_name(node.name)
    law, cut = break_lines(node.law, LAW_LENGTH, LAW_LINES)
    badge = BADGE if added else ""
    title = text_width(name, NAME_SIZE)
    if node.kind in JUNCTIONS:
        width = max(title, text_width(node.kind, KIND_SIZE + 2, bold=True))
        height = 2 * LINE_HEIGHT
    else:
        width = title + text_width(node.kind + " ", KIND_SIZE, bold=True)
        height = LINE_HEIGHT
    width = max(
        [
            width,
            *(text_width(line, LAW_SIZE) for line in (*law, node.note)),
            text_width(badge, BADGE_SIZE, bold=True) + 8,
        ]
    )
    height += LAW_LINE_HEIGHT * (len(law) + bool(node.note)) + (LAW_LINE_HEIGHT + 3 if badge else 0) + 6
    return Label(node.kind, name, law, node.note, cut, badge, round(width + 2 * PADDING, 2), height)
