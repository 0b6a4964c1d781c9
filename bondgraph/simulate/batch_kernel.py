"""Fixed-step simulation of many members in the part of Python that numba compiles."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bondgraph.simulate.arrays import FloatArray, IntArray
from bondgraph.simulate.rk4_kernel import rk4_advance

if TYPE_CHECKING:
    from bondgraph.simulate.kernel_names import output_into


def simulate_members(
    time: FloatArray,
    u: FloatArray,
    u_left: FloatArray,
    u_right: FloatArray,
    substeps: int,
    theta: FloatArray,
    members: tuple[int, int],
    x: FloatArray,
    y: FloatArray,
    last: IntArray,
    scratch: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray],
) -> None:
    """Simulate the members ``members[0] <= m < members[1]``.

    Shapes: time (n,); u (n, n_u) at the times, u_left and u_right (n-1, n_u) of the intervals; theta (n_theta, members);
    x (n_x, n, members) with the initial states in ``x[:, 0]`` and y (n_y, n, members) are filled; last (members,) gets
    the index of the last finite sample.
    """
    x_now, y_now, u_now, theta_now, work = scratch
    for m in range(members[0], members[1]):
        for i in range(theta_now.size):
            theta_now[i] = theta[i, m]
        for i in range(x_now.size):
            x_now[i] = x[i, 0, m]
        last[m] = -1
        for k in range(time.size):
            if k > 0:
                rk4_advance(
                    time[k - 1],
                    time[k] - time[k - 1],
                    substeps,
                    u_left[k - 1],
                    u_right[k - 1],
                    theta_now,
                    x_now,
                    work,
                    u_now,
                )
            if not _is_finite(x_now):
                break
            output_into(time[k], x_now, u[k], theta_now, y_now)
            for i in range(x_now.size):
                x[i, k, m] = x_now[i]
            for i in range(y_now.size):
                y[i, k, m] = y_now[i]
            last[m] = k


def _is_finite(values: FloatArray) -> bool:
    for i in range(values.size):
        if not math.isfinite(values[i]):
            return False
    return True
