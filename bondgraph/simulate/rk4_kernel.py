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

    ``work`` (5, n_x) and ``u`` (n_u,) are scratch. Inputs run linearly from ``u_left`` to ``u_right``.
    """
    step = length / substeps
    slope_1, slope_2, slope_3, slope_4, stage = work[0], work[1], work[2], work[3], work[4]
    for k in range(substeps):
        t = start + k * step
        _inputs_at(k / substeps, u_left, u_right, u)
        rhs_into(t, x, u, theta, slope_1)
        for i in range(x.size):
            stage[i] = x[i] + 0.5 * step * slope_1[i]
        _inputs_at((k + 0.5) / substeps, u_left, u_right, u)
        rhs_into(t + 0.5 * step, stage, u, theta, slope_2)
        for i in range(x.size):
            stage[i] = x[i] + 0.5 * step * slope_2[i]
        rhs_into(t + 0.5 * step, stage, u, theta, slope_3)
        for i in range(x.size):
            stage[i] = x[i] + step * slope_3[i]
        _inputs_at((k + 1) / substeps, u_left, u_right, u)
        rhs_into(t + step, stage, u, theta, slope_4)
        for i in range(x.size):
            x[i] += step / 6.0 * (slope_1[i] + 2.0 * (slope_2[i] + slope_3[i]) + slope_4[i])


def _inputs_at(share: float, left: FloatArray, right: FloatArray, u: FloatArray) -> None:
    for i in range(u.size):
        u[i] = left[i] + share * (right[i] - left[i])
