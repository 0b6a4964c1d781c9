"""The recursion of :mod:`bondgraph.filter.linear.levels`, in the part of Python of kernels.

Levels are the last axis of all that depends on them, so that each product is a loop over neighbouring numbers. What the
gain leaves of a covariance, in Joseph's form (I - K H) dP (I - K H)' + K dR K', is written as

    dP - K (H dP) - (dP H' - K dS) K',

which takes half as many products. What rounding leaves between a covariance and its transpose would grow there, where
Joseph's form damps it, so that one half is computed and the other is its mirror image.
"""

from __future__ import annotations

from typing import NamedTuple

from bondgraph.arrays import FloatArray


class Filter(NamedTuple):
    """The filter along a log, samples first, see :class:`bondgraph.filter.linear.response.LinearLog`.

    ``gathered`` (n - 1, drivers, n_x, n_x) is the covariance that noise of intensity one in each driven state leaves
    over an interval; ``slope`` (n, n_y, n_x) with zero rows for what was not measured, ``seen`` (n, n_y) one for what
    was, else zero; ``innovation`` and ``whitened`` (n, n_y).
    """

    transition: FloatArray
    gathered: FloatArray
    slope: FloatArray
    seen: FloatArray
    gain: FloatArray
    whitener: FloatArray
    innovation: FloatArray
    whitened: FloatArray


class Scratch(NamedTuple):
    """Shifts by levels: of the state, its covariance and that of the innovation, and parts of their products.

    ``weight`` is the innovation over its covariance.
    """

    weight: FloatArray
    moved: FloatArray
    turned: FloatArray
    spread: FloatArray
    half: FloatArray
    shown: FloatArray
    left: FloatArray
    change: FloatArray
    part: FloatArray
    expected: FloatArray


def carried(
    filtered: Filter,
    process: FloatArray,
    noise: FloatArray,
    slopes_z: FloatArray,
    slopes_s: FloatArray,
    scratch: Scratch,
) -> None:
    """Fill derivatives (n, n_y, levels) of whitened innovations and of log scales.

    process (drivers, levels) and noise (n_y, levels) are those of the variances per second that drive states, and of
    the variances of the sensors. The scratch begins with zeros.
    """
    size, outputs, levels = filtered.slope.shape[2], noise.shape[0], process.shape[1]
    moved, turned, spread, half = scratch.moved, scratch.turned, scratch.spread, scratch.half
    shown, left, change, part = scratch.shown, scratch.left, scratch.change, scratch.part
    expected, weight = scratch.expected, scratch.weight
    for k in range(filtered.slope.shape[0]):
        if k > 0:
            _predict(filtered.transition[k - 1], filtered.gathered[k - 1], process, moved, turned, spread, half)
        slope, gain, whitener = filtered.slope[k], filtered.gain[k], filtered.whitener[k]
        _before(slope, spread, shown)
        _behind(shown, slope, change)
        for a in range(outputs):
            for level in range(levels):
                change[a, a, level] += noise[a, level] * filtered.seen[k, a]
        _before(slope, moved, expected)
        _before(gain, change, left)
        _weigh(whitener, filtered.innovation[k], weight)
        for i in range(size):
            for b in range(outputs):
                for level in range(levels):
                    left[i, b, level] = shown[b, i, level] - left[i, b, level]
                    moved[i, 0, level] += left[i, b, level] * weight[b] - gain[i, b] * expected[b, 0, level]
        _update(gain, shown, left, spread)
        _before(whitener, change, part)
        _behind(part, whitener, change)
        _show(whitener, change, expected, filtered.whitened[k], slopes_z[k], slopes_s[k])


def _predict(
    transition: FloatArray,
    gathered: FloatArray,
    process: FloatArray,
    moved: FloatArray,
    turned: FloatArray,
    spread: FloatArray,
    half: FloatArray,
) -> None:
    """Carry the shifts of the state and of its covariance to the next sample."""
    turned[:] = moved
    _before(transition, turned, moved)
    _before(transition, spread, half)
    _behind(half, transition, spread)
    for d in range(process.shape[0]):
        for i in range(spread.shape[0]):
            for j in range(spread.shape[0]):
                if gathered[d, i, j] != 0.0:
                    for level in range(process.shape[1]):
                        spread[i, j, level] += gathered[d, i, j] * process[d, level]


def _update(gain: FloatArray, shown: FloatArray, left: FloatArray, spread: FloatArray) -> None:
    """What the gain leaves of the shift of the covariance, half of it; the rest is its mirror image."""
    for i in range(spread.shape[0]):
        for j in range(i + 1):
            for b in range(gain.shape[1]):
                for level in range(spread.shape[2]):
                    spread[i, j, level] -= gain[i, b] * shown[b, j, level] + left[i, b, level] * gain[j, b]
            for level in range(spread.shape[2]):
                spread[j, i, level] = spread[i, j, level]


def _weigh(whitener: FloatArray, innovation: FloatArray, weight: FloatArray) -> None:
    """The innovation over its covariance."""
    weight[:] = 0.0
    for a in range(weight.size):
        white = 0.0
        for b in range(weight.size):
            white += whitener[a, b] * innovation[b]
        for b in range(weight.size):
            weight[b] += whitener[a, b] * white


def _show(
    whitener: FloatArray,
    change: FloatArray,
    expected: FloatArray,
    whitened: FloatArray,
    slope_z: FloatArray,
    slope_s: FloatArray,
) -> None:
    """Derivatives at one sample, from the whitened change of the covariance of its innovation."""
    for a in range(whitener.shape[0]):
        for level in range(change.shape[2]):
            slope_s[a, level] = 0.5 * change[a, a, level]
            slope_z[a, level] = -0.5 * change[a, a, level] * whitened[a]
        for b in range(a):
            for level in range(change.shape[2]):
                slope_z[a, level] -= change[a, b, level] * whitened[b]
        for b in range(whitener.shape[1]):
            for level in range(change.shape[2]):
                slope_z[a, level] -= whitener[a, b] * expected[b, 0, level]


def _before(factor: FloatArray, many: FloatArray, product: FloatArray) -> None:
    """A matrix times a matrix per level; many of its entries are zero."""
    product[:] = 0.0
    for i in range(factor.shape[0]):
        for m in range(factor.shape[1]):
            if factor[i, m] != 0.0:
                for j in range(many.shape[1]):
                    for level in range(many.shape[2]):
                        product[i, j, level] += factor[i, m] * many[m, j, level]


def _behind(many: FloatArray, factor: FloatArray, product: FloatArray) -> None:
    """A matrix per level times the transpose of a matrix."""
    product[:] = 0.0
    for j in range(factor.shape[0]):
        for m in range(factor.shape[1]):
            if factor[j, m] != 0.0:
                for i in range(many.shape[0]):
                    for level in range(many.shape[2]):
                        product[i, j, level] += many[i, m, level] * factor[j, m]
