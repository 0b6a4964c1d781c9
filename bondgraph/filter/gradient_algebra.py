"""Moments and factors with their derivatives, the direction as the last axis; compiled from their text."""

from __future__ import annotations

import math

from bondgraph.arrays import FloatArray
from bondgraph.filter.gradient_types import Scratch, TangentRules


def _moments(
    rules: TangentRules,
    points: FloatArray,
    d_points: FloatArray,
    mean: FloatArray,
    d_mean: FloatArray,
    cov: FloatArray,
    d_cov: FloatArray,
    shift: FloatArray,
    d_shift: FloatArray,
) -> None:
    """Mean and lower triangle of the covariance of points; the points become deviations from the first."""
    rows, directions = d_mean.shape
    for i in range(rows):
        shift[i] = 0.0
        for d in range(directions):
            d_shift[i, d] = 0.0
        for j in range(i + 1):
            cov[i, j] = 0.0
            for d in range(directions):
                d_cov[i, j, d] = 0.0
    for p in range(1, points.shape[0]):
        for i in range(rows):
            points[p, i] -= points[0, i]
            shift[i] += points[p, i]
            for d in range(directions):
                d_points[p, i, d] -= d_points[0, i, d]
                d_shift[i, d] += d_points[p, i, d]
            for j in range(i + 1):
                a, b = points[p, i], points[p, j]
                cov[i, j] += a * b
                for d in range(directions):
                    d_cov[i, j, d] += d_points[p, i, d] * b + a * d_points[p, j, d]
    for i in range(rows):
        shift[i] *= rules.weight
        mean[i] = points[0, i] + shift[i]
        for d in range(directions):
            d_shift[i, d] *= rules.weight
            d_mean[i, d] = d_points[0, i, d] + d_shift[i, d]
        for j in range(i + 1):
            cov[i, j] = rules.weight * cov[i, j] + rules.correction * shift[i] * shift[j]
            for d in range(directions):
                extra = d_shift[i, d] * shift[j] + shift[i] * d_shift[j, d]
                d_cov[i, j, d] = rules.weight * d_cov[i, j, d] + rules.correction * extra


def _cov_of_factor(i: int, j: int, measured: int, work: Scratch) -> None:
    """An element of the state's covariance from its factor."""
    total = 0.0
    for c in range(j + 1):
        total += work.lower[i, c] * work.lower[j, c]
    work.joint[measured + i, measured + j] = total
    for d in range(work.d_mean.shape[1]):
        work.d_joint[measured + i, measured + j, d] = 0.0
    for c in range(j + 1):
        a, b = work.lower[i, c], work.lower[j, c]
        for d in range(work.d_mean.shape[1]):
            change = work.d_lower[i, c, d] * b + a * work.d_lower[j, c, d]
            work.d_joint[measured + i, measured + j, d] += change


def _factor(
    matrix: FloatArray, d_matrix: FloatArray, size: int, required: int, pivot_floor: float, d_pivot: FloatArray
) -> int:
    """Lower Cholesky factor in place with its derivatives; code 1 not finite, 2 required pivot not positive, 0 good."""
    directions = d_pivot.size
    for j in range(size):
        variance = matrix[j, j]
        pivot = variance
        for d in range(directions):
            d_pivot[d] = d_matrix[j, j, d]
        for k in range(j):
            factor = matrix[j, k]
            pivot -= factor * factor
            for d in range(directions):
                d_pivot[d] -= 2.0 * factor * d_matrix[j, k, d]
        if not math.isfinite(pivot):
            return 1
        root = math.sqrt(pivot) if pivot > pivot_floor * variance else 0.0
        if root == 0.0 and j < required:
            return 2
        inverse = 1.0 / root if root > 0.0 else 0.0
        matrix[j, j] = root
        for d in range(directions):
            d_pivot[d] *= 0.5 * inverse
            d_matrix[j, j, d] = d_pivot[d]
        for i in range(j + 1, size):
            for k in range(j):
                a, b = matrix[i, k], matrix[j, k]
                matrix[i, j] -= a * b
                for d in range(directions):
                    d_matrix[i, j, d] -= d_matrix[i, k, d] * b + a * d_matrix[j, k, d]
            matrix[i, j] *= inverse
            value = matrix[i, j]
            for d in range(directions):
                d_matrix[i, j, d] = (d_matrix[i, j, d] - value * d_pivot[d]) * inverse
    return 0
