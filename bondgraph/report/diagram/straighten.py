"""Small repairs to the heights of one level, which a linear program cannot make: fewer bends, no bonds on one line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bondgraph.report.diagram.layers import Alignment

JOG = 24.0
SAME_LINE = 6.0


@dataclass(frozen=True)
class Column:
    """Items of one column from top to bottom, with the least distance of each from the next."""

    items: tuple[int, ...]
    distances: tuple[float, ...]

    def holds(self, heights: Sequence[float]) -> bool:
        """Whether all items keep their distances."""
        return all(
            heights[lower] - heights[upper] >= distance - 1e-6
            for upper, lower, distance in zip(self.items, self.items[1:], self.distances, strict=False)
        )


def straightened(heights: Sequence[float], columns: Sequence[Column], wishes: Sequence[Alignment]) -> list[float]:
    """Heights with small jogs removed wherever moving a straight chain of items makes one bend fewer.

    Parameters
    ----------
    heights
        Heights that keep all distances.
    wishes
        The bonds, as attachment points that would lie at the same height if the bond were straight.
    """
    best = list(heights)
    for index, wish in enumerate(wishes):
        gap = _gap(best, wish)
        if not 1e-3 < abs(gap) <= JOG:
            continue
        for root, other, shift in ((wish.b, wish.a, gap), (wish.a, wish.b, -gap)):
            chain = _chain(best, wishes, root, index)
            moved = [height + shift * (i in chain) for i, height in enumerate(best)]
            allowed = other not in chain and all(column.holds(moved) for column in columns)
            if allowed and _bends(moved, wishes) < _bends(best, wishes):
                best = moved
                break
    return best


def separated(heights: Sequence[float], columns: Sequence[Column], wishes: Sequence[Alignment]) -> list[float]:
    """Heights moved a little where two bonds that cross would change places on the same two lines."""
    best = list(heights)
    for first, second in _swaps(best, wishes):
        for root in (first.b, second.b, first.a, second.a):
            for shift in (8.0, -8.0, 16.0, -16.0):
                moved = [height + shift * (i == root) for i, height in enumerate(best)]
                fewer = len(_swaps(moved, wishes)) < len(_swaps(best, wishes))
                if fewer and all(column.holds(moved) for column in columns):
                    best = moved
    return best


def _gap(heights: Sequence[float], wish: Alignment) -> float:
    return heights[wish.a] + wish.offset_a - heights[wish.b] - wish.offset_b


def _bends(heights: Sequence[float], wishes: Sequence[Alignment]) -> int:
    return sum(abs(_gap(heights, wish)) > 1e-3 for wish in wishes)


def _chain(heights: Sequence[float], wishes: Sequence[Alignment], root: int, without: int) -> set[int]:
    """Items joined to ``root`` by straight bonds."""
    joined = [(wish.a, wish.b) for k, wish in enumerate(wishes) if k != without and abs(_gap(heights, wish)) <= 1e-3]
    chain, grown = {root}, True
    while grown:
        before = len(chain)
        for a, b in joined:
            if a in chain or b in chain:
                chain |= {a, b}
        grown = len(chain) > before
    return chain


def _swaps(heights: Sequence[float], wishes: Sequence[Alignment]) -> list[tuple[Alignment, Alignment]]:
    """Pairs of bonds between the same two columns of which each starts at the height where the other ends."""
    found = []
    ends = [(heights[wish.a] + wish.offset_a, heights[wish.b] + wish.offset_b, wish) for wish in wishes]
    for i, (left, right, wish) in enumerate(ends):
        if abs(left - right) < 1e-3:
            continue
        for other_left, other_right, other in ends[i + 1 :]:
            same_channel = wish.channel == other.channel
            if same_channel and abs(left - other_right) < SAME_LINE and abs(right - other_left) < SAME_LINE:
                found.append((wish, other))
    return found
