"""The two verbs of a filter on one belief: predict and update, for any transition and measurement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter.sigma_points import MerweScaled, lower_factor
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
    belief: Belief, y: FloatArray, measurement: PointFunction, measurement_noise_cov: FloatArray, points: MerweScaled
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
    factor = lower_factor(joint, required=measured.size)
    m = measured.size
    s_lower, a, p_lower = factor.lower[:m, :m], factor.lower[m:, :m], factor.lower[m:, m:]
    whitened, log_scales = np.zeros(y.size), np.zeros(y.size)
    gain = np.full(a.shape, np.nan)
    if factor.outcome is Outcome.OK:
        whitened[measured] = np.linalg.solve(s_lower, innovation[measured])
        log_scales[measured] = np.log(np.diag(s_lower))
        gain = np.linalg.solve(s_lower.T, a.T).T
    mean = belief.mean + a @ whitened[measured]
    after = belief if m == 0 else Belief(mean, p_lower @ p_lower.T, p_lower)
    return Update(
        after, output_mean, output_cov, innovation, whitened, log_scales, gain, factor.floored, factor.outcome
    )
