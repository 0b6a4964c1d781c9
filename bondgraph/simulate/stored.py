"""Results as files: trees of the toolkit's records with their arrays, and models by the text of their equations.

A file holds what records are made of, not how the program holds them: field by field, arrays as numpy keeps them. What
is read back is made by the records' own constructors, which check it; a model's text is looked at before it is run, as
that of any generated module. So a file from elsewhere can be wrong, but does nothing.
"""

from __future__ import annotations

import dataclasses
import enum
import importlib
import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np

from bondgraph.errors import BondGraphError, OptionError
from bondgraph.files import write_whole
from bondgraph.simulate.model import Model

#: The version of the form, and the only package whose records are read.
_FORMAT, _PACKAGE = 1, "bondgraph."

#: What comes of files that hold something else.
_WRONG = (
    OSError, ValueError, KeyError, TypeError, AttributeError, ImportError, EOFError, zipfile.BadZipFile, BondGraphError,
)  # fmt: skip

_Kind = TypeVar("_Kind")


class Kept:
    """A result that goes to a file and comes back."""

    def save(self, path: str | Path) -> Path:
        """Write the result, with all that it was made from, to a file (``.npz``) that :meth:`load` reads.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        return store(self, path)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what :meth:`save` wrote: the same values, to the last digit.

        Raises
        ------
        OptionError
            If there is no such file, or it holds something else, is damaged, or is of another version.
        """
        return stored(cls, path)


def store(value: object, path: str | Path) -> Path:
    """Write a record of the toolkit, with all that it holds, in one step.

    Raises
    ------
    OptionError
        If it holds something that is no record, text, number, array, enumeration, or collection of these.
    OSError
        If the file cannot be written.
    """
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    text = json.dumps({"format": _FORMAT, "value": _plain(value, arrays)}, allow_nan=False)
    write_whole(Path(path), lambda file: np.savez(file, text=np.array(text), **arrays))  # type: ignore[arg-type]
    return Path(path)


def stored(kind: type[_Kind], path: str | Path) -> _Kind:
    """The record of a type that :func:`store` wrote.

    Raises
    ------
    OptionError
        If there is no such file, or it holds something else, is damaged, or is of another version.

    Examples
    --------
    >>> import tempfile
    >>> from bondgraph.simulate.example import pendulum
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     there = store(pendulum(), Path(folder) / "pendulum.npz")
    ...     stored(Model, there) == pendulum()
    True
    """
    try:
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as content:
            found = json.loads(str(content["text"]))
            if found["format"] != _FORMAT:
                raise ValueError(f"format {found['format']}")
            value = _value(found["value"], content)
    except FileNotFoundError:
        raise OptionError(f"{path}: there is no such file - check the path", where=(str(path),)) from None
    except _WRONG as error:
        raise OptionError(
            f"{path}: cannot be read ({error}) - give a file that a result's save wrote with this version",
            where=(str(path),),
        ) from None
    if not isinstance(value, kind):
        raise OptionError(f"{path}: holds a {type(value).__name__}, no {kind.__name__}", where=(str(path),))
    return value


def _plain(value: Any, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    """A value in words of JSON; arrays go to ``arrays``."""
    if isinstance(value, Model):
        return {"model": value.text}
    if isinstance(value, enum.Enum):
        return {"enum": _name(type(value)), "is": value.name}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        own = {one.name: _plain(getattr(value, one.name), arrays) for one in dataclasses.fields(value) if one.init}
        return {"record": _name(type(value)), "fields": own}
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiubU":
        arrays[f"a{len(arrays)}"] = value
        return {"array": f"a{len(arrays) - 1}"}
    if isinstance(value, np.generic):
        return _plain(value.item(), arrays)
    if isinstance(value, float) and not math.isfinite(value):
        return {"number": repr(value)}
    if isinstance(value, Mapping):
        return {"pairs": [[_plain(key, arrays), _plain(one, arrays)] for key, one in value.items()]}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [_plain(one, arrays) for one in value]
    if isinstance(value, frozenset):
        return {"set": [_plain(one, arrays) for one in sorted(value)]}
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise OptionError(f"a {type(value).__name__} cannot be saved: it is no record of numbers, texts and arrays")


def _name(kind: type) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"


def _value(plain: Any, arrays: Any) -> Any:
    """The value of its words; sequences are tuples, as the records hold them."""
    if isinstance(plain, list):
        return tuple(_value(one, arrays) for one in plain)
    if not isinstance(plain, dict):
        return plain
    if "array" in plain:
        return arrays[plain["array"]]
    if "number" in plain:
        return float(plain["number"])
    if "pairs" in plain:
        return {_value(key, arrays): _value(one, arrays) for key, one in plain["pairs"]}
    if "set" in plain:
        return frozenset(_value(one, arrays) for one in plain["set"])
    if "model" in plain:
        return Model.from_text(plain["model"], "saved model")
    if "enum" in plain:
        return _kind(plain["enum"], enum.Enum)[plain["is"]]
    if not dataclasses.is_dataclass(_kind(plain["record"], object)):
        raise ValueError(f"{plain['record']} is no record")
    fields: dict[str, Any] = {name: _value(one, arrays) for name, one in plain["fields"].items()}
    return _kind(plain["record"], object)(**fields)


def _kind(name: str, above: type) -> Any:
    """A class of the toolkit by its name."""
    module, _, own = name.partition(":")
    if not module.startswith(_PACKAGE):
        raise ValueError(f"{name} is no record of the toolkit")
    kind = getattr(importlib.import_module(module), own)
    if not (isinstance(kind, type) and issubclass(kind, above)):
        raise ValueError(f"{name} is no record of the toolkit")
    return kind
