"""A quadrature rule for what decays: where in an interval process noise enters, and how much of it at each node.

Noise that enters s before the end of an interval has decayed by exp(-r s) there, for every rate r of a model from zero
to the fastest. A rule with n nodes inside and both ends integrates all of these at once. It is the generalised Gauss
rule for a family of functions (Ma, Rokhlin, Wandzura 1996, Generalized Gaussian quadrature rules for systems of
arbitrary functions, SIAM J. Numerical Analysis 33(3)); that few exponentials serve a wide range of rates, as their
error falls like exp(-pi^2 n / log(8 reach)), is due to Braess and Hackbusch (2005), IMA J. Numerical Analysis 25(4).
For slow rates it is the rule of Lobatto, with one node inside Simpson's.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.polynomial.legendre import Legendre

from bondgraph.arrays import FloatArray

#: Most nodes inside: with eight of them rates up to a thousand times the sampling are integrated to 1e-4.
MOST_INSIDE = 8
#: Rates at which the error is looked at, for every number that a rule has, and how far below the fastest they begin.
_LOOKS, _SLOWEST = 20, 1e-2
#: Turns of the search, and digits of what it gives: beyond them the error of a rule does not change.
_TURNS, _DIGITS = 60, 9


@functools.lru_cache(maxsize=256)
def decay_rule(inside: int, reach: float) -> tuple[FloatArray, FloatArray]:
    """Nodes of an interval of length one, before its end, and their weights, which sum to one.

    Parameters
    ----------
    inside
        Nodes between both ends, from 0 to ``MOST_INSIDE``.
    reach
        The fastest rate times the length of the interval; 0: polynomials.

    Returns
    -------
    tuple
        Distances from the end, from 0 to 1, shape (inside + 2,), and weights of the same shape.

    Examples
    --------
    >>> before, weights = decay_rule(1, 0.0)
    >>> before.tolist(), (6.0 * weights).round(12).tolist()
    ([0.0, 0.5, 1.0], [1.0, 4.0, 1.0])
    >>> before, weights = decay_rule(3, 100.0)
    >>> rates = np.array([0.1, 10.0, 100.0])
    >>> gathered = np.exp(-rates[:, np.newaxis] * before) @ weights
    >>> bool((np.abs(gathered / (-np.expm1(-rates) / rates) - 1.0) < 0.01).all())
    True
    """
    before, weights = _stretched(inside, reach)
    if reach > 0.0:
        before, weights = _fitted(before, weights, reach)
    before.setflags(write=False)
    weights.setflags(write=False)
    return before, weights


def _stretched(inside: int, reach: float) -> tuple[FloatArray, FloatArray]:
    """Lobatto's rule on an axis that is stretched towards the end, the more the further the rates reach."""
    order = inside + 1
    last = Legendre.basis(order)
    roots = np.sort(np.real(last.deriv().roots())) if inside else np.zeros(0)
    x = np.concatenate([[-1.0], roots, [1.0]])
    weights: FloatArray = 1.0 / (order * (order + 1) * last(x) ** 2)
    x = 0.5 * (x + 1.0)
    stretch = max(np.log(reach) - 1.0, 0.0) if reach > 0.0 else 0.0
    if stretch > 0.0:
        weights = weights * np.exp(stretch * x)
        x = np.expm1(stretch * x) / np.expm1(stretch)
    return x, weights / weights.sum()


def _fitted(before: FloatArray, weights: FloatArray, reach: float) -> tuple[FloatArray, FloatArray]:
    """The rule whose relative errors are least, over rates that are even on a logarithmic scale."""
    from scipy.optimize import least_squares

    steps = before.size - 1
    rates = np.geomspace(_SLOWEST * min(reach, 1.0), reach, _LOOKS * 2 * before.size)
    exact = -np.expm1(-rates) / rates

    def rule(z: FloatArray) -> tuple[FloatArray, FloatArray]:
        gaps, parts = (np.exp(own - own.max()) for own in (z[:steps], z[steps:]))
        return np.concatenate([[0.0], np.cumsum(gaps) / gaps.sum()]), parts / parts.sum()

    def errors(z: FloatArray) -> FloatArray:
        at, parts = rule(z)
        missed: FloatArray = (np.exp(-rates[:, np.newaxis] * at) @ parts) / exact - 1.0
        return missed

    start = np.log(np.concatenate([np.diff(before), weights]))
    found = least_squares(errors, start, xtol=1e-12, ftol=1e-12, gtol=1e-15, max_nfev=_TURNS)
    at, parts = (np.round(one, _DIGITS) for one in rule(found.x))
    return at, parts / parts.sum()
