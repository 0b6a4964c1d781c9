"""The two verbs of a filter on one belief: predict and update, for any transition and measurement."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter.kernel_robust import _precision, _residual
from bondgraph.filter.kernel_types import Robustness
from bondgraph.filter.robust import PLAIN
from bondgraph.filter.sigma_points import PIVOT_FLOOR, Factor, MerweScaled, lower_factor
from bondgraph.simulate.outcome import Outcome

#: Propagates points (n, 2 n + 1) to points (rows, 2 n + 1).
PointFunction = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Belief:
    """A Gaussian: mean (n,), covariance (n, n) and its lower Cholesky factor."""

    mean: FloatArray
    cov: FloatArray
    lower: FloatArray

    @classmethod
    def of(cls, mean: FloatArray, cov: FloatArray) -> Belief:
        """A belief of a mean and a covariance.

        Examples
        --------
        >>> Belief.of(np.zeros(1), np.array([[4.0]])).lower
        array([[2.]])
        """
        return cls(mean, cov, lower_factor(cov).lower)


@dataclass(frozen=True)
class Prediction:
    """Result of a prediction.

    ``cross_cov`` (n, n) is the covariance between the state before and after, which a smoother needs.
    """

    belief: Belief
    cross_cov: FloatArray
    floored: int
    outcome: Outcome


@dataclass(frozen=True)
class Update:
    """Result of an update with a measurement.

    ``output_mean`` (n_y,) and ``output_cov`` (n_y, n_y) are what was expected of all channels, noise included;
    ``innovation`` (n_y,) is NaN where nothing was measured. ``whitened`` (n_y,) are the innovations made independent
    with unit variance, each given those before it, and ``log_scales`` (n_y,) the logarithms of the standard deviations
    by which that was done; both are zero where nothing was measured. ``gain`` is (n, measured channels).
    """

    belief: Belief
    output_mean: FloatArray
    output_cov: FloatArray
    innovation: FloatArray
    whitened: FloatArray
    log_scales: FloatArray
    gain: FloatArray
    floored: int
    outcome: Outcome

    @property
    def log_likelihood(self) -> float:
        """Logarithm of the density of the measurement."""
        measured = np.count_nonzero(~np.isnan(self.innovation))
        return float(
            -0.5 * self.whitened @ self.whitened - self.log_scales.sum() - 0.5 * measured * np.log(2.0 * np.pi)
        )

    @property
    def nis(self) -> float:
        """Normalised innovation squared."""
        return float(self.whitened @ self.whitened)


def predict(
    belief: Belief, transition: PointFunction, process_noise_cov: FloatArray, points: MerweScaled
) -> Prediction:
    """The belief after a transition, to which the process noise is added.

    Parameters
    ----------
    belief
        Before.
    transition
        Moves points (n, 2 n + 1) over the time step.
    process_noise_cov
        Covariance gathered over the step, (n, n).
    points
        Sigma points.

    Examples
    --------
    >>> start = Belief.of(np.array([1.0]), np.array([[1.0]]))
    >>> predict(start, lambda x: 0.5 * x, np.array([[0.75]]), MerweScaled(1)).belief.cov.round(12)
    array([[1.]])
    """
    moved = transition(points.draw(belief.mean, belief.lower))
    mean, cov, deviations = points.moments(moved)
    cov = cov + process_noise_cov
    factor = lower_factor(cov)
    outcome = factor.outcome if np.isfinite(moved).all() else Outcome.DIVERGED
    cross_cov = points.cross_cov(belief.lower, deviations)
    return Prediction(Belief(mean, cov, factor.lower), cross_cov, factor.floored, outcome)


def update(
    belief: Belief,
    y: FloatArray,
    measurement: PointFunction,
    measurement_noise_cov: FloatArray,
    points: MerweScaled,
    robust: Robustness = PLAIN,
) -> Update:
    """The belief after a measurement; the sigma points are drawn anew from the belief, process noise included.

    One Cholesky factorisation of the joint covariance of measured channels and state,

        [ S    P_yx ]   [ L_s    0 ] [ L_s'  A' ]
        [ P_xy  P   ] = [  A   L_p ] [  0   L_p'],

    gives the factor of the innovation covariance, the gain A L_s^-1 and the factor of the new covariance.

    Parameters
    ----------
    belief
        Before, at the time of the measurement.
    y
        Measurement (n_y,), NaN in missing channels.
    measurement
        Gives the outputs (n_y, 2 n + 1) of points.
    measurement_noise_cov
        Covariance of the noise (n_y, n_y).
    points
        Sigma points.
    robust
        Loss of innovations; of one that is not Gaussian, ``whitened`` are the residuals whose half squares are the
        losses, see :mod:`bondgraph.filter.robust`.

    Examples
    --------
    >>> start = Belief.of(np.array([0.0]), np.array([[1.0]]))
    >>> after = update(start, np.array([1.0]), lambda x: x, np.array([[1.0]]), MerweScaled(1))
    >>> after.belief.mean.round(9), after.belief.cov.round(9)
    (array([0.5]), array([[0.5]]))
    """
    output_mean, output_cov, deviations = points.moments(measurement(points.draw(belief.mean, belief.lower)))
    output_cov = output_cov + measurement_noise_cov
    cross_cov = points.cross_cov(belief.lower, deviations)
    innovation = y - output_mean
    measured = np.flatnonzero(~np.isnan(y))
    used = cross_cov[:, measured]
    joint = np.block([[output_cov[np.ix_(measured, measured)], used.T], [used, belief.cov]])
    m = measured.size
    whitened, log_scales = np.zeros(y.size), np.zeros(y.size)
    if robust.kind:
        noise = np.diag(measurement_noise_cov)[measured]
        factor, known, residuals, scales = _robust_factor(joint, innovation[measured], noise, robust)
    else:
        factor = lower_factor(joint, required=m)
        known, residuals, scales = np.zeros((3, m))
        if factor.outcome is Outcome.OK:
            known[...] = residuals[...] = np.linalg.solve(factor.lower[:m, :m], innovation[measured])
            scales = np.log(np.diag(factor.lower)[:m])
    s_lower, a, p_lower = factor.lower[:m, :m], factor.lower[m:, :m], factor.lower[m:, m:]
    gain = np.full(a.shape, np.nan)
    if factor.outcome is Outcome.OK:
        whitened[measured], log_scales[measured] = residuals, scales
        gain[...] = np.linalg.lstsq(s_lower.T, a.T)[0].T if robust.kind else np.linalg.solve(s_lower.T, a.T).T
    mean = belief.mean + a @ known
    after = belief if m == 0 else Belief(mean, p_lower @ p_lower.T, p_lower)
    return Update(
        after, output_mean, output_cov, innovation, whitened, log_scales, gain, factor.floored, factor.outcome
    )


def _robust_factor(
    joint: FloatArray, innovation: FloatArray, noise: FloatArray, robust: Robustness
) -> tuple[Factor, FloatArray, FloatArray, FloatArray]:
    """Factor of the joint covariance, each channel's noise as its innovation asks; what each innovation says.

    Channel by channel, as :func:`bondgraph.filter.kernel_robust._factor_robust`: innovations over the standard
    deviations with which they count, residuals whose half squares are the losses, and log scales. A channel that does
    not count at all has a column of zeros.
    """
    rest, lower = joint.copy(), np.zeros(joint.shape)
    m = innovation.size
    known, residuals, scales = np.zeros(m), np.zeros(m), np.zeros(m)
    for j in range(m):
        if not np.isfinite(rest[j, j]) or rest[j, j] <= PIVOT_FLOOR * joint[j, j]:
            outcome = Outcome.NOT_POSITIVE if np.isfinite(rest[j, j]) else Outcome.DIVERGED
            return Factor(lower, 0, outcome), known, residuals, scales
        std = math.sqrt(rest[j, j])
        value = innovation[j] - lower[j, :j] @ known[:j]
        residuals[j], scales[j] = _residual(robust, value / std), math.log(std) + robust.constant
        precision = _precision(robust, value / std)
        variance = (precision * (rest[j, j] - noise[j]) + noise[j]) / precision if precision > 0.0 else math.inf
        known[j] = value / math.sqrt(variance)
        lower[j, j] = math.sqrt(variance) if precision > 0.0 else 0.0
        lower[j + 1 :, j] = rest[j + 1 :, j] / math.sqrt(variance)
        rest[j + 1 :, j + 1 :] -= np.outer(lower[j + 1 :, j], lower[j + 1 :, j])
    factor = lower_factor(rest[m:, m:])
    lower[m:, m:] = factor.lower
    return Factor(lower, factor.floored, factor.outcome), known, residuals, scales
