"""The exponential of matrices and its integrals, for shifts of the rates along intervals."""

from __future__ import annotations

import math

import numpy as np

from bondgraph.arrays import FloatArray

#: Terms of the Taylor series of the phi functions, after scaling to a norm below one half.
_TERMS = 9


def phi(a: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The exponential, phi1 and phi2 of matrices (n, m, m): Taylor series of a halved argument, then doubled back."""
    largest = float(np.abs(a).sum(axis=2).max(initial=0.0))
    halvings = max(0, math.ceil(math.log2(max(largest, 1e-300) / 0.5)))
    scaled = a / 2.0**halvings
    unit = np.broadcast_to(np.eye(a.shape[1]), a.shape)
    second = unit / math.factorial(_TERMS + 2)
    for k in range(_TERMS + 1, 1, -1):
        second = unit / math.factorial(k) + scaled @ second
    first = unit + scaled @ second
    whole = unit + scaled @ first
    for _ in range(halvings):
        second = 0.25 * (whole @ second + second + first)
        first = 0.5 * (whole @ first + first)
        whole = whole @ whole
    return whole, first, second
