"""Read logs: CSV, gzipped CSV, Parquet, MATLAB .mat and ASAM MDF give the same value.

Every format is brought to a table of columns with headers ``name [unit]`` (module ``formats``), and one function turns
the table into a ``Log``. Errors name the file, the column and the row as a spreadsheet counts them (row 1: headers).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.data import apart, formats
from bondgraph.data.header import TEXT_UNIT, convert_unit, require_unit, split_header
from bondgraph.data.log import FIRST_ROW, FloatArray, Log, LogChannel, TextArray
from bondgraph.errors import DataError

_READERS: dict[str, Callable[[Path], formats.Table]] = {
    ".csv": formats.read_csv,
    ".csv.gz": formats.read_csv,
    ".parquet": formats.read_parquet,
    ".mat": apart.read_mat,
    ".mf4": apart.read_mdf,
}

#: Letters of a number or a code.
_LONGEST_CELL = 200
#: Cells that mean that nothing was measured.
_EMPTY = ("", "nan", "na", "n/a", "null", "none")


def read_log(path: str | Path) -> Log:
    r"""Read a measured log.

    The first column is ``time [s]`` (any unit of time), every other header is ``name [unit]``; ``[1]`` is a number
    without dimension, ``[text]`` codes. An empty cell is a missing measurement. Values stay in their units; ``match``
    converts them into those of a model.

    Parameters
    ----------
    path
        ``.csv``, ``.csv.gz``, ``.parquet``, ``.mat`` (v5 to v7.3: variables ``time``, one per signal, and a struct
        ``units``) or ``.mf4``. Parquet, MATLAB v7.3 and MDF need the extra ``data``.

    Raises
    ------
    DataError
        If the file is missing, of an unknown kind or not a log: with the column, the row and what to do.

    Examples
    --------
    >>> import bondgraph as bg
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "run7.csv"
    ...     _ = path.write_text("time [s],speed [km/h],gear [text]\n0.0,36,H\n0.1,,L\n")
    ...     log = bg.read_log(path)
    >>> log.name, log.channel("speed").values.tolist(), log.channel("gear").values.tolist()
    ('run7', [36.0, nan], ['H', 'L'])
    """
    path = Path(path)
    suffix = _suffix(path)
    if not path.is_file():
        raise DataError(f"{path}: there is no such file", where=(str(path),))
    return log_from_table(
        formats.read_whole(_READERS[suffix.lower()], path, suffix), path.name, path.name.removesuffix(suffix), str(path)
    )


def log_from_table(table: formats.Table, where: str, name: str, source: str = "") -> Log:
    """The log in a table of columns with headers ``name [unit]``.

    Parameters
    ----------
    table
        Pairs of header and column; columns are numbers, or text still to be read as numbers or codes.
    where
        Name of the file in messages.
    name, source
        Of the log.

    Raises
    ------
    DataError
        If headers, units or cells are not those of a log.
    """
    headers = [split_header(header, where) for header, _ in table]
    _require_headers(headers, where)
    for column, unit in headers:
        require_unit(column, unit, where)
    factor, offset = convert_unit("time", headers[0][1], "s", where)
    time = _numbers("time", _cells("time", table[0][1], where), where) * factor + offset
    channels = {
        column: LogChannel(column, unit, _values(column, unit, _cells(column, cells, where), where))
        for (column, unit), (_, cells) in zip(headers[1:], table[1:], strict=True)
    }
    try:
        return Log(name, time, channels, source)
    except DataError as error:
        raise DataError(where + error.message.removeprefix(name), where=(where, *error.where[1:])) from None


def _suffix(path: Path) -> str:
    for suffix in _READERS:
        if path.name.lower().endswith(suffix):
            return path.name[-len(suffix) :]
    raise DataError(
        f"{path.name}: this kind of file is not read - give one of " + ", ".join(_READERS), where=(str(path),)
    )


def _require_headers(headers: list[tuple[str, str]], where: str) -> None:
    if not headers or headers[0][0] != "time":
        first = headers[0][0] if headers else ""
        raise DataError(f"{where}: the first column must be 'time [s]' but is {first!r} (row 1)", where=(where, first))
    seen: set[str] = set()
    for column, _ in headers:
        if column in seen:
            raise DataError(
                f"{where}: column {column!r} stands twice (row 1) - rename or drop one", where=(where, column)
            )
        seen.add(column)


def _cells(name: str, column: Sequence[object] | np.ndarray[Any, Any], where: str) -> FloatArray | TextArray:
    """A column as floats where it already is numeric, else as stripped text with "" for missing cells."""
    if isinstance(column, np.ndarray) and column.dtype.kind in "fiub":
        return column.astype(np.float64)
    text = ["" if cell is None else str(cell).strip() for cell in column]
    longest = max(range(len(text)), key=lambda row: len(text[row]), default=0)
    if text and len(text[longest]) > _LONGEST_CELL:  # every cell of a column of text takes the room of the longest
        raise DataError(
            f"{where}: column {name!r} has a cell of {len(text[longest])} letters (row {longest + FIRST_ROW}) - codes "
            f"and numbers have at most {_LONGEST_CELL}",
            where=(where, name),
        )
    return np.array(["" if cell.lower() in _EMPTY else cell for cell in text], dtype=np.str_)


def _values(column: str, unit: str, cells: FloatArray | TextArray, where: str) -> FloatArray | TextArray:
    if cells.dtype.kind != "U":
        return cells if unit != TEXT_UNIT else np.array([_code(value) for value in cells], dtype=np.str_)
    if unit == TEXT_UNIT or (unit == "1" and _first_text(cells) is not None):
        return cells
    return _numbers(column, cells, where)


def _code(value: float) -> str:
    return "" if np.isnan(value) else f"{value:g}"


def _numbers(column: str, cells: FloatArray | TextArray, where: str) -> FloatArray:
    if cells.dtype.kind != "U":
        return cells.astype(np.float64)
    wrong = _first_text(cells)
    if wrong is not None:
        raise DataError(
            f"{where}: column {column!r} has {str(cells[wrong])!r} (row {wrong + FIRST_ROW}), which is not a number"
            " - leave the cell empty where nothing was measured, or give codes the unit [text]",
            where=(where, column),
        )
    return np.where(cells == "", "nan", cells).astype(np.float64)


def _first_text(cells: FloatArray | TextArray) -> int | None:
    """Index of the first cell that is neither empty nor a number."""
    for index, cell in enumerate(cells.tolist()):
        try:
            float(cell or 0.0)
        except ValueError:
            return index
    return None
