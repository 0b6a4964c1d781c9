"""Linear algebra of the filter kernel for one member by itself; compiled from its text. Letters as in ``kernel``.

The lanes of ``kernel_algebra`` would be one long here, and its loops scalar. Inner loops run along rows of matrices
instead. Every sum is taken in the same order, so that a member alone and in a block has the same bits.
"""

from __future__ import annotations

import math

from bondgraph.arrays import FloatArray
from bondgraph.filter.kernel_types import Alone, Rules, Work


def _draw_alone(rules: Rules, alone: Alone) -> None:
    """Sigma points of the belief."""
    mean, lower, points = alone.mean, alone.lower, alone.points
    n_s = mean.size
    for i in range(n_s):
        points[0, i] = mean[i]
    for j in range(n_s):
        for i in range(n_s):
            step = rules.spread * lower[i, j]
            points[1 + j, i] = mean[i] + step
            points[1 + n_s + j, i] = mean[i] - step


def _spread_alone(alone: Alone) -> None:
    """Covariance of the belief from its factor."""
    cov, lower, upper = alone.cov, alone.lower, alone.upper
    n_s = alone.mean.size
    for i in range(n_s):
        for c in range(i + 1):
            upper[c, i] = lower[i, c]
    for i in range(n_s):
        for j in range(i + 1):
            cov[i, j] = lower[i, 0] * upper[0, j]
        for c in range(1, i + 1):
            share = lower[i, c]
            for j in range(c, i + 1):
                cov[i, j] += share * upper[c, j]
        for j in range(i):
            cov[j, i] = cov[i, j]


def _moments_alone(
    rules: Rules, points: FloatArray, mean: FloatArray, cov: FloatArray, shift: FloatArray, rows: int
) -> None:
    """Mean and covariance of points, which become deviations from the first."""
    for p in range(1, points.shape[0]):
        for i in range(rows):
            points[p, i] -= points[0, i]
    for i in range(rows):
        shift[i] = points[1, i] + points[2, i]
        for j in range(rows):
            first = points[1, i] * points[1, j]
            cov[i, j] = first + points[2, i] * points[2, j]
    for p in range(3, points.shape[0], 2):  # two at a time: points lie in pairs
        for i in range(rows):
            shift[i] = (shift[i] + points[p, i]) + points[p + 1, i]
            for j in range(rows):
                above = cov[i, j] + points[p, i] * points[p, j]
                cov[i, j] = above + points[p + 1, i] * points[p + 1, j]
    for i in range(rows):
        shift[i] *= rules.weight
        mean[i] = points[0, i] + shift[i]
    for i in range(rows):
        for j in range(i + 1):
            extra = rules.correction * shift[i] * shift[j]
            cov[i, j] = rules.weight * cov[i, j] + extra
            cov[j, i] = cov[i, j]


def _factor_alone(matrix: FloatArray, size: int, required: int, pivot_floor: float, work: Work) -> None:
    """Lower Cholesky factor in place, through its transpose, whose rows lie together; else as in ``kernel_algebra``."""
    upper = work.alone.upper
    for j in range(size):
        for i in range(j, size):
            upper[j, i] = matrix[i, j]
    for j in range(size):
        variance = upper[j, j]
        for k in range(j):
            share = upper[k, j]
            for i in range(j, size):
                upper[j, i] -= upper[k, i] * share
        pivot = upper[j, j]
        inverse = 0.0
        root = 0.0
        if pivot > pivot_floor * variance:
            root = math.sqrt(pivot)
            inverse = 1.0 / root
        if work.code[0] == 0 and inverse == 0.0:
            if not math.isfinite(pivot):
                work.code[0] = 1
            elif j < required:
                work.code[0] = 2
            elif variance > 0.0:
                work.floored[0] += 1
        upper[j, j] = root
        matrix[j, j] = root
        for i in range(j + 1, size):
            upper[j, i] *= inverse
            matrix[i, j] = upper[j, i]


def _join_alone(rules: Rules, measured: int, alone: Alone) -> None:
    """Lower triangle of the joint covariance of measured channels and state."""
    joint, lower, outputs, slopes = alone.joint, alone.lower, alone.outputs, alone.shift
    n_s = alone.mean.size
    for row in range(measured):
        for column in range(row + 1):
            joint[row, column] = alone.output_cov[alone.channels[row], alone.channels[column]]
    for column in range(measured):
        channel = alone.channels[column]
        for j in range(n_s):
            difference = outputs[1 + j, channel] - outputs[1 + n_s + j, channel]
            slopes[j] = difference / (2.0 * rules.spread)
        for i in range(n_s):
            total = lower[i, 0] * slopes[0]
            for j in range(1, i + 1):
                total += lower[i, j] * slopes[j]
            joint[measured + i, column] = total
    for i in range(n_s):
        for j in range(i + 1):
            joint[measured + i, measured + j] = alone.cov[i, j]


def _load_alone(buffer: FloatArray, row: int, lanes: int, points: FloatArray, first: int, n: int, i: int) -> None:
    """Bring an element of points from ``first`` on into a row of the buffer; lanes beyond the last repeat it."""
    last = points.shape[0] - 1
    count = min(n, last + 1 - first)
    for lane in range(count):
        buffer[row * lanes + lane] = points[first + lane, i]
    for lane in range(count, n):
        buffer[row * lanes + lane] = points[last, i]


def _store_alone(buffer: FloatArray, row: int, lanes: int, target: FloatArray, first: int, i: int) -> None:
    """Bring a row of the buffer back to the points from ``first`` on."""
    for p in range(first, min(first + lanes, target.shape[0])):
        target[p, i] = buffer[row * lanes + p - first]
