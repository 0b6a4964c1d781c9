"""Tangents of trajectories for all lanes, in the part of Python that numba compiles. Rows as in ``step_kernel``.

``dw`` (directions, 3 n_x lanes) holds for each direction its vectors at the state and at the stage and the sum over
stages. ``seeds`` (directions, parameters) says how each direction moves the parameters.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bondgraph.arrays import FloatArray

if TYPE_CHECKING:
    from bondgraph.compile.lanes.kernel_names import (
        DIN,
        DOUT,
        LANES,
        N_X,
        ROWS,
        SLOPE,
        STAGE,
        TOTAL,
        X,
        push,
        slopes,
    )


def advance_tangents(
    start: float,
    length: float,
    substeps: int,
    grading: float,
    tableau: FloatArray,
    u_left: FloatArray,
    u_right: FloatArray,
    clock: FloatArray,
    inputs: FloatArray,
    seeds: FloatArray,
    dw: FloatArray,
    w: FloatArray,
    n: int,
) -> None:
    """Advance states and their directions by ``substeps`` equal steps of the classical Runge-Kutta method."""
    step = length / substeps
    size = w.size // ROWS * N_X
    for k in range(substeps):
        for q in range(size):
            w[STAGE * LANES + q] = w[X * LANES + q]
            w[TOTAL * LANES + q] = 0.0
        for d in range(seeds.shape[0]):
            _begin(dw[d], size)
        for s in range(4):
            inner = s == 1 or s == 2
            now = k * step + (0.5 if inner else float(s // 2)) * step
            clock[0] = start + now
            for i in range(u_left.size):
                inputs[i] = u_left[i] + now / length * (u_right[i] - u_left[i])
            slopes(clock, inputs, w, n)
            weight = (2.0 if inner else 1.0) * step / 6.0
            reach = (1.0 if s == 2 else 0.5) * step
            for q in range(size):
                slope = w[SLOPE * LANES + q]
                w[TOTAL * LANES + q] += weight * slope
                w[STAGE * LANES + q] = w[X * LANES + q] + reach * slope
            for d in range(seeds.shape[0]):
                _push_direction(seeds[d], dw[d], weight, reach, size, w, n)
        for q in range(size):
            w[X * LANES + q] += w[TOTAL * LANES + q]
        for d in range(seeds.shape[0]):
            _finish(dw[d], size)


def _begin(row: FloatArray, size: int) -> None:
    for q in range(size):
        row[size + q] = row[q]
        row[2 * size + q] = 0.0


def _finish(row: FloatArray, size: int) -> None:
    for q in range(size):
        row[q] += row[2 * size + q]


def _push_direction(
    seed: FloatArray, row: FloatArray, weight: float, reach: float, size: int, w: FloatArray, n: int
) -> None:
    """One stage of one direction."""
    for q in range(size):
        w[DIN * LANES + q] = row[size + q]
    push(seed, w, n)
    for q in range(size):
        slope = w[DOUT * LANES + q]
        row[2 * size + q] += weight * slope
        row[size + q] = row[q] + reach * slope
