"""Records that the filter kernel keeps of every sample; compiled from its text. Letters as in ``kernel``."""

from __future__ import annotations

import math
from typing import NamedTuple

from bondgraph.arrays import FloatArray
from bondgraph.filter.kernel_types import Rules, Work


class Record(NamedTuple):
    """What is kept of every sample, each (..., n, members); arrays deeper than ``depth`` are empty.

    Depth 0 keeps nothing, 1 the whitened innovations and their log scales (n_y), 2 also means (n_s), covariances
    (n_s, n_s), and expected outputs (n_y) with their covariance (n_y, n_y). What a member leaves after it has failed
    has no meaning.
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


def _keep_cross_cov(rules: Rules, record: Record, k: int, first: int, work: Work) -> None:
    """Covariance between the state before (factor ``lower``) and after the interval (``points``, not yet centred)."""
    n_s = work.mean.shape[0]
    for lane in range(min(work.mean.shape[1], record.cross_cov.shape[3] - first)):
        for i in range(n_s):
            for row in range(n_s):
                total = 0.0
                for j in range(i + 1):
                    difference = work.points[1 + j, row, lane] - work.points[1 + n_s + j, row, lane]
                    total += work.lower[i, j, lane] * difference
                record.cross_cov[i, row, k, first + lane] = total / (2.0 * rules.spread)


def _keep_belief(mean: FloatArray, cov: FloatArray, k: int, first: int, end: int, work: Work) -> None:
    n_s = work.mean.shape[0]
    for m in range(first, end):
        lane = m - first
        for i in range(n_s):
            mean[i, k, m] = work.mean[i, lane]
            for j in range(i + 1):
                total = 0.0
                for c in range(j + 1):
                    total += work.lower[i, c, lane] * work.lower[j, c, lane]
                cov[i, j, k, m] = total
                cov[j, i, k, m] = total


def _keep_innovations(rules: Rules, record: Record, k: int, first: int, end: int, measured: int, work: Work) -> None:
    for m in range(first, end):
        lane = m - first
        for a in range(work.output_mean.shape[0]):
            record.whitened[a, k, m] = 0.0
            record.log_scales[a, k, m] = 0.0
        for row in range(measured):
            channel = work.channels[row]
            if rules.robust.kind > 0:
                record.whitened[channel, k, m] = work.residual[row, lane]
                record.log_scales[channel, k, m] = work.log_scale[row, lane]
            else:
                record.whitened[channel, k, m] = work.innovation[row, lane]
                record.log_scales[channel, k, m] = math.log(work.joint[row, row, lane])


def _keep_outputs(record: Record, k: int, first: int, end: int, work: Work) -> None:
    n_y = work.output_mean.shape[0]
    for m in range(first, end):
        lane = m - first
        for a in range(n_y):
            record.output_mean[a, k, m] = work.output_mean[a, lane]
            for b in range(n_y):
                record.output_cov[a, b, k, m] = work.output_cov[a, b, lane]
