"""Boxes, points and segments of a drawing; pixels, x to the right, y downwards."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass

Point = tuple[float, float]
Path = tuple[Point, ...]


@dataclass(frozen=True)
class Box:
    """An axis-parallel rectangle.

    Examples
    --------
    >>> Box(0, 0, 10, 4).overlaps(Box(9, 3, 5, 5))
    True
    >>> Box(0, 0, 10, 4).centre
    (5.0, 2.0)
    """

    left: float
    top: float
    width: float
    height: float

    @property
    def right(self) -> float:
        """Right edge."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """Lower edge."""
        return self.top + self.height

    @property
    def centre(self) -> Point:
        """Middle of the box."""
        return self.left + self.width / 2, self.top + self.height / 2

    def moved(self, dx: float, dy: float) -> Box:
        """The same box elsewhere."""
        return Box(self.left + dx, self.top + dy, self.width, self.height)

    def grown(self, margin: float) -> Box:
        """The box with a margin on every side."""
        return Box(self.left - margin, self.top - margin, self.width + 2 * margin, self.height + 2 * margin)

    def overlaps(self, other: Box) -> bool:
        """Whether the two boxes share an area."""
        return (
            self.left < other.right and other.left < self.right and self.top < other.bottom and other.top < self.bottom
        )

    def contains(self, other: Box) -> bool:
        """Whether the other box lies inside this one."""
        return (
            self.left <= other.left
            and other.right <= self.right
            and self.top <= other.top
            and other.bottom <= self.bottom
        )

    def meets(self, start: Point, end: Point) -> bool:
        """Whether the segment from ``start`` to ``end`` passes through the inside of the box."""
        near, far = 0.0, 1.0
        for position, delta, low, high in (
            (start[0], end[0] - start[0], self.left, self.right),
            (start[1], end[1] - start[1], self.top, self.bottom),
        ):
            if delta == 0:
                if not low < position < high:
                    return False
                continue
            first, second = sorted(((low - position) / delta, (high - position) / delta))
            near, far = max(near, first), min(far, second)
        return far - near > 1e-9


def bounding_box(boxes: Iterable[Box]) -> Box:
    """The smallest box around all of them (at least one)."""
    parts = list(boxes)
    left, top = min(box.left for box in parts), min(box.top for box in parts)
    return Box(left, top, max(box.right for box in parts) - left, max(box.bottom for box in parts) - top)


def moved_path(path: Path, dx: float, dy: float) -> Path:
    """The same polyline elsewhere."""
    return tuple((x + dx, y + dy) for x, y in path)


def simplified(path: Path) -> Path:
    """A polyline without repeated points and without points in the middle of a straight piece.

    Examples
    --------
    >>> simplified(((0, 0), (1, 0), (1, 0), (2, 0), (2, 3)))
    ((0, 0), (2, 0), (2, 3))
    """
    kept: list[Point] = []
    for point in path:
        if kept and abs(kept[-1][0] - point[0]) < 1e-6 and abs(kept[-1][1] - point[1]) < 1e-6:
            continue
        if len(kept) >= 2 and _straight(kept[-2], kept[-1], point):
            kept[-1] = point
        else:
            kept.append(point)
    return tuple(kept)


def _straight(first: Point, middle: Point, last: Point) -> bool:
    ax, ay = middle[0] - first[0], middle[1] - first[1]
    bx, by = last[0] - middle[0], last[1] - middle[1]
    return abs(ax * by - ay * bx) < 1e-6 and ax * bx + ay * by >= 0


def segments(path: Path) -> list[tuple[Point, Point]]:
    """The straight pieces of a polyline."""
    return list(itertools.pairwise(path))


def cross(first: tuple[Point, Point], second: tuple[Point, Point]) -> bool:
    """Whether two segments properly cross (touching ends do not count).

    Examples
    --------
    >>> cross(((0, 0), (2, 2)), ((0, 2), (2, 0)))
    True
    >>> cross(((0, 0), (2, 2)), ((1, 1), (2, 0)))
    False
    """
    (a, b), (c, d) = first, second

    def side(p: Point, q: Point, r: Point) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return side(a, b, c) * side(a, b, d) < -1e-9 and side(c, d, a) * side(c, d, b) < -1e-9


def path_crossings(first: Path, second: Path) -> int:
    """How often two polylines cross."""
    return sum(cross(piece, other) for piece in segments(first) for other in segments(second))


def path_from(path: Path, point: Point) -> Path:
    """The part of a polyline after a point that lies on it; all of it if the point does not.

    Examples
    --------
    >>> path_from(((0, 0), (4, 0), (4, 6)), (3, 0))
    ((3, 0), (4, 0), (4, 6))
    """
    for k, (start, end) in enumerate(segments(path)):
        around = math.dist(start, point) + math.dist(point, end)
        if around - math.dist(start, end) < 1e-6 and point != path[-1]:
            return simplified((point, *path[k + 1 :]))
    return path
