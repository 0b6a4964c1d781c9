"""Moves points over many intervals with given steps; compiled from its text."""

from __future__ import annotations

from typing import NamedTuple

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.compile.lanes.load import Advance, Prepare
from bondgraph.filter.kernel_types import Log, Rules


class Movement(NamedTuple):
    """Compiled functions of a model and the numbers they work on."""

    prepare: Prepare
    advance: Advance
    buffer: FloatArray
    clock: FloatArray
    inputs: FloatArray


def move_points(
    movement: Movement, log: Log, rules: Rules, theta: FloatArray, intervals: IntArray, points: FloatArray
) -> None:
    """Move points (intervals, n_s, points) of intervals in place, with the steps that the log gives for each.

    ``theta`` (n_theta,) are the parameters but for the appended ones, which are part of the points.
    """
    lanes = rules.lanes
    for i in range(theta.size):
        for lane in range(lanes):
            movement.buffer[(rules.theta + i) * lanes + lane] = theta[i]
    movement.prepare(movement.buffer, lanes)
    for row in range(intervals.size):
        k = intervals[row]
        for first in range(0, points.shape[2], lanes):
            n = _load(movement, rules, points[row], first)
            movement.advance(
                log.time[k],
                log.time[k + 1] - log.time[k],
                log.substeps[k],
                log.grading[k],
                rules.tableau,
                log.u_left[k],
                log.u_right[k],
                movement.clock,
                movement.inputs,
                movement.buffer,
                n,
            )
            for i in range(rules.n_x):
                for p in range(first, min(first + lanes, points.shape[2])):
                    points[row, i, p] = movement.buffer[(rules.x + i) * lanes + p - first]


def _load(movement: Movement, rules: Rules, points: FloatArray, first: int) -> int:
    """Bring points from ``first`` on into the work buffer; the number of lanes to work on, a multiple of eight."""
    last = points.shape[1] - 1
    n: int = (min(rules.lanes, last + 1 - first) + 7) // 8 * 8
    for i in range(points.shape[0]):
        row = rules.x + i if i < rules.n_x else rules.theta + rules.appended[i - rules.n_x]
        for lane in range(n):
            movement.buffer[row * rules.lanes + lane] = points[i, min(first + lane, last)]
    if rules.appended.size > 0:
        movement.prepare(movement.buffer, n)
    return n
