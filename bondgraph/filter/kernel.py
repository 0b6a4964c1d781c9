"""The unscented Kalman filter in the part of Python of kernels: the hot loop of every estimation.

The same steps as :mod:`bondgraph.filter.ukf`, written as loops, for every model: the model's own compiled functions
``prepare``, ``advance`` and ``measure`` are arguments. A call filters a block of members over one log or a part of it,
side by side as lanes (the last axis of all arrays), so that a processor works on eight of them in one instruction. With
one member its sigma points are the lanes of the model's functions. Members share nothing but the log, so neither the
number of threads in which blocks run, nor which members make up a block, nor the parts of a log change a bit of a
result. Nothing is allocated: each thread brings its own :class:`Work`.

A member that fails is an outcome. Its lane goes on with the numbers of one that has not failed, so that no lane works
on what is not finite, which could hold up the others.

Letters: n nodes (samples, and nodes of the process noise between them), n_x states of the model, n_s states of the
filter (with appended parameters), n_y outputs, n_u inputs, L lanes. Points are rows: point 0 is the centre, 1 ... n_s
lie above it and n_s + 1 ... 2 n_s below.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from bondgraph.arrays import FloatArray
from bondgraph.compile.lanes.load import Advance, Measure, Prepare
from bondgraph.filter.kernel_algebra import _condition, _draw, _drive, _expect, _factor, _join, _moments, _spread
from bondgraph.filter.kernel_alone import (
    _draw_alone,
    _factor_alone,
    _join_alone,
    _load_alone,
    _moments_alone,
    _spread_alone,
    _store_alone,
)
from bondgraph.filter.kernel_channels import _find_measured
from bondgraph.filter.kernel_record import (
    Record,
    _keep_belief,
    _keep_cross_cov,
    _keep_innovations,
    _keep_outputs,
)
from bondgraph.filter.kernel_robust import _condition_robust, _factor_robust
from bondgraph.filter.kernel_types import Log, Members, Part, Rules, Verdicts, Work


class Equations(NamedTuple):
    """Compiled functions of a model, see :class:`bondgraph.compile.lanes.load.LaneModel`."""

    prepare: Prepare
    advance: Advance
    measure: Measure


def filter_members(
    equations: Equations,
    log: Log,
    rules: Rules,
    members: Members,
    first: int,
    end: int,
    part: Part,
    verdicts: Verdicts,
    record: Record,
    work: Work,
) -> None:
    """Filter the members ``first <= m < end`` over a part of one log; lanes beyond the last repeat it."""
    _start(equations, rules, members, first, end, work)
    if part.begin > 0:
        _go_on(part, verdicts, work)
    for k in range(part.begin, part.end):
        if k > 0:
            if log.time[k] > log.time[k - 1]:
                _predict(equations, log, rules, members, record, k, first, work)
            else:
                _spread(work)  # on line, measurements of one time may come one after the other
        if _retire(equations, rules, members, first, end, verdicts, work) == 0:
            break
        measured = _find_measured(log.y, k, work.channels)
        if record.depth > 1:
            _keep_belief(record.predicted_mean, record.predicted_cov, k, first, end, work)
        if measured > 0 or record.depth > 1:
            _measure_points(equations, log, rules, members, k, work)
            _expect(rules, members, work)
        if measured > 0:
            _factor_joint(log.y, k, rules, members, measured, work)
            if _retire(equations, rules, members, first, end, verdicts, work) == 0:
                break
            if rules.robust.kind > 0:
                _condition_robust(measured, work)
            else:
                _condition(log.y, k, measured, work)
        if record.depth > 0:
            _keep_innovations(rules, record, k, first, end, measured, work)
        if record.depth > 1:
            _keep_outputs(record, k, first, end, work)
            _keep_belief(record.filtered_mean, record.filtered_cov, k, first, end, work)
        for m in range(first, end):
            if verdicts.outcome[m] == 0:
                verdicts.last[m] = k
    for m in range(first, end):
        verdicts.nll[m] = work.nll[m - first] if verdicts.outcome[m] == 0 else math.inf
        verdicts.floored[m] = work.floored[m - first]
        if part.end < log.time.size:
            _leave(part, m, m - first, work)


def _go_on(part: Part, verdicts: Verdicts, work: Work) -> None:
    """Lanes as their members left the part before; none of these has failed."""
    for lane in range(work.mean.shape[1]):
        m = work.who[lane]
        work.nll[lane] = verdicts.nll[m]
        work.floored[lane] = verdicts.floored[m]
        for i in range(work.mean.shape[0]):
            work.mean[i, lane] = part.mean[i, m]
            for j in range(i + 1):
                work.lower[i, j, lane] = part.lower[i, j, m]


def _leave(part: Part, m: int, lane: int, work: Work) -> None:
    """Keep the belief of a member for the next part; its covariance follows from the factor."""
    for i in range(work.mean.shape[0]):
        part.mean[i, m] = work.mean[i, lane]
        for j in range(i + 1):
            part.lower[i, j, m] = work.lower[i, j, lane]


def _start(equations: Equations, rules: Rules, members: Members, first: int, end: int, work: Work) -> None:
    """The prior: the belief at the first sample."""
    for lane in range(work.mean.shape[1]):
        work.who[lane] = min(first + lane, end - 1)
        work.nll[lane] = 0.0
        work.floored[lane] = 0
        work.code[lane] = 0
        m = work.who[lane]
        for i in range(work.mean.shape[0]):
            own = i < rules.n_x
            work.mean[i, lane] = members.x0[i, m] if own else members.theta[rules.appended[i - rules.n_x], m]
            for j in range(work.mean.shape[0]):
                work.lower[i, j, lane] = members.initial_lower[i, j, m]
    _spread(work)
    _load_parameters(equations, rules, members, work)


def _load_parameters(equations: Equations, rules: Rules, members: Members, work: Work) -> None:
    """Parameters of the members, in all lanes of the model's functions."""
    last = work.mean.shape[1] - 1
    for i in range(members.theta.shape[0]):
        for lane in range(rules.lanes):
            work.buffer[(rules.theta + i) * rules.lanes + lane] = members.theta[i, work.who[min(lane, last)]]
    equations.prepare(work.buffer, rules.lanes)


def _retire(
    equations: Equations, rules: Rules, members: Members, first: int, end: int, verdicts: Verdicts, work: Work
) -> int:
    """Note the outcome of lanes that have failed and give them the numbers of another; lanes that go on."""
    healthy = -1
    alive = 0
    failed = 0
    for lane in range(work.code.size):
        if work.code[lane] == 0:
            healthy = lane
            alive += int(first + lane < end and verdicts.outcome[first + lane] == 0)
        else:
            failed += 1
            m = first + lane
            if m < end and verdicts.outcome[m] == 0:
                verdicts.outcome[m] = work.code[lane]
    if failed == 0 or alive == 0:
        return alive
    for lane in range(work.code.size):
        if work.code[lane] != 0:
            work.code[lane] = 0
            _copy_lane(work, lane, healthy)
    _load_parameters(equations, rules, members, work)
    return alive


def _copy_lane(work: Work, lane: int, source: int) -> None:
    work.who[lane] = work.who[source]
    for i in range(work.mean.shape[0]):
        work.mean[i, lane] = work.mean[i, source]
        for j in range(work.mean.shape[0]):
            work.cov[i, j, lane] = work.cov[i, j, source]
            work.lower[i, j, lane] = work.lower[i, j, source]
    for a in range(work.output_mean.shape[0]):
        work.output_mean[a, lane] = work.output_mean[a, source]
        for b in range(work.output_mean.shape[0]):
            work.output_cov[a, b, lane] = work.output_cov[a, b, source]
        work.innovation[a, lane] = work.innovation[a, source]
        work.residual[a, lane] = work.residual[a, source]
        work.log_scale[a, lane] = work.log_scale[a, source]
    for i in range(work.joint.shape[0]):
        for j in range(work.joint.shape[0]):
            work.joint[i, j, lane] = work.joint[i, j, source]


def _predict(
    equations: Equations, log: Log, rules: Rules, members: Members, record: Record, k: int, first: int, work: Work
) -> None:
    """Belief over the step that ends at node ``k``."""
    alone = work.mean.shape[1] == 1
    if log.noise_start[k - 1] > 0.0:
        if alone:
            _spread_alone(work.alone)
        else:
            _spread(work)
        _factor_driven(rules, members, log.noise_start[k - 1], work)
    _draw_points(rules, work)
    chunk = 0
    while chunk < _chunks(rules, work):
        n = _load_points(equations, rules, work, chunk)
        equations.advance(
            log.time[k - 1],
            log.time[k] - log.time[k - 1],
            log.substeps[k - 1],
            log.grading[k - 1],
            rules.tableau,
            log.u_left[k - 1],
            log.u_right[k - 1],
            work.clock,
            work.inputs,
            work.buffer,
            n,
        )
        _store_points(rules, work, chunk, rules.x, rules.n_x, work.points, work.alone.points)
        chunk += 1
    if record.depth > 1:
        _keep_cross_cov(rules, record, k, first, work)
    if alone:
        one = work.alone
        _moments_alone(rules, one.points, one.mean, one.cov, one.shift, one.mean.size)
    else:
        _moments(rules, work.points, work.mean, work.cov, work.shift)
    _factor_driven(rules, members, log.noise_end[k - 1], work)


def _draw_points(rules: Rules, work: Work) -> None:
    """Sigma points of the belief."""
    if work.mean.shape[1] == 1:
        _draw_alone(rules, work.alone)
    else:
        _draw(rules, work)


def _factor_driven(rules: Rules, members: Members, seconds: float, work: Work) -> None:
    """Add the process noise of some seconds to the covariance and factor it."""
    _drive(members, seconds, work)
    if work.mean.shape[1] == 1:
        _factor_alone(work.alone.lower, work.mean.shape[0], 0, rules.pivot_floor, work)
    else:
        _factor(work.lower, work.mean.shape[0], 0, rules.pivot_floor, work)


def _factor_joint(y: FloatArray, k: int, rules: Rules, members: Members, measured: int, work: Work) -> None:
    """Factor the joint covariance of measured channels and state."""
    size = measured + work.mean.shape[0]
    alone = work.mean.shape[1] == 1
    if alone:
        _join_alone(rules, measured, work.alone)
    else:
        _join(rules, measured, work)
    if rules.robust.kind > 0:
        _factor_robust(y, k, measured, rules, members, work)
    elif alone:
        _factor_alone(work.alone.joint, size, measured, rules.pivot_floor, work)
    else:
        _factor(work.joint, size, measured, rules.pivot_floor, work)


def _measure_points(equations: Equations, log: Log, rules: Rules, members: Members, k: int, work: Work) -> None:
    """Outputs of all points."""
    _draw_points(rules, work)
    n_u = log.u.shape[1]
    for i in range(n_u):
        work.inputs[i] = log.u[k, i]
    work.clock[0] = log.time[k]
    for chunk in range(_chunks(rules, work)):
        n = _load_points(equations, rules, work, chunk)
        equations.measure(work.clock, work.inputs, work.buffer, n)
        _store_points(rules, work, chunk, rules.y, work.outputs.shape[1], work.outputs, work.alone.outputs)


def _chunks(rules: Rules, work: Work) -> int:
    """How often the model's functions are called for all points: one point of all members, or 16 of one."""
    points: int = work.points.shape[0]
    return points if work.mean.shape[1] > 1 else (points + rules.lanes - 1) // rules.lanes


def _load_points(equations: Equations, rules: Rules, work: Work, chunk: int) -> int:
    """Bring points into the work buffer; the number of lanes to work on, a multiple of eight."""
    n_s, lanes = work.mean.shape
    last = work.points.shape[0] - 1
    count = lanes if lanes > 1 else min(rules.lanes, last + 1 - chunk * rules.lanes)
    n: int = (count + 7) // 8 * 8
    for i in range(n_s):
        row = rules.x + i if i < rules.n_x else rules.theta + rules.appended[i - rules.n_x]
        if lanes > 1:
            for lane in range(n):
                work.buffer[row * rules.lanes + lane] = work.points[chunk, i, lane]
        else:
            _load_alone(work.buffer, row, rules.lanes, work.alone.points, chunk * rules.lanes, n, i)
    if rules.appended.size > 0:
        equations.prepare(work.buffer, n)
    return n


def _store_points(
    rules: Rules, work: Work, chunk: int, row: int, rows: int, target: FloatArray, own: FloatArray
) -> None:
    """Bring rows of the work buffer back to the points; ``own`` is what a member by itself has for ``target``."""
    lanes = work.mean.shape[1]
    for i in range(rows):
        if lanes > 1:
            for lane in range(lanes):
                target[chunk, i, lane] = work.buffer[(row + i) * rules.lanes + lane]
        else:
            _store_alone(work.buffer, row + i, rules.lanes, own, chunk * rules.lanes, i)
