"""How well an optimum is known: covariance, intervals, and what the data cannot tell apart.

The covariance of a maximum-likelihood estimate is the inverse of the curvature of the negative log-likelihood. It is
taken by differences along directions in which the Fisher information is the unit matrix, so that one step, a third of
a standard deviation, suits all of them; where that curvature is not positive the Fisher information itself is used.

Directions along which the data leave more than the bounds do are named instead of inverted.

The same values tell whether the likelihood is as smooth as its derivatives say. A Rosenbrock step takes the Jacobian
where it starts; where a law has a kink that jumps, and so does the step, and the likelihood by up to a tenth of a nat.
Its derivatives are exact between the jumps (on a vehicle with a gripping belt differences by 1e-7 of a parameter agree
with them to 3e-6, those by 1e-5 miss them by as much as their size; with Runge-Kutta steps both agree to 3e-5), yet say
little about what lies a third of a standard deviation away.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bondgraph.estimate.objective import BoolArray, Expansion, FloatArray, Objective

#: Curvature is measured over this many standard deviations.
_REACH = 0.3
#: Smallest reach that bounds may force before the Fisher information is preferred.
_LEAST_REACH = 0.01
#: A direction is not identifiable when its standard deviation is more than that of a uniform law over the bounds.
_WEAK = 12.0
#: Share of the largest eigenvalue below which an eigenvalue is rounding.
_ROUNDING = 1e-12
#: Coordinates belong to a weak group when they take this share of its direction.
_SHARE = 0.1
#: Within this share of its bounds a coordinate lies at a bound.
_AT_BOUND = 1e-6


class UncertaintyOutcome(enum.Enum):
    """Where a covariance comes from; the value is the message."""

    CURVATURE = "from the curvature of the negative log-likelihood at the optimum"
    FISHER = (
        "from the Fisher information: the likelihood is not curved like that of an optimum here"
        " - search longer, or look at its profiles"
    )
    NOT_AVAILABLE = "not available: the likelihood cannot be expanded at this point"


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of an optimum in the coordinates of its objective.

    ``covariance`` (n, n) is NaN for coordinates that are not identifiable; ``at_bound`` (n,) marks those that rest on a
    bound, whose variance is Fisher's and uncorrelated; ``groups`` holds indices of coordinates that the data cannot
    tell apart (or, alone, not at all); ``evaluations`` counts what it took. ``roughness`` is how far off, in standard
    deviations, values around the optimum say that it is, over what its gradient says; NaN where none were taken.
    """

    covariance: FloatArray
    at_bound: BoolArray
    groups: tuple[tuple[int, ...], ...]
    outcome: UncertaintyOutcome
    evaluations: int
    roughness: float = math.nan


def uncertainty(objective: Objective, point: FloatArray, expansion: Expansion, curvature: bool = True) -> Uncertainty:
    """Uncertainty of an optimum.

    Parameters
    ----------
    objective
        What was minimised.
    point
        The optimum, shape (n,).
    expansion
        Gradient and Fisher information there.
    curvature
        Measure the curvature, at m^2 + m + 1 evaluations for m interior coordinates; else use the Fisher information.

    Examples
    --------
    >>> class Bowl:
    ...     lower, upper = np.full(2, -5.0), np.full(2, 5.0)
    ...     def nll(self, points):
    ...         return 0.5 * (25.0 * points[0] ** 2 + 4.0 * points[1] ** 2)
    >>> expansion = Expansion(np.zeros(2), np.diag([20.0, 5.0]), 0)
    >>> uncertainty(Bowl(), np.zeros(2), expansion).covariance.round(6).tolist()
    [[0.04, 0.0], [0.0, 0.25]]
    """
    size = point.size
    width = objective.upper - objective.lower
    at_bound = (point - objective.lower <= _AT_BOUND * width) | (objective.upper - point <= _AT_BOUND * width)
    if not np.isfinite(expansion.information).all():
        empty = np.full((size, size), np.nan)
        return Uncertainty(empty, at_bound, (), UncertaintyOutcome.NOT_AVAILABLE, 0)
    scaled = expansion.information * np.outer(width, width)
    groups = weak_groups(scaled)
    weak = np.isin(np.arange(size), [index for group in groups for index in group])
    fisher = _strong_inverse(scaled) * np.outer(width, width)
    covariance = np.where(np.outer(at_bound, at_bound), np.diag(np.diag(fisher)), 0.0)
    interior = np.flatnonzero(~at_bound)
    inner = _strong_inverse(scaled[np.ix_(interior, interior)])
    block, outcome = inner * np.outer(width[interior], width[interior]), UncertaintyOutcome.FISHER
    curved = _Curved(None, 0, math.nan)
    if curvature and interior.size:
        curved = _from_curvature(objective, point, scaled, interior, expansion.gradient[interior])
        if curved.covariance is not None:
            block, outcome = curved.covariance, UncertaintyOutcome.CURVATURE
    elif not interior.size:
        outcome = UncertaintyOutcome.CURVATURE
    covariance[np.ix_(interior, interior)] = block
    covariance[weak, :] = np.nan
    covariance[:, weak] = np.nan
    return Uncertainty(covariance, at_bound, groups, outcome, curved.evaluations, curved.roughness)


def weak_groups(scaled: FloatArray) -> tuple[tuple[int, ...], ...]:
    """Groups of coordinates that the information (n, n), in units of the bounds' widths, does not tell apart.

    Coordinates that share a weak direction belong together. The projector on all weak directions says which do,
    whatever basis of these directions an eigenvalue solver returns. A small share of a direction of which the data say
    nothing counts as well: it leaves a coordinate as unknown as its bounds do.

    Examples
    --------
    >>> weak_groups(1e6 * np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    ((0, 1),)
    """
    values, vectors = np.linalg.eigh(scaled)
    weak, known = vectors[:, _is_weak(values)], values[_is_weak(values)]
    projector = np.abs(weak @ weak.T)
    shares = np.sqrt(np.diag(projector))
    # Information below the rounding of the largest eigenvalue cannot be told from none.
    least = values.size * np.finfo(float).eps * float(values.max(initial=0.0))
    left: FloatArray = np.sum(weak**2 / np.maximum(known, max(least, np.finfo(float).tiny)), axis=1)
    members = np.flatnonzero((shares > _SHARE) | (left > 1.0 / _WEAK))
    together = projector > _SHARE * np.minimum(_SHARE, np.outer(shares, shares))
    groups: list[list[int]] = []
    for index in members:
        joined = [group for group in groups if any(together[index, other] for other in group)]
        merged = sorted([int(index), *(other for group in joined for other in group)])
        groups = [*(group for group in groups if group not in joined), merged]
    return tuple(tuple(group) for group in sorted(groups))


def _is_weak(values: FloatArray) -> BoolArray:
    weak: BoolArray = values < max(_WEAK, _ROUNDING * float(values.max(initial=0.0)))
    return weak


def _strong_inverse(scaled: FloatArray) -> FloatArray:
    """Inverse of an information on the directions of which the data say something.

    Where they say something of all, the inverse is that of the factors of the correlations: eigenvalues are right to
    the rounding of the largest only, which costs a nearly collinear pair (Bennett5 of NIST) its sixth digit.
    """
    values, vectors = np.linalg.eigh(scaled)
    strong = ~_is_weak(values)
    if strong.all():
        scale = np.sqrt(np.diag(scaled))
        half = np.linalg.solve(np.linalg.cholesky(scaled / np.outer(scale, scale)), np.diag(1.0 / scale))
        return half.T @ half
    inverse: FloatArray = (vectors[:, strong] / values[strong]) @ vectors[:, strong].T
    return inverse


class _Curved(NamedTuple):
    """Covariance (m, m) by the curvature, None where that is not positive; what it took; see ``Uncertainty``."""

    covariance: FloatArray | None
    evaluations: int
    roughness: float


def _from_curvature(
    objective: Objective,
    point: FloatArray,
    scaled: FloatArray,
    interior: np.ndarray[tuple[int], np.dtype[np.intp]],
    gradient: FloatArray,
) -> _Curved:
    """Covariance of the m interior coordinates from second differences, with their gradient (m,) to compare."""
    width = (objective.upper - objective.lower)[interior]
    values, vectors = np.linalg.eigh(scaled[np.ix_(interior, interior)])
    strong = ~_is_weak(values)
    # Columns are moves of one standard deviation each, uncorrelated under the Fisher information.
    moves = width[:, np.newaxis] * vectors[:, strong] / np.sqrt(values[strong])
    room = np.minimum(point - objective.lower, objective.upper - point)[interior]
    reaches = np.minimum(_REACH, 0.5 * np.min(room[:, np.newaxis] / np.maximum(np.abs(moves), 1e-300), axis=0))
    if not strong.any() or reaches.min() < _LEAST_REACH:
        return _Curved(None, 0, math.nan)
    slopes, hessian, spent = _differences(objective, point, interior, moves * reaches)
    roughness = float(np.max(np.abs(slopes / reaches - gradient @ moves)))
    hessian /= np.outer(reaches, reaches)
    if not np.isfinite(hessian).all() or np.linalg.eigvalsh(hessian).min() < 0.05:
        return _Curved(None, spent, roughness)
    return _Curved(moves @ np.linalg.inv(hessian) @ moves.T, spent, roughness)


def _differences(
    objective: Objective, point: FloatArray, interior: np.ndarray[tuple[int], np.dtype[np.intp]], moves: FloatArray
) -> tuple[FloatArray, FloatArray, int]:
    """First differences (k,) of the objective along moves (m, k), second ones along pairs, all in one batch.

    Along a move and its opposite for each, and along the sum of two moves and its opposite for each pair: second order
    in the length of the moves at k^2 + k + 1 values (Abramowitz and Stegun 1964, 25.3.27).
    """
    count = moves.shape[1]
    pairs = [(a, b) for a in range(count) for b in range(a)]
    offsets = [np.zeros(moves.shape[0])]
    offsets += [sign * moves[:, a] for a in range(count) for sign in (1.0, -1.0)]
    offsets += [sign * (moves[:, a] + moves[:, b]) for a, b in pairs for sign in (1.0, -1.0)]
    members = np.repeat(point[:, np.newaxis], len(offsets), axis=1)
    members[interior] += np.array(offsets).T
    values = objective.nll(members)
    curved = values[1::2] + values[2::2] - 2.0 * values[0]
    hessian = np.diag(curved[:count])
    for (a, b), along_both in zip(pairs, curved[count:], strict=True):
        hessian[a, b] = hessian[b, a] = 0.5 * (along_both - curved[a] - curved[b])
    slopes: FloatArray = 0.5 * (values[1 : 1 + 2 * count : 2] - values[2 : 2 + 2 * count : 2])
    return slopes, hessian, members.shape[1]
