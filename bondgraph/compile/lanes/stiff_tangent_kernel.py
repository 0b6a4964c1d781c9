"""Tangents of Rosenbrock steps for all lanes, in the part of Python that numba compiles. Rows as in ``step_kernel``.

``dw`` holds each direction, of all lanes. In every step the stages come first: of each the Jacobian of its slopes is
kept, and what its solution makes of the second derivatives. Then one direction after another passes the whole step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bondgraph.arrays import FloatArray

if TYPE_CHECKING:
    from bondgraph.compile.lanes.kernel_names import (
        DIN,
        DOUT,
        JAC,
        JACS,
        LANES,
        N_JAC,
        N_X,
        ROWS,
        SLOPE,
        STAGE,
        STAGES,
        TOTAL,
        TREND,
        X,
        curve,
        factor,
        push_state,
        push_step,
        slopes,
        substitute,
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
    size = w.size // ROWS * N_X  # the lanes, as a number that numba does not know: else loops stay scalar
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
        for s in range(int(tableau[0])):
            _stage(s, start, passed, length, step, tableau, u_left, u_right, clock, inputs, size, w, n)
            _copy(w, JACS + s * N_JAC, JAC, size // N_X * N_JAC)
        curve(w, n)
        for s in range(int(tableau[0])):
            share = tableau[2 + s * (4 + 2 * int(tableau[0])) + 2]
            for q in range(size):
                w[X * LANES + q] += share * w[STAGES * LANES + s * size + q]
        for d in range(seeds.shape[0]):
            _push(seeds[d], clock, dw[d], size, w, n)
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


def _copy(w: FloatArray, target: int, source: int, size: int) -> None:
    for q in range(size):
        w[target * LANES + q] = w[source * LANES + q]


def _push(seed: FloatArray, clock: FloatArray, row: FloatArray, size: int, w: FloatArray, n: int) -> None:
    """A whole step of one direction."""
    for q in range(size):
        w[DIN * LANES + q] = row[q]
    moves = False
    for q in range(seed.size):
        moves = moves or seed[q] != 0.0
    if moves:
        push_step(seed, clock, w, n)
    else:
        push_state(clock, w, n)
    for q in range(size):
        row[q] = w[DOUT * LANES + q]


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
    """One stage of all lanes; its solution goes to STAGES. The slopes of the first are those of the start."""
    stages = int(tableau[0])
    row = 2 + s * (4 + 2 * stages)  # alpha, gamma, m, whether slopes are new, a (stages), c (stages)
    if s > 0 and tableau[row + 3] != 0.0:
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
