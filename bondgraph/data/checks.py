"""What deserves attention in a log, said before any computation.

Errors (a missing column, a bad unit, times that do not increase) stop where a log is read or matched. Findings are what
may be right but often is not: a sensor that was off, stuck, clipped, or showed what no machine does.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from bondgraph import units
from bondgraph.data.header import TEXT_UNIT, require_unit
from bondgraph.data.log import FIRST_ROW, FloatArray, Log, LogChannel, row_list

FindingKind = Literal["missing", "gap", "constant", "saturation", "beyond limits", "spike"]

#: A run of missing samples is a gap when it is this many times longer than the channel's usual step, and 0.5 s.
_GAP_STEPS, _GAP_SECONDS = 10.0, 0.5
#: A channel is clipped when at least this many neighbouring samples rest exactly at its extreme.
_CLIPPED_SAMPLES = 20
#: A sample is a spike when it lies this many robust standard deviations from the median of samples this far away.
_SPIKE_SIGMAS, _SPIKE_OFFSETS = 12.0, (-5, -4, -3, 3, 4, 5)

#: Magnitudes no ground vehicle, drive or laboratory machine reaches, by unit of the dimension; lower and upper.
_LIMITS: tuple[tuple[str, float, float], ...] = (
    ("m/s", -400.0, 400.0),
    ("rad/s", -3.0e4, 3.0e4),
    ("m/s^2", -5.0e3, 5.0e3),
    ("K", 0.0, 4000.0),
    ("kg", 0.0, 1.0e6),
    ("Pa", -1.0e9, 1.0e9),
)


@dataclass(frozen=True)
class Finding:
    """One thing worth knowing about a channel: rows are those of the table, first and last concerned."""

    kind: FindingKind
    channel: str
    rows: tuple[int, int]
    message: str


def check_log(log: Log, limits: Mapping[str, tuple[float, float]] | None = None) -> tuple[Finding, ...]:
    """Findings of a log, in the order of its columns.

    Parameters
    ----------
    log
        As read.
    limits
        Physical bounds of channels in their own units, by name; without them wide limits by dimension hold.

    Raises
    ------
    DataError
        If a channel has a unit that is not one.

    Examples
    --------
    >>> time = np.linspace(0.0, 1.0, 11)
    >>> log = Log("run", time, {"speed": LogChannel("speed", "m/s", np.full(11, 3.0))})
    >>> [finding.message for finding in check_log(log)]
    ["column 'speed' is constant at 3 m/s in all 11 samples"]
    """
    found: list[Finding] = []
    for channel in log.channels.values():
        require_unit(channel.name, channel.unit, log.name)
        if channel.missing.all():
            found.append(_finding("missing", channel, np.arange(len(log)), "has no measurement at all"))
            continue
        found.extend(_gaps(log.time, channel))
        if not channel.is_text:
            found.extend(_value_findings(channel, (limits or {}).get(channel.name)))
    return tuple(found)


def _value_findings(channel: LogChannel, limits: tuple[float, float] | None) -> Iterator[Finding]:
    valid = np.flatnonzero(~channel.missing)
    values = channel.numbers[valid]
    if values.size > 1 and np.ptp(values) == 0.0:
        text = f"is constant at {values[0]:.6g} {channel.unit} in all {values.size} samples"
        yield _finding("constant", channel, valid, text)
        return
    lower, upper = limits if limits is not None else _usual_limits(channel.unit)
    outside = valid[(values < lower) | (values > upper)]
    if outside.size:
        text = f"is beyond {lower:.4g} to {upper:.4g} {channel.unit} in {row_list(outside)}"
        yield _finding("beyond limits", channel, outside, text)
    yield from _saturation(channel, valid, values)
    spikes = valid[spike_mask(values)]
    if spikes.size:
        yield _finding("spike", channel, spikes, f"jumps away and back in {row_list(spikes)}")


def _gaps(time: FloatArray, channel: LogChannel) -> Iterator[Finding]:
    """Runs of missing samples much longer than the step at which this channel is sampled."""
    valid = np.flatnonzero(~channel.missing)
    inner = np.diff(time[valid])
    usual = float(np.median(inner)) if inner.size else 0.0
    edges = np.concatenate(([-1], valid, [time.size]))
    for before, after in itertools.pairwise(edges):
        start, end = time[max(before, 0)], time[min(after, time.size - 1)]
        if after - before > 1 and end - start > max(_GAP_SECONDS, _GAP_STEPS * usual):
            text = f"has no measurement from {start:.6g} s to {end:.6g} s (rows {before + 1 + FIRST_ROW} to "
            yield _finding("gap", channel, np.arange(before + 1, after), f"{text}{after - 1 + FIRST_ROW})")


def _saturation(channel: LogChannel, valid: npt.NDArray[np.intp], values: FloatArray) -> Iterator[Finding]:
    """Longest rest exactly at the largest or smallest value; rest at zero is standstill, not saturation."""
    for extreme, word in ((float(values.max()), "highest"), (float(values.min()), "lowest")):
        start, length = _longest_run(values == extreme)
        if extreme != 0.0 and length >= _CLIPPED_SAMPLES:
            run = valid[start : start + length]
            text = f"rests at its {word} value {extreme:.6g} {channel.unit} for {length} samples from row "
            yield _finding("saturation", channel, run, f"{text}{run[0] + FIRST_ROW}; is the sensor saturated?")


def _longest_run(mask: npt.NDArray[np.bool_]) -> tuple[int, int]:
    """Start and length of the longest run of true values."""
    change = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    starts, lengths = change[::2], change[1::2] - change[::2]
    longest = int(np.argmax(lengths))
    return int(starts[longest]), int(lengths[longest])


def spike_mask(values: FloatArray) -> npt.NDArray[np.bool_]:
    """Where a signal leaves its neighbourhood for up to four samples and returns; shape (n,), a rule after Hampel.

    A sample is a spike when it differs from the median of those three to five samples away by more than twelve robust
    standard deviations of that difference over the whole channel, while those agree among themselves.

    Reference: Davies and Gather (1993), The identification of multiple outliers, JASA 88(423).

    Examples
    --------
    >>> wave = np.sin(np.arange(100) / 5.0)
    >>> wave[40] = 9.0
    >>> np.flatnonzero(spike_mask(wave)).tolist()
    [40]
    """
    reach = max(_SPIKE_OFFSETS)
    mask = np.zeros(values.size, dtype=bool)
    if values.size < 4 * reach:
        return mask
    windows = np.lib.stride_tricks.sliding_window_view(values, 2 * reach + 1)
    around = windows[:, reach + np.array(_SPIKE_OFFSETS)]
    away = np.abs(windows[:, reach] - np.median(around, axis=1))
    moved = away[away > 0.0]  # a quantised signal at rest does not move at all; its scale is that of its steps
    if moved.size:
        sigma = 1.4826 * float(np.median(moved))
        mask[reach:-reach] = (away > _SPIKE_SIGMAS * sigma) & (away > 3.0 * np.ptp(around, axis=1))
    return mask


def _usual_limits(unit: str) -> tuple[float, float]:
    if unit != TEXT_UNIT:
        for base, lower, upper in _LIMITS:
            # Angles count as dimensionless, so a frequency and an angular velocity share a dimension and a limit.
            if units.dimension(unit) == units.dimension(base):
                factor, offset = units.conversion(unit, base)
                return (lower - offset) / factor, (upper - offset) / factor
    return -np.inf, np.inf


def _finding(kind: FindingKind, channel: LogChannel, indices: npt.NDArray[np.intp], text: str) -> Finding:
    rows = (int(indices[0]) + FIRST_ROW, int(indices[-1]) + FIRST_ROW)
    return Finding(kind, channel.name, rows, f"column {channel.name!r} {text}")
