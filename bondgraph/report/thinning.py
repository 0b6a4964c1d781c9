"""Fewer points of long lines with the same look, and breaks of lines where a log has a gap."""

from __future__ import annotations

import numpy as np

from bondgraph.arrays import FloatArray, IntArray

#: Points of a line beyond which it is thinned: the lowest and the highest of each pixel of a panel, 450 pixels on a
#: screen and 290 on a phone.
MOST_POINTS, MOST_NARROW = 1000, 600


def with_gaps(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same points with a NaN wherever samples are missing, so that no line is drawn across the gap.

    Examples
    --------
    >>> with_gaps(np.array([0.0, 1.0, 2.0, 3.0, 20.0]), np.ones(5))[1]
    array([ 1.,  1.,  1.,  1., nan,  1.])
    """
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > 5 * np.median(steps)) + 1 if steps.size else np.empty(0, dtype=int)
    return np.insert(time, gaps, time[gaps - 1]), np.insert(values, gaps, np.nan)


def thinned(time: FloatArray, values: FloatArray, most: int = MOST_POINTS) -> tuple[FloatArray, FloatArray]:
    """Fewer points with the same look: of each interval its smallest and largest value and a gap if there is one.

    Examples
    --------
    >>> time = np.arange(10000.0)
    >>> spike = np.where(time == 1234.0, 5.0, 0.0)
    >>> shown_time, shown = thinned(time, spike)
    >>> shown.size <= 1000, float(shown.max())
    (True, 5.0)
    """
    if values.size <= most:
        return time, values
    width, longer = divmod(values.size, most // 2)
    edge = longer * (width + 1)
    parts = (_outlined(values[:edge], width + 1), edge + _outlined(values[edge:], width))
    order = np.unique(np.concatenate(parts))
    return time[order], values[order]


def _outlined(values: FloatArray, width: int) -> IntArray:
    """Of each stretch of so many values the positions of the smallest, the largest and the first gap."""
    rows = values.reshape(-1, width)
    unknown = np.isnan(rows)
    chosen = [np.where(unknown, np.inf, rows).argmin(axis=1), np.where(unknown, -np.inf, rows).argmax(axis=1)]
    chosen.append(np.where(unknown.any(axis=1), unknown.argmax(axis=1), chosen[0]))
    known = np.isfinite(rows).any(axis=1)  # of a stretch without any the first stands for all
    found: IntArray = (width * np.arange(rows.shape[0]) + np.where(known, chosen, 0)).ravel()
    return found
