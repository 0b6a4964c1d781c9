"""Fixed-step simulation of members side by side in the part of Python of kernels; the same for every model."""

from __future__ import annotations

from typing import NamedTuple

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.compile.lanes.load import Advance, Measure, Prepare


class Equations(NamedTuple):
    """Compiled functions of a model, see :class:`bondgraph.compile.lanes.load.LaneModel`."""

    prepare: Prepare
    advance: Advance
    measure: Measure


class Grid(NamedTuple):
    """Times (n,), inputs at them (n, n_u) and at the ends of each interval (n-1, n_u), and how each is integrated."""

    time: FloatArray
    u: FloatArray
    u_left: FloatArray
    u_right: FloatArray
    substeps: int
    grading: float
    tableau: FloatArray


class Scratch(NamedTuple):
    """Work buffer of the model with the first rows of theta, x and y in it, for so many lanes."""

    buffer: FloatArray
    clock: FloatArray
    inputs: FloatArray
    lanes: int
    theta: int
    x: int
    y: int


def simulate_members(
    equations: Equations,
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
    for first in range(0, last.size, scratch.lanes):
        end = min(first + scratch.lanes, last.size)
        _load(equations, theta, x, first, end, scratch)
        for m in range(first, end):
            last[m] = -1
        for k in range(grid.time.size):
            if k > 0:
                equations.advance(
                    grid.time[k - 1],
                    grid.time[k] - grid.time[k - 1],
                    grid.substeps,
                    grid.grading,
                    grid.tableau,
                    grid.u_left[k - 1],
                    grid.u_right[k - 1],
                    scratch.clock,
                    scratch.inputs,
                    scratch.buffer,
                    scratch.lanes,
                )
            scratch.clock[0] = grid.time[k]
            for i in range(grid.u.shape[1]):
                scratch.inputs[i] = grid.u[k, i]
            equations.measure(scratch.clock, scratch.inputs, scratch.buffer, scratch.lanes)
            if _store(k, x, y, last, first, end, scratch) == 0:
                break


def _load(equations: Equations, theta: FloatArray, x: FloatArray, first: int, end: int, scratch: Scratch) -> None:
    """Parameters and initial states of a block of members; lanes beyond the last repeat it."""
    for lane in range(scratch.lanes):
        m = min(first + lane, end - 1)
        for i in range(theta.shape[0]):
            scratch.buffer[(scratch.theta + i) * scratch.lanes + lane] = theta[i, m]
        for i in range(x.shape[0]):
            scratch.buffer[(scratch.x + i) * scratch.lanes + lane] = x[i, 0, m]
    equations.prepare(scratch.buffer, scratch.lanes)


def _store(k: int, x: FloatArray, y: FloatArray, last: IntArray, first: int, end: int, scratch: Scratch) -> int:
    """Keep sample ``k`` of the members that are finite until now; how many there are."""
    going = 0
    for m in range(first, end):
        lane = m - first
        total = 0.0
        for i in range(x.shape[0]):
            total += 0.0 * scratch.buffer[(scratch.x + i) * scratch.lanes + lane]  # zero times infinity is nan
        if last[m] == k - 1 and total == 0.0:
            for i in range(x.shape[0]):
                x[i, k, m] = scratch.buffer[(scratch.x + i) * scratch.lanes + lane]
            for a in range(y.shape[0]):
                y[a, k, m] = scratch.buffer[(scratch.y + a) * scratch.lanes + lane]
            last[m] = k
            going += 1
    return going
