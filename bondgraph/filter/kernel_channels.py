"""Which channels are measured at a sample; compiled from its text."""

from __future__ import annotations

import math

from bondgraph.arrays import FloatArray, IntArray


def _find_measured(y: FloatArray, k: int, channels: IntArray) -> int:
    """Number of channels measured at sample ``k``; their positions go into ``channels``."""
    measured = 0
    for a in range(channels.size):
        if not math.isnan(y[k, a]):
            channels[measured] = a
            measured += 1
    return measured
