"""Tables of a generated module as values: their rows, and the modes and zero functions of an exactly derived one."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from bondgraph.coherent import Displayed, coherent
from bondgraph.compile.loader import require_function
from bondgraph.errors import ModelError
from bondgraph.units import dimension

_Info = TypeVar("_Info")

_Shown = TypeVar("_Shown", bound=Displayed)

#: How a module writes of an input that it follows another one.
_LATE = re.compile(r"(\S+) s after (\S+)\Z")


@dataclass(frozen=True)
class ModeInfo:
    """A discrete value held between events: its input, ``switch``, ``friction`` or ``impact``, and whose it is.

    ``reset`` names the function of the states after an impact or lock.
    """

    input: str
    kind: str
    element: str
    reset: str | None


@dataclass(frozen=True)
class EventInfo:
    """One row of the zero functions of a model, and the input that holds the mode it belongs to."""

    mode: str
    unit: str
    meaning: str


def rows(names: Mapping[str, Any], table: str, kind: type[_Info], source: str) -> tuple[_Info, ...]:
    """The rows of one table of a module.

    Raises
    ------
    ModelError
        If a row has other columns.
    """
    try:
        return tuple(kind(*row) for row in names[table])
    except TypeError:
        fields = ", ".join(field.name for field in dataclasses.fields(kind))  # type: ignore[arg-type]
        raise ModelError(
            f"{source}: a row of {table} does not have the columns ({fields}) - regenerate the module",
            where=(source, table),
        ) from None


def shown_rows(names: Mapping[str, Any], table: str, kind: type[_Shown], source: str) -> tuple[_Shown, ...]:
    """The rows of a table of quantities, with the units in which they are shown where those are not their own.

    Raises
    ------
    ModelError
        If a row has other columns, or a unit in which it is shown does not fit its own.
    """
    shown = {name: unit for of, name, unit in names.get("SHOWN_UNITS", ()) if of == table}
    found: list[_Shown] = []
    for row in rows(names, table, kind, source):
        info: Any = row  # a dataclass with a name
        found.append(dataclasses.replace(info, shown_unit=shown.get(info.name, "")))
        unit = shown.get(info.name, "")
        if unit and (dimension(unit) != dimension(info.unit) or coherent(info.unit)[1] != 1.0):
            raise ModelError(
                f"{source}: {info.name} is in [{info.unit}] and cannot be shown in [{unit}] - regenerate the module",
                where=(source, info.name),
            )
    return tuple(found)


def parameter_rows(names: Mapping[str, Any], kind: type[_Shown], source: str) -> tuple[_Shown, ...]:
    """The parameters of a module; those listed in ``TOLERANCES`` are known to a declared share of their value."""
    known = dict(names.get("TOLERANCES", ()))
    found: list[Any] = list(shown_rows(names, "PARAMETERS", kind, source))
    return tuple(dataclasses.replace(info, tolerance=known.get(info.name)) for info in found)


def input_rows(names: Mapping[str, Any], kind: type[_Shown], source: str) -> tuple[_Shown, ...]:
    """The inputs of a module; those listed in ``ZERO_DEFAULTS`` have a declared default of zero.

    Raises
    ------
    ModelError
        If one is late of what is no input before it.
    """
    zeros = names.get("ZERO_DEFAULTS", ())
    found: list[Any] = list(shown_rows(names, "INPUTS", kind, source))
    ways: dict[str, str] = {}
    done = []
    for info in found:
        late = _LATE.match(str(info.interpolation))
        if late:
            if late[2] not in ways:
                raise ModelError(
                    f"{source}: {info.name!r} is said to be {info.interpolation}, which is no input before it - "
                    "regenerate the module",
                    where=(source, info.name),
                )
            info = dataclasses.replace(info, interpolation=ways[late[2]], late_of=late[2], late_by=float(late[1]))
        ways[info.name] = info.interpolation
        done.append(dataclasses.replace(info, zero_default=info.name in zeros))
    return tuple(done)


def events_of(names: Mapping[str, Any], source: str) -> dict[str, Any]:
    """Modes, zero functions and jumps of a module that has them, by the fields of a model.

    Raises
    ------
    ModelError
        If a function is missing that the table of modes names.
    """
    if "MODES" not in names:
        return {}
    missing = [name for name in ("EVENTS", "events") if name not in names]
    modes = rows(names, "MODES", ModeInfo, source)
    missing += [mode.reset for mode in modes if mode.reset is not None and mode.reset not in names]
    if missing:
        raise ModelError(
            f"{source}: the module has modes but no {', '.join(missing)} - regenerate it", where=(source, *missing)
        )
    resets = {mode.input: require_function(names, mode.reset, source) for mode in modes if mode.reset is not None}
    return {
        "modes": modes,
        "event_rows": rows(names, "EVENTS", EventInfo, source),
        "_events": require_function(names, "events", source),
        "_resets": resets,
    }
