"""Transforms between the value of a free parameter and the coordinate that searches move.

Each takes the bounds of the parameter with it, since a logit is relative to them. The coordinate of a bound gives that
bound to the last digit, so that no estimate leaves its bounds by rounding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, Protocol

import numpy as np

from bondgraph.arrays import FloatArray

Scale = Literal["linear", "log", "logit"]

#: The logit of a bound is infinite. A box of coordinates ends where the logistic function is a millionth from its own
#: ends; the function is stretched by as much, so that these coordinates are the bounds.
_END = math.log(1e6 - 1.0)
#: The exponential function still has a value here; of 710 it has none.
_OVERFLOW = 700.0


class Transform(Protocol):
    """Map between values and coordinates, increasing and smooth."""

    def coordinate(self, value: float, lower: float, upper: float) -> float:
        """The coordinate of a value within bounds."""

    def values(self, coordinates: FloatArray, lower: float, upper: float) -> FloatArray:
        """Values at coordinates of any shape."""

    def slope(self, value: float, lower: float, upper: float) -> float:
        """Derivative of the value with respect to its coordinate."""

    def bend(self, value: float, lower: float, upper: float) -> float:
        """Second derivative of the value with respect to its coordinate."""

    def around(self, value: float, reach: float, lower: float, upper: float) -> tuple[float, float]:
        """Values to both sides of one, as far in the coordinate as ``reach`` is in the value to first order."""


class Linear:
    """The value itself."""

    def coordinate(self, value: float, lower: float, upper: float) -> float:
        """The coordinate of a value within bounds."""
        return float(value)

    def values(self, coordinates: FloatArray, lower: float, upper: float) -> FloatArray:
        """Values at coordinates of any shape."""
        return coordinates

    def slope(self, value: float, lower: float, upper: float) -> float:
        """Derivative of the value with respect to its coordinate."""
        return 1.0

    def bend(self, value: float, lower: float, upper: float) -> float:
        """Second derivative of the value with respect to its coordinate."""
        return 0.0

    def around(self, value: float, reach: float, lower: float, upper: float) -> tuple[float, float]:
        """Values to both sides of one."""
        return value - reach, value + reach


class Logarithm:
    """The natural logarithm of the value, for quantities known to an order of magnitude."""

    def coordinate(self, value: float, lower: float, upper: float) -> float:
        """The coordinate of a value within bounds."""
        return math.log(value)

    def values(self, coordinates: FloatArray, lower: float, upper: float) -> FloatArray:
        """Values at coordinates of any shape."""
        values = np.exp(coordinates)
        for bound in (lower, upper):
            values = np.where(coordinates == math.log(bound), bound, values)
        return values

    def slope(self, value: float, lower: float, upper: float) -> float:
        """Derivative of the value with respect to its coordinate."""
        return value

    def bend(self, value: float, lower: float, upper: float) -> float:
        """Second derivative of the value with respect to its coordinate."""
        return value

    def around(self, value: float, reach: float, lower: float, upper: float) -> tuple[float, float]:
        """Values to both sides of one, by the same factor."""
        factor = math.exp(min(reach / value, _OVERFLOW))
        return value / factor, value * factor


class Logit:
    """The logit of where the value lies between its bounds, for shares and efficiencies near the end of their range.

    Examples
    --------
    >>> round(Logit().coordinate(0.75, 0.0, 1.0), 4), round(math.log(3.0), 4)
    (1.0986, 1.0986)
    """

    def coordinate(self, value: float, lower: float, upper: float) -> float:
        """The coordinate of a value within bounds."""
        share = _LEAST + (1.0 - 2.0 * _LEAST) * (value - lower) / (upper - lower)
        if value in (lower, upper):
            return -_END if value == lower else _END
        return math.log(share / (1.0 - share))

    def values(self, coordinates: FloatArray, lower: float, upper: float) -> FloatArray:
        """Values at coordinates of any shape."""
        shares = 0.5 * (1.0 + np.tanh(0.5 * coordinates))  # the logistic function, without overflow
        values = lower + (upper - lower) * (shares - _LEAST) / (1.0 - 2.0 * _LEAST)
        return np.where(coordinates <= -_END, lower, np.where(coordinates >= _END, upper, values))

    def slope(self, value: float, lower: float, upper: float) -> float:
        """Derivative of the value with respect to its coordinate."""
        share = self._share(value, lower, upper)
        return (upper - lower) * share * (1.0 - share) / (1.0 - 2.0 * _LEAST)

    def bend(self, value: float, lower: float, upper: float) -> float:
        """Second derivative of the value with respect to its coordinate."""
        return self.slope(value, lower, upper) * (1.0 - 2.0 * self._share(value, lower, upper))

    def around(self, value: float, reach: float, lower: float, upper: float) -> tuple[float, float]:
        """Values to both sides of one, by the same step of the logit."""
        middle, way = self.coordinate(value, lower, upper), reach / self.slope(value, lower, upper)
        below, above = map(float, self.values(np.array([middle - way, middle + way]), lower, upper))
        return below, above

    def _share(self, value: float, lower: float, upper: float) -> float:
        """The logistic function at the coordinate of a value."""
        return _LEAST + (1.0 - 2.0 * _LEAST) * (value - lower) / (upper - lower)


#: The logistic function at the lower end of the coordinates.
_LEAST = 1.0 / (1.0 + math.exp(_END))

#: By the names that free parameters use.
TRANSFORMS: Mapping[Scale, Transform] = {"linear": Linear(), "log": Logarithm(), "logit": Logit()}
