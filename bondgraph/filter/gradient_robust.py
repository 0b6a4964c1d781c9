"""The update with robust measurements and its derivatives, the direction as the last axis; compiled from its text.

As :mod:`bondgraph.filter.kernel_robust`, step by step. The losses are smooth but where Huber and gate begin to act.
"""

from __future__ import annotations

import math

from bondgraph.arrays import FloatArray
from bondgraph.filter.gradient_types import Found, Prior, Scratch, TangentRules
from bondgraph.filter.kernel_robust import _precision, _precision_slope, _residual, _residual_slope


def _factor_robust_tangents(
    y: FloatArray, k: int, measured: int, rules: TangentRules, prior: Prior, found: Found, work: Scratch
) -> int:
    """Factor the joint covariance, the noise of each channel as its innovation asks; code of the outcome."""
    directions = work.d_pivot.size
    matrix, d_matrix, size = work.joint, work.d_joint, measured + work.mean.size
    for j in range(size):
        variance, pivot = matrix[j, j], matrix[j, j]
        for d in range(directions):
            work.d_pivot[d] = d_matrix[j, j, d]
        for c in range(j):
            pivot -= matrix[j, c] * matrix[j, c]
            for d in range(directions):
                work.d_pivot[d] -= 2.0 * matrix[j, c] * d_matrix[j, c, d]
        if not math.isfinite(pivot):
            return 1
        root = math.sqrt(pivot) if pivot > rules.pivot_floor * variance else 0.0
        if root == 0.0 and j < measured:
            return 2
        inverse = 1.0 / root if root > 0.0 else 0.0
        matrix[j, j] = root
        for d in range(directions):
            d_matrix[j, j, d] = 0.5 * inverse * work.d_pivot[d]
            work.d_pivot[d] *= -0.5 * inverse * inverse * inverse  # from here on that of the inverse
        if j < measured:
            inverse = _judge_tangents(y, k, j, inverse, rules, prior, found, work)
        for i in range(j + 1, size):
            for c in range(j):
                a, b = matrix[i, c], matrix[j, c]
                matrix[i, j] -= a * b
                for d in range(directions):
                    d_matrix[i, j, d] -= d_matrix[i, c, d] * b + a * d_matrix[j, c, d]
            for d in range(directions):
                d_matrix[i, j, d] = d_matrix[i, j, d] * inverse + matrix[i, j] * work.d_pivot[d]
            matrix[i, j] *= inverse
    return 0


def _judge_tangents(
    y: FloatArray, k: int, row: int, inverse: float, rules: TangentRules, prior: Prior, found: Found, work: Scratch
) -> float:
    """One over the standard deviation with which a channel counts, its derivatives in ``d_pivot``; the rest is kept."""
    robust, channel, directions = rules.robust, work.channels[row], work.d_pivot.size
    value = y[k, channel] - work.output_mean[channel]
    for d in range(directions):
        work.d_known[row, d] = -work.d_output_mean[channel, d]
    for c in range(row):
        factor, known = work.joint[row, c], work.known[c]
        value -= factor * known
        for d in range(directions):
            work.d_known[row, d] -= work.d_joint[row, c, d] * known + factor * work.d_known[c, d]
    z = value * inverse
    found.whitened[channel, k] = _residual(robust, z)
    found.log_scales[channel, k] = robust.constant - math.log(inverse)
    precision, noise = _precision(robust, z), prior.noise_cov[channel, channel]
    expected = work.joint[row, row] * work.joint[row, row] - noise
    whole = precision * expected + noise
    counted = math.sqrt(precision / whole)
    slope, fall = _residual_slope(robust, z), _precision_slope(robust, z)
    half = 0.5 / (counted * whole * whole) if counted > 0.0 else 0.0
    for d in range(directions):
        d_z = work.d_known[row, d] * inverse + value * work.d_pivot[d]
        found.d_whitened[channel, k, d] = slope * d_z
        found.d_log_scales[channel, k, d] = -work.d_pivot[d] / inverse
        d_noise = prior.d_noise_cov[channel, channel, d]
        d_expected = 2.0 * work.joint[row, row] * work.d_joint[row, row, d] - d_noise
        change = fall * d_z * noise - precision * precision * d_expected - precision * d_noise
        work.d_pivot[d] = half * change
        work.d_known[row, d] = work.d_known[row, d] * counted + value * work.d_pivot[d]
    work.known[row] = value * counted
    return counted


def _condition_robust_tangents(measured: int, work: Scratch) -> None:
    """Belief given the measurement, from the joint covariance factored above."""
    n_s, directions = work.d_mean.shape
    for i in range(n_s):
        for column in range(measured):
            known, gain = work.known[column], work.joint[measured + i, column]
            work.mean[i] += gain * known
            for d in range(directions):
                change = work.d_joint[measured + i, column, d] * known + gain * work.d_known[column, d]
                work.d_mean[i, d] += change
        for j in range(i + 1):
            work.lower[i, j] = work.joint[measured + i, measured + j]
            for d in range(directions):
                work.d_lower[i, j, d] = work.d_joint[measured + i, measured + j, d]
