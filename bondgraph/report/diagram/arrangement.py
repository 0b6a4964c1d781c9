"""Coordinates of one level: columns from left to right in one or more rows, and the bonds between the columns."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from bondgraph.report.diagram.cells import EXIT_SPACING, Block
from bondgraph.report.diagram.folding import Return, choose_rows
from bondgraph.report.diagram.geometry import Path, Point
from bondgraph.report.diagram.layers import Alignment, assign_tracks, place_vertically
from bondgraph.report.diagram.straighten import Column, separated, straightened

ITEM_GAP, LINE_GAP = 22.0, EXIT_SPACING
CHANNEL_MARGIN, PORT_MARGIN, TRACK_SPACING = 24.0, 14.0, 16.0
EDGE_MARGIN, RETURN_MARGIN = 16.0, 26.0


@dataclass(frozen=True, order=True)
class Item:
    """A node with its one-ports, a sub-graph, a port of the level, or a bend of a long bond."""

    form: Literal["node", "frame", "port", "bend"]
    name: str


Piece = tuple[int, int, int]


@dataclass
class Grid:
    """Items by index with their layer, and the pieces (bond, left item, right item) between neighbouring layers."""

    items: list[Item]
    layer: list[int]
    pieces: list[Piece] = field(default_factory=list)
    columns: tuple[tuple[int, ...], ...] = ()

    def pieces_at(self, item: int, side: str) -> list[Piece]:
        """Pieces on one side of an item, from top to bottom."""
        position = {member: k for column in self.columns for k, member in enumerate(column)}
        own, other = (2, 1) if side == "left" else (1, 2)
        return sorted((p for p in self.pieces if p[own] == item), key=lambda p: (position[p[other]], p[0]))

    def only_ports(self, column: int) -> bool:
        """Whether a column holds nothing but ports of the level."""
        return all(self.items[i].form == "port" for i in self.columns[column])


@dataclass(frozen=True)
class Arrangement:
    """Reference point of every item, the polyline of every piece by (bond, left item), and the size of the level."""

    points: tuple[Point, ...]
    pieces: Mapping[tuple[int, int], Path]
    width: float
    height: float


def arrange(grid: Grid, blocks: Sequence[Block], may_fold: bool) -> Arrangement:
    """Place the blocks of a level; a level that ``may_fold`` is broken into rows when it is very wide."""
    rows = _rows(grid, blocks) if may_fold else [0] * len(grid.columns)
    heights = _heights(grid, blocks, rows)
    points: list[Point] = [(0.0, 0.0)] * len(grid.items)
    pieces: dict[tuple[int, int], Path] = {}
    returns: list[Return] = []
    top = width = 0.0
    for row in range(max(rows) + 1):
        columns = [k for k, value in enumerate(rows) if value == row]
        items = [i for k in columns for i in grid.columns[k]]
        entering = sum(grid.layer[piece[2]] == columns[0] for piece in grid.pieces) * bool(row)
        leaving = sum(grid.layer[piece[1]] == columns[-1] for piece in grid.pieces)
        top += 2 * RETURN_MARGIN * bool(row) + max(entering - 1, 0) * TRACK_SPACING
        shift = top - min(heights[i] - blocks[i].above for i in items)
        for i in items:
            heights[i] += shift
        top = max(heights[i] + blocks[i].below for i in items)
        start = (0.0 if grid.only_ports(columns[0]) else EDGE_MARGIN) + _channel(entering)
        centres, inner, end = _row(grid, blocks, heights, columns, start)
        pieces |= inner
        for k, centre in centres.items():
            for i in grid.columns[k]:
                points[i] = (centre, heights[i])
        returns.append(Return(end + CHANNEL_MARGIN, top + RETURN_MARGIN, EDGE_MARGIN, TRACK_SPACING))
        edge = 0.0 if grid.only_ports(columns[-1]) else EDGE_MARGIN
        width = max(width, end + _channel(leaving) + edge)
    pieces |= _between_rows(grid, blocks, points, rows, returns)
    return Arrangement(tuple(points), pieces, width, top)


def _channel(count: int) -> float:
    """Width of the channel at the end of a row through which ``count`` bonds leave."""
    return CHANNEL_MARGIN + (count - 1) * TRACK_SPACING if count else 0.0


def _rows(grid: Grid, blocks: Sequence[Block]) -> list[int]:
    """Row of every column."""
    widths, heights = [], []
    for column in grid.columns:
        widths.append(max(blocks[i].left for i in column) + max(blocks[i].right for i in column) + 2 * CHANNEL_MARGIN)
        heights.append(sum(blocks[i].above + blocks[i].below + ITEM_GAP for i in column))
    cuts = [sum(grid.layer[piece[1]] == k for piece in grid.pieces) for k in range(len(grid.columns) - 1)]
    return choose_rows(widths, heights, cuts)


def _heights(grid: Grid, blocks: Sequence[Block], rows: Sequence[int]) -> list[float]:
    """Vertical position of every item; straightness counts more where a bond has bends that could be straight."""
    alignments = []
    for bond, a, b in grid.pieces:
        if rows[grid.layer[a]] == rows[grid.layer[b]]:
            points = sum(grid.items[i].form in ("bend", "port") for i in (a, b))
            start, end = blocks[a].ports["right", bond], blocks[b].ports["left", bond]
            later = 1 + 0.05 * grid.layer[a]  # of two equally good bends, the earlier
            alignments.append(Alignment(a, start[1], b, end[1], (1.0, 2.0, 6.0)[points] * later, grid.layer[a]))
    gaps = [ITEM_GAP if item.form in ("node", "frame") else LINE_GAP for item in grid.items]
    above, below = [block.above for block in blocks], [block.below for block in blocks]
    columns = []
    for column in grid.columns:
        pairs = itertools.pairwise(column)
        columns.append(Column(column, tuple(below[i] + above[j] + max(gaps[i], gaps[j]) for i, j in pairs)))
    heights = place_vertically(grid.columns, above, below, alignments, gaps)
    return separated(straightened(heights, columns, alignments), columns, alignments)


def _row(
    grid: Grid, blocks: Sequence[Block], heights: Sequence[float], columns: Sequence[int], x: float
) -> tuple[dict[int, float], dict[tuple[int, int], Path], float]:
    """Centre line of every column of a row, the polylines between them, and where the row ends."""
    centres: dict[int, float] = {}
    pieces: dict[tuple[int, int], Path] = {}
    for k in columns:
        centres[k] = x + max(blocks[i].left for i in grid.columns[k])
        x = centres[k] + max(blocks[i].right for i in grid.columns[k])
        if k == columns[-1]:
            break
        here = [piece for piece in grid.pieces if grid.layer[piece[1]] == k]
        ends = [
            (heights[a] + blocks[a].ports["right", bond][1], heights[b] + blocks[b].ports["left", bond][1])
            for bond, a, b in here
        ]
        tracks, count = assign_tracks(ends, 8.0)
        x += PORT_MARGIN if grid.only_ports(k) else CHANNEL_MARGIN
        first = x
        x += max(count - 1, 0) * TRACK_SPACING + (PORT_MARGIN if grid.only_ports(k + 1) else CHANNEL_MARGIN)
        next_centre = x + max(blocks[i].left for i in grid.columns[k + 1])
        for (bond, a, b), (y_left, y_right), track in zip(here, ends, tracks, strict=True):
            start = (centres[k] + blocks[a].ports["right", bond][0], y_left)
            end = (next_centre + blocks[b].ports["left", bond][0], y_right)
            bend = first + (track or 0) * TRACK_SPACING
            pieces[bond, a] = (start, end) if track is None else (start, (bend, y_left), (bend, y_right), end)
    return centres, pieces, x


def _between_rows(
    grid: Grid, blocks: Sequence[Block], points: Sequence[Point], rows: Sequence[int], returns: Sequence[Return]
) -> dict[tuple[int, int], Path]:
    """The pieces that lead from the end of one row to the start of the next."""
    found: dict[tuple[int, int], Path] = {}
    for row, space in enumerate(returns[:-1]):
        here = [p for p in grid.pieces if rows[grid.layer[p[1]]] == row and rows[grid.layer[p[2]]] == row + 1]
        ends = []
        for bond, a, b in here:
            start, end = blocks[a].ports["right", bond], blocks[b].ports["left", bond]
            ends.append(
                ((points[a][0] + start[0], points[a][1] + start[1]), (points[b][0] + end[0], points[b][1] + end[1]))
            )
        for (bond, a, _), path in zip(here, space.paths(ends), strict=True):
            found[bond, a] = path
    return found
