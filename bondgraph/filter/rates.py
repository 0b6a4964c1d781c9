"""How fast a model is along the logs that a filter ran over."""

from __future__ import annotations

import numpy as np

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.samples import Samples

#: Points along each log at which rates are looked at.
_POINTS = 40


def looked_at(samples: Samples) -> IntArray:
    """The nodes at which rates are looked at: starts of steps."""
    return np.unique(np.linspace(0, max(samples.time.size - 2, 0), _POINTS).astype(np.int64))


def fastest_rates(
    filtered: FilterRun, samples: Samples, theta: FloatArray | None, chosen: IntArray | None = None
) -> FloatArray:
    """Largest magnitude of an eigenvalue of the Jacobian at some nodes of a filtered log, 1/s; by default even ones.

    Infinite where the filter or the Jacobian is not finite.
    """
    slopes = jacobians(filtered, samples, theta, looked_at(samples) if chosen is None else chosen)
    usable = np.isfinite(slopes).all(axis=(1, 2))
    rates = np.full(slopes.shape[0], np.inf)
    rates[usable] = np.max(np.abs(np.linalg.eigvals(slopes[usable])), axis=1, initial=0.0)
    return rates


def jacobians(filtered: FilterRun, samples: Samples, theta: FloatArray | None, chosen: IntArray) -> FloatArray:
    """Derivatives (chosen, n_x, n_x) of the rates by the states at nodes of a filtered log; NaN where it failed."""
    filter_model = filtered.filter_model
    model = filter_model.model
    n_x = len(model.states)
    parameters = samples.theta(filter_model, np.array(model.theta() if theta is None else theta, dtype=np.float64))
    means = filtered.filtered_mean if filtered.nodes is None else filtered.nodes.run.filtered_mean
    states = means[:, chosen]
    known = np.repeat(parameters[:, np.newaxis], chosen.size, axis=1)
    known[filter_model.appended_index] = states[n_x:]
    with np.errstate(all="ignore"):
        slopes = model.jacobian_x(samples.time[chosen], states[:n_x], samples.u[:, chosen], known)
    return np.where(np.isfinite(states).all(axis=0), slopes, np.nan).transpose(2, 0, 1)
