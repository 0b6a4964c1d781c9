"""Look-up in tables in the part of Python that numba compiles."""

from __future__ import annotations

from bondgraph.arrays import FloatArray


def search_right(knots: FloatArray, value: float) -> int:
    """How many increasing ``knots`` are not above ``value``: ``np.searchsorted(knots, value, side="right")``.

    numba's own form of it serves any type, and takes ten times as long to compile.

    Examples
    --------
    >>> import numpy as np
    >>> [search_right(np.array([0.0, 1.0, 2.0]), value) for value in (-1.0, 0.0, 1.5, 2.0, np.nan)]
    [0, 1, 2, 3, 3]
    """
    low = 0
    high = knots.size
    while low < high:
        middle = (low + high) // 2
        if value < knots[middle]:
            high = middle
        else:
            low = middle + 1
    return low
