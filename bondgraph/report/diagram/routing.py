"""Routes of modulating signals: shortest paths on a grid around labels, with few bends and few crossings.

Signals of the same source may share their way and branch off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from bondgraph.report.diagram.geometry import Box, Path, Point, bounding_box, segments, simplified
from bondgraph.report.diagram.search import BLOCKED, cheapest_path

STEP = 8.0
MARGIN = 5
ON_BOND, NEAR_BOND, ON_MARK, ON_SIGNAL, ON_OUTLINE, BEND = 9.0, 2.5, 40.0, 9.0, 2.5, 5.0
OWN_SIGNAL = 0.3
MARK_LENGTH = 15.0
_MOVES = ((1, 0), (0, 1), (-1, 0), (0, -1))


@dataclass(frozen=True)
class Signals:
    """Polylines of the signals, from the edge of the source's box to that of the target's, and where they branch."""

    paths: tuple[Path, ...] = ()
    branches: tuple[tuple[int, Point], ...] = ()


def route_signals(
    signals: Sequence[tuple[str, str]],
    boxes: Mapping[str, Box],
    bonds: Sequence[Path],
    keep_out: Sequence[Box] = (),
    frames: Sequence[Box] = (),
) -> Signals:
    """Route the signals; a branch is where one (by its index) leaves the way of an earlier one of the same source.

    Parameters
    ----------
    signals
        Pairs (from, to) of box names.
    boxes
        Labels, which no signal may cross.
    bonds
        Polylines that may be crossed where needed.
    keep_out
        Further areas that no signal may cross (titles of frames).
    frames
        Rectangles whose outline signals may cross but not follow.
    """
    if not signals:
        return Signals()
    field_ = _Field.around([*boxes.values(), *keep_out], bonds)
    order = sorted(range(len(signals)), key=lambda k: (_distance(boxes, signals[k]), k))
    for frame in frames:
        field_.mark_outline(frame)
    routes: dict[int, Path] = {}
    branches: list[tuple[int, Point]] = []
    for k in order:
        source, target = signals[k]
        cells = _search(field_, source, boxes[source], boxes[target])
        if cells is None:
            routes[k] = (boxes[source].centre, boxes[target].centre)
            continue
        shared = [cell for cell in cells if source in field_.users.get(cell, ())]
        if shared:
            branches.append((k, field_.point(shared[-1])))
        field_.occupy(cells, source)
        routes[k] = _attached(field_, cells, boxes[source], boxes[target])
    return Signals(tuple(routes[k] for k in range(len(signals))), tuple(branches))


def _distance(boxes: Mapping[str, Box], signal: tuple[str, str]) -> float:
    (x1, y1), (x2, y2) = boxes[signal[0]].centre, boxes[signal[1]].centre
    return abs(x2 - x1) + abs(y2 - y1)


Cell = tuple[int, int]


@dataclass
class _Field:
    """Cost of entering each cell of a regular grid, and which sources' signals run through it."""

    left: float
    top: float
    columns: int
    rows: int
    cost: list[float]
    users: dict[Cell, set[str]] = field(default_factory=dict)

    @staticmethod
    def around(boxes: Sequence[Box], bonds: Sequence[Path]) -> _Field:
        whole = bounding_box(boxes)
        columns = math.ceil(whole.width / STEP) + 2 * MARGIN
        rows = math.ceil(whole.height / STEP) + 2 * MARGIN
        made = _Field(whole.left - MARGIN * STEP, whole.top - MARGIN * STEP, columns, rows, [1.0] * (columns * rows))
        for path in bonds:
            made._mark_bond(path)
        for box in boxes:
            made._block(box.grown(4))
        for x in range(columns):
            made._raise((x, 0), BLOCKED)
            made._raise((x, rows - 1), BLOCKED)
        for y in range(rows):
            made._raise((0, y), BLOCKED)
            made._raise((columns - 1, y), BLOCKED)
        return made

    def cell(self, point: Point) -> Cell:
        return round((point[0] - self.left) / STEP), round((point[1] - self.top) / STEP)

    def point(self, cell: Cell) -> Point:
        return self.left + cell[0] * STEP, self.top + cell[1] * STEP

    def inside(self, cell: Cell) -> bool:
        return 0 <= cell[0] < self.columns and 0 <= cell[1] < self.rows

    def _raise(self, cell: Cell, cost: float) -> None:
        if self.inside(cell):
            place = self.index(cell)
            self.cost[place] = max(self.cost[place], cost)

    def _mark_bond(self, path: Path) -> None:
        """Crossing a bond costs, running along it costs at every cell, and its ends with their marks cost most."""
        length = sum(math.dist(a, b) for a, b in segments(path))
        done = 0.0
        for a, b in segments(path):
            piece = math.dist(a, b)
            for k in range(max(int(piece / (STEP / 2)), 1) + 1):
                along = min(k * STEP / 2, piece)
                share = along / piece if piece else 0.0
                x, y = self.cell((a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])))
                at_end = min(done + along, length - done - along) < MARK_LENGTH
                self._raise((x, y), ON_MARK if at_end else ON_BOND)
                for dx, dy in _MOVES:
                    self._raise((x + dx, y + dy), ON_BOND if at_end else NEAR_BOND)
            done += piece

    def mark_outline(self, box: Box) -> None:
        """Make following the outline of a frame dearer than crossing it."""
        left, top = self.cell((box.left, box.top))
        right, bottom = self.cell((box.right, box.bottom))
        for x in range(left, right + 1):
            self._raise((x, top), ON_OUTLINE)
            self._raise((x, bottom), ON_OUTLINE)
        for y in range(top, bottom + 1):
            self._raise((left, y), ON_OUTLINE)
            self._raise((right, y), ON_OUTLINE)

    def _block(self, box: Box) -> None:
        for x in range(math.ceil((box.left - self.left) / STEP), math.floor((box.right - self.left) / STEP) + 1):
            for y in range(math.ceil((box.top - self.top) / STEP), math.floor((box.bottom - self.top) / STEP) + 1):
                self._raise((x, y), BLOCKED)

    def index(self, cell: Cell) -> int:
        return cell[1] * self.columns + cell[0]

    def prices(self, source: str) -> list[float]:
        """Price of every cell for a signal of ``source``: cheap on its own earlier signals, dear on others'."""
        prices = list(self.cost)
        for cell, users in self.users.items():
            place = self.index(cell)
            if prices[place] < BLOCKED:
                prices[place] = OWN_SIGNAL if users == {source} else prices[place] + ON_SIGNAL
        return prices

    def occupy(self, cells: Sequence[Cell], source: str) -> None:
        for cell in cells:
            self.users.setdefault(cell, set()).add(source)

    @staticmethod
    def _cells_between(low: float, high: float) -> range:
        return range(math.ceil(low / STEP), math.floor(high / STEP) + 1)

    def doors(self, box: Box) -> list[tuple[Cell, int]]:
        """Free cells next to a box, each with the direction that leads away from it."""
        grown = box.grown(4)
        left, right = math.floor((grown.left - self.left) / STEP), math.ceil((grown.right - self.left) / STEP)
        top, bottom = math.floor((grown.top - self.top) / STEP), math.ceil((grown.bottom - self.top) / STEP)
        corner = min(7.0, box.height / 2 - STEP / 2)
        inner_x = self._cells_between(box.left + corner - self.left, box.right - corner - self.left)
        inner_y = self._cells_between(box.top + corner - self.top, box.bottom - corner - self.top)
        found = [((x, bottom), 1) for x in inner_x] + [((x, top), 3) for x in inner_x]
        found += [((right, y), 0) for y in inner_y] + [((left, y), 2) for y in inner_y]
        return [(cell, way) for cell, way in found if self.inside(cell)]


def _search(grid: _Field, source: str, start: Box, goal: Box) -> list[Cell] | None:
    """Cheapest cells from one box to another, or None if there is no way."""
    known = any(source in users for users in grid.users.values())
    prices = grid.prices(source)
    starts = [(grid.index(cell), way) for cell, way in grid.doors(start)]
    ends = {grid.index(cell): (way + 2) % 4 for cell, way in grid.doors(goal)}
    corners = (*grid.cell((goal.left - STEP, goal.top - STEP)), *grid.cell((goal.right + STEP, goal.bottom + STEP)))
    found = cheapest_path(prices, grid.columns, starts, ends, corners, BEND, OWN_SIGNAL if known else 1.0)
    return None if found is None else [(cell % grid.columns, cell // grid.columns) for cell in found]


def _attached(grid: _Field, cells: Sequence[Cell], start: Box, goal: Box) -> Path:
    """The route as points, from box edge to box edge."""
    points = [grid.point(cell) for cell in cells]
    return simplified((_edge_point(start, points[0]), *points, _edge_point(goal, points[-1])))


def _edge_point(box: Box, point: Point) -> Point:
    return min(max(point[0], box.left), box.right), min(max(point[1], box.top), box.bottom)
