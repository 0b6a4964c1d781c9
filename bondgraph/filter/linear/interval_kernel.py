"""How kicks of the states inside the intervals of a log reach their ends, in the part of Python of kernels.

They are followed from one node to the next, where the states are kicked anew: a transition is the product of those of
its parts, which costs less than to follow the kicks of every node to the end.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.compile.lanes.load import Advance, Prepare


class Equations(NamedTuple):
    """Compiled functions of a model, see :class:`bondgraph.compile.lanes.load.LaneModel`."""

    prepare: Prepare
    advance: Advance


class Intervals(NamedTuple):
    """Intervals of a log: starts and lengths (n,), inputs at both ends (n, n_u), steps (n,) of a whole one, method."""

    start: FloatArray
    length: FloatArray
    u_left: FloatArray
    u_right: FloatArray
    substeps: IntArray
    grading: float
    tableau: FloatArray


class Scratch(NamedTuple):
    """Work buffer of the model with the first rows of theta and x in it, for so many lanes.

    ``left`` and ``right`` are inputs of a part of an interval, ``whole`` a transition.
    """

    buffer: FloatArray
    clock: FloatArray
    inputs: FloatArray
    left: FloatArray
    right: FloatArray
    whole: FloatArray
    lanes: int
    theta: int
    x: int


def kicked(
    equations: Equations,
    intervals: Intervals,
    theta: FloatArray,
    x: FloatArray,
    kicks: FloatArray,
    nodes: FloatArray,
    reached: FloatArray,
    moved: FloatArray,
    scratch: Scratch,
) -> None:
    """States at some nodes of every interval, and at its end what kicks of each state at these nodes leave.

    theta (n_theta,), x (n, n_x) where the intervals start, kicks (n_x,), nodes (m,) as shares of an interval; filled:
    reached (n, m, n_x), and moved (n, m, n_x, n_x) with one kicked state per last index, divided by the kick.
    """
    for i in range(theta.size):
        for lane in range(scratch.lanes):
            scratch.buffer[(scratch.theta + i) * scratch.lanes + lane] = theta[i]
    equations.prepare(scratch.buffer, scratch.lanes)
    for k in range(x.shape[0]):
        for i in range(x.shape[1]):
            for lane in range(scratch.lanes):
                scratch.buffer[(scratch.x + i) * scratch.lanes + lane] = x[k, i]
        if nodes[0] > 0.0:
            _part(equations, intervals, k, 0.0, nodes[0], scratch, 8)
        for i in range(x.shape[1]):
            reached[k, 0, i] = scratch.buffer[(scratch.x + i) * scratch.lanes]
        for m in range(nodes.size):
            _kick(equations, intervals, k, m, kicks, nodes, reached, moved, scratch)
        for turn in range(nodes.size - 1):
            m = nodes.size - 2 - turn
            _joined(moved[k, m + 1], moved[k, m], scratch.whole)


def _kick(
    equations: Equations,
    intervals: Intervals,
    k: int,
    m: int,
    kicks: FloatArray,
    nodes: FloatArray,
    reached: FloatArray,
    moved: FloatArray,
    scratch: Scratch,
) -> None:
    """From one node to the next or the end, the states kicked one after the other, many side by side in lanes.

    What a kick leaves there that is no number counts as nothing.
    """
    size, last = kicks.size, m + 1 == nodes.size
    first = 0
    while first < size:
        count = min(scratch.lanes - 1, size - first)
        n = (count + 8) // 8 * 8
        for i in range(size):
            for lane in range(n):
                kick = kicks[i] if lane > 0 and first + lane - 1 == i and lane <= count else 0.0
                scratch.buffer[(scratch.x + i) * scratch.lanes + lane] = reached[k, m, i] + kick
        _part(equations, intervals, k, nodes[m], 1.0 if last else nodes[m + 1], scratch, n)
        for i in range(size):
            row = (scratch.x + i) * scratch.lanes
            if not last:
                reached[k, m + 1, i] = scratch.buffer[row]
            for lane in range(1, count + 1):
                change = (scratch.buffer[row + lane] - scratch.buffer[row]) / kicks[first + lane - 1]
                moved[k, m, i, first + lane - 1] = change if math.isfinite(change) else 0.0
        first += count


def _joined(late: FloatArray, early: FloatArray, whole: FloatArray) -> None:
    """Make of the transition to a node that from there on too; ``whole`` is scratch."""
    size = late.shape[0]
    for i in range(size):
        for j in range(size):
            total = 0.0
            for c in range(size):
                total += late[i, c] * early[c, j]
            whole[i, j] = total
    early[:] = whole


def _part(
    equations: Equations, intervals: Intervals, k: int, begin: float, end: float, scratch: Scratch, n: int
) -> None:
    """Integrate from one share of an interval to another."""
    for i in range(intervals.u_left.shape[1]):
        bend = intervals.u_right[k, i] - intervals.u_left[k, i]
        scratch.left[i] = intervals.u_left[k, i] + begin * bend
        scratch.right[i] = intervals.u_left[k, i] + end * bend
    substeps = math.ceil((end - begin) * intervals.substeps[k])
    equations.advance(
        intervals.start[k] + begin * intervals.length[k],
        (end - begin) * intervals.length[k],
        substeps,
        intervals.grading,
        intervals.tableau,
        scratch.left,
        scratch.right,
        scratch.clock,
        scratch.inputs,
        scratch.buffer,
        n,
    )
