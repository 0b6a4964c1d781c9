"""Where the first of several functions of time falls below zero within one step of an integration.

The functions are smooth there, since modes are held. They are sampled inside the step, so that one that dips below zero
and returns is found too; the crossing itself is bracketed and refined on the dense output (Brent 1973, Algorithms for
Minimization without Derivatives, chapters 4 and 5). Values within a tolerance of zero count as zero: a function that
starts at zero fires only once it has really fallen below, not by rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from bondgraph.arrays import FloatArray

#: Samples of each function per step, its ends included.
_SAMPLES = 9
#: How often the way to a first sample below zero is halved in search of a stretch above it.
_HALVINGS = 50
#: Rounding of the interpolation over a step, as a share of the largest value in it.
_INTERPOLATION = 1e-14

#: Values of all functions (rows, k) at times (k,).
Functions = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Crossing:
    """The function that falls below zero first, and when."""

    time: float
    row: int


def first_crossing(functions: Functions, start: float, end: float, tolerance: FloatArray) -> Crossing | None:
    """The first crossing in ``[start, end]``, None where all functions stay above ``-tolerance``.

    Parameters
    ----------
    functions
        Values (rows, k) at times (k,).
    start, end
        The step.
    tolerance
        Shape (rows,): what counts as zero.

    Examples
    --------
    >>> found = first_crossing(lambda t: np.stack([1.0 - t, 4.0 - t**2]), 0.0, 3.0, np.full(2, 1e-12))
    >>> found.row, round(found.time, 12)
    (0, 1.0)
    >>> first_crossing(lambda t: (t - 1.0)[np.newaxis] ** 2 + 0.1, 0.0, 3.0, np.full(1, 1e-12)) is None
    True
    """
    times = np.linspace(start, end, _SAMPLES)
    values = functions(times)
    zero = np.maximum(tolerance, _INTERPOLATION * np.max(np.abs(values), axis=1, initial=0.0))
    found: Crossing | None = None
    for row in range(values.shape[0]):
        where = _bracket(functions, row, times, values[row], float(zero[row]))
        if where is None:
            continue
        time = _refined(functions, row, *where)
        if found is None or time < found.time:
            found = Crossing(time, row)
    return found


def _bracket(
    functions: Functions, row: int, times: FloatArray, values: FloatArray, tolerance: float
) -> tuple[float, float] | None:
    """Two times between which a function falls below zero for the first time."""
    below = np.flatnonzero(values[1:] < -tolerance) + 1  # the start was looked at, and is known better there
    dip = _dip(functions, row, times[: below[0] + 1] if below.size else times, values, tolerance)
    if dip is not None:
        return dip
    if not below.size:
        return None
    k = int(below[0])
    return _left_above(functions, row, float(times[k - 1]), float(times[k]), tolerance)


def _dip(
    functions: Functions, row: int, times: FloatArray, values: FloatArray, tolerance: float
) -> tuple[float, float] | None:
    """A dip below zero between samples above it: about the lowest sample, where a parabola through three comes near."""
    for k in range(1, times.size - 1):
        left, middle, right = values[k - 1 : k + 2]
        if not (middle > tolerance and left > middle <= right):
            continue
        curvature = left - 2.0 * middle + right
        if curvature <= 0 or middle - (right - left) ** 2 / (8.0 * curvature) > 0.5 * middle:
            continue
        bounds = (float(times[k - 1]), float(times[k + 1]))
        lowest = minimize_scalar(lambda t: _value(functions, row, t), bounds=bounds, method="bounded")
        if lowest.fun < -tolerance:
            return bounds[0], float(lowest.x)
    return None


def _left_above(functions: Functions, row: int, left: float, right: float, tolerance: float) -> tuple[float, float]:
    """The bracket of a fall below zero, begun where the function is clearly above: it may start at zero and rise."""
    if _value(functions, row, left) > tolerance:
        return left, right
    times: FloatArray = left + (right - left) * 0.5 ** np.arange(_HALVINGS, 0, -1, dtype=np.float64)
    values = functions(times)[row]
    above = np.flatnonzero(values > tolerance)
    if not above.size:
        return left, left
    last = int(above[-1])
    return float(times[last]), float(times[last + 1]) if last + 1 < times.size else right


def _refined(functions: Functions, row: int, left: float, right: float) -> float:
    if right <= left:
        return left
    if _value(functions, row, right) > 0:
        return right
    smallest = 4.0 * np.finfo(float).eps
    found = brentq(
        lambda t: _value(functions, row, t), left, right, xtol=max(smallest * abs(right), 1e-300), rtol=smallest
    )
    return float(found)


def _value(functions: Functions, row: int, time: float) -> float:
    return float(functions(np.array([time]))[row, 0])
