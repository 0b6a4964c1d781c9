"""Fills the nodes of one interval of a stream into the form that the filter kernel reads; numba compiles it."""

from __future__ import annotations

from bondgraph.arrays import BoolArray, FloatArray, IntArray
from bondgraph.filter.kernel_types import Log


def fill_interval(
    log: Log,
    offset: FloatArray,
    noise: FloatArray,
    hold: BoolArray,
    rates: IntArray,
    before: float,
    u_before: FloatArray,
    time: float,
    u: FloatArray,
    y: FloatArray,
) -> None:
    """Times, inputs, noise and measurements of the nodes of an interval from ``before`` to ``time``.

    ``offset`` (m,) are the nodes as shares of the interval, ``noise`` (2, m-1) the process noise before and after each
    step. Inputs whose rows stand first in a row of ``rates`` (rates, 2) are the slopes of the second.
    """
    length = time - before
    last = offset.size - 1
    for k in range(last):
        log.time[k] = before + offset[k] * length
        log.noise_start[k] = noise[0, k] * length
        log.noise_end[k] = noise[1, k] * length
    log.time[0] = before
    log.time[last] = time
    for i in range(u.size):
        right = u_before[i] if hold[i] else u[i]
        bend = right - u_before[i]
        for k in range(last):
            begin = (log.time[k] - before) / length if k > 0 else 0.0
            end = (log.time[k + 1] - before) / length if k + 1 < last else 1.0
            log.u_left[k, i] = u_before[i] + begin * bend if k > 0 else u_before[i]
            log.u_right[k, i] = u_before[i] + end * bend if k + 1 < last else right
        log.u[last, i] = u[i]
    for row in range(rates.shape[0]):
        own, base = rates[row, 0], rates[row, 1]
        slope = (log.u_right[last - 1, base] - log.u_left[0, base]) / length if length > 0.0 else u_before[own]
        for k in range(last):
            log.u_left[k, own] = slope
            log.u_right[k, own] = slope
        log.u[last, own] = slope
    for k in range(last):
        for i in range(u.size):
            log.u[k, i] = log.u_left[k, i]
    for a in range(y.size):
        log.y[last, a] = y[a]
