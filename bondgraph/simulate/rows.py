"""Tables of a generated module as values: their rows, and the modes and zero functions of an exactly derived one."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from bondgraph.errors import ModelError
from bondgraph.simulate.loader import require_function

_Info = TypeVar("_Info")


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


#: Columns of an input in a module.
_INPUT_COLUMNS = 6


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


def input_rows(names: Mapping[str, Any], kind: type[_Info], source: str) -> tuple[_Info, ...]:
    """The inputs of a module; those listed as such have a declared default of zero."""
    zeros = names.get("ZERO_DEFAULTS", ())
    marked = [(*row, row[0] in zeros) if len(row) == _INPUT_COLUMNS else row for row in names["INPUTS"]]
    return rows({"INPUTS": marked}, "INPUTS", kind, source)


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
