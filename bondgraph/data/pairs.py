"""Channels of one log that are another one in another unit, by a factor or an offset: suspected without any model."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np

from bondgraph import units
from bondgraph.data.header import TEXT_UNIT, UNKNOWN_UNIT
from bondgraph.data.log import FloatArray, Log, LogChannel
from bondgraph.data.offsets import offset_readings
from bondgraph.data.suspicions import FACTORS, FEWEST, agreement
from bondgraph.text import number

#: Two channels are one quantity where this share of either is left when their ratio is taken out, and their ratio is
#: one of units within this factor: rolling radii and gears seldom come so near by chance.
_LEFT, _NEAR = 0.02, 1.01
#: Largest difference (rms) of two channels that show one temperature, as a share of what a unit with an offset shifts:
#: 3 K, a convention.
_SAME = 0.01
#: Samples looked at of each channel; more tell nothing new of a ratio.
_MOST = 20_000


def factor_suspicions(log: Log) -> list[str]:
    """Sentences on pairs of channels whose ratio is that of two units, and on channels that are slopes of others so.

    Examples
    --------
    >>> time = np.arange(100) * 0.1
    >>> speed = 10.0 + np.sin(time)
    >>> channels = {"gps": LogChannel("gps", "m/s", speed), "dash": LogChannel("dash", "m/s", 3.6 * speed)}
    >>> factor_suspicions(Log("run", time, channels))
    ["'dash' is 3.6 times 'gps', which suggests km/h read as m/s - check the units in their headers"]
    """
    known = [one for one in log.channels.values() if _is_number(one)]
    step = max(1, math.ceil(len(log) / _MOST))
    found: list[str] = []
    for first, second in itertools.permutations(known, 2):
        if units.dimension(first.unit) == units.dimension(second.unit):
            values = _converted(second, first.unit)
            found += _ratio(repr(second.name), repr(first.name), values[::step], first.numbers[::step], first.unit)
    for place, rate in itertools.permutations(known, 2):
        if units.dimension(rate.unit) == units.dimension(f"({place.unit}) / s"):
            values = _travelled(log.time, _converted(rate, f"({place.unit}) / s"))[::step]
            moved = (place.numbers - place.numbers[0])[::step]
            found += _ratio(f"the integral of {rate.name!r}", repr(place.name), values, moved, f"({place.unit}) / s")
    return found


def offset_suspicions(log: Log) -> list[str]:
    """Sentences on channels that are another one as soon as their numbers are read in a unit with an offset.

    Examples
    --------
    >>> room = 20.0 + np.sin(np.arange(50.0))
    >>> channels = {"wall": LogChannel("wall", "K", 273.15 + room), "air": LogChannel("air", "K", room + 0.3)}
    >>> offset_suspicions(Log("run", np.arange(50.0), channels))
    ["'air' (19.3 to 21.3 K as read) is 'wall' to 0.3 K (rms) if its numbers are degC - write the header of the column
    as 'air [degC]'"]
    """
    known = [one for one in log.channels.values() if _is_number(one)]
    step = max(1, math.ceil(len(log) / _MOST))
    found: list[str] = []
    for channel, other in itertools.permutations(known, 2):
        readings = offset_readings(channel.unit)
        if not readings or units.dimension(channel.unit) != units.dimension(other.unit):
            continue
        values, reference = channel.numbers[::step], _converted(other, channel.unit)[::step]
        both = np.isfinite(values) & np.isfinite(reference)
        for reading in readings if both.sum() >= FEWEST else ():
            left = float(np.sqrt(np.mean((reading.of(values) - reference)[both] ** 2)))
            if left < _SAME * reading.shift(values):
                ends = " to ".join(number(float(end(values[both]))) for end in (np.min, np.max))
                found.append(
                    f"{channel.name!r} ({ends} {channel.unit} as read) is {other.name!r} to {number(left)} "
                    f"{channel.unit} (rms) if its numbers are {reading.unit} - write the header of the column as "
                    f"'{channel.name} [{reading.unit}]'"
                )
    return found


def _is_number(channel: LogChannel) -> bool:
    return not channel.is_text and channel.unit not in (TEXT_UNIT, UNKNOWN_UNIT) and not channel.missing.all()


def _converted(channel: LogChannel, unit: str) -> FloatArray:
    factor, offset = units.conversion(channel.unit, unit)
    return channel.numbers * factor + offset


def _travelled(time: FloatArray, rate: FloatArray) -> FloatArray:
    """Integral of a rate (n,) by trapezia from the first sample; NaN from where a sample is missing."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))))


def _ratio(name: str, other: str, measured: FloatArray, reference: FloatArray, unit: str) -> Iterator[str]:
    found = agreement(measured, reference)
    if found is None or found.slope <= 1.0 / _NEAR:
        return
    scaled = agreement(measured / found.slope, reference)
    if scaled is None or scaled.error > _LEFT:
        return
    for factor, dimensions, suggestion in FACTORS:
        fits = not dimensions or any(units.dimension(unit) == units.dimension(one) for one in dimensions)
        if factor > 1.0 and fits and abs(math.log(found.slope / factor)) < math.log(_NEAR):
            said = f"{name} is {found.slope:.4g} times {other}, which suggests {suggestion}"
            yield f"{said} - check the units in their headers"
            return
