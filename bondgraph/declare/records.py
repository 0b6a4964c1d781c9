"""Checked access to the records of a graph file: a wrong type or unknown key is an error that names it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bondgraph.errors import DeclarationError, suggest


def check_keys(record: Any, known: Sequence[str], where: str, required: Sequence[str] = ()) -> Mapping[str, Any]:
    """The record itself, if it is an object with these keys only."""
    if not isinstance(record, Mapping):
        raise DeclarationError(f"{where}: expected an object but got {record!r}", where=(where,))
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
        raise DeclarationError(f"{where}: {key} must be a list but is {value!r}", where=(key,))
    return value


def mapping(record: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
    """An object under a key, empty where the key is missing."""
    value = record.get(key, {})
    if not isinstance(value, Mapping):
        raise DeclarationError(f"{where}: {key} must be an object but is {value!r}", where=(key,))
    return value


def text(record: Mapping[str, Any], key: str, where: str) -> str:
    """A text under a key, empty where the key is missing."""
    value = record.get(key, "")
    if not isinstance(value, str):
        raise DeclarationError(f"{where}: {key} must be a text but is {value!r}", where=(key,))
    return value


def number(value: Any, where: str) -> float:
    """A number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DeclarationError(f"{where}: expected a number but got {value!r}", where=(where,))
    return float(value)


def numbers(value: Any, where: str) -> list[float]:
    """A list of numbers."""
    if not isinstance(value, list):
        raise DeclarationError(f"{where}: expected a list of numbers but got {value!r}", where=(where,))
    return [number(item, where) for item in value]


def count(record: Mapping[str, Any], key: str, where: str) -> int:
    """A whole number of at least one under a key, one where the key is missing."""
    value = record.get(key, 1)
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise DeclarationError(f"{where}: {key} must be a whole number of at least 1 but is {value!r}", where=(where,))
    return value
