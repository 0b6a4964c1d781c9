"""Fixed-step simulation of many members in the part of Python that numba compiles; the same code for every model."""

from __future__ import annotations

from typing import NamedTuple

from bondgraph.simulate.arrays import FloatArray, IntArray
from bondgraph.simulate.compile import Advance, Measure


class Grid(NamedTuple):
    """Times (n,), inputs at them (n, n_u) and at the ends of each interval (n-1, n_u); steps per interval."""

    time: FloatArray
    u: FloatArray
    u_left: FloatArray
    u_right: FloatArray
    substeps: int


class Scratch(NamedTuple):
    """Work space: one state as a point (1, n_x), its outputs (1, n_y), and the arguments of the scalar model."""

    point: FloatArray
    outputs: FloatArray
    theta: FloatArray
    appended: IntArray
    x: FloatArray
    y: FloatArray
    u: FloatArray
    stages: FloatArray


def simulate_members(
    advance: Advance,
    measure: Measure,
    grid: Grid,
    theta: FloatArray,
    x: FloatArray,
    y: FloatArray,
    last: IntArray,
    scratch: Scratch,
) -> None:
    """Simulate every member: theta (n_theta, members), x (n_x, n, members), y (n_y, n, members), last (members,).

    ``x[:, 0]`` holds the initial states; the rest of x, and y, are filled up to the last finite sample, whose index
    goes into ``last``.
    """
    point, outputs, theta_now = scratch.point, scratch.outputs, scratch.theta
    for m in range(last.size):
        for i in range(theta_now.size):
            theta_now[i] = theta[i, m]
        for i in range(point.shape[1]):
            point[0, i] = x[i, 0, m]
        last[m] = -1
        for k in range(grid.time.size):
            if k > 0:
                advance(
                    grid.time[k - 1],
                    grid.time[k] - grid.time[k - 1],
                    grid.substeps,
                    grid.u_left[k - 1],
                    grid.u_right[k - 1],
                    theta_now,
                    scratch.appended,
                    point,
                    scratch.x,
                    scratch.stages,
                    scratch.u,
                )
            if not _is_finite(point[0]):
                break
            measure(grid.time[k], grid.u[k], theta_now, scratch.appended, point, outputs, scratch.x, scratch.y)
            for i in range(point.shape[1]):
                x[i, k, m] = point[0, i]
            for i in range(outputs.shape[1]):
                y[i, k, m] = outputs[0, i]
            last[m] = k


def _is_finite(values: FloatArray) -> bool:
    total = 0.0
    for i in range(values.size):
        total += 0.0 * values[i]  # zero times an infinity or a NaN is a NaN
    return total == 0.0
