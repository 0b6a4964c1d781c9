"""Headers of logs: ``name [unit]``, and units that are checked where they are read."""

from __future__ import annotations

import re

from bondgraph import units
from bondgraph.errors import DataError, DeclarationError, suggest

#: Unit written over a column of codes.
TEXT_UNIT = "text"

_HEADER = re.compile(r"^\s*(?P<name>[^\[\]]+?)\s*\[\s*(?P<unit>[^\[\]]*?)\s*\]\s*$")

#: Units met in logs of machines, for suggestions.
_COMMON = (
    "1", "s", "ms", "min", "h", "m", "mm", "km", "m/s", "km/h", "mph", "m/s^2", "g_0", "rad", "deg", "rad/s", "deg/s",
    "rpm", "rad/s^2", "N", "kN", "N m", "N/m", "kg", "g", "kg m^2", "W", "kW", "J", "Pa", "kPa", "bar", "V", "mV", "A",
    "mA", "ohm", "H", "F", "C", "K", "degC", "percent", "Hz", "L/min", "m^3/s", "T",
)  # fmt: skip


def split_header(header: str, source: str) -> tuple[str, str]:
    """Name and unit of a column header.

    Raises
    ------
    DataError
        If the header carries no unit.

    Examples
    --------
    >>> split_header("engine_speed [rpm]", "run7.csv")
    ('engine_speed', 'rpm')
    """
    match = _HEADER.match(header)
    if match is None:
        raise DataError(
            f"{source}: column {header!r} has no unit (row 1) - write it as 'name [unit]', with [1] for a number "
            "without dimension and [text] for codes",
            where=(source, header),
        )
    return match["name"], match["unit"] or "1"


def require_unit(name: str, unit: str, source: str) -> None:
    """Refuse a unit that the units library does not know.

    Raises
    ------
    DataError
        With the closest known unit.

    Examples
    --------
    >>> require_unit("engine_speed", "rpn", "run7.csv")
    Traceback (most recent call last):
        ...
    bondgraph.errors.DataError: run7.csv: column 'engine_speed' has unit 'rpn' (row 1); did you mean 'rpm'?
    """
    if unit == TEXT_UNIT:
        return
    try:
        units.parse_unit(unit)
    except DeclarationError:
        meant = units.meant_unit(unit)
        hint = (
            f"; did you mean {meant!r}?"
            if meant
            else suggest(unit, _COMMON) or " - it is not a unit; write one such as 'rpm', 'km/h', 'N m' or '1'"
        )
        raise DataError(f"{source}: column {name!r} has unit {unit!r} (row 1){hint}", where=(source, name)) from None


def convert_unit(name: str, unit: str, to: str, source: str) -> tuple[float, float]:
    """Factor and offset that bring a column into the unit of the model.

    Raises
    ------
    DataError
        If the dimensions differ.

    Examples
    --------
    >>> convert_unit("v", "km/h", "m/s", "run7.csv")[1]
    0.0
    """
    require_unit(name, unit, source)
    _require_angle(name, unit, to, source)
    try:
        return units.conversion(unit, to)
    except DeclarationError:
        have, need = (units.dimension_text(units.dimension(text)) for text in (unit, to))
        raise DataError(
            f"{source}: column {name!r} has unit {unit!r} (dimension {have}) but the model needs {to!r} ({need})"
            " - correct the unit, or map another column",
            where=(source, name),
        ) from None


def _require_angle(name: str, unit: str, to: str, source: str) -> None:
    # The SI calls both 1/s, so a units library turns 50 Hz into 50 rad/s and 3000 1/min into 50 without a word; a
    # factor of 2 pi is at stake.
    if units.is_bare_rate(unit) and units.is_angular_rate(to):
        raise DataError(
            f"{source}: column {name!r} has unit {unit!r}, which counts cycles or radians, but the model "
            f"needs {to!r} - write {units.ANGULAR_UNITS}",
            where=(source, name),
        )
    if units.is_angular_rate(unit) and units.is_bare_rate(to):
        raise DataError(
            f"{source}: column {name!r} has unit {unit!r}, an angular speed, but the model needs {to!r}"
            " - declare the quantity in 'rad/s' if it is an angular speed, or write the column in a unit per time",
            where=(source, name),
        )
