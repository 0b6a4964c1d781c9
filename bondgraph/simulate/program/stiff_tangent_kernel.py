"""Tangents of Rosenbrock steps for all lanes, in the part of Python that numba compiles. Rows as in ``lane_kernel``.

``dw`` holds for each direction its vectors, each of all lanes: at the state (0), of the trend (1), of the slopes (2),
and of the stages (3 ...). A stage U solves W U = R with W = 1/(gamma h) I - J, so its tangent solves W dU = dR + dJ U.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bondgraph.simulate.arrays import FloatArray

if TYPE_CHECKING:
    from bondgraph.simulate.program.lane_names import (
        DIN,
        DOUT,
        LANES,
        N_X,
        ROWS,
        SLOPE,
        STAGE,
        STAGES,
        TOTAL,
        TREND,
        X,
        bend,
        curve,
        factor,
        push,
        slopes,
        substitute,
        sway,
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
    """Advance states and their directions by steps that are each ``grading`` times as long as the one before."""
    size = w.size // ROWS * N_X
    passed = 0.0
    step = length / substeps
    if grading != 1.0:
        step = length * (grading - 1.0) / (grading**substeps - 1.0)
    for _ in range(substeps):
        clock[1] = 1.0 / (tableau[1] * step)
        _set_time(start, passed, length, u_left, u_right, clock, inputs)
        for i in range(u_left.size):
            inputs[u_left.size + i] = (u_right[i] - u_left[i]) / length
        factor(clock, inputs, w, n)
        for d in range(seeds.shape[0]):
            _copy_in(w, dw[d], 0, size)
            sway(seeds[d], w, n)
            _copy_out(w, dw[d], size, DOUT * LANES, size)
        for s in range(int(tableau[0])):
            _stage(s, start, passed, length, step, tableau, u_left, u_right, clock, inputs, size, w, n)
            _set_time(start, passed, length, u_left, u_right, clock, inputs)
            curve(clock, inputs, w, n)
            for d in range(seeds.shape[0]):
                _push_stage(s, step, tableau, seeds[d], dw[d], size, w, n)
        for s in range(int(tableau[0])):
            share = tableau[2 + s * (4 + 2 * int(tableau[0])) + 2]
            for q in range(size):
                w[X * LANES + q] += share * w[STAGES * LANES + s * size + q]
            for d in range(seeds.shape[0]):
                _add_row(dw[d], share, (3 + s) * size, size)
        passed += step
        step *= grading


def _set_time(
    start: float,
    passed: float,
    length: float,
    u_left: FloatArray,
    u_right: FloatArray,
    clock: FloatArray,
    inputs: FloatArray,
) -> None:
    clock[0] = start + passed
    for i in range(u_left.size):
        inputs[i] = u_left[i] + passed / length * (u_right[i] - u_left[i])


def _copy_in(w: FloatArray, row: FloatArray, first: int, size: int) -> None:
    for q in range(size):
        w[DIN * LANES + q] = row[first + q]


def _copy_out(w: FloatArray, row: FloatArray, first: int, source: int, size: int) -> None:
    for q in range(size):
        row[first + q] = w[source + q]


def _add_row(row: FloatArray, share: float, source: int, size: int) -> None:
    for q in range(size):
        row[q] += share * row[source + q]


def _stage(
    s: int,
    start: float,
    passed: float,
    length: float,
    step: float,
    tableau: FloatArray,
    u_left: FloatArray,
    u_right: FloatArray,
    clock: FloatArray,
    inputs: FloatArray,
    size: int,
    w: FloatArray,
    n: int,
) -> None:
    """One stage of all lanes; its solution is in STAGES and TOTAL, and the Jacobian of its slopes is kept."""
    stages = int(tableau[0])
    row = 2 + s * (4 + 2 * stages)  # alpha, gamma, m, whether slopes are new, a (stages), c (stages)
    if tableau[row + 3] != 0.0:
        for q in range(size):
            w[STAGE * LANES + q] = w[X * LANES + q]
        for j in range(s):
            for q in range(size):
                w[STAGE * LANES + q] += tableau[row + 4 + j] * w[STAGES * LANES + j * size + q]
        _set_time(start, passed + tableau[row] * step, length, u_left, u_right, clock, inputs)
        slopes(clock, inputs, w, n)
    for q in range(size):
        w[TOTAL * LANES + q] = w[SLOPE * LANES + q] + tableau[row + 1] * step * w[TREND * LANES + q]
    for j in range(s):
        for q in range(size):
            w[TOTAL * LANES + q] += tableau[row + 4 + stages + j] / step * w[STAGES * LANES + j * size + q]
    substitute(w, n)
    for q in range(size):
        w[STAGES * LANES + s * size + q] = w[TOTAL * LANES + q]


def _push_stage(
    s: int, step: float, tableau: FloatArray, seed: FloatArray, row: FloatArray, size: int, w: FloatArray, n: int
) -> None:
    """One stage of one direction."""
    stages = int(tableau[0])
    at = 2 + s * (4 + 2 * stages)
    if tableau[at + 3] != 0.0:
        _copy_in(w, row, 0, size)
        for j in range(s):
            for q in range(size):
                w[DIN * LANES + q] += tableau[at + 4 + j] * row[(3 + j) * size + q]
        push(seed, w, n)
        _copy_out(w, row, 2 * size, DOUT * LANES, size)
    _copy_in(w, row, 0, size)
    bend(seed, w, n)
    for q in range(size):
        trend = tableau[at + 1] * step * row[size + q]
        w[TOTAL * LANES + q] = w[DOUT * LANES + q] + row[2 * size + q] + trend
    for j in range(s):
        for q in range(size):
            w[TOTAL * LANES + q] += tableau[at + 4 + stages + j] / step * row[(3 + j) * size + q]
    substitute(w, n)
    _copy_out(w, row, (3 + s) * size, TOTAL * LANES, size)
