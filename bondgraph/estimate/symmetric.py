"""Symmetric matrices of information in scaled coordinates, whatever they hold: no row ends a computation.

Information is scaled to a unit diagonal before its eigenvalues are taken, so that units do not matter. A coordinate of
which the data say nothing has a diagonal of zero, or of rounding; one whose derivatives overflowed has rows that are
not finite. Both carry no information, and are left out instead of spoiling the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bondgraph.estimate.objective import BoolArray, FloatArray

_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Eigen:
    """Eigenvalues (m,) and eigenvectors (n, m) of a matrix scaled by ``scale`` (n,) on both sides.

    ``scale`` is zero where a coordinate carries no information; its rows in ``vectors`` are zero too.
    """

    scale: FloatArray
    values: FloatArray
    vectors: FloatArray

    @property
    def largest(self) -> float:
        """The largest eigenvalue; zero where there is none."""
        return float(self.values.max(initial=0.0))

    def inverse(self, kept: BoolArray) -> FloatArray:
        """Inverse (n, n) of the scaled matrix on some of its eigenvectors."""
        found: FloatArray = (self.vectors[:, kept] / self.values[kept]) @ self.vectors[:, kept].T
        return found


def informed(matrix: FloatArray) -> BoolArray:
    """Coordinates (n,) of a symmetric matrix with a positive diagonal and finite entries among each other.

    Examples
    --------
    >>> informed(np.array([[2.0, 0.0, np.nan], [0.0, 1e-320, 0.0], [np.nan, 0.0, np.inf]])).tolist()
    [True, False, False]
    """
    own, finite = np.diag(matrix), np.isfinite(matrix)
    found: BoolArray = np.isfinite(own) & (own >= _TINY)
    while (spoilt := np.where(found, (~finite[:, found]).sum(axis=1), 0)).any():
        found[int(np.argmax(spoilt))] = False  # the one that spoils most of the others
    return found


def scaled_eigen(matrix: FloatArray) -> Eigen:
    """Eigenvalues of a symmetric matrix (n, n) with its diagonal scaled to one.

    Examples
    --------
    >>> scaled_eigen(np.array([[4.0, 0.0], [0.0, 0.0]])).scale.tolist()
    [0.5, 0.0]
    >>> scaled_eigen(np.diag([1.0, np.nan])).values.tolist()
    [1.0]
    """
    rows = np.flatnonzero(informed(matrix))
    scale = np.zeros(matrix.shape[0])
    scale[rows] = 1.0 / np.sqrt(np.diag(matrix)[rows])
    vectors = np.zeros((matrix.shape[0], rows.size))
    if not rows.size:
        return Eigen(scale, np.empty(0), vectors)
    own = scale[rows]
    # beyond one is rounding: of entries next to nothing it may be any number
    alike = np.clip(own[:, np.newaxis] * matrix[np.ix_(rows, rows)] * own, -1.0, 1.0)
    values, vectors[rows] = np.linalg.eigh(alike)
    return Eigen(scale, values, vectors)
