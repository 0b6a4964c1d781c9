"""Tangents of Rosenbrock steps for all lanes, in the part of Python that ``compiler`` compiles.

Rows as in ``step_kernel``. ``dw`` holds each direction, of all lanes. In every step the stages come first: of each the
Jacobian of its slopes is kept, and what its solution makes of the second derivatives. Then one direction after another
passes the whole step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bondgraph.arrays import FloatArray

if TYPE_CHECKING:
    from bondgraph.compile.lanes.kernel_names import (
        bring_direction,
        curve,
        factor,
        finish,
        keep,
        keep_slopes,
        push_state,
        push_step,
        reach,
        right,
        slopes,
        substitute,
        take_direction,
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
    passed = 0.0
    step = length / substeps
    if grading != 1.0:
        growth = 1.0
        for _ in range(substeps):
            growth *= grading
        step = length * (grading - 1.0) / (growth - 1.0)
    for _ in range(substeps):
        clock[1] = 1.0 / (tableau[1] * step)
        _set_time(start, passed, length, u_left, u_right, clock, inputs)
        for i in range(u_left.size):
            inputs[u_left.size + i] = (u_right[i] - u_left[i]) / length
        factor(clock, inputs, w, n)
        keep_slopes(0, w, n)
        for s in range(int(tableau[0])):
            _stage(s, start, passed, length, step, tableau, u_left, u_right, clock, inputs, w, n)
        curve(w, n)
        finish(tableau, int(tableau[0]), w, n)
        for d in range(seeds.shape[0]):
            _push(seeds[d], clock, dw[d], w, n)
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


def _push(seed: FloatArray, clock: FloatArray, direction: FloatArray, w: FloatArray, n: int) -> None:
    """A whole step of one direction."""
    moves = False
    for q in range(seed.size):
        moves |= seed[q] != 0.0
    bring_direction(direction, w, n)
    if moves:
        push_step(seed, clock, w, n)
    else:
        push_state(clock, w, n)
    take_direction(direction, w, n)


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
    w: FloatArray,
    n: int,
) -> None:
    """One stage of all lanes; its solution goes to STAGES. The slopes of the first are those of the start."""
    stages = int(tableau[0])
    row = 2 + s * (4 + 2 * stages)  # alpha, gamma, m, whether slopes are new, a (stages), c (stages)
    if s > 0 and tableau[row + 3] != 0.0:
        reach(tableau, row, s, w, n)
        _set_time(start, passed + tableau[row] * step, length, u_left, u_right, clock, inputs)
        slopes(clock, inputs, w, n)
        keep_slopes(s, w, n)
    right(tableau, row, stages, s, step, w, n)
    substitute(w, n)
    keep(s, w, n)
