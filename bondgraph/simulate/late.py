"""Inputs that follow others a fixed time later: what they are along a log, and in a table.

No log holds them. A log tells one from the input that it follows: before the first sample that had its first value,
unless the log knows what it was.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.data.band_limited import BAND_LIMITED, finer, finer_times, is_even
from bondgraph.data.rates import slopes
from bondgraph.simulate.model import Model

#: Break points of a table closer than this share of its shortest interval are one: a sum of times has rounding.
_SAME_TIME = 1e-6


class Recorded(Protocol):
    """Times (n,) and inputs (n_u, n), such as a log holds them."""

    @property
    def time(self) -> FloatArray:
        """Times, s."""

    @property
    def u(self) -> FloatArray:
        """Inputs; late ones may be missing."""


class LateRow(NamedTuple):
    """A late input: its row, that of the input that it follows, and how many seconds later."""

    row: int
    source: int
    seconds: float


def late_rows(model: Model) -> tuple[LateRow, ...]:
    """The late inputs of a model."""
    names = model.names("input")
    return tuple(
        LateRow(row, names.index(info.late_of), info.late_by) for row, info in enumerate(model.inputs) if info.late_of
    )


def given_rows(model: Model) -> list[int]:
    """Rows of the inputs that a log tells by itself: neither late nor the rate of what is."""
    late = {info.name for info in model.inputs if info.late_of}
    return [row for row, info in enumerate(model.inputs) if info.name not in late and info.rate_of not in late]


def inputs_of(model: Model, log: Recorded) -> FloatArray:
    """All inputs of a model along a log (n_u, n), see :func:`complete`."""
    return complete(model, log.time, log.u, _before(log))


def first_inputs(model: Model, log: Recorded) -> FloatArray:
    """All inputs of a model at the first sample of a log, shape (n_u,)."""
    return complete(model, log.time[:1], log.u[:, :1], _before(log))[:, 0]


def _before(log: Recorded) -> Mapping[str, float]:
    """Inputs before the first sample of a log that knows them; none of one that has no such field."""
    return getattr(log, "before", {})


def complete(model: Model, time: FloatArray, u: FloatArray, before: Mapping[str, float] | None = None) -> FloatArray:
    """All inputs of a model (n_u, n) at times (n,), from those that a log tells by itself; complete ones are kept.

    ``before`` says what inputs were before the first time, by name; others had their first value.

    A held input that is late has its mean over each interval, so that what it gives in all is right where the delay is
    no whole number of intervals.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.declare.functions import delay
    >>> g = bg.BondGraph("sled")
    >>> body = g.one_junction("body", bg.TRANSLATION)
    >>> _ = g.effort_source("rope", delay(g.input("pull", "N"), 0.25), at=body)
    >>> _ = g.inertance("mass", g.parameter("m", 80.0, "kg"), at=body)
    >>> complete(bg.build(g).model, np.arange(4) * 0.5, np.array([[0.0, 2.0, 2.0, 4.0]])).tolist()
    [[0.0, 2.0, 2.0, 4.0], [0.0, 1.0, 2.0, 3.0]]
    >>> complete(bg.build(g).model, np.arange(3) * 0.25, np.array([[2.0, 2.0, 4.0]]), {"pull": 0.0}).tolist()
    [[2.0, 2.0, 4.0], [0.0, 2.0, 2.0]]
    """
    given = given_rows(model)
    if len(given) == len(model.inputs) or u.shape[0] != len(given):
        return u
    every = np.empty((len(model.inputs), u.shape[1]))
    every[given] = u
    names = model.names("input")
    for row, source, seconds in late_rows(model):
        first = (before or {}).get(names[source], float(every[source, 0]))
        every[row] = _late(model.inputs[source].interpolation, time, every[source], seconds, first)
    for row, info in enumerate(model.inputs):
        if info.rate_of and row not in given:
            every[row] = slopes(time, every[names.index(info.rate_of)])
    return every


def _late(way: str, time: FloatArray, values: FloatArray, seconds: float, first: float) -> FloatArray:
    """An input (n,) so many seconds later, at the same times; ``first`` is what it was before these."""
    if time.size < 2:
        return np.full_like(values, first) if seconds > 0.0 else values.copy()
    if way == "hold":
        ends = np.append(time, 2.0 * time[-1] - time[-2])  # the last value holds
        whole = np.append(0.0, np.cumsum(values * np.diff(ends)))
        before = np.minimum(ends - seconds - ends[0], 0.0) * first
        means: FloatArray = np.diff(np.interp(ends - seconds, ends, whole) + before) / np.diff(ends)
        return means
    if way == BAND_LIMITED and is_even(time):
        time_of, values = finer_times(time), finer(values[np.newaxis])[0]
    else:
        time_of = time
    later: FloatArray = np.interp(time - seconds, time_of, values, left=first)
    return later


def break_times(model: Model, time: FloatArray) -> FloatArray:
    """Times of a table (n,), not decreasing, and those at which late inputs bend or jump, sorted; none twice."""
    own = np.unique(time)
    lengths = np.diff(own)
    close = _SAME_TIME * float(lengths.min()) if lengths.size else 0.0
    for _, _, seconds in late_rows(model):
        later = np.unique(time) + seconds
        after = np.searchsorted(own, later)
        nearest = np.minimum(
            np.abs(later - own[np.minimum(after, own.size - 1)]), np.abs(later - own[np.maximum(after - 1, 0)])
        )
        own = np.union1d(own, later[nearest > close])
    return own
