"""Expansions of a likelihood by differences of its terms: central ones, and one-sided ones at half their cost.

One-sided ones are for the fits of a closed loop. The terms of a likelihood are smooth in the parameters, and the steps
are a hundredth of a standard deviation, so that what the curvature adds to a slope is far below what the data can tell
(tests compare with central differences). The exact derivatives of the filter
(:mod:`bondgraph.estimate.derivatives.exact`) are no cheaper here: every candidate is another model, and their kernel
takes ten times as long to compile as one fit by differences. The gradient is formed from the slopes of the terms, never
from differences of their sum, which would drown in rounding.
"""

from __future__ import annotations

import numpy as np

from bondgraph.estimate.objective import Expansion, FloatArray, Objective, Terms, expansion_of

#: Share of the steps of a search (a tenth of a standard deviation) that is used here.
_SHARE = 0.1
#: No step is smaller than this share of a coordinate's range.
_FINEST = 1e-10


def central_differences(objective: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
    """Expansions by differences of the scalar terms, of second order also at a bound.

    Parameters
    ----------
    objective
        The objective.
    points
        Where, shape (n, members), inside the bounds.
    steps
        Difference steps, shape (n, members), positive.

    Examples
    --------
    >>> class Line:
    ...     lower, upper = np.array([-10.0]), np.array([10.0])
    ...     def terms(self, points):
    ...         return Terms(2.0 * points - 6.0, np.zeros(points.shape))
    >>> (expansion,) = central_differences(Line(), np.array([[0.0]]), np.array([[1e-4]]))
    >>> expansion.gradient.round(6).tolist(), expansion.information.round(6).tolist()
    ([-12.0], [[4.0]])
    """
    return tuple(_expand_one(objective, points[:, member], steps[:, member]) for member in range(points.shape[1]))


def _expand_one(objective: Objective, point: FloatArray, step: FloatArray) -> Expansion:
    free = np.flatnonzero(objective.upper > objective.lower)
    offsets = [_either_side(point[j], step[j], objective.lower[j], objective.upper[j]) for j in free]
    members = np.repeat(point[:, np.newaxis], 2 * free.size + 1, axis=1)
    for k, j in enumerate(free):
        members[j, 2 * k + 1 : 2 * k + 3] += offsets[k]
    terms = objective.terms(members)
    innovations = np.zeros((terms.innovations.shape[0], 1 + point.size))
    log_scales = np.zeros(innovations.shape)
    innovations[:, 0], log_scales[:, 0] = terms.innovations[:, 0], terms.log_scales[:, 0]
    for k, j in enumerate(free):
        weights = _weights(members[j, 2 * k + 1 : 2 * k + 3] - point[j], terms.innovations[:, 2 * k + 1 : 2 * k + 3])
        columns = [0, 2 * k + 1, 2 * k + 2]
        used = [column for column, weight in zip(columns, weights, strict=True) if weight != 0.0]
        kept = np.array([weight for weight in weights if weight != 0.0])
        innovations[:, 1 + j] = terms.innovations[:, used] @ kept
        log_scales[:, 1 + j] = terms.log_scales[:, used] @ kept
    return expansion_of(innovations, log_scales, members.shape[1])


def forward_differences(objective: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
    """Expansions at points, as :func:`central_differences`, in one batch of evaluations.

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
    offsets = np.array([_one_sided(objective, points[:, m], steps[:, m]) for m in range(members)])
    terms = objective.terms(_neighbours(points, offsets))
    found = []
    for m in range(members):
        own = terms.members(np.arange(m * (size + 1), (m + 1) * (size + 1)))
        found.append(_expansion(objective, points[:, m], offsets[m], own))
    return tuple(found)


def _one_sided(objective: Objective, point: FloatArray, steps: FloatArray) -> FloatArray:
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


def _either_side(value: float, step: float, lower: float, upper: float) -> tuple[float, float]:
    """Two points for a derivative: either side, or both on the inner side of a bound."""
    step = min(step, 0.25 * (upper - lower))
    if value - step < lower:
        return step, 2.0 * step
    if value + step > upper:
        return -step, -2.0 * step
    return step, -step


def _weights(offsets: FloatArray, values: FloatArray) -> tuple[float, float, float]:
    """Weights of the value itself and of two neighbours in its derivative; a neighbour that failed gets none."""
    a, b = float(offsets[0]), float(offsets[1])
    good_a, good_b = (bool(np.isfinite(values[:, column]).all()) for column in (0, 1))
    if good_a and good_b:
        # Derivative at 0 of the parabola through (0, a, b).
        return -(a + b) / (a * b), b / (a * (b - a)), -a / (b * (b - a))
    if good_a:
        return -1.0 / a, 1.0 / a, 0.0
    if good_b:
        return -1.0 / b, 0.0, 1.0 / b
    return 0.0, 0.0, 0.0
