"""Long power paths folded into rows, as text is: where to break, and the way of the bonds from one row to the next."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from bondgraph.report.diagram.geometry import Path, Point

FOLD_ABOVE = 1700.0
ASPECT = 1.7
ROW_COST, CUT_COST, EMPTY_COST = 0.15, 0.15, 1.0
MAX_ROWS = 4


def choose_rows(widths: Sequence[float], heights: Sequence[float], cuts: Sequence[int]) -> list[int]:
    """Row of every column so that the whole comes near the shape of a page.

    Parameters
    ----------
    widths, heights
        Size of each column with the channel behind it.
    cuts
        Number of bonds between each column and the next.

    Examples
    --------
    >>> choose_rows([900.0, 900.0, 900.0, 900.0], [400.0] * 4, [1, 1, 1])
    [0, 0, 1, 1]
    """
    count = len(widths)
    if sum(widths) <= FOLD_ABOVE:
        return [0] * count
    best, lowest = [0] * count, math.inf
    for breaks in range(min(MAX_ROWS, count)):
        for places in itertools.combinations(range(1, count), breaks):
            rows = [sum(k >= place for place in places) for k in range(count)]
            spans = [[k for k in range(count) if rows[k] == row] for row in range(breaks + 1)]
            row_widths = [sum(widths[k] for k in span) for span in spans]
            width = max(row_widths)
            height = sum(max(heights[k] for k in span) for span in spans) + 60.0 * breaks
            score = abs(math.log(width / height / ASPECT)) + ROW_COST * breaks
            score += EMPTY_COST * (1 - sum(row_widths) / width / (breaks + 1))
            score += CUT_COST * sum(cuts[place - 1] for place in places)
            if score < lowest - 1e-9:
                best, lowest = rows, score
    return best


@dataclass(frozen=True)
class Return:
    """The space in which bonds go from the end of one row back to the start of the next."""

    right: float
    top: float
    left: float
    spacing: float

    def paths(self, ends: Sequence[tuple[Point, Point]]) -> list[Path]:
        """Polylines of the bonds, given where each leaves the row above and enters the row below."""
        count = len(ends)
        leaving = {k: p for p, k in enumerate(sorted(range(count), key=lambda k: ends[k][0][1]))}
        entering = {k: p for p, k in enumerate(sorted(range(count), key=lambda k: ends[k][1][1]))}
        paths: list[Path] = []
        for k, (start, end) in enumerate(ends):
            outer, inner = count - 1 - leaving[k], count - 1 - entering[k]
            right = self.right + outer * self.spacing
            height = self.top + outer * self.spacing
            left = self.left + inner * self.spacing
            paths.append((start, (right, start[1]), (right, height), (left, height), (left, end[1]), end))
        return paths
