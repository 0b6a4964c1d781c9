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

from bondgraph.arrays import IntArray
from bondgraph.compile.machine_code import load_translated
from bondgraph.data.log import FloatArray
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.linear import level_kernel
from bondgraph.filter.linear.response import LinearLog


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
    count, outputs, _ = linear.slope.shape
    levels = changes.process.shape[0]
    seen = np.isfinite(run.y).T.astype(np.float64)
    drivers = np.flatnonzero(changes.process.any(axis=0))
    arrays = (
        linear.transition, _gathered(run, drivers), linear.slope * seen[:, :, np.newaxis], seen, linear.gain,
        linear.whitener, np.nan_to_num(run.innovation).T, np.nan_to_num(run.whitened).T,
    )  # fmt: skip
    filtered = level_kernel.Filter(*map(np.ascontiguousarray, arrays))
    slopes_z, slopes_s = np.zeros((count, outputs, levels)), np.zeros((count, outputs, levels))
    process, noise = np.ascontiguousarray(changes.process.T[drivers]), np.ascontiguousarray(changes.measurement.T)
    carry(filtered, process, noise, slopes_z, slopes_s)
    rows = (np.moveaxis(found, 1, 0).reshape(-1, levels) for found in (slopes_z, slopes_s))
    first, second = rows
    return np.ascontiguousarray(first), np.ascontiguousarray(second)


def carry(
    filtered: level_kernel.Filter,
    process: FloatArray,
    noise: FloatArray,
    slopes_z: FloatArray,
    slopes_s: FloatArray,
) -> None:
    """Fill in derivatives by levels as :func:`bondgraph.filter.linear.level_kernel.carried` says."""
    size, outputs, levels = filtered.slope.shape[2], noise.shape[0], process.shape[1]
    shapes = (
        (size, 1), (size, 1), (size, size), (size, size), (outputs, size), (size, outputs), (outputs, outputs),
        (outputs, outputs), (outputs, 1),
    )  # fmt: skip
    by_level = (np.zeros((*shape, levels)) for shape in shapes)
    scratch = level_kernel.Scratch(np.zeros(outputs), *by_level)
    load_translated("carried", level_kernel)(filtered, process, noise, slopes_z, slopes_s, scratch)


def _gathered(run: FilterRun, drivers: IntArray) -> FloatArray:
    """Covariance (n - 1, drivers, n_x, n_x) that noise of intensity one in each driven state leaves over intervals."""
    assert run.nodes is not None
    size = len(run.filter_model.model.states)
    rows = [run.nodes.noise_gathered(int(state))[:, :size, :size] for state in drivers]
    empty = np.zeros((0, run.time.size - 1, size, size))
    return np.ascontiguousarray(np.nan_to_num(np.swapaxes(np.array(rows) if rows else empty, 0, 1)))
