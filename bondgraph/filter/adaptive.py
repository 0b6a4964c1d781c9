"""Sensor noise that is not known, or changes, followed on line with the state.

The variance of each sensor has an inverse gamma distribution of shape alpha and scale beta, whose weight fades with
time; each measured value adds half to its shape and, to its scale, half of what the state leaves of it: its squared
residual and the variance with which the state is known. Both are found together by a fixed-point iteration.

Reference: Sarkka and Nummenmaa (2009), Recursive noise adaptive Kalman filtering by variational Bayesian
approximations, IEEE Trans. Automatic Control 54(3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.errors import FilterError

#: Rounds of the fixed point; in the reference a few suffice. Ended where no variance moves by the share.
_ROUNDS, _SETTLED = 20, 1e-6


class NoiseBelief(NamedTuple):
    """Shapes and scales of the sensors' variances, (n_y,) each."""

    shape: FloatArray
    scale: FloatArray

    @property
    def variance(self) -> FloatArray:
        """Variance of each sensor, (n_y,): one over the mean of its precision."""
        found: FloatArray = self.scale / self.shape
        return found


@dataclass(frozen=True)
class AdaptiveNoise:
    """Noise levels of sensors that are followed on line.

    Parameters
    ----------
    memory
        Time after which a measured value counts 1/e, s. With n samples in it a level scatters by about 1/sqrt(2 n).

    Raises
    ------
    FilterError
        If it is not positive.

    Examples
    --------
    >>> adaptive = AdaptiveNoise(memory=2.0)
    >>> start = adaptive.start(np.array([0.5]), interval=0.1)
    >>> start.shape.round(2), start.variance
    (array([10.25]), array([0.25]))
    """

    memory: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.memory) and self.memory > 0.0):
            raise FilterError(f"adaptive: memory is {self.memory!r} s - give a positive time", where=("memory",))

    def start(self, noise_std: FloatArray, interval: float) -> NoiseBelief:
        """Declared standard deviations (n_y,), believed as after a long time of samples ``interval`` s apart."""
        shape = np.full(noise_std.size, 0.5 / -math.expm1(-interval / self.memory))
        return NoiseBelief(shape, shape * np.nan_to_num(noise_std) ** 2)

    def faded(self, belief: NoiseBelief, seconds: float) -> NoiseBelief:
        """The belief after some seconds."""
        share = math.exp(-seconds / self.memory)
        return NoiseBelief(belief.shape * share, belief.scale * share)


def updated(belief: NoiseBelief, y: FloatArray, output_mean: FloatArray, output_cov: FloatArray) -> NoiseBelief:
    """The belief given a sample, and what was expected of it.

    Parameters
    ----------
    belief
        Before, faded.
    y
        Measured values (n_y,), NaN where missing: their sensors keep theirs.
    output_mean, output_cov
        Expected outputs (n_y,) and their covariance (n_y, n_y) without the noise of the sensors.

    Examples
    --------
    >>> known = NoiseBelief(np.array([50.0]), np.array([50.0]))
    >>> after = updated(known, np.array([10.0]), np.zeros(1), np.zeros((1, 1)))
    >>> after.variance.round(3)  # (50 + 10^2/2) over (50 + 1/2)
    array([1.98])
    """
    there = np.flatnonzero(~np.isnan(y))
    if not there.size:
        return belief
    shape, scale = belief.shape.copy(), belief.scale.copy()
    shape[there] += 0.5
    error, expected = (y - output_mean)[there], output_cov[np.ix_(there, there)]
    for _ in range(_ROUNDS):
        noise = np.diag(scale[there] / shape[there])
        # of the error the noise keeps R S^-1, and the state is then known to H - H S^-1 H = R S^-1 H
        kept = np.linalg.solve(expected + noise, noise).T
        left = kept @ error
        after = belief.scale[there] + 0.5 * (left**2 + np.diag(kept @ expected))
        moved = np.max(np.abs(after / scale[there] - 1.0))
        scale[there] = after
        if moved < _SETTLED:
            break
    return NoiseBelief(shape, scale)
