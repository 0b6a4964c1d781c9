"""Innovations of channels on jets, one given the ones before it: their cost, and the weight that a loss gives them.

The same computation as :mod:`bondgraph.filter.kernel_robust`, whose letters it has; slopes are those of its functions.
"""

from __future__ import annotations

import math

import numpy as np

from bondgraph.filter.kernel_robust import _loss, _precision, _precision_slope, _score
from bondgraph.filter.kernel_types import Robustness
from bondgraph.filter.second_order import Jet, inverse, joined, logarithm, product, root


class Channels:
    """Innovations (m,) of a sample, judged while their joint covariance is factored.

    Parameters
    ----------
    robust
        The loss, or none.
    innovation
        Measured minus expected, shape (m,).
    noise
        Covariance of the sensors' noise, shape (m, m).

    Examples
    --------
    >>> from bondgraph.filter.robust import PLAIN
    >>> from bondgraph.filter.second_order import factor
    >>> two, unit = Jet.still(np.array([2.0]), 1), Jet.still(np.eye(1), 1)
    >>> channels = Channels(PLAIN, two, unit)
    >>> _ = factor(unit * 4.0, 1, channels.scale)
    >>> float(channels.nll.v) == 0.5 + math.log(2.0) + 0.5 * math.log(2.0 * math.pi), channels.scores.v.tolist()
    (True, [1.0])
    """

    def __init__(self, robust: Robustness, innovation: Jet, noise: Jet) -> None:
        self._robust, self._innovation, self._noise = robust, innovation, noise
        self._found: list[Jet] = []
        constant = innovation.v.size * (0.5 * math.log(2.0 * math.pi) + robust.constant)
        self.nll = Jet.still(np.array(constant), innovation.d.shape[-1])

    @property
    def scores(self) -> Jet:
        """Factors of the columns by which they move the state, shape (m,)."""
        return joined([one.map(lambda array: array[np.newaxis]) for one in self._found])

    def scale(self, position: int, row: Jet, pivot: Jet) -> Jet:
        """One over the standard deviation with which a channel counts; what :func:`factor` asks for."""
        value, unit = self._innovation[position], inverse(root(pivot))
        if self._found:
            value = value - product("c,c->", row, self.scores)
        z = value * unit
        self.nll = self.nll + self._lost(z) - logarithm(unit)
        if self._robust.kind:
            unit = self._counted(z, pivot, self._noise[position, position])
        self._found.append(value * unit)
        return unit

    def _lost(self, z: Jet) -> Jet:
        """The loss of an innovation."""
        robust, at = self._robust, float(z.v)
        if not robust.kind:
            return z * z * 0.5
        return z.through(*(np.array(one) for one in (_loss(robust, at), _score(robust, at), _bend(robust, at))))

    def _counted(self, z: Jet, pivot: Jet, noise: Jet) -> Jet:
        """One over the standard deviation of a channel whose noise has its variance over its precision."""
        robust, at = self._robust, float(z.v)
        if _precision(robust, at) == 0.0:  # not used at all, and so around here
            return Jet.still(np.array(0.0), z.d.shape[-1])
        numbers = (_precision(robust, at), _precision_slope(robust, at), _precision_bend(robust, at))
        precision = z.through(*map(np.array, numbers))
        return root(precision * inverse(precision * (pivot - noise) + noise))


def _bend(robust: Robustness, z: float) -> float:
    """Second derivative of the loss."""
    if robust.kind == 1:
        square = robust.second * z * z
        return robust.first * robust.second * (1.0 - square) / (1.0 + square) ** 2
    return robust.second if abs(z) <= robust.first else 0.0


def _precision_bend(robust: Robustness, z: float) -> float:
    """Second derivative of the precision."""
    if robust.kind == 1:
        square = robust.second * z * z
        return -2.0 * robust.first * robust.second**2 * (1.0 - 3.0 * square) / (1.0 + square) ** 3
    if robust.kind == 2 and abs(z) > robust.first:
        return 2.0 * robust.first / abs(z) ** 3
    return 0.0
