"""Numbers that carry their first and second derivatives, and the linear algebra of a filter on them.

A jet holds an array ``v`` of some shape, its derivatives ``d`` (*shape, D) in D directions, and ``h`` (*shape, D, D).
Griewank and Walther (2008), Evaluating Derivatives, chapter 13.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter.sigma_points import PIVOT_FLOOR, MerweScaled
from bondgraph.simulate.outcome import Outcome


@dataclass(frozen=True)
class Jet:
    """An array with its first and second derivatives; see the module.

    Examples
    --------
    >>> x = Jet(np.array(3.0), np.array([1.0]), np.zeros((1, 1)))
    >>> (x * x * x).h.tolist(), root(x * x).d.tolist()
    ([[18.0]], [1.0])
    """

    v: FloatArray
    d: FloatArray
    h: FloatArray

    @classmethod
    def still(cls, value: FloatArray, directions: int) -> Jet:
        """An array that does not move."""
        shape = np.shape(value)
        return cls(np.asarray(value), np.zeros((*shape, directions)), np.zeros((*shape, directions, directions)))

    def map(self, function: Callable[[FloatArray], FloatArray]) -> Jet:
        """A linear function of the array that leaves what stands behind its axes alone."""
        return Jet(function(self.v), function(self.d), function(self.h))

    def __getitem__(self, key: Any) -> Jet:
        return Jet(self.v[key], self.d[key], self.h[key])

    def __add__(self, other: Jet) -> Jet:
        return Jet(self.v + other.v, self.d + other.d, self.h + other.h)

    def __sub__(self, other: Jet) -> Jet:
        return Jet(self.v - other.v, self.d - other.d, self.h - other.h)

    def __mul__(self, other: Jet | float) -> Jet:
        """The product, element by element; arrays of one shape, or a number."""
        if not isinstance(other, Jet):
            return Jet(self.v * other, self.d * other, self.h * other)
        first = self.v[..., np.newaxis] * other.d + other.v[..., np.newaxis] * self.d
        second = self.v[..., np.newaxis, np.newaxis] * other.h + other.v[..., np.newaxis, np.newaxis] * self.h
        cross = self.d[..., :, np.newaxis] * other.d[..., np.newaxis, :]
        return Jet(self.v * other.v, first, second + cross + np.swapaxes(cross, -1, -2))

    def through(self, value: FloatArray, slope: FloatArray, bend: FloatArray) -> Jet:
        """A function with this value, slope and second derivative at each element."""
        cross = self.d[..., :, np.newaxis] * self.d[..., np.newaxis, :]
        own = np.newaxis
        return Jet(
            value, slope[..., own] * self.d, slope[..., own, own] * self.h + bend[..., own, own] * cross
        )  # fmt: skip


def product(subscripts: str, left: Jet, right: Jet) -> Jet:
    """The sum of products that :func:`numpy.einsum` forms of two arrays, with letters before ``y``."""
    operands, _, result = subscripts.partition("->")
    first, second = operands.split(",")

    def formed(a: FloatArray, b: FloatArray, behind_a: str = "", behind_b: str = "", behind: str = "") -> FloatArray:
        found: FloatArray = np.einsum(f"{first}{behind_a},{second}{behind_b}->{result}{behind}", a, b)
        return found

    cross = formed(left.d, right.d, "y", "z", "yz")
    return Jet(
        formed(left.v, right.v),
        formed(left.v, right.d, "", "y", "y") + formed(left.d, right.v, "y", "", "y"),
        formed(left.v, right.h, "", "yz", "yz") + formed(left.h, right.v, "yz", "", "yz")
        + cross + np.swapaxes(cross, -1, -2),
    )  # fmt: skip


def root(jet: Jet) -> Jet:
    """Square roots of positive elements."""
    value = np.sqrt(jet.v)
    return jet.through(value, 0.5 / value, -0.25 / (value * jet.v))


def inverse(jet: Jet) -> Jet:
    """One over each element."""
    value = 1.0 / jet.v
    return jet.through(value, -(value**2), 2.0 * value**3)


def logarithm(jet: Jet) -> Jet:
    """Natural logarithms of positive elements."""
    return jet.through(np.log(jet.v), 1.0 / jet.v, -1.0 / jet.v**2)


def joined(parts: list[Jet], axis: int = 0) -> Jet:
    """Arrays one behind the other along an axis of their own."""
    return Jet(*(np.concatenate([getattr(one, name) for one in parts], axis=axis) for name in ("v", "d", "h")))


#: Factor of a column: ``scale(position, row, pivot)`` with what is left of the pivot, and the row (position,) so far.
Scale = Callable[[int, Jet, Jet], Jet]


def _unit(position: int, row: Jet, pivot: Jet) -> Jet:
    """The scale with which the factor is that of the matrix."""
    return inverse(root(pivot))


def factor(matrix: Jet, required: int = 0, scale: Scale = _unit) -> tuple[Jet, Outcome]:
    """The lower Cholesky factor (n, n), pivots floored as :func:`bondgraph.filter.sigma_points.lower_factor` does.

    Parameters
    ----------
    matrix
        Shape (n, n).
    required
        Pivots that must be positive.
    scale
        Another scale of these columns: a noise that is judged on the way.
    """
    n, rest = matrix.v.shape[0], matrix
    lower = Jet.still(np.zeros(matrix.v.shape), matrix.d.shape[-1])
    for j in range(n):
        column = rest[j:, j]
        pivot = float(column.v[0])
        if not np.isfinite(pivot):
            return lower, Outcome.DIVERGED
        if pivot <= PIVOT_FLOOR * float(matrix.v[j, j]):
            if j < required:
                return lower, Outcome.NOT_POSITIVE
            continue
        scaled = product("i,->i", column, (scale if j < required else _unit)(j, lower[j, :j], column[0]))
        for name in ("v", "d", "h"):
            getattr(lower, name)[j:, j] = getattr(scaled, name)
        taken = product("i,k->ik", scaled, scaled)
        left = Jet(rest.v.copy(), rest.d.copy(), rest.h.copy())
        for name in ("v", "d", "h"):
            getattr(left, name)[j:, j:] -= getattr(taken, name)
        rest = left
    return lower, Outcome.OK


def drawn(points: MerweScaled, mean: Jet, lower: Jet) -> Jet:
    """Sigma points (n, 2 n + 1) of a belief."""
    centre = mean.map(lambda array: array[:, np.newaxis])
    step = lower * points.spread
    return joined([centre, centre + step, centre - step], axis=1)


def moments(points: MerweScaled, moved: Jet) -> tuple[Jet, Jet, Jet]:
    """Mean and covariance of moved points (rows, 2 n + 1), and their deviations from the first."""
    deviations = moved - moved[:, :1]
    shift = deviations.map(lambda array: array.sum(axis=1)) * points.weight
    cov = product("ip,jp->ij", deviations, deviations) * points.weight
    return moved[:, 0] + shift, cov + product("i,j->ij", shift, shift) * points.correction, deviations
