"""Tables as files hold them, limits of their size, and the message where a library is missing or fails."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bondgraph.data.header import Reading
from bondgraph.data.log import FIRST_ROW
from bondgraph.errors import DataError

#: Times of two sensors closer than this [s] are one sample.
_SAME_TIME = 1e-9
#: Bytes of a file, or of what it holds when unpacked, beyond which it is no log that fits into memory.
LARGEST = 1 << 30


@dataclass(frozen=True)
class Table:
    """Columns of a file, each with its header ``name [unit]``.

    A column holds n numbers, n cells of text, or is :class:`Coded`. ``first_row`` is the row of the first sample as a
    spreadsheet counts it. ``is_merged``: the first column is called ``time`` and holds seconds, whatever it was
    in the file.
    """

    columns: tuple[tuple[str, Any], ...]
    first_row: int = FIRST_ROW
    is_merged: bool = False


@dataclass(frozen=True)
class Coded:
    """A column of text by its distinct cells: ``index`` (n,) into ``texts``."""

    texts: tuple[str, ...]
    index: npt.NDArray[np.int64]


Reader = Callable[[Path, Reading], Table]


def check_size(size: int, path: Path) -> None:
    """Refuse what would not fit into memory, before it is read.

    Raises
    ------
    DataError
        With the size.
    """
    if size > LARGEST:
        raise DataError(
            f"{path.name}: holds {size / 1e9:.1f} GB, at most {LARGEST / 1e9:.1f} GB are read - cut the log into "
            "parts, or take fewer samples",
            where=(path.name,),
        )


def read_whole(reader: Reader, path: Path, kind: str, reading: Reading) -> Table:
    """The columns of a file; whatever a library says of a damaged one becomes one message.

    Raises
    ------
    DataError
        If it is too large or cannot be read.
    """
    try:
        check_size(path.stat().st_size, path)
        return reader(path, reading)
    except DataError:
        raise
    except Exception as error:
        said = (str(error).strip() or type(error).__name__).splitlines()[0][:200]
        problem = "".join(letter if letter.isprintable() else "?" for letter in said)
        raise DataError(
            f"{path.name}: this is not a readable {kind} file ({problem}) - it is damaged, cut short or of another "
            "kind; write it again",
            where=(path.name,),
        ) from None


def extra(module: str, path: Path, name: str) -> Any:
    """A module that belongs to the extra called ``name``.

    Raises
    ------
    DataError
        If it is not installed, with what to install.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.split(".")[0]
        raise DataError(
            f"{path.name}: this format needs {package}, which is not installed - run: pip install 'bondloop[{name}]'",
            where=(path.name, package),
        ) from None


@dataclass(frozen=True)
class Signal:
    """A signal with times (n,) in seconds and values (n,) of its own."""

    header: str
    time: npt.NDArray[np.float64]
    values: Any


def merged(signals: Sequence[Signal]) -> Table:
    """Signals of different rates in one table: a row for each time at which any was sampled, empty cells elsewhere.

    Examples
    --------
    >>> slow = Signal("a [1]", np.array([0.0, 0.2]), np.array([1.0, 2.0]))
    >>> quick = Signal("b [1]", np.array([0.0, 0.1, 0.2]), np.array([5.0, 6.0, 7.0]))
    >>> dict(merged([slow, quick]).columns)["a [1]"].tolist()
    [1.0, nan, 2.0]
    """
    known: dict[bytes, npt.NDArray[np.float64]] = {signal.time.tobytes(): signal.time for signal in signals}
    times = np.unique(np.concatenate(list(known.values())))
    time = times[np.concatenate(([True], np.diff(times) > _SAME_TIME))]
    rows = {key: np.searchsorted(time, own + _SAME_TIME, side="right") - 1 for key, own in known.items()}
    spread = ((signal.header, _spread(signal.values, rows[signal.time.tobytes()], time.size)) for signal in signals)
    return Table((("time [s]", time), *spread), is_merged=True)


def _spread(values: Any, rows: npt.NDArray[np.intp], size: int) -> np.ndarray[Any, Any]:
    samples = np.asarray(values)
    if samples.dtype.kind in "SUO":
        column = np.full(size, "", dtype=object)
        column[rows] = [cell.decode() if isinstance(cell, bytes) else str(cell) for cell in samples]
        return column
    numbers = np.full(size, np.nan)
    numbers[rows] = samples.astype(np.float64)
    return numbers
