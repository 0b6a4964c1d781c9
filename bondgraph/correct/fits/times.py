"""The times of the terms of a likelihood, and how much sums over all of them scatter under coloured noise.

The variance of a sum of dependent values is that of the long run, the sum of all their covariances. It is estimated as
Andrews and Monahan (1992), Econometrica 60(4), do: each series is first whitened by an autoregression of order one,
which takes out most of a colour whose memory is longer than any block; sums of what is left over blocks of time are
nearly independent, and their scatter is coloured again by one over the square of one less the correlation. Without
colour nothing is taken out, and nothing of the power of a test is lost.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np

from bondgraph.correct.constants import BLOCKS, LONGEST_MEMORY
from bondgraph.data.log import FloatArray
from bondgraph.estimate.problem import EstimationProblem


@dataclass(frozen=True)
class Times:
    """Sample of each term (n_terms,), -1 for priors, which have no time; of each sample its block and log (samples,).

    Examples
    --------
    >>> Times(np.array([0, 1, 2, 0, 1, 2, -1]), np.array([0, 0, 1]), np.zeros(3, dtype=int)).series(np.ones((7, 1)))
    array([[2.],
           [2.],
           [2.]])
    """

    sample: np.ndarray
    block: np.ndarray
    log: np.ndarray

    def series(self, pieces: FloatArray) -> FloatArray:
        """Rows (n_terms, n) summed at each sample, shape (samples, n)."""
        sums = np.zeros((self.block.size, pieces.shape[1]))
        for rows, samples in self._runs:
            sums[samples] += pieces[rows]
        return sums

    @functools.cached_property
    def _runs(self) -> tuple[tuple[slice, slice], ...]:
        """Stretches of terms whose samples follow each other, as slices of both: adding them needs no sorting."""
        edges = np.flatnonzero(np.diff(self.sample) != 1) + 1
        return tuple(
            (slice(first, end), slice(int(self.sample[first]), int(self.sample[end - 1]) + 1))
            for first, end in itertools.pairwise([0, *map(int, edges), self.sample.size])
            if end > first and self.sample[first] >= 0
        )

    def sums(self, series: FloatArray) -> FloatArray:
        """Sums over blocks of time of series (samples, n), whitened and coloured again; shape (blocks, n)."""
        centred = series - series.mean(axis=0)
        follows = np.flatnonzero(np.diff(self.log) == 0) + 1
        before, after = centred[follows - 1], centred[follows]
        power = np.maximum((before**2).sum(axis=0), np.finfo(float).tiny)
        correlation = np.clip((before * after).sum(axis=0) / power, 0.0, LONGEST_MEMORY)
        white = centred * np.sqrt((1.0 + correlation) / (1.0 - correlation))
        white[follows] = (after - correlation * before) / (1.0 - correlation)
        return summed(white, self.block, int(self.block.max()) + 1)


def summed(rows: FloatArray, index: np.ndarray, count: int) -> FloatArray:
    """Sums of rows (m, n) that share an index (m,) below ``count``, shape (count, n)."""
    order = np.argsort(index, kind="stable")
    sums = np.zeros((count, rows.shape[1]))
    present, first = np.unique(index[order], return_index=True)
    if order.size:
        sums[present] = np.add.reduceat(rows[order], first, axis=0)
    return sums


def term_times(problem: EstimationProblem, blocks: int = BLOCKS) -> Times:
    """Times of the terms of a problem, its logs cut into so many blocks of equal length."""
    total = sum(float(log.time[-1] - log.time[0]) for log in problem.logs)
    seconds = max(total / blocks, 1e-9)
    samples: list[np.ndarray] = []
    blocked: list[np.ndarray] = []
    first = count = 0
    for log in problem.logs:
        own = first + ((log.time - log.time[0]) / seconds).astype(np.int64)
        samples += [count + np.arange(log.time.size)] * log.y.shape[0]
        blocked.append(own)
        first, count = int(own.max()) + 1, count + log.time.size
    logs = np.repeat(np.arange(len(problem.logs)), [log.time.size for log in problem.logs])
    priors = sum(parameter.prior_mean is not None for parameter in problem.free)
    return Times(np.concatenate([*samples, np.full(priors, -1)]), np.concatenate(blocked), logs)
