"""How finely process noise must enter between two samples: chosen by what a coarser way would change.

Along a filtered log the model is linearised at some samples. There the covariance that the noise gathers over an
interval is known exactly (Van Loan 1978, Computing integrals involving the matrix exponential, IEEE Trans. Automatic
Control 23(3)), and that of every rule follows from the same linear model. The one with the fewest nodes serves that
misses it by no more than a share of the uncertainty which the filter has there anyway.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter.decay_rule import MOST_INSIDE
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.noise_nodes import continuous_nodes
from bondgraph.filter.planning import TOLERANCE, FilteredLog, filtered_logs
from bondgraph.filter.rates import jacobians, looked_at
from bondgraph.filter.samples import MeasuredLog

#: Decays that are faster than this, in an interval, are not followed: nothing that a sensor shows is so fast.
_FASTEST = 1024.0
#: Standard deviations by which a rule may shift an estimate of a stiff model, as certificates have it.
_SHIFT = 0.1

#: Terms of Taylor's series: 0.5^15 / 15! is below the last digit.
_TERMS = 14


def with_noise_nodes(filter_model: FilterModel, logs: Sequence[MeasuredLog], *, compiled: bool = True) -> FilterModel:
    """The filter model with as many nodes of process noise as its logs need, at the declared numbers.

    Parameters
    ----------
    filter_model
        With a method that is decided; one that nothing drives, or of the sampled scheme, is returned as it is.
    logs
        Logs along which the model is linearised.
    compiled
        Use the compiled model.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1})
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> with_noise_nodes(swing, [log], compiled=False).noise_nodes
    0
    """
    if filter_model.noise_rule[0] == "sampled":
        return filter_model
    inside, reach = noise_nodes_along(filtered_logs(filter_model, logs, compiled), strict=filter_model.is_stiff)
    return replace(filter_model, noise_nodes=inside, noise_reach=reach)


def noise_nodes_along(filtered: Sequence[FilteredLog], strict: bool = False) -> tuple[int, float]:
    """Nodes inside an interval and their reach for runs that are there already; the last rule where none is enough.

    ``strict``: so many that no certificate asks for more after a fit, whose noises may be others, for another fit of a
    stiff model is dear. N measurements tell a variance to sqrt(2/N) of itself, and what a rule misses shifts by as much
    of a standard deviation what is estimated beside it.
    """
    places = _Places.of(filtered, strict)
    if places is None:
        return (0, 0.0)
    measured = sum(int(np.isfinite(log.samples.y).sum()) for log in filtered)
    tolerance = min(TOLERANCE, _SHIFT * math.sqrt(2.0 / max(measured, 1))) if strict else TOLERANCE
    rules = [(0, 0.0), *itertools.product(range(1, MOST_INSIDE + 1), (0.0, places.reach))]
    return next((own for own in rules if places.are_served(own, tolerance)), rules[-1])


@dataclass(frozen=True)
class _Places:
    """Some samples along logs; time in shares of the median interval.

    ``slopes`` (m, n, n) are Jacobians, ``noise`` (m, n, n) covariances per interval, ``exact`` (m, n, n) what noise
    leaves, and ``sizes`` (m, n, n) products of the standard deviations that a filter has there anyway, or of those that
    the noise alone leaves.
    """

    slopes: FloatArray
    noise: FloatArray
    exact: FloatArray
    sizes: FloatArray

    @classmethod
    def of(cls, filtered: Sequence[FilteredLog], alone: bool) -> _Places | None:
        """The places along filtered logs; None where there are none."""
        parts = [part for log in filtered if (part := _looked_at(log)) is not None]
        if not parts or not sum(len(slopes) for slopes, _, _ in parts):
            return None
        slopes, noise, known = (np.concatenate(own) for own in zip(*parts, strict=True))
        with np.errstate(all="ignore"):
            exact = np.array([gathered_noise(own, added, 1.0) for own, added in zip(slopes, noise, strict=True)])
            whole = exponentials(slopes)
            # the uncertainty at the end is that of the linear model, since a run with too few nodes misses it
            at_end = exact if alone else whole @ known @ np.swapaxes(whole, 1, 2) + exact
            std = np.sqrt(np.maximum(np.diagonal(at_end, axis1=1, axis2=2), 0.0))
        return cls(slopes, noise, exact, std[:, :, np.newaxis] * std[:, np.newaxis, :])

    @property
    def reach(self) -> float:
        """How far nodes must reach, as a power of two: a covariance decays twice as fast as what it is of.

        All decays count, also those that hardly matter with the noises from which a fit begins.
        """
        fastest = 2.0 * float(np.max(-np.linalg.eigvals(self.slopes).real, initial=1.0))
        return min(2.0 ** math.ceil(math.log2(fastest)), _FASTEST)

    def are_served(self, rule: tuple[int, float], tolerance: float) -> bool:
        """True for a rule that gathers the noise of an interval everywhere to a share of the uncertainty there."""
        nodes = continuous_nodes(np.array([0.0, 1.0]), *rule)
        with np.errstate(all="ignore"):
            gathered = np.zeros(self.noise.shape)
            for length, start, end in zip(np.diff(nodes.time), nodes.start, nodes.end, strict=True):
                move = exponentials(self.slopes * length)
                gathered = move @ (gathered + start * self.noise) @ np.swapaxes(move, 1, 2) + end * self.noise
            return not bool(np.any(np.abs(gathered - self.exact) > tolerance * self.sizes))


def _looked_at(log: FilteredLog) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Jacobian and noise of an interval, and the covariance after the measurement, at some samples of a log."""
    if log.run.time.size < 2:
        return None
    assert log.run.nodes is not None
    sample = log.samples.sample
    chosen = np.unique(np.searchsorted(sample, looked_at(log.samples)))
    chosen = chosen[chosen < log.run.time.size - 1]
    slopes = jacobians(log.run, log.samples, log.batch.theta[:, 0], sample[chosen])
    n_x = slopes.shape[1]
    interval = float(np.median(np.diff(log.run.time)))
    noise = log.run.nodes.process_cov[:n_x, :n_x]
    known = np.moveaxis(log.run.filtered_cov[:n_x, :n_x, chosen], -1, 0)
    usable = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(known).all(axis=(1, 2))
    several = np.broadcast_to(noise * interval, (int(usable.sum()), n_x, n_x))
    return slopes[usable] * interval, several, known[usable]


def gathered_noise(slope: FloatArray, noise: FloatArray, interval: float) -> FloatArray:
    """Covariance that noise of some intensity leaves in a linear model over an interval (Van Loan 1978).

    Parameters
    ----------
    slope
        Jacobian of the rates (n, n), 1/s.
    noise
        Covariance per second, (n, n).
    interval
        Length, s.

    Examples
    --------
    >>> gathered_noise(np.array([[-6.0]]), np.array([[1.0]]), 5.0).round(6)
    array([[0.083333]])
    """
    size = slope.shape[0]
    # doubled from a short interval on, since the block form overflows for fast rates
    norm = float(np.linalg.norm(slope, 1)) * interval
    doublings = max(0, math.ceil(math.log2(max(norm, 1e-300))))
    part = interval / 2.0**doublings
    block = np.block([[-slope, noise], [np.zeros((size, size)), slope.T]]) * part
    found = exponentials(block[np.newaxis])[0]
    move = found[size:, size:].T
    gathered = move @ found[:size, size:]
    for _ in range(doublings):
        gathered = gathered + move @ gathered @ move.T
        move = move @ move
    symmetric: FloatArray = 0.5 * (gathered + gathered.T)
    return symmetric


def exponentials(matrices: FloatArray) -> FloatArray:
    """Exponentials of a stack of matrices (m, n, n): Taylor's series of a part, squared.

    Halved until its norm is below 1/2, a part needs 14 terms for the last digit. scipy's ``expm`` hands every single
    matrix to the threads of a BLAS, which takes a hundred times longer on a machine that is busy.

    Examples
    --------
    >>> exponentials(np.array([[[0.0, 1.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, np.log(2.0)]]])).round(12).tolist()
    [[[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 2.0]]]
    """
    norms = np.max(np.sum(np.abs(matrices), axis=1), axis=1, initial=0.0)
    halvings = np.maximum(0, np.ceil(np.log2(np.maximum(norms, 1e-300))) + 1).astype(np.int64)
    part = matrices / (2.0**halvings)[:, np.newaxis, np.newaxis]
    found = unit = np.broadcast_to(np.eye(matrices.shape[1]), matrices.shape)
    for term in range(_TERMS, 0, -1):
        found = unit + part @ found / term
    for turn in range(int(np.max(halvings, initial=0))):
        found = np.where((turn < halvings)[:, np.newaxis, np.newaxis], found @ found, found)
    return found
