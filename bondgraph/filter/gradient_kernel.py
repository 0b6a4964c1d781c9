"""The filter of one member with its derivatives in several directions at once; compiled from its text.

Every quantity of the filter carries its derivatives, with the direction as the last axis D: forward differentiation of
the same steps as in ``kernel``, so that what comes out is the derivative of the number that the filter computes. The
derivative of a Cholesky factor follows from that of its recursion (Smith 1995, Differentiation of the Cholesky
algorithm, J. Comp. Graph. Stat. 4(2)). The sigma points are the lanes of the model's functions.
"""

from __future__ import annotations

import math

from bondgraph.arrays import FloatArray
from bondgraph.filter.gradient_algebra import _cov_of_factor, _factor, _moments
from bondgraph.filter.gradient_robust import _condition_robust_tangents, _factor_robust_tangents
from bondgraph.filter.gradient_types import Found, Prior, Scratch, TangentEquations, TangentRules
from bondgraph.filter.kernel_channels import _find_measured
from bondgraph.filter.kernel_types import Log


def filter_with_tangents(
    equations: TangentEquations, log: Log, rules: TangentRules, prior: Prior, found: Found, work: Scratch
) -> int:
    """Filter one member over one log; code of the outcome."""
    _start(equations, rules, prior, work)
    for k in range(log.time.size):
        n_s = work.mean.size
        if k > 0:
            if log.noise_start[k - 1] > 0.0:
                _spread(work)
                _drive(prior, log.noise_start[k - 1], work)
                code = _factor(work.lower, work.d_lower, n_s, 0, rules.pivot_floor, work.d_pivot)
                if code > 0:
                    return code
            _predict(equations, log, rules, prior, k, work)
            _drive(prior, log.noise_end[k - 1], work)
            code = _factor(work.lower, work.d_lower, n_s, 0, rules.pivot_floor, work.d_pivot)
            if code > 0:
                return code
        measured = _find_measured(log.y, k, work.channels)
        for a in range(work.output_mean.size):
            found.whitened[a, k] = 0.0
            found.log_scales[a, k] = 0.0
            for d in range(work.d_mean.shape[1]):
                found.d_whitened[a, k, d] = 0.0
                found.d_log_scales[a, k, d] = 0.0
        if measured > 0:
            _expect(equations, log, rules, prior, k, work)
            _join(rules, measured, work)
            if rules.robust.kind > 0:
                code = _factor_robust_tangents(log.y, k, measured, rules, prior, found, work)
            else:
                code = _factor(work.joint, work.d_joint, measured + n_s, measured, rules.pivot_floor, work.d_pivot)
            if code > 0:
                return code
            if rules.robust.kind > 0:
                _condition_robust_tangents(measured, work)
            else:
                _condition(log.y, k, measured, found, work)
    return 0


def _start(equations: TangentEquations, rules: TangentRules, prior: Prior, work: Scratch) -> None:
    """The prior, and the parameters in all lanes."""
    for i in range(work.mean.size):
        work.mean[i] = prior.x0[i]
        for d in range(work.d_mean.shape[1]):
            work.d_mean[i, d] = prior.d_x0[i, d]
        for j in range(work.mean.size):
            work.lower[i, j] = prior.initial_lower[i, j]
            for d in range(work.d_mean.shape[1]):
                work.d_lower[i, j, d] = prior.d_initial_lower[i, j, d]
    for i in range(prior.theta.size):
        for lane in range(rules.lanes):
            work.buffer[(rules.theta + i) * rules.lanes + lane] = prior.theta[i]
    equations.prepare(work.buffer, rules.lanes)


def _spread(work: Scratch) -> None:
    """Lower triangle of the covariance from its factor, in place."""
    n_s = work.mean.size
    for i in range(n_s):
        for j in range(i + 1):
            _cov_of_factor(i, j, 0, work)
    for i in range(n_s):
        for j in range(i + 1):
            work.lower[i, j] = work.joint[i, j]
            for d in range(work.d_mean.shape[1]):
                work.d_lower[i, j, d] = work.d_joint[i, j, d]


def _drive(prior: Prior, seconds: float, work: Scratch) -> None:
    """Add the process noise of some seconds to the lower triangle of the covariance."""
    for i in range(work.mean.size):
        for j in range(i + 1):
            work.lower[i, j] += prior.process_cov[i, j] * seconds
            for d in range(work.d_mean.shape[1]):
                work.d_lower[i, j, d] += prior.d_process_cov[i, j, d] * seconds


def _draw(rules: TangentRules, work: Scratch) -> None:
    """Sigma points of the belief and their derivatives."""
    n_s, directions = work.d_mean.shape
    for i in range(n_s):
        work.points[0, i] = work.mean[i]
        for d in range(directions):
            work.d_points[0, i, d] = work.d_mean[i, d]
    for j in range(n_s):
        for i in range(n_s):
            step = rules.spread * work.lower[i, j]
            work.points[1 + j, i] = work.mean[i] + step
            work.points[1 + n_s + j, i] = work.mean[i] - step
            for d in range(directions):
                d_step = rules.spread * work.d_lower[i, j, d]
                work.d_points[1 + j, i, d] = work.d_mean[i, d] + d_step
                work.d_points[1 + n_s + j, i, d] = work.d_mean[i, d] - d_step


def _load(rules: TangentRules, first: int, work: Scratch) -> int:
    """Bring points from ``first`` on into the buffer; the number of lanes to work on, a multiple of eight."""
    last = work.points.shape[0] - 1
    n: int = (min(rules.lanes, last + 1 - first) + 7) // 8 * 8
    for i in range(work.mean.size):
        for lane in range(n):
            work.buffer[(rules.x + i) * rules.lanes + lane] = work.points[min(first + lane, last), i]
    return n


def _predict(equations: TangentEquations, log: Log, rules: TangentRules, prior: Prior, k: int, work: Scratch) -> None:
    """Mean and covariance over the step that ends at node ``k``, into ``mean`` and ``lower``, without its noise."""
    _draw(rules, work)
    n_s, directions = work.d_mean.shape
    interval = log.time[k] - log.time[k - 1]
    last = work.points.shape[0] - 1
    for first in range(0, last + 1, rules.lanes):
        n = _load(rules, first, work)
        for d in range(directions):
            for i in range(n_s):
                for lane in range(n):
                    work.directions[d, i * rules.lanes + lane] = work.d_points[min(first + lane, last), i, d]
        equations.advance(
            log.time[k - 1],
            interval,
            log.substeps[k - 1],
            log.grading[k - 1],
            rules.tableau,
            log.u_left[k - 1],
            log.u_right[k - 1],
            work.clock,
            work.inputs,
            prior.seeds,
            work.directions,
            work.buffer,
            n,
        )
        for p in range(first, min(first + n, last + 1)):
            for i in range(n_s):
                work.points[p, i] = work.buffer[(rules.x + i) * rules.lanes + p - first]
                for d in range(directions):
                    work.d_points[p, i, d] = work.directions[d, i * rules.lanes + p - first]
    _moments(
        rules, work.points, work.d_points, work.mean, work.d_mean, work.lower, work.d_lower, work.shift, work.d_shift
    )


def _expect(equations: TangentEquations, log: Log, rules: TangentRules, prior: Prior, k: int, work: Scratch) -> None:
    """Expected outputs and their covariance with the noise; the outputs become deviations."""
    n_y, directions = work.d_output_mean.shape
    _draw(rules, work)
    for i in range(log.u.shape[1]):
        work.inputs[i] = log.u[k, i]
    work.clock[0] = log.time[k]
    last = work.points.shape[0] - 1
    for first in range(0, last + 1, rules.lanes):
        n = _load(rules, first, work)
        equations.measure(work.clock, work.inputs, work.buffer, n)
        for a in range(n_y):
            for p in range(first, min(first + n, last + 1)):
                work.outputs[p, a] = work.buffer[(rules.y + a) * rules.lanes + p - first]
        for d in range(directions):
            for i in range(work.mean.size):
                for lane in range(n):
                    direction = work.d_points[min(first + lane, last), i, d]
                    work.buffer[(rules.din + i) * rules.lanes + lane] = direction
            equations.push(prior.seeds[d], work.buffer, n)
            for a in range(n_y):
                for p in range(first, min(first + n, last + 1)):
                    work.d_outputs[p, a, d] = work.buffer[(rules.dy + a) * rules.lanes + p - first]
    _moments(
        rules,
        work.outputs,
        work.d_outputs,
        work.output_mean,
        work.d_output_mean,
        work.output_cov,
        work.d_output_cov,
        work.shift,
        work.d_shift,
    )
    for a in range(n_y):
        for b in range(a + 1):
            work.output_cov[a, b] += prior.noise_cov[a, b]
            for d in range(directions):
                work.d_output_cov[a, b, d] += prior.d_noise_cov[a, b, d]


def _join(rules: TangentRules, measured: int, work: Scratch) -> None:
    """Lower triangle of the joint covariance of measured channels and state."""
    n_s, directions = work.d_mean.shape
    for row in range(measured):
        for column in range(row + 1):
            a, b = work.channels[row], work.channels[column]
            work.joint[row, column] = work.output_cov[a, b]
            for d in range(directions):
                work.d_joint[row, column, d] = work.d_output_cov[a, b, d]
    half = 0.5 / rules.spread
    for column in range(measured):
        channel = work.channels[column]
        for j in range(n_s):
            work.slopes[j] = half * (work.outputs[1 + j, channel] - work.outputs[1 + n_s + j, channel])
            for d in range(directions):
                difference = work.d_outputs[1 + j, channel, d] - work.d_outputs[1 + n_s + j, channel, d]
                work.d_slopes[j, d] = half * difference
        for i in range(n_s):
            row = measured + i
            work.joint[row, column] = 0.0
            for d in range(directions):
                work.d_joint[row, column, d] = 0.0
            for j in range(i + 1):
                factor, slope = work.lower[i, j], work.slopes[j]
                work.joint[row, column] += factor * slope
                for d in range(directions):
                    work.d_joint[row, column, d] += work.d_lower[i, j, d] * slope + factor * work.d_slopes[j, d]
    for i in range(n_s):
        for j in range(i + 1):
            _cov_of_factor(i, j, measured, work)


def _condition(y: FloatArray, k: int, measured: int, found: Found, work: Scratch) -> None:
    """Belief given the measurement, from the factored joint covariance; what it found is kept."""
    n_s, directions = work.d_mean.shape
    for row in range(measured):
        channel = work.channels[row]
        value = y[k, channel] - work.output_mean[channel]
        for d in range(directions):
            found.d_whitened[channel, k, d] = -work.d_output_mean[channel, d]
        for column in range(row):
            other = work.channels[column]
            z, factor = found.whitened[other, k], work.joint[row, column]
            value -= factor * z
            for d in range(directions):
                change = work.d_joint[row, column, d] * z + factor * found.d_whitened[other, k, d]
                found.d_whitened[channel, k, d] -= change
        inverse = 1.0 / work.joint[row, row]
        value *= inverse
        found.whitened[channel, k] = value
        found.log_scales[channel, k] = math.log(work.joint[row, row])
        for d in range(directions):
            slope = work.d_joint[row, row, d] * inverse
            found.d_log_scales[channel, k, d] = slope
            found.d_whitened[channel, k, d] = found.d_whitened[channel, k, d] * inverse - value * slope
    for i in range(n_s):
        for column in range(measured):
            channel = work.channels[column]
            z, gain = found.whitened[channel, k], work.joint[measured + i, column]
            work.mean[i] += gain * z
            for d in range(directions):
                change = work.d_joint[measured + i, column, d] * z + gain * found.d_whitened[channel, k, d]
                work.d_mean[i, d] += change
        for j in range(i + 1):
            work.lower[i, j] = work.joint[measured + i, measured + j]
            for d in range(directions):
                work.d_lower[i, j, d] = work.d_joint[measured + i, measured + j, d]
