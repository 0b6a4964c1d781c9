"""How alike two small effects are in a log that nobody has measured."""

from __future__ import annotations

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.estimate.symmetric import scaled_eigen

#: Directions of the other responses with less than this share of the largest eigenvalue take nothing.
_SINGULAR = 1e-9
#: A response of which the others leave less than this share is one of theirs.
_LEAST = 1e-6


def likeness(rows: FloatArray) -> float:
    """Correlation of the last two of some responses (n, k) once the others have taken their share.

    If one of both acts with a small coefficient c, the expected log-likelihood ratio over the other is c^2/2 times what
    is left of its squared response, times one minus this correlation squared: T-optimality to second order. It is 1
    where nothing is left of one, and where a response runs away: a machine that is not held back tells nothing of small
    changes.

    Examples
    --------
    >>> round(likeness(np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])) ** 2, 12)
    0.5
    """
    size = np.abs(rows).max(axis=0, initial=0.0)
    if not np.isfinite(size).all():
        return 1.0
    rows = rows / np.where(size > 0.0, size, 1.0)
    information = rows.T @ rows
    inner, outer = slice(0, -2), slice(-2, None)
    others = scaled_eigen(information[inner, inner])
    scale = others.scale[:, np.newaxis]
    share = scale * (others.inverse(others.values > _SINGULAR * others.largest) @ (scale * information[inner, outer]))
    left = information[outer, outer] - information[outer, inner] @ share
    both = float(np.sqrt(max(left[0, 0], 0.0) * max(left[1, 1], 0.0)))
    kept = min(left[k, k] / max(information[k - 2, k - 2], 1e-300) for k in (0, 1))
    return float(left[0, 1]) / both if kept > _LEAST else 1.0
