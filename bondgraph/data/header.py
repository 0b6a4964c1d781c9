"""Headers of logs: ``name [unit]``, and units that are checked where they are read."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from bondgraph import units
from bondgraph.errors import DataError, DeclarationError, suggest

#: Unit written over a column of codes, and over one whose format has no room for units.
TEXT_UNIT, UNKNOWN_UNIT = "text", "?"
#: Cells that mean that nothing was measured, in lower case.
EMPTY = ("", "nan", "na", "n/a", "null", "none")
#: Letters of a number or a code.
LONGEST_CELL = 200

_HEADER = re.compile(r"^\s*(?P<name>[^\[\]]+?)\s*\[\s*(?P<unit>[^\[\]]*?)\s*\]\s*$")

#: Units met in logs of machines, for suggestions.
_COMMON = (
    "1", "s", "ms", "min", "h", "m", "mm", "km", "m/s", "km/h", "mph", "m/s^2", "g_0", "rad", "deg", "rad/s", "deg/s",
    "rpm", "rad/s^2", "N", "kN", "N m", "N/m", "kg", "g", "kg m^2", "W", "kW", "J", "Pa", "kPa", "bar", "V", "mV", "A",
    "mA", "ohm", "H", "F", "C", "K", "degC", "percent", "Hz", "L/min", "m^3/s", "T",
)  # fmt: skip


@dataclass(frozen=True)
class Reading:
    """What a user says of a file beside its name: units by column, and which column holds the time."""

    units: Mapping[str, str] = field(default_factory=dict)
    time: str | None = None

    def unit(self, label: str, is_time: bool = False) -> str | None:
        """The unit given for a column; that of the time may be given as that of ``time``."""
        return self.units.get(label) or (self.units.get("time") if is_time else None)


def resolve_headers(headers: Sequence[str], reading: Reading, source: str) -> list[tuple[str, str | None]]:
    """Name and unit of each column; the column of time is called ``time`` and may have no unit (it may hold dates).

    Raises
    ------
    DataError
        If there is no column of time, two columns have the same name, one has no unit or a wrong one, or the reading
        names a column that is not there.

    Examples
    --------
    >>> resolve_headers(["Stamp", "speed [km/h]", "lever"], Reading({"lever": "deg"}, "Stamp"), "run7.csv")
    [('time', None), ('speed', 'km/h'), ('lever', 'deg')]
    """
    split = [_loosely(header) for header in headers]
    labels = [label for label, _ in split]
    _require_known(reading, labels, source)
    place = _time_place(headers, labels, reading.time, source)
    resolved: list[tuple[str, str | None]] = []
    for position, (label, written) in enumerate(split):
        unit = reading.unit(label, position == place) or written
        if unit is None and position != place:
            raise _no_unit(headers[position], source)
        if unit is not None:
            require_unit(label, unit, source)
        resolved.append(("time" if position == place else label, unit))
    names = [name for name, _ in resolved]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise DataError(f"{source}: column {twice!r} stands twice (row 1) - rename or drop one", where=(source, twice))
    return resolved


def units_row(header: Sequence[str], second: Sequence[str]) -> list[str] | None:
    """Headers ``name [unit]`` where names stand in the first row and units in the second; None where they do not.

    Examples
    --------
    >>> units_row(["time", "speed", "ratio"], ["s", "(km/h)", ""])
    ['time [s]', 'speed [km/h]', 'ratio [1]']
    >>> units_row(["time [s]", "speed [km/h]"], ["0", "36"]) is None
    True
    """
    if len(second) != len(header) or any("[" in name for name in header):
        return None
    written = [cell.strip().strip("[]()").strip() for cell in second]
    found = ["1" if unit in ("", "-", "--") else unit for unit in written]
    if not any(written) or any(_is_number(unit) for unit in written):
        return None
    known = [is_unit(unit) for unit in found if unit != "1"]
    if sum(known) <= len(known) / 2:  # codes and dates are no units; one that is misspelt among others is told
        return None
    return [f"{name} [{unit}]" for name, unit in zip(header, found, strict=True)]


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def is_unit(text: str) -> bool:
    """Whether the units library knows a unit, or it is that of codes."""
    try:
        units.parse_unit(text)
    except DeclarationError:
        return text == TEXT_UNIT
    return True


def _loosely(header: str) -> tuple[str, str | None]:
    """Name and unit of a header; None where it has no unit."""
    match = _HEADER.match(header)
    return (header.strip(), None) if match is None else (match["name"], match["unit"] or "1")


def _require_known(reading: Reading, labels: Iterable[str], source: str) -> None:
    known = list(labels)
    for name in reading.units:
        if name not in (*known, "time"):
            raise DataError(
                f"{source}: a unit is given for {name!r}, which is no column{suggest(name, known)} - the columns are "
                f"{', '.join(known)}",
                where=(source, name),
            )


def _time_place(headers: Sequence[str], labels: Sequence[str], given: str | None, source: str) -> int:
    if given is not None:
        for position, (header, label) in enumerate(zip(headers, labels, strict=True)):
            if given in (label, header):
                return position
        raise DataError(
            f"{source}: no column {given!r}{suggest(given, labels)} that could hold the time - the columns are "
            f"{', '.join(labels)}",
            where=(source, given),
        )
    if "time" in labels:
        return labels.index("time")
    first = labels[0] if labels else ""
    raise DataError(
        f"{source}: the first column must be 'time [s]' but is {first!r} (row 1), and no other is called 'time' - "
        "rename it, or name the column of time with --time",
        where=(source, first),
    )


def _no_unit(header: str, source: str) -> DataError:
    return DataError(
        f"{source}: column {header!r} has no unit (row 1) - write it as 'name [unit]', with [1] for a number "
        f"without dimension and [text] for codes, or give --units '{header}=UNIT'",
        where=(source, header),
    )


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
        raise _no_unit(header, source)
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
    if unit in (TEXT_UNIT, UNKNOWN_UNIT):
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
    if unit == UNKNOWN_UNIT:
        raise DataError(
            f"{source}: column {name!r} has no unit in this kind of file, and the model needs {to!r} - give it, such "
            f"as --units '{name}={to}'",
            where=(source, name),
        )
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
