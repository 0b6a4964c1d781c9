"""The smoother over a long log: the filter's parts once more, from the last to the first.

A smoother goes backwards and needs what the filter knew: of every sample three covariances, of a day of a vehicle at 40
samples per second twelve gigabytes. So of the filter's way forwards is kept the belief in which each part began. On the
way back each part is filtered once more from there, smoothed, and let go: the filter's time twice, the memory of one
part, and the bits of a smoother that keeps all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter.bands import BandRecorder, Beliefs, FilterBands, PartFilter, filter_in_parts, gathered, stretch
from bondgraph.filter.batch import BatchRun
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.members import MemberBatch
from bondgraph.filter.samples import Samples
from bondgraph.filter.smoother import AbstractSmootherRun, smooth_back

#: Nodes of a part. Smoothing one works on several copies of its covariances: about a hundred megabytes of a machine
#: with a dozen states.
PART = 5_000


@dataclass(frozen=True, repr=False)
class SmootherBands(AbstractSmootherRun):
    """Record of a smoother over a long log, without covariances.

    Shapes: time (n,); ``smoothed_mean`` and ``smoothed_var`` (n_s, n), means and variances of the filter's state.
    ``filtered`` is the record of the filter.
    """

    filter_model: FilterModel
    log_name: str
    time: FloatArray
    smoothed_mean: FloatArray
    smoothed_var: FloatArray
    filtered: FilterBands


class _Checkpoint(NamedTuple):
    """Where a part began: its nodes, and the belief before it, as the filter goes on from it and as it is recorded."""

    begin: int
    end: int
    mean: FloatArray
    lower: FloatArray
    filtered_mean: FloatArray
    filtered_cov: FloatArray


def smoother_bands(
    filter_model: FilterModel, samples: Samples, batch: MemberBatch, told: Beliefs | None = None
) -> SmootherBands:
    """Bands of the compiled filter and of the smoother over a log, with the single member of a batch.

    Parameters
    ----------
    filter_model, samples, batch
        As for :func:`bondgraph.filter.bands.filter_bands`.
    told
        Called with every part of the log, the last one first: the samples it holds, their smoothed means (n_s, k) and
        covariances (n_s, n_s, k), which are not kept.

    Raises
    ------
    FilterError
        If the filter did not reach the end of the log.
    """
    checkpoints: list[_Checkpoint] = []

    def in_parts(recorder: BandRecorder) -> None:
        filter_part = PartFilter(filter_model, batch)
        checkpoints.clear()

        def began(begin: int, end: int) -> None:
            mean, lower = filter_part.belief
            checkpoints.append(_Checkpoint(begin, end, mean.copy(), lower.copy(), *recorder.ended))

        filter_in_parts(recorder, filter_part, PART, began)

    recorder, filtered = gathered(BandRecorder(filter_model, samples, batch, None), in_parts)
    return _smoothed(filtered.raise_if_failed(), recorder.samples, batch, checkpoints, told)


def _smoothed(
    filtered: FilterBands,
    samples: Samples,
    batch: MemberBatch,
    checkpoints: list[_Checkpoint],
    told: Beliefs | None,
) -> SmootherBands:
    """Part after part backwards, each from the smoothed belief at its last sample."""
    filter_part = PartFilter(filtered.filter_model, batch)
    means, variances = (np.full(filtered.filtered_mean.shape, np.nan) for _ in range(2))
    mean, cov = filtered.filtered_mean[:, -1], np.empty(0)
    for checkpoint in reversed(checkpoints):
        run = _filtered_again(filtered.filter_model, samples, batch, filter_part, checkpoint)
        if not cov.size:
            cov = run.filtered_cov[..., -1]
        own_mean, own_cov = np.empty_like(run.filtered_mean), np.empty_like(run.filtered_cov)
        own_mean[:, -1], own_cov[..., -1] = mean, cov
        smooth_back(run, own_mean, own_cov)
        mean, cov = own_mean[:, 0], own_cov[..., 0]
        # what comes first belongs to the part before, where there is one
        skipped = int(checkpoint.begin > 0)
        own = slice(*map(int, np.searchsorted(samples.sample, [checkpoint.begin, checkpoint.end])))
        means[:, own] = own_mean[:, skipped:]
        variances[:, own] = np.einsum("iik->ik", own_cov[..., skipped:])
        if told is not None:
            told(own, own_mean[:, skipped:], own_cov[..., skipped:])
    return SmootherBands(filtered.filter_model, filtered.log_name, filtered.time, means, variances, filtered)


def _filtered_again(
    filter_model: FilterModel, samples: Samples, batch: MemberBatch, filter_part: PartFilter, checkpoint: _Checkpoint
) -> FilterRun:
    """The full record of a part on its samples, after the last sample of the part before."""
    begin, end = checkpoint.begin, checkpoint.end
    filter_part.belief[0][:], filter_part.belief[1][:] = checkpoint.mean, checkpoint.lower
    record = filter_part.room(end - max(begin - 1, 0))
    first = filter_part.run(samples, begin, end, record)
    if begin > 0:
        record.filtered_mean[:, 0, 0] = checkpoint.filtered_mean
        record.filtered_cov[..., 0, 0] = checkpoint.filtered_cov
    there = samples.sample[(samples.sample >= first) & (samples.sample < end)] - first
    own = replace(stretch(samples, first, end), sample=there)
    return BatchRun(own, batch, filter_part.verdicts, record, np.zeros(1, dtype=np.bool_)).filter_run(filter_model, 0)
