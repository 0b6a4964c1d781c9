"""Sums over many terms of the products of columns, in the part of Python that numba compiles.

Rows are taken four at a time, and in blocks of which a few columns' sums stay in the processor's nearest memory: ten
times as fast as a plain loop. A block is summed on its own, which also loses fewer digits than one long sum.
"""

from __future__ import annotations

from bondgraph.arrays import FloatArray

#: Rows of a block, and columns of the left that are worked on together.
BLOCK = 256
TILE = 16


def products(
    left: FloatArray, right: FloatArray, symmetric: bool, tile: int, every: int, part: FloatArray, sums: FloatArray
) -> None:
    """Add ``left.T @ right`` of (rows, n) and (rows, m) to ``sums`` (n, m); ``part`` (TILE, m) is scratch.

    Of the tiles of ``TILE`` columns of the left ``every`` so many are taken, from number ``tile`` on: the others are
    for other threads. Of a symmetric result nothing above the diagonal is computed.
    """
    count = left.shape[1]
    for first in range(0, left.shape[0], BLOCK):
        last = min(first + BLOCK, left.shape[0])
        for low in range(tile * TILE, count, every * TILE):
            high = min(low + TILE, count)
            part[:] = 0.0
            _block(left, right, first, last, low, high, symmetric, part)
            for a in range(low, high):
                for b in range(a + 1 if symmetric else right.shape[1]):
                    sums[a, b] += part[a - low, b]


def _block(
    left: FloatArray, right: FloatArray, first: int, last: int, low: int, high: int, symmetric: bool, part: FloatArray
) -> None:
    """Add the products of a block of rows for some columns of the left."""
    fours = first + (last - first) // 4 * 4
    for i in range(first, fours, 4):
        for a in range(low, high):
            one, two, three, four = left[i, a], left[i + 1, a], left[i + 2, a], left[i + 3, a]
            for b in range(a + 1 if symmetric else right.shape[1]):
                pair = one * right[i, b] + two * right[i + 1, b]
                part[a - low, b] += pair + (three * right[i + 2, b] + four * right[i + 3, b])
    for i in range(fours, last):
        for a in range(low, high):
            one = left[i, a]
            for b in range(a + 1 if symmetric else right.shape[1]):
                part[a - low, b] += one * right[i, b]
