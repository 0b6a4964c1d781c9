"""Fixed-step Runge-Kutta in the part of Python that numba compiles, on the scalar form of a model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bondgraph.simulate.arrays import FloatArray

if TYPE_CHECKING:
    from bondgraph.simulate.kernel_names import rhs_into


def rk4_advance(
    start: float,
    length: float,
    substeps: int,
    u_left: FloatArray,
    u_right: FloatArray,
    theta: FloatArray,
    x: FloatArray,
    work: FloatArray,
    u: FloatArray,
) -> None:
    """Advance ``x`` in place by ``substeps`` equal steps of the classical Runge-Kutta method of order 4.

    ``work`` (3, n_x) and ``u`` (n_u,) are scratch. Inputs run linearly from ``u_left`` to ``u_right``. The four stages
    are one loop, so that the equations stand in the machine code once: that halves the time to compile a model.
    """
    step = length / substeps
    slope, total, stage = work[0], work[1], work[2]
    for k in range(substeps):
        for i in range(x.size):
            stage[i] = x[i]
            total[i] = 0.0
        for s in range(4):
            # nodes 0, 1/2, 1/2, 1 and weights 1/6, 1/3, 1/3, 1/6
            inner = s == 1 or s == 2
            node = 0.5 if inner else float(s // 2)
            weight = 2.0 if inner else 1.0
            reach = (1.0 if s == 2 else 0.5) * step
            share = (k + node) / substeps
            for i in range(u.size):
                u[i] = u_left[i] + share * (u_right[i] - u_left[i])
            rhs_into(start + (k + node) * step, stage, u, theta, slope)
            for i in range(x.size):
                total[i] += weight * slope[i]
                stage[i] = x[i] + reach * slope[i]
        for i in range(x.size):
            x[i] += step / 6.0 * total[i]
