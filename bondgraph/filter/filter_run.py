"""The record of a filter over one log: on its samples, and on the nodes of the process noise between them.

What one sample knows of the next follows from what each node knows of the one after it: with the covariance P after
node j, noise included, and C between the states at j and j + 1, the transition is Phi = C' P^-1, and an interval's
transition is the product of those of its steps.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bondgraph.arrays import BoolArray, FloatArray
from bondgraph.filter.abstract_run import AbstractRun
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.samples import Samples
from bondgraph.simulate.outcome import Outcome
from bondgraph.text import count

if TYPE_CHECKING:
    pass

#: Eigenvalues of a correlation matrix below this share of the largest are rounding.
ROUNDING = 1e-11


@dataclass(frozen=True, repr=False)
class FilterRun(AbstractRun):
    """Beliefs before and after each measurement, and what the measurements said.

    Shapes: time (n,); means (n_s, n) and covariances (n_s, n_s, n) of the filter's state, ``predicted`` before and
    ``filtered`` after the measurement of a sample; ``cross_cov`` (n_s, n_s, n) between the filtered state of the sample
    before and the predicted one; ``output_mean`` (n_y, n) and ``output_cov`` (n_y, n_y, n) expected of all channels,
    noise included (without it for channels that are not used); ``innovation`` (n_y, n), NaN where nothing was measured;
    ``whitened`` and ``log_scales`` (n_y, n) as in :class:`bondgraph.filter.belief.Update`.

    The prior is the belief at the first sample, which is updated without a prediction. After a failure everything is
    NaN, ``ended_at`` is the last time that was finished, and ``cause`` says more of it, where more is known. ``nodes``
    has the same on the nodes of the process noise.
    """

    filter_model: FilterModel
    log_name: str
    time: FloatArray
    y: FloatArray
    predicted_mean: FloatArray
    predicted_cov: FloatArray
    filtered_mean: FloatArray
    filtered_cov: FloatArray
    cross_cov: FloatArray
    output_mean: FloatArray
    output_cov: FloatArray
    whitened: FloatArray
    log_scales: FloatArray
    floored_pivots: int
    outcome: Outcome
    ended_at: float
    cause: str = ""
    nodes: NodeRecord | None = None

    @property
    def filtered_var(self) -> FloatArray:
        """Variances of the filtered states, shape (n_s, n)."""
        variances: FloatArray = np.einsum("iik->ik", self.filtered_cov)
        return variances

    @property
    def output_var(self) -> FloatArray:
        """Variances of the expected outputs, shape (n_y, n), noise included as in ``output_cov``."""
        variances: FloatArray = np.einsum("iik->ik", self.output_cov)
        return variances


@dataclass(frozen=True, repr=False)
class NodeRecord:
    """The record of a filter on the nodes of a log.

    ``run`` has the nodes as its samples; ``samples`` the log; ``process_cov`` (n_s, n_s) the noise per second.
    """

    run: FilterRun
    samples: Samples
    process_cov: FloatArray

    def __repr__(self) -> str:
        return f"<NodeRecord {self.run.log_name}: {count(self.run.time.size, 'node')}>"

    def at_samples(self) -> FilterRun:
        """The record on the samples of the log, which keeps this one as its ``nodes``."""
        run, samples = self.run, self.samples
        if samples.sample.size == samples.time.size and not samples.noise_start.any():
            return replace(run, nodes=self)
        chosen = samples.sample
        names = ("predicted_mean", "predicted_cov", "filtered_mean", "filtered_cov", "output_mean", "output_cov")
        arrays = {name: getattr(run, name)[..., chosen] for name in (*names, "whitened", "log_scales")}
        finished = np.searchsorted(run.time[chosen], run.ended_at, side="right") - 1
        return replace(
            run, time=run.time[chosen], y=run.y[:, chosen], cross_cov=self._cross_cov(), nodes=self,
            ended_at=float(run.time[chosen[max(int(finished), 0)]]), **arrays,
        )  # fmt: skip

    @functools.cached_property
    def transitions(self) -> FloatArray:
        """Transitions (m-1, n_s, n_s) of the filter over each step, in the directions that are not known exactly.

        They cost an eigenvalue problem for each step, and are kept for every noise that is carried through them.
        """
        cross = np.moveaxis(self.run.cross_cov[..., 1:], -1, 0)
        return np.swapaxes(solved(self.driven_cov(), cross), 1, 2)

    def noise_gathered(self, state: int) -> FloatArray:
        """Covariance (n-1, n_s, n_s) that noise of intensity one in a state leaves over each interval of the log."""
        samples, size = self.samples, self.process_cov.shape[0]
        moves = self.transitions
        gathered = np.zeros((samples.sample.size - 1, size, size))
        unit = np.zeros((size, size))
        unit[state, state] = 1.0
        edges = samples.sample
        longest = int(np.max(np.diff(edges), initial=0))
        for hop in range(longest):
            own = np.flatnonzero(np.diff(edges) > hop)
            step = edges[own] + hop
            begun = gathered[own] + unit * samples.noise_start[step, np.newaxis, np.newaxis]
            moved = moves[step] @ begun @ np.swapaxes(moves[step], 1, 2)
            gathered[own] = moved + unit * samples.noise_end[step, np.newaxis, np.newaxis]
        return gathered

    def driven_cov(self) -> FloatArray:
        """Covariances (m-1, n_s, n_s) from which the points of each step were drawn."""
        before = np.moveaxis(self.run.filtered_cov[..., :-1], -1, 0)
        return before + self.samples.noise_start[:, np.newaxis, np.newaxis] * self.process_cov

    def _cross_cov(self) -> FloatArray:
        """Covariance (n_s, n_s, n) between the state at a sample and that expected at the next."""
        edges = self.samples.sample
        cross = np.moveaxis(self.run.cross_cov[..., 1:], -1, 0)
        before = np.moveaxis(self.run.filtered_cov[..., :-1], -1, 0)
        found = np.full((edges.size, *self.process_cov.shape), np.nan)
        counts = np.diff(edges)
        for hop in range(int(np.max(counts, initial=0))):
            own = np.flatnonzero(counts > hop)
            step = edges[own] + hop
            reached = before[step] if hop == 0 else found[own + 1]
            without = (self.samples.noise_start[step] == 0.0) & (hop == 0)
            # a step without noise at its start begins at the sample itself
            gone = cross[step] if without.all() else reached @ np.swapaxes(self.transitions[step], 1, 2)
            gone[without] = cross[step[without]]
            found[own + 1] = gone
        return np.moveaxis(found, 0, -1)


def solved(cov: FloatArray, cross: FloatArray) -> FloatArray:
    """``cov^-1 cross`` for stacks (m, n, n); directions that are known up to rounding take no part.

    Scaled to unit variances first, since states in different units may differ by many orders of magnitude.

    Examples
    --------
    >>> solved(np.diag([4.0, 0.0])[np.newaxis], np.ones((1, 2, 2)))[0]
    array([[0.25, 0.25],
           [0.  , 0.  ]])
    """
    variance = np.einsum("kii->ki", cov)
    usable = np.asarray(np.isfinite(cov).all(axis=(1, 2)) & np.isfinite(cross).all(axis=(1, 2)))
    known = ~(variance > 0.0)
    scale = np.where(known, 0.0, 1.0 / np.sqrt(np.where(known, 1.0, variance)))
    correlation = np.where(usable[:, np.newaxis, np.newaxis], cov * scale[:, :, np.newaxis] * scale[:, np.newaxis], 0.0)
    scaled = scale[:, :, np.newaxis] * np.where(usable[:, np.newaxis, np.newaxis], cross, 0.0)
    found = _by_inverses(correlation, known | ~usable[:, np.newaxis], scaled)
    found *= scale[:, :, np.newaxis]
    found[~usable] = np.nan
    return found


def _by_inverses(correlation: FloatArray, known: BoolArray, scaled: FloatArray) -> FloatArray:
    """``correlation^-1 scaled`` for stacks (m, n, n); ``known`` (m, n) are rows and columns of zeros.

    An inverse serves where it shows that no direction is known up to rounding: it takes less than half the time.
    Eigenvalues tell of all others which directions are left out.
    """
    size = correlation.shape[1]
    filled = correlation.copy()
    np.einsum("kii->ki", filled)[known] = 1.0
    sure = np.zeros(filled.shape[0], dtype=bool)
    found = np.empty(scaled.shape)
    try:
        inverse = np.linalg.inv(filled)
        with np.errstate(over="ignore", invalid="ignore"):
            largest = np.sqrt(np.einsum("kij,kij->k", inverse, inverse))
        sure = largest * ROUNDING * size < 1.0  # no eigenvalue of a correlation is above its size
        np.matmul(inverse, scaled, out=found)
    except np.linalg.LinAlgError:  # one of them is singular: eigenvalues tell which
        pass
    left = np.flatnonzero(~sure)
    if left.size:
        values, vectors = np.linalg.eigh(correlation[left])
        good = values > ROUNDING * values[:, -1:]
        kept = np.where(good, 1.0 / np.where(good, values, 1.0), 0.0)
        found[left] = vectors @ (kept[:, :, np.newaxis] * (np.swapaxes(vectors, 1, 2) @ scaled[left]))
    return found
