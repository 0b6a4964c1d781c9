"""What a compiled model does for others: advance states over an interval, and measure them.

These two functions are compiled with the model and called by address, so that the filters and simulators that use them
are compiled once for all models. They are also where states side by side can become SIMD lanes.

``points`` (n_points, n_x + n_appended) holds one state per row; its last columns stand in ``theta`` at ``appended``.
``x``, ``y``, ``u_now`` and ``stages`` (3, n_x) are scratch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bondgraph.simulate.arrays import FloatArray, IntArray
from bondgraph.simulate.rk4_kernel import rk4_advance

if TYPE_CHECKING:
    from bondgraph.simulate.kernel_names import output_into


def advance_points(
    start: float,
    length: float,
    substeps: int,
    u_left: FloatArray,
    u_right: FloatArray,
    theta: FloatArray,
    appended: IntArray,
    points: FloatArray,
    x: FloatArray,
    stages: FloatArray,
    u_now: FloatArray,
) -> None:
    """Advance every point in place over one interval."""
    for j in range(points.shape[0]):
        _load_point(points, j, theta, appended, x)
        rk4_advance(start, length, substeps, u_left, u_right, theta, x, stages, u_now)
        for i in range(x.size):
            points[j, i] = x[i]


def measure_points(
    t: float,
    u: FloatArray,
    theta: FloatArray,
    appended: IntArray,
    points: FloatArray,
    outputs: FloatArray,
    x: FloatArray,
    y: FloatArray,
) -> None:
    """Outputs (n_points, n_y) of every point."""
    for j in range(points.shape[0]):
        _load_point(points, j, theta, appended, x)
        output_into(t, x, u, theta, y)
        for a in range(y.size):
            outputs[j, a] = y[a]


def _load_point(points: FloatArray, j: int, theta: FloatArray, appended: IntArray, x: FloatArray) -> None:
    for i in range(x.size):
        x[i] = points[j, i]
    for a in range(appended.size):
        theta[appended[a]] = points[j, x.size + a]
