"""Losses of robust measurements by kind, and the update they make of a belief; compiled from its text.

A loss rho(z) of an innovation z over its own standard deviation takes the place of z^2/2. Kinds: 1 Student t,
(first)/2 log(1 + second z^2); 2 Huber, quadratic to ``first`` and straight beyond; 3 gate, quadratic to ``first`` and
constant beyond; the last two times ``second``. See :mod:`bondgraph.filter.robust`; letters
as in ``kernel``.
"""

from __future__ import annotations

import math

from bondgraph.arrays import FloatArray
from bondgraph.filter.kernel_types import Members, Robustness, Rules, Work


def _loss(robust: Robustness, z: float) -> float:
    """Loss of a normalised innovation, nats."""
    size = abs(z)
    if robust.kind == 1:
        return 0.5 * robust.first * math.log1p(robust.second * z * z)
    if size <= robust.first:
        return 0.5 * robust.second * z * z
    if robust.kind == 2:
        return robust.second * robust.first * (size - 0.5 * robust.first)
    return 0.5 * robust.second * robust.first * robust.first


def _score(robust: Robustness, z: float) -> float:
    """Slope of the loss."""
    if robust.kind == 1:
        return robust.first * robust.second * z / (1.0 + robust.second * z * z)
    if abs(z) <= robust.first:
        return robust.second * z
    return math.copysign(robust.second * robust.first, z) if robust.kind == 2 else 0.0


def _precision(robust: Robustness, z: float) -> float:
    """Share of the declared precision (one over the variance) of its noise with which a value counts."""
    if robust.kind == 1:
        return robust.first * robust.second / (1.0 + robust.second * z * z)
    if abs(z) <= robust.first:
        return 1.0
    return robust.first / abs(z) if robust.kind == 2 else 0.0


def _precision_slope(robust: Robustness, z: float) -> float:
    """Derivative of the precision by the innovation."""
    if robust.kind == 1:
        fall = 1.0 + robust.second * z * z
        return -2.0 * robust.first * robust.second * robust.second * z / (fall * fall)
    if robust.kind == 2 and abs(z) > robust.first:
        return -robust.first / (z * abs(z))
    return 0.0


def _residual(robust: Robustness, z: float) -> float:
    """The residual whose half square is the loss, with the sign of the innovation."""
    return math.copysign(math.sqrt(2.0 * _loss(robust, z)), z)


def _residual_slope(robust: Robustness, z: float) -> float:
    """Derivative of the residual by the innovation."""
    residual = _residual(robust, z)
    if abs(residual) > 1e-8:
        return _score(robust, z) / residual
    return math.sqrt(robust.first * robust.second if robust.kind == 1 else robust.second)


def _factor_robust(y: FloatArray, k: int, measured: int, rules: Rules, members: Members, work: Work) -> None:
    """Factor the joint covariance of measured channels and state, the noise of each channel as its innovation asks.

    Channel after channel: the factor so far makes the next innovation independent of those before it; then its noise
    gets its variance over its precision, and the elimination goes on. Codes of failure as in ``kernel_algebra``.
    """
    n_s, lanes = work.mean.shape
    matrix, size = work.joint, measured + n_s
    for j in range(size):
        for lane in range(lanes):
            variance, pivot = matrix[j, j, lane], matrix[j, j, lane]
            for c in range(j):
                pivot -= matrix[j, c, lane] * matrix[j, c, lane]
            inverse = 0.0
            if pivot > rules.pivot_floor * variance:
                inverse = 1.0 / math.sqrt(pivot)
            if work.code[lane] == 0 and inverse == 0.0:
                if not math.isfinite(pivot):
                    work.code[lane] = 1
                elif j < measured:
                    work.code[lane] = 2
                elif variance > 0.0:
                    work.floored[lane] += 1
            matrix[j, j, lane] = pivot * inverse
            if j < measured:
                inverse = _judge(y[k, work.channels[j]], j, lane, inverse, rules.robust, members, work)
            for i in range(j + 1, size):
                value = matrix[i, j, lane]
                for c in range(j):
                    value -= matrix[i, c, lane] * matrix[j, c, lane]
                matrix[i, j, lane] = value * inverse


def _judge(
    measured: float, row: int, lane: int, inverse: float, robust: Robustness, members: Members, work: Work
) -> float:
    """One over the standard deviation with which the innovation of a channel counts; what it says is noted."""
    channel = work.channels[row]
    value = measured - work.output_mean[channel, lane]
    for c in range(row):
        value -= work.joint[row, c, lane] * work.innovation[c, lane]
    z = value * inverse
    work.residual[row, lane] = _residual(robust, z)
    work.log_scale[row, lane] = robust.constant - math.log(inverse) if inverse > 0.0 else 0.0
    precision, noise = _precision(robust, z), members.noise_cov[channel, channel, work.who[lane]]
    if inverse > 0.0:
        expected = work.joint[row, row, lane] * work.joint[row, row, lane] - noise
        inverse = math.sqrt(precision / (precision * expected + noise))
    work.innovation[row, lane] = value * inverse
    return inverse


def _condition_robust(measured: int, work: Work) -> None:
    """Belief given the measurement, from the joint covariance factored above; its cost in nats is added."""
    n_s, lanes = work.mean.shape
    for row in range(measured):
        for lane in range(lanes):
            value = work.residual[row, lane]
            work.nll[lane] += 0.5 * (value * value + math.log(2.0 * math.pi)) + work.log_scale[row, lane]
    for i in range(n_s):
        for column in range(measured):
            for lane in range(lanes):
                work.mean[i, lane] += work.joint[measured + i, column, lane] * work.innovation[column, lane]
        for j in range(i + 1):
            for lane in range(lanes):
                work.lower[i, j, lane] = work.joint[measured + i, measured + j, lane]
