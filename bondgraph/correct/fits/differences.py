"""Expansions of a likelihood by one-sided differences: half the evaluations of central ones, and so half the time.

The terms of a likelihood are smooth in the parameters, and the steps are a hundredth of a standard deviation, so that
what the curvature adds to a slope is far below what the data can tell (tests compare with central differences). The
exact derivatives of the filter (``estimate/exact.py``) are no cheaper here: every candidate is another model, and their
kernel takes ten times as long to compile as one fit by differences. The
gradient is formed from the slopes of the terms, never from differences of their sum, which would drown in rounding.
"""

from __future__ import annotations

import numpy as np

from bondgraph.estimate.objective import Expansion, FloatArray, Objective, Terms, expansion_of

#: Share of the steps of a search (a tenth of a standard deviation) that is used here.
_SHARE = 0.1
#: No step is smaller than this share of a coordinate's range.
_FINEST = 1e-10


def forward_differences(objective: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
    """Expansions at points, as :func:`bondgraph.estimate.objective.central_differences`, in one batch of evaluations.

    Parameters
    ----------
    objective
        The objective.
    points
        Where, shape (n, members), inside the bounds.
    steps
        Steps of a search, shape (n, members), positive; a tenth of them is used, away from a bound.

    Examples
    --------
    >>> class Line:
    ...     lower, upper = np.array([-10.0]), np.array([10.0])
    ...     def terms(self, points):
    ...         return Terms(2.0 * points - 6.0, np.zeros(points.shape))
    >>> (expansion,) = forward_differences(Line(), np.array([[0.0]]), np.array([[1e-4]]))
    >>> expansion.gradient.round(6).tolist(), expansion.information.round(6).tolist()
    ([-12.0], [[4.0]])
    """
    size, members = points.shape
    offsets = np.array([_offsets(objective, points[:, m], steps[:, m]) for m in range(members)])
    terms = objective.terms(_neighbours(points, offsets))
    found = []
    for m in range(members):
        own = terms.members(np.arange(m * (size + 1), (m + 1) * (size + 1)))
        found.append(_expansion(objective, points[:, m], offsets[m], own))
    return tuple(found)


def _offsets(objective: Objective, point: FloatArray, steps: FloatArray) -> FloatArray:
    """Signed differences, shape (n,): upwards, unless that leaves the box; zero for what is held fixed."""
    span = objective.upper - objective.lower
    size = np.minimum(np.maximum(_SHARE * steps, _FINEST * span), 0.25 * span)
    return np.where(point + size > objective.upper, -size, size)


def _neighbours(points: FloatArray, offsets: FloatArray) -> FloatArray:
    """Each point followed by its neighbours, shape (n, members * (n + 1))."""
    size = points.shape[0]
    blocks = []
    for m in range(points.shape[1]):
        block = np.repeat(points[:, m : m + 1], size + 1, axis=1)
        block[:, 1:] += np.diag(offsets[m])
        blocks.append(block)
    return np.concatenate(blocks, axis=1)


def _expansion(objective: Objective, point: FloatArray, offsets: FloatArray, terms: Terms) -> Expansion:
    failed = [j for j in np.flatnonzero(offsets) if not np.isfinite(terms.innovations[:, 1 + j]).all()]
    evaluations = terms.innovations.shape[1]
    innovations, log_scales = terms.innovations.copy(), terms.log_scales.copy()
    if failed:  # the model diverges on that side: look on the other
        offsets = offsets.copy()
        offsets[failed] *= -1.0
        other = np.clip(point + offsets, objective.lower, objective.upper)
        members = np.repeat(point[:, np.newaxis], len(failed), axis=1)
        members[failed, np.arange(len(failed))] = other[failed]
        offsets[failed] = other[failed] - point[failed]
        again = objective.terms(members)
        columns = [1 + j for j in failed]
        innovations[:, columns], log_scales[:, columns] = again.innovations, again.log_scales
        evaluations += len(failed)
    with np.errstate(divide="ignore", invalid="ignore"):
        for values in (innovations, log_scales):
            values[:, 1:] = (values[:, 1:] - values[:, :1]) / offsets
    dead = ~(np.isfinite(innovations[:, 1:]).all(axis=0) & (offsets != 0.0))
    innovations[:, 1:][:, dead] = 0.0
    log_scales[:, 1:][:, dead] = 0.0
    return expansion_of(innovations, log_scales, evaluations)
