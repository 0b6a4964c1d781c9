"""Points that fill a box evenly, with which searches begin."""

from __future__ import annotations

import numpy as np

from bondgraph.arrays import FloatArray


def latin_hypercube(size: int, members: int, rng: np.random.Generator) -> FloatArray:
    """Points (size, members) of the unit box, one in each of as many slices of every side.

    Reference: McKay, Beckman and Conover (1979), A comparison of three methods for selecting values of input variables,
    Technometrics 21(2).

    Examples
    --------
    >>> points = latin_hypercube(2, 4, np.random.default_rng(0))
    >>> np.sort(np.floor(4.0 * points), axis=1).tolist()
    [[0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0, 3.0]]
    """
    from scipy.stats import qmc  # a third of the time in which the estimation loads, for searches that draw

    points: FloatArray = qmc.LatinHypercube(size, rng=rng).random(members).T
    return points
