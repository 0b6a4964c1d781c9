"""How whitened innovations respond to noise levels, in the linearised filter: its covariances are carried along.

A level enters the covariances only. Their derivatives follow the Riccati recursion in Joseph's form, those of gain and
whitening matrix follow from them, and the state is moved by the changed gain:

    dP- = F dP F' + dQ,   dS = H dP- H' + dR,   dP = (I - K H) dP- (I - K H)' + K dR K',
    dK  = ((I - K H) dP- H' - K dR) S^-1,       dL = L half(L^-1 dS L^-T),

with half() the lower triangle and half of the diagonal. Reference: Gupta and Mehra (1974), IEEE Trans. Automatic
Control 19(6); Sarkka (2013), Bayesian Filtering and Smoothing, appendix A.3, for the derivative of a Cholesky factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bondgraph.correct.response import LinearLog
from bondgraph.data.log import FloatArray
from bondgraph.filter.filter_run import FilterRun


@dataclass(frozen=True)
class LevelChanges:
    """Derivatives of covariances by some levels, each (levels,) first.

    ``process`` (levels, n_x) of the variances per second that drive the states, ``measurement`` (levels, n_y) of the
    variances of the sensors.
    """

    process: FloatArray
    measurement: FloatArray


def respond_to_levels(linear: LinearLog, run: FilterRun, changes: LevelChanges) -> tuple[FloatArray, FloatArray]:
    """Derivatives of whitened innovations and of log scales by levels, both (n_y * n, levels), rows by output."""
    count, outputs, size = linear.slope.shape
    levels = changes.process.shape[0]
    intervals = linear.path.intervals
    innovation = np.nan_to_num(run.innovation).T
    unit = np.eye(size)
    seen = np.isfinite(run.y).T
    driven = changes.process[:, :, np.newaxis] * unit
    noise = changes.measurement[:, :, np.newaxis] * np.eye(outputs)
    keep = np.tril(np.ones((outputs, outputs)), -1) + 0.5 * np.eye(outputs)
    moved, spread = np.zeros((levels, size, 1)), np.zeros((levels, size, size))
    slopes_z, slopes_s = np.zeros((count, outputs, levels)), np.zeros((count, outputs, levels))
    for k in range(count):
        if k:
            transition = linear.transition[k - 1]
            moved = transition @ moved
            spread = transition @ spread @ transition.T + intervals[k - 1] * driven
        shown, whitener, gain = linear.slope[k] * seen[k][:, np.newaxis], linear.whitener[k], linear.gain[k]
        own = noise * seen[k]
        change = whitener @ (shown @ spread @ shown.T + own) @ whitener.T
        expected = -(shown @ moved)
        slopes_z[k] = ((whitener @ expected)[..., 0] - (change * keep) @ run.whitened[:, k]).T
        slopes_s[k] = 0.5 * np.einsum("lii->il", change)
        left = unit - gain @ shown
        turned = (left @ spread @ shown.T - gain @ own) @ (whitener.T @ (whitener @ innovation[k]))
        moved = moved + gain @ expected + turned[..., np.newaxis]
        spread = left @ spread @ left.T + gain @ own @ gain.T
    rows = (np.moveaxis(found, 1, 0).reshape(-1, levels) for found in (slopes_z, slopes_s))
    first, second = rows
    return np.ascontiguousarray(first), np.ascontiguousarray(second)
