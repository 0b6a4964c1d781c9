"""Channels that hold numbers of a unit with an offset, degrees Celsius, under a header without: said, never corrected.

A bare range tells nothing: machines are cold, too. Told are channels that agree with a model, or with another channel
of the log, once their numbers are read in the other unit, while as they are they do not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bondgraph import units
from bondgraph.coherent import has_offset
from bondgraph.data.log import FloatArray
from bondgraph.data.suspicions import BETTER, FEWEST, in_blocks, is_surely_smaller
from bondgraph.text import number

#: Units with an offset that loggers write; pint knows that of Réaumur too, whose numbers pass for degrees Celsius.
_WRITTEN = ("degC", "degF")
#: Largest error (rms) of a model that follows a channel read in the other unit, and smallest error of one that does not
#: follow it as it is read, as shares of the offset: 27 K and 68 K. Parameters that are not estimated yet leave the
#: first, and seldom the second. Conventions.
_FOLLOWED, _LOST = 0.1, 0.25


@dataclass(frozen=True)
class OffsetReading:
    """A reading of numbers in coherent SI as numbers of ``unit``: ``factor * value + offset``."""

    unit: str
    factor: float
    offset: float

    def of(self, values: FloatArray) -> FloatArray:
        """Values in coherent SI, read so; any shape."""
        read: FloatArray = self.factor * values + self.offset
        return read

    def shift(self, values: FloatArray) -> float:
        """How far the reading moves values, rms over those that are measured."""
        return float(np.sqrt(np.nanmean((self.of(values) - values) ** 2)))


def offset_readings(unit: str) -> tuple[OffsetReading, ...]:
    """Readings of a channel of a coherent unit in units with an offset; none where there is no such unit.

    Examples
    --------
    >>> [(one.unit, round(float(one.of(np.array(20.0))), 4)) for one in offset_readings("K")]
    [('degC', 293.15), ('degF', 266.4833)]
    >>> offset_readings("N")
    ()
    """
    fitting = [one for one in _WRITTEN if units.dimension(one) == units.dimension(unit)]
    if not fitting or has_offset(unit):
        return ()
    return tuple(OffsetReading(one, *units.conversion(one, unit)) for one in fitting)


def squared_errors(measured: FloatArray, modelled: FloatArray | None) -> FloatArray | None:
    """Mean squared errors of channels (n_channels, n), as what each block of the log adds (blocks,).

    None where nothing is modelled, or where too little is measured.
    """
    if modelled is None:
        return None
    each = []
    for y, m in zip(measured, modelled, strict=True):
        both = np.isfinite(y) & np.isfinite(m)
        if both.sum() >= FEWEST:
            each.append(in_blocks((y[both] - m[both]) ** 2) / both.sum())
    return np.mean(each, axis=0) if each else None


def tells_offset(as_read: FloatArray, otherwise: FloatArray, reading: OffsetReading) -> bool:
    """True where a model follows channels in another unit, and is lost as they are read."""
    followed = math.sqrt(otherwise.sum()) < _FOLLOWED * reading.offset
    return followed and is_lost(as_read, reading) and is_clearly_better(otherwise, as_read)


def is_lost(squares: FloatArray, reading: OffsetReading) -> bool:
    """True where the errors of a model are large beside the offset of a reading."""
    return math.sqrt(squares.sum()) > _LOST * reading.offset


def is_clearly_better(squares: FloatArray, others: FloatArray) -> bool:
    """True where errors (blocks,) are surely smaller than others, and half of them at most (rms)."""
    return math.sqrt(squares.sum()) < BETTER * math.sqrt(others.sum()) and is_surely_smaller(squares, others)


def offset_sentence(
    names: Sequence[str], reading: OffsetReading, values: FloatArray, unit: str, errors: tuple[float, float]
) -> str:
    """The sentence that suspects channels of a unit with an offset.

    Parameters
    ----------
    names
        Of the channels.
    reading
        That agrees.
    values
        All their values as read, coherent SI, of any shape.
    unit
        That of these values.
    errors
        Of the model as read and read otherwise, rms.
    """
    before, after = map(number, errors)
    headers = " and ".join(f"'{name} [{reading.unit}]'" for name in names)
    columns = "the column" if len(names) == 1 else "the columns"
    return (
        f"{', '.join(map(repr, names))}: the values, {number(float(np.nanmin(values)))} to "
        f"{number(float(np.nanmax(values)))} {unit} as read, look like numbers in {reading.unit}; read so, the model "
        f"is {after} {unit} off (rms) instead of {before} {unit} - write the header of {columns} as {headers}"
    )
