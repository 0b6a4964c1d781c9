"""The unscented Kalman filter in the part of Python that numba compiles: the hot loop of every estimation.

The same steps as :mod:`bondgraph.filter.ukf`, written as loops, for every model: the model's own compiled functions
``advance`` and ``measure`` are arguments. A call filters a block of members over one log; members share nothing but the
log, so blocks run in threads and their number changes no bit of a result. Nothing is allocated: each thread brings its
own :class:`Work`.

Letters: n samples, n_x states of the model, n_s states of the filter (with appended parameters), n_y outputs, n_u
inputs. Points are rows: point 0 is the centre, 1 ... n_s lie above it and n_s + 1 ... 2 n_s below.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from bondgraph.simulate.arrays import FloatArray, IntArray
from bondgraph.simulate.compile import Advance, Measure


class Log(NamedTuple):
    """A log: time (n,); u (n, n_u); u_left, u_right (n-1, n_u); y (n, n_y); substeps (n-1,)."""

    time: FloatArray
    u: FloatArray
    u_left: FloatArray
    u_right: FloatArray
    y: FloatArray
    substeps: IntArray


class Rules(NamedTuple):
    """Numbers of the sigma points, the appended parameters' positions in theta, and the share of a rounding pivot."""

    spread: float
    weight: float
    correction: float
    pivot_floor: float
    appended: IntArray


class Members(NamedTuple):
    """Numbers of each member in a column: theta, x0 (n_x), initial_std and process_std (n_s), noise_std (n_y)."""

    theta: FloatArray
    x0: FloatArray
    initial_std: FloatArray
    process_std: FloatArray
    noise_std: FloatArray


class Verdicts(NamedTuple):
    """Per member: negative log-likelihood, code of the outcome, index of the last finished sample, floored pivots."""

    nll: FloatArray
    outcome: IntArray
    last: IntArray
    floored: IntArray


class Record(NamedTuple):
    """What is kept of every sample, each (..., n, members); arrays deeper than ``depth`` are empty.

    Depth 0 keeps nothing, 1 the whitened innovations and their log scales (n_y), 2 also means (n_s), covariances
    (n_s, n_s), and expected outputs (n_y) with their covariance (n_y, n_y).
    """

    depth: int
    whitened: FloatArray
    log_scales: FloatArray
    predicted_mean: FloatArray
    predicted_cov: FloatArray
    filtered_mean: FloatArray
    filtered_cov: FloatArray
    cross_cov: FloatArray
    output_mean: FloatArray
    output_cov: FloatArray


class Work(NamedTuple):
    """Scratch of one thread.

    The belief: mean (n_s,), cov and its lower factor (n_s, n_s). Points (2 n_s + 1, n_s) and their outputs
    (2 n_s + 1, n_y). The scalar model's arguments: theta, x, u, y and the stages (3, n_x) of a step.
    """

    mean: FloatArray
    cov: FloatArray
    lower: FloatArray
    points: FloatArray
    outputs: FloatArray
    shift: FloatArray
    slopes: FloatArray
    output_mean: FloatArray
    output_cov: FloatArray
    joint: FloatArray
    innovation: FloatArray
    channels: IntArray
    theta: FloatArray
    x: FloatArray
    u: FloatArray
    y: FloatArray
    stages: FloatArray


def filter_members(
    advance: Advance,
    measure: Measure,
    log: Log,
    rules: Rules,
    members: Members,
    first: int,
    end: int,
    verdicts: Verdicts,
    record: Record,
    work: Work,
) -> None:
    """Filter the members ``first <= m < end`` over one log."""
    for m in range(first, end):
        _start(rules, members, m, work)
        nll = 0.0
        outcome = 0
        floored = 0
        last = -1
        for k in range(log.time.size):
            if k > 0:
                pivots = _predict(advance, log, rules, members, record, k, m, work)
                if pivots < 0:
                    outcome = -pivots
                    break
                floored += pivots
            pivots, cost = _update(measure, log, rules, members, record, k, m, work)
            if pivots < 0:
                outcome = -pivots
                break
            floored += pivots
            nll += cost
            last = k
        verdicts.nll[m] = nll if outcome == 0 else math.inf
        verdicts.outcome[m] = outcome
        verdicts.last[m] = last
        verdicts.floored[m] = floored


def _start(rules: Rules, members: Members, m: int, work: Work) -> None:
    """The prior: the belief at the first sample."""
    for i in range(work.theta.size):
        work.theta[i] = members.theta[i, m]
    n_x = work.x.size
    for i in range(work.mean.size):
        work.mean[i] = members.x0[i, m] if i < n_x else members.theta[rules.appended[i - n_x], m]
        for j in range(work.mean.size):
            work.cov[i, j] = 0.0
            work.lower[i, j] = 0.0
        work.cov[i, i] = members.initial_std[i, m] ** 2
        work.lower[i, i] = members.initial_std[i, m]


def _predict(
    advance: Advance, log: Log, rules: Rules, members: Members, record: Record, k: int, m: int, work: Work
) -> int:
    """Belief over the interval that ends at sample ``k``; floored pivots, or minus the code of a failure."""
    n_s = work.mean.size
    _draw(rules, work)
    interval = log.time[k] - log.time[k - 1]
    advance(
        log.time[k - 1],
        interval,
        log.substeps[k - 1],
        log.u_left[k - 1],
        log.u_right[k - 1],
        work.theta,
        rules.appended,
        work.points,
        work.x,
        work.stages,
        work.u,
    )
    if record.depth > 1:
        _keep_cross_cov(rules, record, k, m, work)
    _moments(rules, work.points, n_s, work.mean, work.cov, work.shift)
    for i in range(n_s):
        work.cov[i, i] += members.process_std[i, m] ** 2 * interval
        for j in range(i + 1):
            work.lower[i, j] = work.cov[i, j]
    return _factor(work.lower, n_s, 0, rules.pivot_floor)


def _update(
    measure: Measure, log: Log, rules: Rules, members: Members, record: Record, k: int, m: int, work: Work
) -> tuple[int, float]:
    """Belief after the measurement of sample ``k``; floored pivots or minus a failure's code, and its cost in nats."""
    n_s = work.mean.size
    measured = _find_measured(log.y, k, work.channels)
    if record.depth > 1:
        _keep_belief(record.predicted_mean, record.predicted_cov, k, m, work)
    if measured > 0 or record.depth > 1:
        _expect_outputs(measure, log, rules, members, k, m, work)
    pivots = 0
    cost = 0.0
    if measured > 0:
        _join(rules, measured, work)
        pivots = _factor(work.joint, measured + n_s, measured, rules.pivot_floor)
        if pivots >= 0:
            cost = _condition(log, k, measured, work)
    if record.depth > 0:
        _keep_innovations(record, k, m, measured, work)
    if record.depth > 1:
        _keep_outputs(record, k, m, work)
        _keep_belief(record.filtered_mean, record.filtered_cov, k, m, work)
    return pivots, cost


def _find_measured(y: FloatArray, k: int, channels: IntArray) -> int:
    """Number of channels measured at sample ``k``; their positions go into ``channels``."""
    measured = 0
    for a in range(channels.size):
        if not math.isnan(y[k, a]):
            channels[measured] = a
            measured += 1
    return measured


def _draw(rules: Rules, work: Work) -> None:
    """Sigma points of the belief."""
    n_s = work.mean.size
    for i in range(n_s):
        work.points[0, i] = work.mean[i]
    for j in range(n_s):
        for i in range(n_s):
            step = rules.spread * work.lower[i, j]
            work.points[1 + j, i] = work.mean[i] + step
            work.points[1 + n_s + j, i] = work.mean[i] - step


def _moments(rules: Rules, points: FloatArray, rows: int, mean: FloatArray, cov: FloatArray, shift: FloatArray) -> None:
    """Mean and covariance (lower and upper triangle) of points; the points become deviations from the first."""
    for i in range(rows):
        shift[i] = 0.0
        for j in range(rows):
            cov[i, j] = 0.0
    for p in range(1, points.shape[0]):
        for i in range(rows):
            points[p, i] -= points[0, i]
            shift[i] += points[p, i]
        for i in range(rows):
            for j in range(i + 1):
                cov[i, j] += points[p, i] * points[p, j]
    for i in range(rows):
        shift[i] *= rules.weight
        mean[i] = points[0, i] + shift[i]
    for i in range(rows):
        for j in range(i + 1):
            cov[i, j] = rules.weight * cov[i, j] + rules.correction * shift[i] * shift[j]
            cov[j, i] = cov[i, j]


def _expect_outputs(measure: Measure, log: Log, rules: Rules, members: Members, k: int, m: int, work: Work) -> None:
    """Expected outputs and their covariance with the noise; ``outputs`` holds deviations afterwards."""
    n_y = work.y.size
    _draw(rules, work)
    measure(log.time[k], log.u[k], work.theta, rules.appended, work.points, work.outputs, work.x, work.y)
    _moments(rules, work.outputs, n_y, work.output_mean, work.output_cov, work.slopes)
    for a in range(n_y):
        if not math.isnan(members.noise_std[a, m]):
            work.output_cov[a, a] += members.noise_std[a, m] ** 2


def _join(rules: Rules, measured: int, work: Work) -> None:
    """Lower triangle of the joint covariance of measured channels and state."""
    n_s = work.mean.size
    for row in range(measured):
        for column in range(row + 1):
            work.joint[row, column] = work.output_cov[work.channels[row], work.channels[column]]
    for column in range(measured):
        channel = work.channels[column]
        for j in range(n_s):
            difference = work.outputs[1 + j, channel] - work.outputs[1 + n_s + j, channel]
            work.slopes[j] = difference / (2.0 * rules.spread)
        for i in range(n_s):
            total = 0.0
            for j in range(i + 1):
                total += work.lower[i, j] * work.slopes[j]
            work.joint[measured + i, column] = total
    for i in range(n_s):
        for j in range(i + 1):
            work.joint[measured + i, measured + j] = work.cov[i, j]


def _condition(log: Log, k: int, measured: int, work: Work) -> float:
    """Belief given the measurement, from the factored joint covariance; its cost in nats."""
    n_s = work.mean.size
    cost = 0.0
    for row in range(measured):
        channel = work.channels[row]
        value = log.y[k, channel] - work.output_mean[channel]
        for column in range(row):
            value -= work.joint[row, column] * work.innovation[column]
        value /= work.joint[row, row]
        work.innovation[row] = value
        cost += 0.5 * (value * value + math.log(2.0 * math.pi)) + math.log(work.joint[row, row])
    for i in range(n_s):
        for column in range(measured):
            work.mean[i] += work.joint[measured + i, column] * work.innovation[column]
        for j in range(i + 1):
            work.lower[i, j] = work.joint[measured + i, measured + j]
    return cost


def _factor(matrix: FloatArray, size: int, required: int, pivot_floor: float) -> int:
    """Lower Cholesky factor in place; floored pivots, or minus a code: 1 not finite, 2 required pivot not positive."""
    floored = 0
    for j in range(size):
        variance = matrix[j, j]
        pivot = variance
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not math.isfinite(pivot):
            return -1
        if pivot > pivot_floor * variance:
            root = math.sqrt(pivot)
            matrix[j, j] = root
            for i in range(j + 1, size):
                total = matrix[i, j]
                for k in range(j):
                    total -= matrix[i, k] * matrix[j, k]
                matrix[i, j] = total / root
        elif j < required:
            return -2
        else:
            if variance > 0.0:
                floored += 1
            for i in range(j, size):
                matrix[i, j] = 0.0
    return floored


def _keep_cross_cov(rules: Rules, record: Record, k: int, m: int, work: Work) -> None:
    """Covariance between the state before (factor ``lower``) and after the interval (``points``, not yet centred)."""
    n_s = work.mean.size
    for i in range(n_s):
        for row in range(n_s):
            total = 0.0
            for j in range(i + 1):
                total += work.lower[i, j] * (work.points[1 + j, row] - work.points[1 + n_s + j, row])
            record.cross_cov[i, row, k, m] = total / (2.0 * rules.spread)


def _keep_belief(mean: FloatArray, cov: FloatArray, k: int, m: int, work: Work) -> None:
    n_s = work.mean.size
    for i in range(n_s):
        mean[i, k, m] = work.mean[i]
        for j in range(i + 1):
            total = 0.0
            for c in range(j + 1):
                total += work.lower[i, c] * work.lower[j, c]
            cov[i, j, k, m] = total
            cov[j, i, k, m] = total


def _keep_innovations(record: Record, k: int, m: int, measured: int, work: Work) -> None:
    for a in range(work.y.size):
        record.whitened[a, k, m] = 0.0
        record.log_scales[a, k, m] = 0.0
    for row in range(measured):
        record.whitened[work.channels[row], k, m] = work.innovation[row]
        record.log_scales[work.channels[row], k, m] = math.log(work.joint[row, row])


def _keep_outputs(record: Record, k: int, m: int, work: Work) -> None:
    for a in range(work.y.size):
        record.output_mean[a, k, m] = work.output_mean[a]
        for b in range(work.y.size):
            record.output_cov[a, b, k, m] = work.output_cov[a, b]
