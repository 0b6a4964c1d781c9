"""Tangents of trajectories for all lanes, in the part of Python that ``compiler`` compiles. Rows as in ``step_kernel``.

``dw`` (directions, 3 n_x lanes) holds for each direction its vectors at the state and at the stage and the sum over
stages. ``seeds`` (directions, parameters) says how each direction moves the parameters.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bondgraph.arrays import FloatArray

if TYPE_CHECKING:
    from bondgraph.compile.lanes.kernel_names import (
        begin,
        begin_direction,
        bring_direction,
        finish_direction,
        first,
        inner,
        last,
        push,
        slopes,
        turn_direction,
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
    for k in range(substeps):
        begin(w, n)
        for d in range(seeds.shape[0]):
            begin_direction(dw[d], n)
        for s in range(4):
            middle = s == 1 or s == 2
            now = k * step + (0.5 if middle else float(s // 2)) * step
            clock[0] = start + now
            for i in range(u_left.size):
                inputs[i] = u_left[i] + now / length * (u_right[i] - u_left[i])
            slopes(clock, inputs, w, n)
            weight = (2.0 if middle else 1.0) * step / 6.0
            length_there = (1.0 if s == 2 else 0.5) * step
            if s == 0:
                first(weight, length_there, w, n)
            elif s < 3:
                inner(weight, length_there, w, n)
            else:
                last(weight, w, n)
            for d in range(seeds.shape[0]):
                bring_direction(dw[d], w, n)
                push(seeds[d], w, n)
                turn_direction(weight, length_there, dw[d], w, n)
        for d in range(seeds.shape[0]):
            finish_direction(dw[d], n)
