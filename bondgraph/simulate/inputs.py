"""Inputs over time: tables that run linearly, are held or are band limited between points, as each input declares.

A band-limited input is followed by short lines between its samples. Between two neighbouring break points every input
is a straight line, so an integrator that starts anew at each of them never steps over a bend or a jump. An input that
is the rate of another (a storage follows that one) is its slope there.
"""

from __future__ import annotations

import functools
from collections.abc import Container
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import BoolArray, FloatArray
from bondgraph.data.band_limited import BAND_LIMITED, finer, finer_times, is_even
from bondgraph.data.rates import slopes
from bondgraph.errors import ModelError
from bondgraph.simulate.late import break_times, complete, given_rows, late_rows
from bondgraph.simulate.model import Model
from bondgraph.text import count

#: Slopes that differ by less than this share of the steepest one are the same line.
_SAME_SLOPE = 1e-12
#: Times evaluated at once: a long log takes no more memory beside its inputs than these.
_BLOCK = 65_536


@dataclass(frozen=True)
class InputSegment:
    """All inputs over a stretch of time without break points: lines from ``left`` to ``right``, (n_u,) each."""

    start: float
    end: float
    left: FloatArray
    right: FloatArray

    def at(self, t: float) -> FloatArray:
        """Inputs at ``t``, shape (n_u,)."""
        values: FloatArray = self.left + self._rise * ((t - self.start) / (self.end - self.start))
        return values

    @functools.cached_property
    def _rise(self) -> FloatArray:
        """Rise of the inputs over the stretch, asked for at each of many times in it."""
        return self.right - self.left


@dataclass(frozen=True, repr=False)
class InputSignal:
    """Inputs over time.

    Parameters
    ----------
    time
        Shape (n,), s, not decreasing; a time given twice is a jump at which the later value counts.
    values
        Shape (n_u, n). Before the first and after the last time the end values hold.
    hold
        Shape (n_u,): whether an input keeps its value until the next time, instead of running linearly to it.
    rates
        Rows that hold the slope of another input up to the next time. At a point of the table such an input is the mean
        of the slopes on both sides, which is accurate to second order where the other one is sampled from a smooth
        course; outside the table it is zero.

    Raises
    ------
    ModelError
        If shapes do not fit, times decrease, or a value is not finite.

    Examples
    --------
    >>> ramp = InputSignal(np.array([0.0, 2.0]), np.array([[0.0, 4.0], [1.0, 5.0]]), np.array([False, True]))
    >>> ramp.at(1.0), ramp.at(9.0)
    (array([2., 1.]), array([4., 5.]))
    """

    time: FloatArray
    values: FloatArray
    hold: BoolArray
    rates: tuple[int, ...] = ()

    def __repr__(self) -> str:
        return f"<InputSignal: {count(self.hold.size, 'input')} at {count(self.time.size, 'time')}>"

    def __post_init__(self) -> None:
        if self.time.ndim != 1 or self.time.size == 0 or self.values.shape != (self.hold.size, self.time.size):
            raise ModelError(
                f"inputs: values of shape {self.values.shape} do not fit {self.hold.size} inputs at"
                f" {self.time.size} times - give one row per input and one column per time"
            )
        if not np.isfinite(self.time).all() or np.any(np.diff(self.time) < 0):
            raise ModelError("inputs: times must be finite and must not decrease - sort the table by time")
        bad = np.argwhere(~np.isfinite(self.values))
        if bad.size:
            row, column = bad[0]
            raise ModelError(
                f"inputs: input {row} has no finite value at t = {self.time[column]:.6g} s - fill or cut the gap"
            )

    @classmethod
    def of(cls, model: Model, time: npt.ArrayLike = (0.0,), **signals: float | str | npt.ArrayLike) -> InputSignal:
        """Inputs of a model by name: a number, a letter, or one value per time; those not named keep their default.

        The rate of an input follows from that input, unless it is named as well.

        Examples
        --------
        >>> from bondgraph.simulate.example import pendulum
        >>> InputSignal.of(pendulum(), [0.0, 1.0], drive=[0.0, 2.0]).at(0.5)
        array([1.])
        """
        times = np.array(time, dtype=np.float64)
        values = np.repeat(model.u0()[:, np.newaxis], times.size, axis=1)
        for name, signal in signals.items():
            row = model.index("input", name)
            values[row] = _numbers(model, name, signal, times.size)
        return cls.of_table(model, times, values, signals)

    @classmethod
    def of_table(
        cls, model: Model, time: FloatArray, values: FloatArray, given: Container[str] | None = None
    ) -> InputSignal:
        """Inputs of a model in its order, (n_u, n); rates and late ones not ``given`` (None: all are) are filled in.

        Band-limited inputs are interpolated where times are even; a table with uneven times is a drawn course, straight
        between its points. Late inputs may be left out; those of a log, which has none, are late on its samples.
        """
        if late_rows(model) and (given is not None or values.shape[0] == len(given_rows(model))):
            time, values = _with_late(model, time, values)
        values = with_rates(model, time, values, given)
        if limited_rows(model) and time.size > 2 and is_even(time):
            time, values = _refined(model, time, values)
        return cls(time, values, hold_flags(model), rate_rows(model))

    def at(self, t: npt.ArrayLike) -> FloatArray:
        """Inputs at one time (n_u,) or several (n_u, k); at a jump, the value after it."""
        times = np.asarray(t, dtype=np.float64)
        values = np.empty((self.hold.size, *times.shape))
        for own in _blocks(times):
            values[:, own] = self._evaluate(self._interval(times[own]), times[own])
        for row in self.rates:
            interval = self._interval(times)
            values[row] = np.where(np.isin(times, self.time), self._mean_rates(row)[interval], values[row])
        return values

    def _mean_rates(self, row: int) -> FloatArray:
        """Mean of the slopes before and after each point of the table (n,), of those there are."""
        lengths = np.diff(self.time)
        after = np.append(np.where(lengths > 0, self.values[row, :-1], np.nan), np.nan)
        before = np.insert(after[:-1], 0, np.nan)
        mean: FloatArray = np.nan_to_num(
            np.where(np.isnan(after), before, np.where(np.isnan(before), after, (before + after) / 2))
        )
        return mean

    def break_points(self, start: float, end: float) -> FloatArray:
        """Times strictly between ``start`` and ``end`` at which an input bends or jumps, increasing."""
        lengths = np.diff(self.time)
        rises = np.diff(self.values, axis=1)
        jumps = np.any((rises != 0) & (self.hold[:, np.newaxis] | (lengths == 0)), axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = np.where(self.hold[:, np.newaxis] | (lengths == 0), 0.0, rises / lengths)
        edge = np.zeros((self.hold.size, 1))
        padded = np.hstack([edge, slopes, edge])
        steepest = np.max(np.abs(padded), axis=1, keepdims=True, initial=0.0)
        bends = np.any(np.abs(np.diff(padded, axis=1)) > _SAME_SLOPE * steepest, axis=0)
        breaks = bends
        breaks[1:] |= jumps
        times = np.unique(self.time[breaks])
        return times[(times > start) & (times < end)]

    def segment(self, start: float, end: float) -> InputSegment:
        """The straight lines between two times that have no break point between them."""
        left, right = self.intervals(np.array([start, end]))
        return InputSegment(start, end, left[:, 0], right[:, 0])

    def intervals(self, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Left and right input values of each interval of a grid that contains all break points, (n_u, n-1) each."""
        starts, ends = grid[:-1], grid[1:]
        left, right = (np.empty((self.hold.size, starts.size)) for _ in range(2))
        for own in _blocks(starts):
            interval = self._interval(0.5 * (starts[own] + ends[own]))
            left[:, own], right[:, own] = self._evaluate(interval, starts[own]), self._evaluate(interval, ends[own])
        return left, right

    def _interval(self, times: FloatArray) -> npt.NDArray[np.intp]:
        """Index of the last point of the table at or before each time; -1 before the first."""
        return np.asarray(np.searchsorted(self.time, times, side="right") - 1)

    def _evaluate(self, interval: npt.NDArray[np.intp], times: FloatArray) -> FloatArray:
        """The lines of the given intervals of the table, evaluated at ``times``; constant outside the table."""
        left = np.maximum(interval, 0)
        right = np.minimum(interval + 1, self.time.size - 1)
        length = self.time[right] - self.time[left]
        share = np.where(length > 0, times - self.time[left], 0.0) / np.where(length > 0, length, 1.0)
        start = self.values[:, left]
        hold = self.hold.reshape(-1, *(1,) * (start.ndim - 1))
        values: FloatArray = start + np.where(hold, 0.0, self.values[:, right] - start) * share
        rates = list(self.rates)
        values[rates] = np.where((interval < 0) | (interval >= self.time.size - 1), 0.0, values[rates])
        return values


def _blocks(times: FloatArray) -> list[Any]:
    """Parts of an array of times, one after the other; a single time has one part."""
    if times.ndim == 0:
        return [...]
    return [slice(first, first + _BLOCK) for first in range(0, times.shape[0], _BLOCK)]


def hold_flags(model: Model) -> BoolArray:
    """Which inputs of a model are held between samples, shape (n_u,); the rate of one that runs linearly is."""
    return np.array([info.interpolation == "hold" or bool(info.rate_of) for info in model.inputs], dtype=np.bool_)


def limited_rows(model: Model) -> tuple[int, ...]:
    """Positions of the inputs that are band limited."""
    return tuple(row for row, info in enumerate(model.inputs) if info.interpolation == BAND_LIMITED)


def limited_rates(model: Model) -> tuple[tuple[int, int], ...]:
    """Positions of the rates of band-limited inputs, each with that of its input."""
    names, limited = model.names("input"), limited_rows(model)
    followed = [(row, names.index(info.rate_of)) for row, info in enumerate(model.inputs) if info.rate_of]
    return tuple((row, source) for row, source in followed if source in limited)


def with_rates(model: Model, time: FloatArray, values: FloatArray, given: Container[str] | None) -> FloatArray:
    """Inputs (n_u, n) in which the rates that are not ``given`` (None: all are) are the slopes of what they follow."""
    filled = values.copy()
    names = model.names("input")
    for row, info in enumerate(model.inputs):
        if info.rate_of and given is not None and info.name not in given:
            filled[row] = slopes(time, filled[names.index(info.rate_of)])
    return filled


def _refined(model: Model, time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Finer times, and inputs of which those that are band limited are interpolated there."""
    times, limited = finer_times(time), list(limited_rows(model))
    between = InputSignal(time, values, hold_flags(model))._evaluate(
        np.searchsorted(time, times, side="right") - 1, times
    )
    between[limited] = finer(values[limited])
    for row, source in limited_rates(model):
        between[row] = slopes(times, between[source])
    return times, between


def _with_late(model: Model, time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The times of a table with those at which late inputs bend, and all inputs (n_u, n) there."""
    if values.shape[0] == len(given_rows(model)):
        return time, complete(model, time, values)
    hold = hold_flags(model)
    table = InputSignal(time, values, hold)
    grid = break_times(model, time)
    grid = np.append(grid, grid[-1] + 1.0)  # what is there at the last time lasts
    left, right = table.intervals(grid)
    for row, source, seconds in late_rows(model):
        earlier = table.intervals(grid - seconds)
        left[row], right[row] = earlier[0][source], earlier[1][source]
    starts, ends = left[:, 1:], right[:, :-1]
    size = np.max(np.abs(left), axis=1, keepdims=True, initial=0.0)
    jumps = np.any((np.abs(starts - ends) > _SAME_SLOPE * size) & ~hold[:, np.newaxis], axis=0)
    times = np.repeat(grid[1:-1], 1 + jumps)
    doubled = np.insert(starts, np.flatnonzero(jumps), ends[:, jumps], axis=1)
    return np.append(grid[:1], times), np.concatenate([left[:, :1], doubled], axis=1)


def rate_rows(model: Model) -> tuple[int, ...]:
    """Positions of the inputs that are the rate of another."""
    return tuple(row for row, info in enumerate(model.inputs) if info.rate_of)


def _numbers(model: Model, name: str, signal: float | str | npt.ArrayLike, size: int) -> FloatArray:
    if isinstance(signal, str):
        return np.full(size, model.input_value(name, signal))
    listed = np.asarray(signal)
    if listed.dtype.kind in "US":
        listed = np.array([model.input_value(name, str(letter)) for letter in listed.ravel()])
    if listed.shape not in ((), (size,)):
        raise ModelError(
            f"{model.name}: input {name!r} has {listed.size} values for {size} times - give one number or one per time",
            where=(model.name, name),
        )
    numbers: FloatArray = np.broadcast_to(listed, (size,)).astype(np.float64)
    return numbers
