"""What stands in a report as a file, so that the page can be written again without computing anything.

Values of dataclasses are kept by their fields, arrays as numpy keeps them; nothing in the file is run when it is read.
"""

from __future__ import annotations

import dataclasses
import json
import math
import types
import typing
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.errors import OptionError
from bondgraph.files import write_whole

#: Name of the file in the folder of a command.
NAME = "report_data.npz"
#: Stand in the text for arrays, and for numbers that JSON has no word for.
_ARRAY, _NUMBER = "array", "number"


def save_data(data: Any, path: Path) -> None:
    """Write a tree of dataclasses, tuples, sets, texts, numbers and arrays.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    text = json.dumps(_plain(data, arrays), allow_nan=False)
    write_whole(path, lambda file: np.savez_compressed(file, text=np.array(text), **arrays))  # type: ignore[arg-type]


def load_data(kind: type, path: Path) -> Any:
    """The value of a type that :func:`save_data` wrote.

    Raises
    ------
    OptionError
        If there is no such file, or it is damaged or of another version.

    Examples
    --------
    >>> import tempfile
    >>> from bondgraph.report.series import Prediction
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_data(Prediction(one_step=np.array([1.0, np.nan])), Path(folder) / NAME)
    ...     load_data(Prediction, Path(folder) / NAME)
    Prediction(one_step=array([ 1., nan]), simulated=None)
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as content:
            return _value(kind, json.loads(str(content["text"])), content)
    except FileNotFoundError:
        raise OptionError(
            f"{path.parent}: holds no {path.name} - name the folder of a finished filter, estimate or close-loop of "
            "this version",
            where=(str(path.parent),),
        ) from None
    except (OSError, ValueError, KeyError, TypeError, IndexError, EOFError, zipfile.BadZipFile) as error:
        raise OptionError(
            f"{path}: cannot be read ({error}) - it is damaged or of another version; run the command again",
            where=(str(path),),
        ) from None


def _plain(value: Any, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {one.name: _plain(getattr(value, one.name), arrays) for one in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        name = f"a{len(arrays)}"
        arrays[name] = value
        return {_ARRAY: name}
    if isinstance(value, float) and not math.isfinite(value):
        return {_NUMBER: repr(float(value))}
    if isinstance(value, np.generic):
        return _plain(value.item(), arrays)
    if isinstance(value, Mapping):
        return {str(key): _plain(one, arrays) for key, one in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(one, arrays) for one in value]
    return sorted(value) if isinstance(value, frozenset | set) else value


def _value(kind: Any, plain: Any, arrays: Any) -> Any:
    """The value of a type from its plain form."""
    if plain is None:
        return None
    if isinstance(plain, dict) and set(plain) == {_ARRAY}:
        return arrays[plain[_ARRAY]]
    if isinstance(plain, dict) and set(plain) == {_NUMBER}:
        return float(plain[_NUMBER])
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        hints = typing.get_type_hints(kind)
        return kind(**{name: _value(hints[name], one, arrays) for name, one in plain.items()})
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return _value(next(one for one in arguments if one is not type(None)), plain, arrays)
    if origin is tuple:
        repeated = len(arguments) == 2 and arguments[1] is Ellipsis
        kinds = [arguments[0]] * len(plain) if repeated else arguments
        return tuple(_value(one, part, arrays) for one, part in zip(kinds, plain, strict=True))
    if origin in (frozenset, set):
        return origin(plain)
    if isinstance(plain, list) and arguments:
        return tuple(_value(arguments[0], part, arrays) for part in plain)
    if isinstance(plain, dict) and len(arguments) == 2:
        return {key: _value(arguments[1], part, arrays) for key, part in plain.items()}
    return plain
