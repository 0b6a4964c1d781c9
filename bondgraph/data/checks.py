"""What deserves attention in a log, said before any computation.

Errors (a missing column, a bad unit, times that do not increase) stop where a log is read or matched. Findings are what
may be right but often is not: a sensor that was off, stuck, clipped, or showed what no machine does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from bondgraph import units
from bondgraph.data.header import TEXT_UNIT, UNKNOWN_UNIT, require_unit
from bondgraph.data.log import FloatArray, Log, LogChannel, row_list

FindingKind = Literal["missing", "gap", "constant", "saturation", "beyond limits", "spike"]

#: A run of missing samples is a gap when it is this many times longer than the channel's usual step, and 0.5 s.
_GAP_STEPS, _GAP_SECONDS = 10.0, 0.5
#: A channel is clipped when at least this many neighbouring samples rest exactly at its extreme.
_CLIPPED_SAMPLES = 20
#: A sample is a spike when it lies this many robust standard deviations from the median of samples this far away.
_SPIKE_SIGMAS, _SPIKE_OFFSETS = 12.0, (-5, -4, -3, 3, 4, 5)
#: Samples whose neighbourhoods are held at one time.
_SPIKE_BLOCK = 1 << 16

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
            rows = np.arange(len(log))
            found.append(_finding("missing", channel, rows, "has no measurement at all", log.first_row))
            continue
        found.extend(_gaps(log.time, channel, log.first_row))
        if not channel.is_text:
            found.extend(_value_findings(channel, (limits or {}).get(channel.name), log.first_row))
    return tuple(found)


def _value_findings(channel: LogChannel, limits: tuple[float, float] | None, first_row: int) -> Iterator[Finding]:
    valid = np.flatnonzero(~channel.missing)
    values = channel.numbers[valid]
    if values.size > 1 and np.ptp(values) == 0.0:
        unit = "" if channel.unit in ("", "1") else f" {channel.unit}"
        text = f"is constant at {values[0]:.6g}{unit} in all {values.size} samples"
        yield _finding("constant", channel, valid, text, first_row)
        return
    lower, upper = limits if limits is not None else _usual_limits(channel.unit)
    outside = valid[(values < lower) | (values > upper)]
    if outside.size:
        text = f"is beyond {lower:.4g} to {upper:.4g} {channel.unit} in {row_list(outside, first_row)}"
        yield _finding("beyond limits", channel, outside, text, first_row)
    yield from _saturation(channel, valid, values, first_row)
    spikes = valid[spike_mask(values)]
    if spikes.size:
        text = f"jumps away and back in {row_list(spikes, first_row)}"
        yield _finding("spike", channel, spikes, text, first_row)


def _gaps(time: FloatArray, channel: LogChannel, first_row: int) -> Iterator[Finding]:
    """Runs of missing samples much longer than the step at which this channel is sampled."""
    valid = np.flatnonzero(~channel.missing)
    inner = np.diff(time[valid])
    usual = float(np.median(inner)) if inner.size else 0.0
    edges = np.concatenate(([-1], valid, [time.size]))
    bounds = time[np.clip(edges, 0, time.size - 1)]
    for place in np.flatnonzero((np.diff(edges) > 1) & (np.diff(bounds) > max(_GAP_SECONDS, _GAP_STEPS * usual))):
        before, after = int(edges[place]), int(edges[place + 1])
        start, end = bounds[place], bounds[place + 1]
        text = f"has no measurement from {start:.6g} s to {end:.6g} s (rows {before + 1 + first_row} to "
        run = np.arange(before + 1, after)
        yield _finding("gap", channel, run, f"{text}{after - 1 + first_row})", first_row)


def _saturation(
    channel: LogChannel, valid: npt.NDArray[np.intp], values: FloatArray, first_row: int
) -> Iterator[Finding]:
    """Longest rest exactly at the largest or smallest value; rest at zero is standstill, not saturation.

    A signal that rests as long between its extremes is held there by whoever sets it.
    """
    between = (values[1:] == values[:-1]) & (values[1:] < values.max()) & (values[1:] > values.min())
    if _longest_run(between)[1] >= _CLIPPED_SAMPLES - 1:
        return
    for extreme, word in ((float(values.max()), "highest"), (float(values.min()), "lowest")):
        start, length = _longest_run(values == extreme)
        if extreme != 0.0 and length >= _CLIPPED_SAMPLES:
            run = valid[start : start + length]
            text = f"rests at its {word} value {extreme:.6g} {channel.unit} for {length} samples from row "
            text += f"{run[0] + first_row}; is the sensor saturated?"
            yield _finding("saturation", channel, run, text, first_row)


def _longest_run(mask: npt.NDArray[np.bool_]) -> tuple[int, int]:
    """Start and length of the longest run of true values."""
    change = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    starts, lengths = change[::2], change[1::2] - change[::2]
    if not lengths.size:
        return 0, 0
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
    away, spread = np.empty(len(windows)), np.empty(len(windows))
    for start in range(0, len(windows), _SPIKE_BLOCK):
        block = slice(start, start + _SPIKE_BLOCK)
        around = np.sort(windows[block, reach + np.array(_SPIKE_OFFSETS)], axis=1)
        middle = len(_SPIKE_OFFSETS) // 2
        away[block] = np.abs(windows[block, reach] - np.mean(around[:, middle - 1 : middle + 1], axis=1))
        spread[block] = around[:, -1] - around[:, 0]
    moved = away[away > 0.0]  # a quantised signal at rest does not move at all; its scale is that of its steps
    if moved.size:
        sigma = 1.4826 * float(np.median(moved))
        mask[reach:-reach] = (away > _SPIKE_SIGMAS * sigma) & (away > 3.0 * spread)
    return mask


def _usual_limits(unit: str) -> tuple[float, float]:
    if unit not in (TEXT_UNIT, UNKNOWN_UNIT):
        for base, lower, upper in _LIMITS:
            # Angles count as dimensionless, so a frequency and an angular velocity share a dimension and a limit.
            if units.dimension(unit) == units.dimension(base):
                factor, offset = units.conversion(unit, base)
                return (lower - offset) / factor, (upper - offset) / factor
    return -np.inf, np.inf


def _finding(
    kind: FindingKind, channel: LogChannel, indices: npt.NDArray[np.intp], text: str, first_row: int
) -> Finding:
    rows = (int(indices[0]) + first_row, int(indices[-1]) + first_row)
    return Finding(kind, channel.name, rows, f"column {channel.name!r} {text}")
