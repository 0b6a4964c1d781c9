"""From the record of a filter on all nodes of a log to that on its samples, and what crosses from node to node.

Between two samples the state passes the nodes of the process noise. What one sample knows of the next follows from
what each node knows of the one after it: with the covariance P after node j, noise included, and C between the states
at j and j + 1, the transition is Phi = C' P^-1, and an interval's transition is the product of those of its steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.samples import Samples
from bondgraph.simulate.arrays import FloatArray

#: Eigenvalues of a correlation matrix below this share of the largest are rounding.
ROUNDING = 1e-11


@dataclass(frozen=True)
class NodeRecord:
    """The record of a filter on the nodes of a log.

    ``run`` has the nodes as its samples; ``samples`` the log; ``process_cov`` (n_s, n_s) the noise per second.
    """

    run: FilterRun
    samples: Samples
    process_cov: FloatArray

    def at_samples(self) -> FilterRun:
        """The record on the samples of the log, which keeps this one as its ``nodes``."""
        run, samples = self.run, self.samples
        if samples.sample.size == samples.time.size and not samples.noise_start.any():
            return replace(run, nodes=self)
        chosen = samples.sample
        names = ("predicted_mean", "predicted_cov", "filtered_mean", "filtered_cov", "output_mean", "output_cov")
        arrays = {name: getattr(run, name)[..., chosen] for name in (*names, "whitened", "log_scales")}
        return replace(
            run, time=run.time[chosen], y=run.y[:, chosen], cross_cov=self._cross_cov(), nodes=self, **arrays
        )

    def transitions(self) -> FloatArray:
        """Transitions (m-1, n_s, n_s) of the filter over each step, in the directions that are not known exactly."""
        cross = np.moveaxis(self.run.cross_cov[..., 1:], -1, 0)
        return np.swapaxes(solved(self.driven_cov(), cross), 1, 2)

    def noise_gathered(self, state: int) -> FloatArray:
        """Covariance (n-1, n_s, n_s) that noise of intensity one in a state leaves over each interval of the log."""
        samples, size = self.samples, self.process_cov.shape[0]
        moves = self.transitions()
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
        driven = self.driven_cov()
        found = np.full((edges.size, *self.process_cov.shape), np.nan)
        counts = np.diff(edges)
        for hop in range(int(np.max(counts, initial=0))):
            own = np.flatnonzero(counts > hop)
            step = edges[own] + hop
            if hop == 0 and not self.samples.noise_start.any():
                found[own + 1] = cross[step]
                continue
            reached = before[step] if hop == 0 else found[own + 1]
            found[own + 1] = reached @ solved(driven[step], cross[step])
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
    usable = np.isfinite(cov).all(axis=(1, 2)) & np.isfinite(cross).all(axis=(1, 2))
    known = ~(variance > 0.0)
    scale = np.where(known, 0.0, 1.0 / np.sqrt(np.where(known, 1.0, variance)))
    correlation = np.where(usable[:, np.newaxis, np.newaxis], cov * scale[:, :, np.newaxis] * scale[:, np.newaxis], 0.0)
    values, vectors = np.linalg.eigh(correlation)
    good = values > ROUNDING * values[:, -1:]
    inverse = np.where(good, 1.0 / np.where(good, values, 1.0), 0.0)
    scaled = scale[:, :, np.newaxis] * np.where(usable[:, np.newaxis, np.newaxis], cross, 0.0)
    found: FloatArray = vectors @ (inverse[:, :, np.newaxis] * (np.swapaxes(vectors, 1, 2) @ scaled))
    found = scale[:, :, np.newaxis] * found
    found[~usable] = np.nan
    return found
