"""Routes of modulating signals: shortest paths on a grid around labels, with few bends and few crossings.

Signals of the same source may share their way and branch off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from bondgraph.report.diagram.geometry import Box, Path, Point, bounding_box, segments, simplified
from bondgraph.report.diagram.search import BLOCKED, cheapest_path

#: Cell size in pixels, and that of large drawings, which have more than so many cells.
STEP, LARGEST_STEP, MANY_CELLS = 8.0, 12.0, 60000
MARGIN = 5
ON_BOND, NEAR_BOND, ON_MARK, ON_SIGNAL, ON_OUTLINE, BEND = 9.0, 2.5, 40.0, 9.0, 2.5, 5.0
OWN_SIGNAL = 0.4
#: How far, in cells, a signal may stray from the area between its ends before it is looked for everywhere.
REACH = 28
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

    step: float
    left: float
    top: float
    columns: int
    rows: int
    cost: list[float]
    users: dict[Cell, set[str]] = field(default_factory=dict)

    @staticmethod
    def around(boxes: Sequence[Box], bonds: Sequence[Path]) -> _Field:
        whole = bounding_box(boxes)
        step = min(max(STEP, math.sqrt(whole.width * whole.height / MANY_CELLS)), LARGEST_STEP)
        columns = math.ceil(whole.width / step) + 2 * MARGIN
        rows = math.ceil(whole.height / step) + 2 * MARGIN
        left, top = whole.left - MARGIN * step, whole.top - MARGIN * step
        made = _Field(step, left, top, columns, rows, [1.0] * (columns * rows))
        for path in bonds:
            made._mark_bond(path)
        for box in boxes:
            made._block(box.grown(4))
        return made

    def cell(self, point: Point) -> Cell:
        return round((point[0] - self.left) / self.step), round((point[1] - self.top) / self.step)

    def point(self, cell: Cell) -> Point:
        return self.left + cell[0] * self.step, self.top + cell[1] * self.step

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
            for k in range(max(int(piece / (self.step / 2)), 1) + 1):
                along = min(k * self.step / 2, piece)
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
        for x in self._cells_between(box.left - self.left, box.right - self.left):
            for y in self._cells_between(box.top - self.top, box.bottom - self.top):
                self._raise((x, y), BLOCKED)

    def index(self, cell: Cell) -> int:
        return cell[1] * self.columns + cell[0]

    def prices(self, source: str, window: tuple[int, int, int, int]) -> list[float]:
        """Price of every cell of a window for a signal of a source: low on its own earlier ones, high on others'."""
        left, top, right, bottom = window
        columns = right - left + 1
        prices: list[float] = []
        for y in range(top, bottom + 1):
            prices += self.cost[y * self.columns + left : y * self.columns + right + 1]
        for (x, y), users in self.users.items():
            place = (y - top) * columns + x - left
            if left <= x <= right and top <= y <= bottom and prices[place] < BLOCKED:
                prices[place] = OWN_SIGNAL if users == {source} else prices[place] + ON_SIGNAL
        prices[:columns] = prices[-columns:] = [BLOCKED] * columns
        prices[::columns] = prices[columns - 1 :: columns] = [BLOCKED] * (bottom - top + 1)
        return prices

    def occupy(self, cells: Sequence[Cell], source: str) -> None:
        for cell in cells:
            self.users.setdefault(cell, set()).add(source)

    def _cells_between(self, low: float, high: float) -> range:
        return range(math.ceil(low / self.step), math.floor(high / self.step) + 1)

    def doors(self, box: Box) -> list[tuple[Cell, int]]:
        """Free cells next to a box, each with the direction that leads away from it."""
        grown = box.grown(4)
        left, right = math.floor((grown.left - self.left) / self.step), math.ceil((grown.right - self.left) / self.step)
        top, bottom = math.floor((grown.top - self.top) / self.step), math.ceil((grown.bottom - self.top) / self.step)
        corner = min(7.0, box.height / 2 - self.step / 2)
        inner_x = self._cells_between(box.left + corner - self.left, box.right - corner - self.left)
        inner_y = self._cells_between(box.top + corner - self.top, box.bottom - corner - self.top)
        found = [((x, bottom), 1) for x in inner_x] + [((x, top), 3) for x in inner_x]
        found += [((right, y), 0) for y in inner_y] + [((left, y), 2) for y in inner_y]
        return [(cell, way) for cell, way in found if self.inside(cell)]


def _search(grid: _Field, source: str, start: Box, goal: Box) -> list[Cell] | None:
    """Cheapest cells from one box to another near both, or else anywhere; None if there is no way."""
    (x1, y1), (x2, y2) = (
        grid.cell((min(start.left, goal.left), min(start.top, goal.top))),
        grid.cell((max(start.right, goal.right), max(start.bottom, goal.bottom))),
    )
    near = (max(x1 - REACH, 0), max(y1 - REACH, 0), min(x2 + REACH, grid.columns - 1), min(y2 + REACH, grid.rows - 1))
    found = _search_in(grid, near, source, start, goal)
    return found or _search_in(grid, (0, 0, grid.columns - 1, grid.rows - 1), source, start, goal)


def _search_in(
    grid: _Field, window: tuple[int, int, int, int], source: str, start: Box, goal: Box
) -> list[Cell] | None:
    """The same, in a window of the grid given by its first and last column and row."""
    left, top, right, _ = window
    columns = right - left + 1

    def place(cell: Cell) -> int:
        return (cell[1] - top) * columns + cell[0] - left

    known = any(source in users for users in grid.users.values())
    starts = [(place(cell), way) for cell, way in grid.doors(start)]
    ends = {place(cell): (way + 2) % 4 for cell, way in grid.doors(goal)}
    around = goal.grown(grid.step)
    first, last = grid.cell((around.left, around.top)), grid.cell((around.right, around.bottom))
    area = (first[0] - left, first[1] - top, last[0] - left, last[1] - top)
    prices = grid.prices(source, window)
    found = cheapest_path(prices, columns, starts, ends, area, BEND, OWN_SIGNAL if known else 1.0)
    return None if found is None else [(cell % columns + left, cell // columns + top) for cell in found]


def _attached(grid: _Field, cells: Sequence[Cell], start: Box, goal: Box) -> Path:
    """The route as points, from box edge to box edge."""
    points = [grid.point(cell) for cell in cells]
    return simplified((_edge_point(start, points[0]), *points, _edge_point(goal, points[-1])))


def _edge_point(box: Box, point: Point) -> Point:
    return min(max(point[0], box.left), box.right), min(max(point[1], box.top), box.bottom)
