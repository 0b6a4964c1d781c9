"""Rates of signals that are known at points and run linearly between them."""

from __future__ import annotations

import numpy as np

from bondgraph.data.log import FloatArray


def slopes(time: FloatArray, values: FloatArray) -> FloatArray:
    """Slope of a table from each point to the next, shape (n,); the last is repeated, a jump (time twice) has none.

    Examples
    --------
    >>> slopes(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 0.0])).tolist()
    [2.0, -1.0, -1.0]
    """
    lengths = np.diff(time)
    rises = np.divide(np.diff(values), lengths, out=np.zeros(lengths.shape), where=lengths > 0)
    return np.append(rises, rises[-1:] if rises.size else 0.0)
