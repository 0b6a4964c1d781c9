"""Integration of all lanes over an interval, in the part of Python that ``compiler`` compiles.

The rows of the work buffer are numbers that the module in which this text stands defines, see ``writer``:

    X        state                            STAGE    where slopes are taken
    SLOPE    time derivatives at STAGE        TOTAL    sum, or right-hand side
    TREND    derivative of slopes by time     STAGES   solved stages, one after another

``clock`` holds the time and 1/(gamma h); ``inputs`` the inputs, then their time derivatives.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bondgraph.arrays import FloatArray

if TYPE_CHECKING:
    from bondgraph.compile.lanes.kernel_names import (
        begin,
        factor,
        finish,
        first,
        inner,
        keep,
        last,
        one_step,
        rates,
        reach,
        right,
        substitute,
    )


def advance(
    start: float,
    length: float,
    substeps: int,
    grading: float,
    tableau: FloatArray,
    u_left: FloatArray,
    u_right: FloatArray,
    clock: FloatArray,
    inputs: FloatArray,
    w: FloatArray,
    n: int,
) -> None:
    """Advance the state of ``n`` lanes by ``substeps`` steps, each ``grading`` times as long as the one before."""
    passed = 0.0
    step = length / substeps
    if grading != 1.0:
        growth = 1.0
        for _ in range(substeps):
            growth *= grading
        step = length * (grading - 1.0) / (growth - 1.0)
    for _ in range(substeps):
        one_step(start, length, passed, step, tableau, u_left, u_right, clock, inputs, w, n)
        passed += step
        step *= grading


def _set_inputs(share: float, u_left: FloatArray, u_right: FloatArray, inputs: FloatArray) -> None:
    for i in range(u_left.size):
        inputs[i] = u_left[i] + share * (u_right[i] - u_left[i])


def _rk4_step(
    start: float,
    length: float,
    passed: float,
    step: float,
    tableau: FloatArray,
    u_left: FloatArray,
    u_right: FloatArray,
    clock: FloatArray,
    inputs: FloatArray,
    w: FloatArray,
    n: int,
) -> None:
    """One step of the classical Runge-Kutta method of order 4."""
    begin(w, n)
    for s in range(4):
        # nodes 0, 1/2, 1/2, 1 and weights 1/6, 1/3, 1/3, 1/6
        middle = s == 1 or s == 2
        now = passed + (0.5 if middle else float(s // 2)) * step
        clock[0] = start + now
        _set_inputs(now / length, u_left, u_right, inputs)
        rates(clock, inputs, w, n)
        weight = (2.0 if middle else 1.0) * step / 6.0
        length_there = (1.0 if s == 2 else 0.5) * step
        if s == 0:
            first(weight, length_there, w, n)
        elif s < 3:
            inner(weight, length_there, w, n)
        else:
            last(weight, w, n)


def _rosenbrock_step(
    start: float,
    length: float,
    passed: float,
    step: float,
    tableau: FloatArray,
    u_left: FloatArray,
    u_right: FloatArray,
    clock: FloatArray,
    inputs: FloatArray,
    w: FloatArray,
    n: int,
) -> None:
    """One step of a Rosenbrock method, see :class:`bondgraph.compile.rosenbrock.Tableau`.

    (1/(gamma h) I - J) U_s = f(X + sum a U) + sum c U / h + gamma_s h df/dt,      X += sum m U
    """
    stages = int(tableau[0])
    clock[0] = start + passed
    clock[1] = 1.0 / (tableau[1] * step)
    _set_inputs(passed / length, u_left, u_right, inputs)
    for i in range(u_left.size):
        inputs[u_left.size + i] = (u_right[i] - u_left[i]) / length
    factor(clock, inputs, w, n)  # and the slopes of the first stage, which is the start
    for s in range(stages):
        row = 2 + s * (4 + 2 * stages)  # alpha, gamma, m, whether slopes are new, a (stages), c (stages)
        if s > 0 and tableau[row + 3] != 0.0:
            reach(tableau, row, s, w, n)
            now = passed + tableau[row] * step
            clock[0] = start + now
            _set_inputs(now / length, u_left, u_right, inputs)
            rates(clock, inputs, w, n)
        right(tableau, row, stages, s, step, w, n)
        substitute(w, n)
        keep(s, w, n)
    finish(tableau, stages, w, n)
