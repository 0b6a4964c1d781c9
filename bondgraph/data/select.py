"""Parts of logs: a window, the two sides of a cut, a lower rate. Measurements are left out, never interpolated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from bondgraph.data.log import FloatArray, Log, MatchedLog
from bondgraph.data.suspicions import gaps
from bondgraph.errors import DataError

AnyLog = TypeVar("AnyLog", Log, MatchedLog)


def window(log: AnyLog, start: float, end: float) -> AnyLog:
    """The samples from ``start`` to before ``end``, in seconds of the log's own time.

    Raises
    ------
    DataError
        If there are none.
    """
    chosen = (log.time >= start) & (log.time < end)
    if not chosen.any():
        raise DataError(
            f"{log.name}: no samples {_said(start, end)}; the log runs from {log.time[0]:g} s to {log.time[-1]:g} s",
            where=(log.name,),
        )
    return log.rows(chosen)


def _said(start: float, end: float) -> str:
    """A window in words; an end that is not given is no number."""
    parts = [f"from {start:g} s"] if math.isfinite(start) else []
    return " ".join([*parts, f"to {end:g} s"] if math.isfinite(end) else [*parts, "on"])


def beginnings(logs: Sequence[AnyLog], share: float, least: int = 1) -> tuple[AnyLog, ...]:
    """The first share of the samples of each log, at least so many where it has them.

    Examples
    --------
    >>> log = MatchedLog("run", np.arange(10.0), np.zeros((0, 10)), np.zeros((1, 10)))
    >>> [len(one) for one in beginnings([log], 0.25)], [len(one) for one in beginnings([log], 0.25, least=20)]
    ([3], [10])
    """
    counts = [max(math.ceil(share * len(log)), least) for log in logs]
    return tuple(log.rows(np.arange(len(log)) < count) for log, count in zip(logs, counts, strict=True))


def pieces(log: AnyLog, count: int, samples: int) -> tuple[AnyLog, ...]:
    """Pieces of a log, so many of so many samples each, evenly over it; the log itself where they would cover it all.

    Examples
    --------
    >>> log = MatchedLog("run", np.arange(100.0), np.zeros((0, 100)), np.zeros((1, 100)))
    >>> [one.time[[0, -1]].tolist() for one in pieces(log, 3, 10)], len(pieces(log, 3, 50))
    ([[0.0, 9.0], [45.0, 54.0], [90.0, 99.0]], 1)
    """
    if count * samples >= len(log):
        return (log,)
    first = np.linspace(0, len(log) - samples, count).astype(int)
    place = np.arange(len(log))
    return tuple(log.rows((begin <= place) & (place < begin + samples)) for begin in first)


def split(log: AnyLog, fraction: float) -> tuple[AnyLog, AnyLog]:
    """The log before and after a point in time: ``fraction`` of its duration, between 0 and 1.

    Raises
    ------
    DataError
        If either side would be empty.

    Examples
    --------
    >>> first, second = split(Log("run", np.arange(10.0), {}), 0.7)
    >>> len(first), len(second), float(second.time[0])
    (7, 3, 7.0)
    """
    cut = float(log.time[0] + fraction * (log.time[-1] - log.time[0]))
    before = log.time < cut
    if not 0.0 < fraction < 1.0 or before.all() or not before.any():
        raise DataError(
            f"{log.name}: {len(log)} samples cannot be split at {fraction:g} of their time - choose a fraction "
            "between 0 and 1 with samples on both sides",
            where=(log.name,),
        )
    return log.rows(before), log.rows(~before)


def split_at_gaps(log: AnyLog) -> tuple[AnyLog, ...]:
    """The parts of a log between jumps in time, each with a start of its own; the log itself where time never jumps.

    Nobody knows what the inputs did meanwhile, so that no model can lead across. Parts are called after the log,
    ``run.1`` and so on; one of a single sample is left out.

    Parameters
    ----------
    log
        As read, or matched. A jump is ten times the usual interval, and half a second at least.

    Examples
    --------
    >>> import bondgraph as bg
    >>> time = np.array([0.0, 0.1, 0.2, 0.3, 5.3, 5.4, 5.5])
    >>> first, second = bg.split_at_gaps(bg.Log("run", time, {}))
    >>> first.name, len(first), second.name, second.time.tolist()
    ('run.1', 4, 'run.2', [5.3, 5.4, 5.5])
    """
    ends = gaps(log.time)
    if not ends.size:
        return (log,)
    part = np.searchsorted(ends, np.arange(len(log)), side="left")
    parts = [log.rows(part == k) for k in range(ends.size + 1)]
    return tuple(replace(one, name=f"{log.name}.{k}") for k, one in enumerate(parts, start=1) if len(one) > 1)


def decimate(log: AnyLog, rate: float) -> AnyLog:
    """The log at a lower rate: of every signal the samples that are due, and all that stands in their rows.

    Signals of different rates or in alternating rows are thinned each by itself, so none vanishes. White measurement
    noise stays white; nothing is averaged.

    Parameters
    ----------
    log
        As read, or matched (there the outputs decide).
    rate
        Samples per second to keep of each signal.

    Raises
    ------
    DataError
        If the rate is not positive.

    Examples
    --------
    >>> len(decimate(Log("run", np.arange(100) / 100, {}), 10.0))
    10
    """
    if not rate > 0.0:
        raise DataError(f"{log.name}: a rate of {rate:g} samples per second is not possible", where=(log.name,))
    if isinstance(log, MatchedLog):
        missing = [np.isnan(row) for row in log.y]
    else:
        missing = [channel.missing for channel in log.channels.values()]
    chosen = np.zeros(log.time.size, dtype=bool)
    for valid in (np.flatnonzero(~empty) for empty in missing or [np.zeros(log.time.size, dtype=bool)]):
        chosen[valid[_due(log.time[valid], 1.0 / rate)]] = True
    return log.rows(chosen)


def _due(time: FloatArray, step: float) -> npt.NDArray[np.intp]:
    """Of each interval of length ``step`` the first sample."""
    if time.size == 0:
        return np.zeros(0, dtype=np.intp)
    # A sample that is due but a rounding error early still belongs to its own interval.
    interval = np.floor((time - time[0]) / step + 1e-6)
    return np.flatnonzero(np.concatenate(([True], np.diff(interval) > 0)))
