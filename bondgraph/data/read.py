"""Read logs: files of every format give the same value.

Every format is brought to a table of columns with headers ``name [unit]`` (package ``formats``), and one function turns
the table into a ``Log``. Errors name the file, the column and the row as a spreadsheet counts them (row 1: headers).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.data import apart
from bondgraph.data.dates import parsed_dates, seconds_since_first, split_date
from bondgraph.data.formats.csv_quick import read_csv_quick
from bondgraph.data.formats.csv_text import read_csv_text
from bondgraph.data.formats.excel import read_excel
from bondgraph.data.formats.extras import EXTRAS
from bondgraph.data.formats.parquet import read_parquet
from bondgraph.data.formats.ros import read_bag, read_mcap
from bondgraph.data.formats.table import Coded, Reader, Table, read_whole
from bondgraph.data.header import (
    EMPTY,
    LONGEST_CELL,
    TEXT_UNIT,
    UNKNOWN_UNIT,
    Reading,
    convert_unit,
    resolve_headers,
    split_header,
)
from bondgraph.data.log import FloatArray, Log, LogChannel, TextArray
from bondgraph.errors import DataError, require_kind


def _read_csv(path: Path, reading: Reading) -> Table:
    return read_csv_quick(path, reading) or read_csv_text(path, reading)


_READERS: dict[str, Reader] = {
    ".csv": _read_csv,
    ".csv.gz": _read_csv,
    ".parquet": read_parquet,
    ".mat": apart.read_mat,
    ".mf4": apart.read_mdf,
    ".mdf": apart.read_mdf,
    ".h5": apart.read_hdf5,
    ".hdf5": apart.read_hdf5,
    ".xlsx": read_excel,
    ".bag": read_bag,
    ".mcap": read_mcap,
}


def read_log(path: str | Path, *, units: Mapping[str, str] | None = None, time: str | None = None) -> Log:
    r"""Read a measured log.

    One column is called ``time`` (any unit of time, or dates like 2024-05-01T12:00:00.250, which count from the first),
    every other header is ``name [unit]``; ``[1]`` is a number without dimension, ``[text]`` codes. Units may stand in
    the second row instead. An empty cell is a missing measurement. Values stay in their units; ``match`` converts them
    into those of a model.

    Parameters
    ----------
    path
        ``.csv`` or ``.csv.gz`` (separated by commas, semicolons or tabs; with the latter two decimal marks may be
        commas), ``.mat`` (variables ``time``, one per signal, and a struct ``units``; or structs of these), and with
        an extra each ``.parquet``, ``.mat`` of version 7.3, ``.mf4`` and ``.mdf``, ``.h5``, ``.xlsx``, ``.bag`` and
        ``.mcap``.
    units
        Units by column, where the file does not say them or is wrong; that of the column of time may be called
        ``time``.
    time
        The column with the time, where it is not called so.

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
    ...     _ = path.write_text("stamp;speed\n0,0;36,5\n100,0;\n")
    ...     other = bg.read_log(path, time="stamp", units={"time": "ms", "speed": "km/h"})
    >>> log.name, log.channel("speed").values.tolist(), log.channel("gear").values.tolist()
    ('run7', [36.0, nan], ['H', 'L'])
    >>> other.time.tolist(), other.channel("speed").values.tolist()
    ([0.0, 0.1], [36.5, nan])
    """
    require_kind("read_log", path, (str, Path), "file")
    path = Path(path)
    suffix = _suffix(path)
    if not path.is_file():
        raise DataError(f"{path}: there is no such file", where=(str(path),))
    reading = Reading(dict(units or {}), time)
    table = read_whole(_READERS[suffix.lower()], path, suffix, reading)
    return log_from_table(table, path.name, path.name.removesuffix(suffix), str(path), reading)


def log_from_table(table: Table, where: str, name: str, source: str = "", reading: Reading | None = None) -> Log:
    """The log in a table of columns with headers ``name [unit]``.

    Parameters
    ----------
    table
        Headers and columns; columns are numbers, or text still to be read as numbers or codes.
    where
        Name of the file in messages.
    name, source
        Of the log.
    reading
        Units and the column of time where the headers do not tell.

    Raises
    ------
    DataError
        If headers, units or cells are not those of a log.
    """
    said = reading or Reading()
    if table.is_merged:
        said = Reading({column: unit for column, unit in said.units.items() if column not in ("time", said.time)})
    named = resolve_headers([header for header, _ in table.columns], said, where)
    place = _Place(where, table.first_row)
    position = [column for column, _ in named].index("time")
    header, cells = table.columns[position]
    time, start = _time(header, named[position][1], _cells("time", cells, place), place)
    channels = {
        column: LogChannel(column, unit or "1", _values(column, unit or "1", _cells(column, cells, place), place))
        for k, ((column, unit), (_, cells)) in enumerate(zip(named, table.columns, strict=True))
        if k != position
    }
    try:
        return Log(name, time, channels, source, {"start": start} if start else {}, table.first_row)
    except DataError as error:
        raise DataError(where + error.message.removeprefix(name), where=(where, *error.where[1:])) from None


@dataclass(frozen=True)
class _Place:
    """Where cells stand: the name of the file in messages, and the row of the first sample."""

    where: str
    first_row: int


def _suffix(path: Path) -> str:
    for suffix in _READERS:
        if path.name.lower().endswith(suffix):
            return path.name[-len(suffix) :]
    kinds = ", ".join(f"{suffix} (needs the extra {name!r})" if name else suffix for suffix, name in EXTRAS.items())
    raise DataError(
        f"{path.name}: this kind of file is not read - give one of {kinds}; pip install 'bondloop[data]' installs all "
        "extras",
        where=(str(path),),
    )


def _time(header: str, unit: str | None, cells: Any, place: _Place) -> tuple[FloatArray, str]:
    """Times (n,) in seconds; of dates also the first, from which they count."""
    if cells.dtype.kind == "U" and unit in (None, "s", "1", TEXT_UNIT) and split_date(_first_cell(cells)):
        cells = parsed_dates(cells.tolist(), place.where, place.first_row)
    if cells.dtype.kind == "M":
        return seconds_since_first(cells) if cells.size else (np.zeros(0), "")
    if unit is None:
        split_header(header, place.where)  # which says that there is none
    factor, offset = convert_unit("time", unit or "", "s", place.where)
    return _numbers("time", cells, place) * factor + offset, ""


def _first_cell(cells: TextArray) -> str:
    return next((cell for cell in cells.tolist() if cell), "")


def _cells(name: str, column: Sequence[object] | np.ndarray[Any, Any] | Coded, place: _Place) -> Any:
    """A column as floats or dates where it is already, else as stripped text with "" for missing cells."""
    if isinstance(column, Coded):
        texts = np.array([_cleaned(text) for text in column.texts] or [""], dtype=np.str_)
        return texts[column.index]
    if isinstance(column, np.ndarray) and column.dtype.kind in "fiub":
        return column.astype(np.float64, copy=False)
    if isinstance(column, np.ndarray) and column.dtype.kind == "M":
        return column if name == "time" else np.array([str(cell) for cell in column], dtype=np.str_)
    text = ["" if cell is None else str(cell).strip() for cell in column]
    longest = max(range(len(text)), key=lambda row: len(text[row]), default=0)
    if text and len(text[longest]) > LONGEST_CELL:  # every cell of a column of text takes the room of the longest
        raise DataError(
            f"{place.where}: column {name!r} has a cell of {len(text[longest])} letters (row "
            f"{longest + place.first_row}) - codes and numbers have at most {LONGEST_CELL}",
            where=(place.where, name),
        )
    return np.array([_cleaned(cell) for cell in text], dtype=np.str_)


def _cleaned(cell: str) -> str:
    stripped = cell.strip()
    return "" if stripped.lower() in EMPTY else stripped


def _values(column: str, unit: str, cells: FloatArray | TextArray, place: _Place) -> FloatArray | TextArray:
    if cells.dtype.kind != "U":
        return cells if unit != TEXT_UNIT else np.array([_code(value) for value in cells], dtype=np.str_)
    if unit == TEXT_UNIT or (unit in ("1", UNKNOWN_UNIT) and _first_text(cells) is not None):
        return cells
    return _numbers(column, cells, place)


def _code(value: float) -> str:
    return "" if np.isnan(value) else f"{value:g}"


def _numbers(column: str, cells: FloatArray | TextArray, place: _Place) -> FloatArray:
    if cells.dtype.kind != "U":
        return cells.astype(np.float64, copy=False)
    wrong = _first_text(cells)
    if wrong is not None:
        raise DataError(
            f"{place.where}: column {column!r} has {str(cells[wrong])!r} (row {wrong + place.first_row}), which is not "
            "a number - leave the cell empty where nothing was measured, or give codes the unit [text]",
            where=(place.where, column),
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
