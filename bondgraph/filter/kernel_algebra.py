"""Linear algebra of the filter kernel for lanes side by side; compiled from its text. Letters as in ``kernel``."""

from __future__ import annotations

import math

from bondgraph.arrays import FloatArray
from bondgraph.filter.kernel_alone import _moments_alone
from bondgraph.filter.kernel_types import Members, Rules, Work


def _draw(rules: Rules, work: Work) -> None:
    """Sigma points of the belief."""
    n_s, lanes = work.mean.shape
    for i in range(n_s):
        for lane in range(lanes):
            work.points[0, i, lane] = work.mean[i, lane]
    for j in range(n_s):
        for i in range(n_s):
            for lane in range(lanes):
                step = rules.spread * work.lower[i, j, lane]
                work.points[1 + j, i, lane] = work.mean[i, lane] + step
                work.points[1 + n_s + j, i, lane] = work.mean[i, lane] - step


def _spread(work: Work) -> None:
    """Covariance of the belief from its factor."""
    n_s, lanes = work.mean.shape
    for i in range(n_s):
        for j in range(i + 1):
            for lane in range(lanes):
                work.cov[i, j, lane] = work.lower[i, 0, lane] * work.lower[j, 0, lane]
            for c in range(1, j + 1):
                for lane in range(lanes):
                    work.cov[i, j, lane] += work.lower[i, c, lane] * work.lower[j, c, lane]
            for lane in range(lanes):
                work.cov[j, i, lane] = work.cov[i, j, lane]


def _drive(members: Members, seconds: float, work: Work) -> None:
    """Add the process noise of some seconds to the covariance, whose lower triangle then waits to be factored."""
    n_s, lanes = work.mean.shape
    for i in range(n_s):
        for j in range(i + 1):
            for lane in range(lanes):
                work.cov[i, j, lane] += members.process_cov[i, j, work.who[lane]] * seconds
                work.lower[i, j, lane] = work.cov[i, j, lane]
            for lane in range(lanes):
                work.cov[j, i, lane] = work.cov[i, j, lane]


def _moments(rules: Rules, points: FloatArray, mean: FloatArray, cov: FloatArray, shift: FloatArray) -> None:
    """Mean and covariance (lower and upper triangle) of points; the points become deviations from the first."""
    rows, lanes = mean.shape
    for p in range(1, points.shape[0]):
        for i in range(rows):
            for lane in range(lanes):
                points[p, i, lane] -= points[0, i, lane]
    # sums begin with their first term: setting few lanes to zero is a call each
    for i in range(rows):
        for lane in range(lanes):
            shift[i, lane] = points[1, i, lane] + points[2, i, lane]
        for j in range(i + 1):
            for lane in range(lanes):
                first = points[1, i, lane] * points[1, j, lane]
                cov[i, j, lane] = first + points[2, i, lane] * points[2, j, lane]
    for p in range(3, points.shape[0], 2):  # two at a time: points lie in pairs
        for i in range(rows):
            for lane in range(lanes):
                shift[i, lane] = (shift[i, lane] + points[p, i, lane]) + points[p + 1, i, lane]
            for j in range(i + 1):
                for lane in range(lanes):
                    above = cov[i, j, lane] + points[p, i, lane] * points[p, j, lane]
                    cov[i, j, lane] = above + points[p + 1, i, lane] * points[p + 1, j, lane]
    for i in range(rows):
        for lane in range(lanes):
            shift[i, lane] *= rules.weight
            mean[i, lane] = points[0, i, lane] + shift[i, lane]
    for i in range(rows):
        for j in range(i + 1):
            for lane in range(lanes):
                extra = rules.correction * shift[i, lane] * shift[j, lane]
                cov[i, j, lane] = rules.weight * cov[i, j, lane] + extra
                cov[j, i, lane] = cov[i, j, lane]


def _expect(rules: Rules, members: Members, work: Work) -> None:
    """Expected outputs and their covariance with the noise; ``outputs`` holds deviations afterwards."""
    n_y, lanes = work.output_mean.shape
    if lanes == 1:
        one = work.alone
        _moments_alone(rules, one.outputs, one.output_mean, one.output_cov, one.shift, n_y)
    else:
        _moments(rules, work.outputs, work.output_mean, work.output_cov, work.shift)
    for a in range(n_y):
        for b in range(n_y):
            for lane in range(lanes):
                work.output_cov[a, b, lane] += members.noise_cov[a, b, work.who[lane]]


def _join(rules: Rules, measured: int, work: Work) -> None:
    """Lower triangle of the joint covariance of measured channels and state."""
    n_s, lanes = work.mean.shape
    for row in range(measured):
        for column in range(row + 1):
            a, b = work.channels[row], work.channels[column]
            for lane in range(lanes):
                work.joint[row, column, lane] = work.output_cov[a, b, lane]
    for column in range(measured):
        channel = work.channels[column]
        for j in range(n_s):
            for lane in range(lanes):
                difference = work.outputs[1 + j, channel, lane] - work.outputs[1 + n_s + j, channel, lane]
                work.slopes[j, lane] = difference / (2.0 * rules.spread)
        for i in range(n_s):
            for lane in range(lanes):
                work.joint[measured + i, column, lane] = work.lower[i, 0, lane] * work.slopes[0, lane]
            for j in range(1, i + 1):
                for lane in range(lanes):
                    work.joint[measured + i, column, lane] += work.lower[i, j, lane] * work.slopes[j, lane]
    for i in range(n_s):
        for j in range(i + 1):
            for lane in range(lanes):
                work.joint[measured + i, measured + j, lane] = work.cov[i, j, lane]


def _condition(y: FloatArray, k: int, measured: int, work: Work) -> None:
    """Belief given the measurement, from the factored joint covariance; its cost in nats is added."""
    n_s, lanes = work.mean.shape
    for row in range(measured):
        channel = work.channels[row]
        for lane in range(lanes):
            work.innovation[row, lane] = y[k, channel] - work.output_mean[channel, lane]
        for column in range(row):
            for lane in range(lanes):
                work.innovation[row, lane] -= work.joint[row, column, lane] * work.innovation[column, lane]
        for lane in range(lanes):
            value = work.innovation[row, lane] / work.joint[row, row, lane]
            work.innovation[row, lane] = value
            scale = math.log(work.joint[row, row, lane])
            work.nll[lane] += 0.5 * (value * value + math.log(2.0 * math.pi)) + scale
    for i in range(n_s):
        for column in range(measured):
            for lane in range(lanes):
                work.mean[i, lane] += work.joint[measured + i, column, lane] * work.innovation[column, lane]
        for j in range(i + 1):
            for lane in range(lanes):
                work.lower[i, j, lane] = work.joint[measured + i, measured + j, lane]


def _factor(matrix: FloatArray, size: int, required: int, pivot_floor: float, work: Work) -> None:
    """Lower Cholesky factor in place; floored pivots are counted.

    The code of a lane becomes 1 where a pivot is not finite, 2 where one of the first ``required`` is not positive.
    """
    lanes = work.mean.shape[1]
    for j in range(size):
        for lane in range(lanes):
            work.pivot[lane] = matrix[j, j, lane]
        for k in range(j):
            for lane in range(lanes):
                work.pivot[lane] -= matrix[j, k, lane] * matrix[j, k, lane]
        for lane in range(lanes):
            variance, pivot = matrix[j, j, lane], work.pivot[lane]
            inverse = 0.0
            root = 0.0
            if pivot > pivot_floor * variance:
                root = math.sqrt(pivot)
                inverse = 1.0 / root
            if work.code[lane] == 0 and inverse == 0.0:
                if not math.isfinite(pivot):
                    work.code[lane] = 1
                elif j < required:
                    work.code[lane] = 2
                elif variance > 0.0:
                    work.floored[lane] += 1
            matrix[j, j, lane] = root
            work.pivot[lane] = inverse
        for i in range(j + 1, size):
            for k in range(j):
                for lane in range(lanes):
                    matrix[i, j, lane] -= matrix[i, k, lane] * matrix[j, k, lane]
            for lane in range(lanes):
                matrix[i, j, lane] = matrix[i, j, lane] * work.pivot[lane]
