"""Checked access to the records of a graph file: a wrong type or unknown key is an error that names it."""

from __future__ import annotations

import decimal
import reprlib
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from bondgraph.errors import DeclarationError, suggest

#: Longer values are cut in messages.
_SHOWN = 120
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = _SHOWN


def check_keys(record: Any, known: Sequence[str], where: str, required: Sequence[str] = ()) -> Mapping[str, Any]:
    """The record itself, if it is an object with these keys only."""
    if not isinstance(record, Mapping):
        raise DeclarationError(f"{where}: expected an object but got {shown(record)}", where=(where,))
    for key in record:
        if key not in known:
            raise DeclarationError(
                f"{where}: unknown key {key!r}{suggest(str(key), known)} - known are {', '.join(known)}",
                where=(str(key),),
            )
    for key in required:
        if key not in record:
            raise DeclarationError(f"{where}: key {key!r} is missing", where=(key,))
    return record


def items(record: Mapping[str, Any], key: str, where: str) -> list[Any]:
    """A list under a key, empty where the key is missing."""
    value = record.get(key, [])
    if not isinstance(value, list):
        raise DeclarationError(f"{where}: {key} must be a list but is {shown(value)}", where=(key,))
    return value


def mapping(record: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
    """An object under a key, empty where the key is missing."""
    value = record.get(key, {})
    if not isinstance(value, Mapping):
        raise DeclarationError(f"{where}: {key} must be an object but is {shown(value)}", where=(key,))
    return value


def text(record: Mapping[str, Any], key: str, where: str) -> str:
    """A text under a key, empty where the key is missing."""
    value = record.get(key, "")
    if not isinstance(value, str):
        raise DeclarationError(f"{where}: {key} must be a text but is {shown(value)}", where=(key,))
    return value


def number(value: Any, where: str) -> float:
    """A finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DeclarationError(f"{where}: expected a number but got {shown(value)}", where=(where,))
    if not abs(value) <= sys.float_info.max:
        raise DeclarationError(f"{where}: {shown(value)} must be a finite number", where=(where,))
    return float(value)


def numbers(value: Any, where: str) -> list[float]:
    """A list of numbers."""
    if not isinstance(value, list):
        raise DeclarationError(f"{where}: expected a list of numbers but got {shown(value)}", where=(where,))
    return [number(item, where) for item in value]


def count(record: Mapping[str, Any], key: str, where: str, most: int) -> int:
    """A whole number from one to ``most`` under a key, one where the key is missing."""
    value = record.get(key, 1)
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= most:
        raise DeclarationError(
            f"{where}: {key} must be a whole number of at least 1 and at most {most} but is {shown(value)}",
            where=(where,),
        )
    return value


def shown(value: Any) -> str:
    """A value as messages show it: long ones cut.

    Examples
    --------
    >>> shown([1.5, "b"]), shown(10**400)
    ("[1.5, 'b']", '1.0e+400')
    """
    if isinstance(value, int) and abs(value) >= 10**_SHOWN:
        return f"{decimal.Decimal(value):.1e}"
    text = _SHORT.repr(value)
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "..."
