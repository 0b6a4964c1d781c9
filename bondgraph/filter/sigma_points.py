"""Scaled sigma points (van der Merwe 2004) in deviation form.

With c = alpha^2 (n + kappa) the points are the mean and the mean plus and minus sqrt(c) times each column of a lower
Cholesky factor. Of the propagated points F_0 ... F_2n only the deviations E_i = F_i - F_0 are summed:

    W = 1/(2 c)      d = W sum E_i      mean = F_0 + d      covariance = W sum E_i E_i' + (beta - alpha^2) d d'

This is the same as the usual sum with the weights of the mean and covariance, and no large weights cancel: for
beta >= alpha^2 the covariance cannot lose positive semi-definiteness, and a small alpha costs nothing.

References
----------
van der Merwe (2004), Sigma-point Kalman filters for probabilistic inference in dynamic state-space models, PhD thesis;
Julier and Uhlmann (2004), Unscented filtering and nonlinear estimation, Proc. IEEE 92(3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.errors import FilterError
from bondgraph.simulate.outcome import Outcome

#: A pivot below this share of the variance it started from is rounding error, and its column is set to zero.
PIVOT_FLOOR = 1e-14


class Moments(NamedTuple):
    """Mean (n,), covariance (n, n) and deviations from the central point (n, 2 n_points + 1) of propagated points."""

    mean: FloatArray
    cov: FloatArray
    deviations: FloatArray


class Factor(NamedTuple):
    """Lower Cholesky factor, the pivots that were floored on the way, and whether it exists."""

    lower: FloatArray
    floored: int
    outcome: Outcome


@dataclass(frozen=True)
class MerweScaled:
    """Merwe's scaled sigma points for ``n`` states.

    Parameters
    ----------
    n
        Number of states.
    alpha
        Spread of the points; they lie alpha sqrt(n + kappa) standard deviations from the mean.
    beta
        Knowledge of the distribution; 2 is best for a Gaussian.
    kappa
        Second spread parameter, larger than -n.

    Raises
    ------
    FilterError
        If there are no states, alpha is not positive, or n + kappa is not.

    Examples
    --------
    >>> points = MerweScaled(2, alpha=1.0)
    >>> round(float(points.mean_weights.sum()), 12)
    1.0
    >>> drawn = points.draw(np.array([1.0, 2.0]), np.eye(2))
    >>> points.moments(drawn).cov.round(12).tolist()
    [[1.0, 0.0], [0.0, 1.0]]
    """

    n: int
    alpha: float = 0.1
    beta: float = 2.0
    kappa: float = 0.0

    def __post_init__(self) -> None:
        if self.n < 1 or not self.alpha > 0 or not self.n + self.kappa > 0 or not math.isfinite(self.beta):
            raise FilterError(
                f"sigma points: alpha={self.alpha!r}, beta={self.beta!r}, kappa={self.kappa!r} for {self.n} states"
                " - alpha must be positive and kappa above minus the number of states"
            )

    @property
    def spread(self) -> float:
        """Distance of the points from the mean in standard deviations, sqrt(c)."""
        return self.alpha * math.sqrt(self.n + self.kappa)

    @property
    def weight(self) -> float:
        """Weight of every point but the central one."""
        return 0.5 / self.spread**2

    @property
    def correction(self) -> float:
        """Weight of the squared shift of the mean in the covariance."""
        return self.beta - self.alpha**2

    @property
    def mean_weights(self) -> FloatArray:
        """Weights of the mean in the usual form, shape (2 n + 1,)."""
        weights = np.full(2 * self.n + 1, self.weight)
        weights[0] = 1.0 - self.n / self.spread**2
        return weights

    @property
    def cov_weights(self) -> FloatArray:
        """Weights of the covariance in the usual form, shape (2 n + 1,)."""
        weights = self.mean_weights
        weights[0] += 1.0 - self.alpha**2 + self.beta
        return weights

    def draw(self, mean: FloatArray, lower: FloatArray) -> FloatArray:
        """Points of a mean (n,) and a lower Cholesky factor (n, n), shape (n, 2 n + 1), the central one first."""
        centre = mean[:, np.newaxis]
        return np.hstack([centre, centre + self.spread * lower, centre - self.spread * lower])

    def moments(self, points: FloatArray) -> Moments:
        """Mean and covariance of propagated points (rows, 2 n + 1)."""
        deviations = points - points[:, :1]
        shift = self.weight * deviations.sum(axis=1)
        cov = self.weight * (deviations @ deviations.T) + self.correction * np.outer(shift, shift)
        return Moments(points[:, 0] + shift, cov, deviations)

    def cross_cov(self, lower: FloatArray, deviations: FloatArray) -> FloatArray:
        """Covariance (n, rows) between the states from which the points were drawn and the propagated points."""
        n = self.n
        half_difference = (deviations[:, 1 : n + 1] - deviations[:, n + 1 :]) / (2.0 * self.spread)
        return lower @ half_difference.T


def lower_factor(matrix: FloatArray, required: int = 0) -> Factor:
    """Lower Cholesky factor of a positive semi-definite matrix, shape (n, n).

    Parameters
    ----------
    matrix
        Symmetric; only the lower triangle is read.
    required
        The first rows whose pivots must be positive. Of the others a pivot that is zero but for rounding is floored:
        its column becomes zero, which takes the direction out of the sigma points. Flooring a variance that was not
        zero from the start is counted.

    Examples
    --------
    >>> lower_factor(np.array([[4.0, 2.0], [2.0, 1.0]]))
    Factor(lower=array([[2., 0.], [1., 0.]]), floored=1, outcome=<Outcome.OK: 'finished'>)
    """
    n = matrix.shape[0]
    lower = np.tril(matrix)
    floored = 0
    for j in range(n):
        variance = matrix[j, j]
        pivot = variance - lower[j, :j] @ lower[j, :j]
        if not np.isfinite(pivot):
            return Factor(lower, floored, Outcome.DIVERGED)
        if pivot > PIVOT_FLOOR * variance:
            lower[j, j] = math.sqrt(pivot)
            lower[j + 1 :, j] = (lower[j + 1 :, j] - lower[j + 1 :, :j] @ lower[j, :j]) / lower[j, j]
        elif j < required:
            return Factor(lower, floored, Outcome.NOT_POSITIVE)
        else:
            lower[j:, j] = 0.0
            floored += int(variance > 0)
    return Factor(lower, floored, Outcome.OK)


def lower_factors(matrices: FloatArray) -> FloatArray:
    """Lower Cholesky factors of a stack (m, n, n) of positive semi-definite matrices, with pivots floored.

    NaN from the column on at which a matrix is not finite.

    Examples
    --------
    >>> lower_factors(np.array([[[4.0, 2.0], [2.0, 1.0]], [[1.0, 0.0], [0.0, 9.0]]])).tolist()
    [[[2.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [0.0, 3.0]]]
    """
    lower = np.tril(matrices)
    for j in range(matrices.shape[1]):
        variance = lower[:, j, j].copy()
        pivot = variance - np.einsum("mk,mk->m", lower[:, j, :j], lower[:, j, :j])
        floored = pivot <= PIVOT_FLOOR * variance
        column = lower[:, j:, j] - np.einsum("mik,mk->mi", lower[:, j:, :j], lower[:, j, :j])
        root = np.sqrt(np.where(floored, 1.0, pivot))
        lower[:, j:, j] = np.where(floored[:, np.newaxis], 0.0, column / root[:, np.newaxis])
    return lower
