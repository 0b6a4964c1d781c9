"""Cheapest path with few bends through a grid of priced cells.

A* search (P. Hart, N. Nilsson, B. Raphael (1968), IEEE Trans. SSC 4(2)) over pairs of cell and direction.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence

#: Price of a cell that cannot be entered; the outermost cells of a grid must have it.
BLOCKED = math.inf

#: A cell by its index, row by row, and a direction: 0 right, 1 down, 2 left, 3 up.
Door = tuple[int, int]


def cheapest_path(
    prices: Sequence[float],
    columns: int,
    starts: Sequence[Door],
    ends: Mapping[int, int],
    goal: tuple[int, int, int, int],
    bend: float,
    least: float,
) -> list[int] | None:
    """Cells of the cheapest path, or None if there is none.

    Parameters
    ----------
    prices
        Price of entering each cell, row by row.
    columns
        Cells per row.
    starts
        Where the path may start, with the direction of its first step.
    ends
        Where it may end, with the direction in which it must arrive.
    goal
        First column, first row, last column, last row of an area that holds all ends.
    bend
        Price of a change of direction.
    least
        A price that no cell falls below.

    Examples
    --------
    >>> wall = BLOCKED
    >>> prices = [wall] * 5 + [wall, 1.0, 1.0, 1.0, wall] + [wall] * 5
    >>> cheapest_path(prices, 5, [(6, 0)], {8: 0}, (3, 1, 3, 1), 1.0, 1.0)
    [6, 7, 8]
    """
    across = [least * max(goal[0] - x, x - goal[2], 0) for x in range(columns)]
    down = [least * max(goal[1] - y, y - goal[3], 0) for y in range(len(prices) // columns)]
    moves = (1, columns, -1, -columns)
    reached = [BLOCKED] * (4 * len(prices))
    came: dict[int, int] = {}
    queue: list[tuple[float, float, int]] = []
    for cell, way in starts:
        if prices[cell] < reached[4 * cell + way]:
            reached[4 * cell + way] = prices[cell]
            heapq.heappush(
                queue, (prices[cell] + across[cell % columns] + down[cell // columns], prices[cell], 4 * cell + way)
            )
    while queue:
        _, cost, state = heapq.heappop(queue)
        if state < 0:
            return _walk_back(came, -1 - state)
        if cost > reached[state]:
            continue
        cell, way = divmod(state, 4)
        if cell in ends:
            total = cost + (bend if ends[cell] != way else 0.0)
            heapq.heappush(queue, (total, total, -1 - state))
        for turn, turning in ((way, 0.0), ((way + 1) % 4, bend), ((way + 3) % 4, bend)):
            onto = cell + moves[turn]
            total = cost + prices[onto] + turning
            next_state = 4 * onto + turn
            if total < reached[next_state]:
                reached[next_state], came[next_state] = total, state
                row, column = divmod(onto, columns)
                heapq.heappush(queue, (total + across[column] + down[row], total, next_state))
    return None


def _walk_back(came: Mapping[int, int], state: int) -> list[int]:
    cells = [state // 4]
    while state in came:
        state = came[state]
        cells.append(state // 4)
    return cells[::-1]
