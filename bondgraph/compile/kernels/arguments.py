"""Arguments of a compiled kernel: numbers, arrays, compiled functions and records of them, as one row of words.

A word is 64 bits: a number, an address or a length. An array is its address and its lengths, a record what its fields
are, one after the other. So a record of a record lies in one piece, and code finds a field at a place that it knows.
"""

from __future__ import annotations

import array
import ctypes
import functools
import struct
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from bondgraph.compile.pointer import CompiledFunction
from bondgraph.errors import ModelError


class Number(NamedTuple):
    """A float, or an integer."""

    is_float: bool


class Numbers(NamedTuple):
    """An array of floats or integers, row by row."""

    is_float: bool
    axes: int


class Function(NamedTuple):
    """A compiled function with a signature of numba's."""

    signature: Any


class Fields(NamedTuple):
    """A record: names and kinds of its fields."""

    named: tuple[tuple[str, Kind], ...]


Kind = Number | Numbers | Function | Fields

_FLOAT, _INTEGER = np.dtype(np.float64), np.dtype(np.int64)
_BYTE = ctypes.c_char
_ITEMS = {_FLOAT: True, _INTEGER: False}


def width(kind: Kind) -> int:
    """Words of a value.

    Examples
    --------
    >>> width(Fields((("x", Numbers(True, 2)), ("k", Number(False)))))
    4
    """
    if isinstance(kind, Numbers):
        return 1 + kind.axes
    if isinstance(kind, Fields):
        return sum(width(field) for _, field in kind.named)
    return 1


def kind_of(value: Any) -> Kind:
    """The kind of a value that :func:`words_of` takes."""
    if isinstance(value, np.ndarray):
        return Numbers(_ITEMS[value.dtype], value.ndim)
    if isinstance(value, tuple):
        return Fields(tuple((name, kind_of(field)) for name, field in zip(_names(type(value)), value, strict=True)))
    if isinstance(value, CompiledFunction):
        return Function(value.signature())
    return Number(isinstance(value, float))


def words_of(values: Sequence[Any]) -> tuple[array.array[int], tuple[Any, ...]]:
    """The words of values, and what tells their kinds apart.

    Raises
    ------
    ModelError
        If an array has other numbers than floats or integers of 64 bits, or does not lie in memory row by row.

    Examples
    --------
    >>> words, _ = words_of((3, np.zeros((2, 5))))
    >>> words[0], words[2], words[3]
    (3, 2, 5)
    """
    words: list[int] = []
    kinds: list[Any] = []
    for value in _flat(values):
        if isinstance(value, np.ndarray):
            if value.dtype not in _ITEMS or not value.flags.c_contiguous:
                raise ModelError(
                    f"a kernel is given an array {value.shape} of {value.dtype}"
                    " - give float64 or int64, row by row (numpy.ascontiguousarray)"
                )
            words.append(_address(value))
            words.extend(value.shape)
            kinds.append(value.dtype.char)
            kinds.append(value.ndim)
        elif isinstance(value, float):
            words.append(_bits(value))
            kinds.append(float)
        elif isinstance(value, CompiledFunction):
            words.append(value.__wrapper_address__())
            kinds.append(value.notation)
        else:
            words.append(value)
            kinds.append(int)
    return array.array("q", words), tuple(kinds)


def _address(value: Any) -> int:
    """Where the numbers of an array begin; numpy takes five times as long to say it."""
    if value.size == 0:
        return 0  # never looked at
    try:
        return ctypes.addressof(_BYTE.from_buffer(value))
    except TypeError:  # it is not to be written
        return int(value.ctypes.data)


def _flat(values: Sequence[Any]) -> Iterator[Any]:
    for value in values:
        if isinstance(value, tuple):
            yield from _flat(value)
        else:
            yield value


def _bits(value: float) -> int:
    (bits,) = struct.unpack("q", struct.pack("d", value))
    return int(bits)


@functools.cache
def _names(record: Any) -> tuple[str, ...]:
    return tuple(record._fields)
