"""The recursion of :mod:`bondgraph.filter.linear.response`, in the part of Python of kernels.

Lanes are the last axis of all that depends on them, so that each product is a loop over neighbouring numbers.
"""

from __future__ import annotations

from typing import NamedTuple

from bondgraph.arrays import FloatArray, IntArray


class Filter(NamedTuple):
    """The filter along a log, samples first, see :class:`bondgraph.filter.linear.response.LinearLog`."""

    transition: FloatArray
    early: FloatArray
    late: FloatArray
    slope: FloatArray
    gain: FloatArray
    whitener: FloatArray


class Shifts(NamedTuple):
    """What shifts the filter: rates (n_x, n - 1, lanes) of the states in the rows ``moving``, outputs (n_y, n, lanes).

    ``showing`` are the rows of the outputs that are shifted.
    """

    start: FloatArray
    end: FloatArray
    outputs: FloatArray
    moving: IntArray
    showing: IntArray


def carried(
    filtered: Filter,
    shifts: Shifts,
    first: int,
    moved: FloatArray,
    at: IntArray,
    found: FloatArray,
    lane: int,
    states: FloatArray,
    before: FloatArray,
    expected: FloatArray,
) -> None:
    """Fill in changes of whitened innovations from sample ``first`` on, the state before it shifted by ``moved``.

    ``found`` (n_y, n, all lanes) takes them from ``lane`` on, ``states`` (at, n_x, lanes) the shifts of the filtered
    states at increasing samples ``at``; ``moved`` (n_x, lanes) is overwritten. Scratch: ``before`` (n_x, lanes) and
    ``expected`` (n_y, lanes).
    """
    size, lanes = moved.shape
    outputs = expected.shape[0]
    place = 0
    for k in range(first, filtered.slope.shape[0]):
        if k > 0:
            before[:] = moved
            _times(filtered.transition[k - 1], before, moved)
            for row in range(shifts.moving.size):
                j = shifts.moving[row]
                for i in range(size):
                    early, late = filtered.early[k - 1, i, j], filtered.late[k - 1, i, j]
                    for q in range(lanes):
                        moved[i, q] += early * shifts.start[j, k - 1, q] + late * shifts.end[j, k - 1, q]
        _times(filtered.slope[k], moved, expected)
        for row in range(shifts.showing.size):
            a = shifts.showing[row]
            for q in range(lanes):
                expected[a, q] += shifts.outputs[a, k, q]
        for a in range(outputs):
            for q in range(lanes):
                found[a, k, lane + q] = 0.0
            for b in range(a + 1):  # the inverse of a lower factor
                weight = filtered.whitener[k, a, b]
                if weight != 0.0:
                    for q in range(lanes):
                        found[a, k, lane + q] -= weight * expected[b, q]
        for i in range(size):
            for b in range(outputs):
                gain = filtered.gain[k, i, b]
                if gain != 0.0:
                    for q in range(lanes):
                        moved[i, q] -= gain * expected[b, q]
        while place < at.size and at[place] == k:
            states[place] = moved
            place += 1


def _times(factor: FloatArray, many: FloatArray, product: FloatArray) -> None:
    """A matrix times lanes; many of its entries are zero."""
    product[:] = 0.0
    for i in range(factor.shape[0]):
        for j in range(factor.shape[1]):
            if factor[i, j] != 0.0:
                for q in range(many.shape[1]):
                    product[i, q] += factor[i, j] * many[j, q]
