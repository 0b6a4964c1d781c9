"""CSV files by pyarrow: ordinary files quickly; None for all that needs a closer look.

What is read here is the same as :mod:`bondgraph.data.formats.csv_text` reads, but for numbers of more than 200 digits,
which that refuses. Where the library refuses a line or a
cell, or the file holds quotes, empty lines or zero bytes, that module reads it again and names the row.
"""

from __future__ import annotations

import csv
import importlib
import io
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.data.dates import split_date
from bondgraph.data.formats import table
from bondgraph.data.formats.csv_text import delimiter, opened
from bondgraph.data.formats.table import Coded, Table
from bondgraph.data.header import EMPTY, LONGEST_CELL, TEXT_UNIT, Reading, resolve_headers, units_row
from bondgraph.data.log import FIRST_ROW

#: Bytes that are looked at for header, units and decimal marks.
_BEGINNING = 1 << 20
_COMMA = re.compile(rb"(?:^|[;\t\n\r])\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*(?=[;\t\r\n])")
#: Spellings of empty cells that the library compares letter by letter; others are left to the slow reader.
_NULLS = tuple({spelt for word in EMPTY for spelt in (word, word.upper(), word.capitalize())} | {"NaN"})


class _UnusualError(Exception):
    """Something that only the slow reader reads."""


class _Plain(io.RawIOBase):
    """A stream that refuses quotes, zero bytes and more than fits into memory."""

    def __init__(self, file: IO[bytes]) -> None:
        super().__init__()
        self._file, self._size = file, 0

    def readable(self) -> bool:
        """Whether it can be read."""
        return True

    def read(self, size: int = -1) -> bytes:
        """The next bytes."""
        data = self._file.read(size)
        self._size += len(data)
        if b'"' in data or b"\x00" in data or self._size > table.LARGEST:
            raise _UnusualError
        return data


@dataclass(frozen=True)
class _Layout:
    """What the beginning of a file says of it; ``zone`` is that of dated times, empty where they have none."""

    headers: list[str]
    units: list[str | None]
    delimiter: str
    decimal: str
    first_row: int
    time: int
    zone: str | None
    skipped: int


def read_csv_quick(path: Path, reading: Reading) -> Table | None:
    """Columns of a CSV file as pyarrow reads it; None where it is not installed or the file needs a closer look.

    Raises
    ------
    DataError
        If headers or units are wrong.
    """
    try:
        arrow, arrow_csv = importlib.import_module("pyarrow"), importlib.import_module("pyarrow.csv")
    except ImportError:
        return None
    try:
        with opened(path) as file:
            layout = _layout(file.read(_BEGINNING), reading, path.name)
        return _either(arrow, arrow_csv, path, layout)
    except (_UnusualError, UnicodeDecodeError, OSError, EOFError, zlib.error, arrow.ArrowInvalid):
        return None


def _either(arrow: Any, arrow_csv: Any, path: Path, layout: _Layout) -> Table:
    """The columns under ``[1]`` as numbers, or else as codes."""
    try:
        return _read(arrow, arrow_csv, path, layout, is_code=False)
    except arrow.ArrowInvalid:
        if "1" not in layout.units or layout.delimiter != ",":  # numbers among codes may mix decimal marks
            raise
        return _read(arrow, arrow_csv, path, layout, is_code=True)


def _layout(beginning: bytes, reading: Reading, where: str) -> _Layout:
    text = beginning[: beginning.rfind(b"\n") + 1].decode("utf-8-sig")
    lines = text.splitlines(keepends=True)[:3]
    if len(lines) < 2 or not lines[0].strip() or text.count('"', 0, len(lines[0])) % 2:
        raise _UnusualError
    mark = delimiter(lines[0])
    header, second, *_ = csv.reader(lines[:2], delimiter=mark)
    if not second:
        raise _UnusualError
    titles = units_row(header, second)
    count = 1 if titles is None else 2
    data = second if titles is None else next(csv.reader(lines[2:], delimiter=mark), [])
    named = resolve_headers(titles or header, reading, where)
    if len(data) != len(named):
        raise _UnusualError
    place = next(position for position, (name, _) in enumerate(named) if name == "time")
    dated = split_date(data[place].strip())
    has_commas = mark != "," and _COMMA.search(beginning) is not None
    bom = 3 if beginning.startswith(b"\xef\xbb\xbf") else 0
    skipped = bom + len("".join(lines[:count]).encode())
    zone = None if dated is None else "UTC" if dated[1] else ""
    return _Layout(
        headers=titles or header,
        units=[unit for _, unit in named],
        delimiter=mark,
        decimal="," if has_commas else ".",
        first_row=FIRST_ROW - 1 + count,
        time=place,
        zone=zone,
        skipped=skipped,
    )


def _read(arrow: Any, arrow_csv: Any, path: Path, layout: _Layout, is_code: bool) -> Table:
    types = {str(k): _type(arrow, layout, k, is_code) for k in range(len(layout.units))}
    with opened(path) as file:
        file.read(layout.skipped)
        found = arrow_csv.read_csv(
            arrow.PythonFile(_Plain(file), mode="r"),
            read_options=arrow_csv.ReadOptions(column_names=list(types)),
            parse_options=arrow_csv.ParseOptions(
                delimiter=layout.delimiter, quote_char=False, ignore_empty_lines=False
            ),
            convert_options=arrow_csv.ConvertOptions(
                column_types=types, null_values=list(_NULLS), decimal_point=layout.decimal
            ),
        )  # fmt: skip
    if found.column(layout.time).null_count:  # an empty line, or a sample without time
        raise _UnusualError
    columns = []
    for header in layout.headers:  # only one column at a time is held twice
        columns.append((header, _column(arrow, found.column(0))))
        found = found.remove_column(0)
    arrow.default_memory_pool().release_unused()  # which else keeps as much as the columns take
    return Table(tuple(columns), layout.first_row)


def _type(arrow: Any, layout: _Layout, position: int, is_code: bool) -> Any:
    unit = layout.units[position]
    if position == layout.time and layout.zone is not None:
        return arrow.timestamp("ns", tz=layout.zone or None)
    if unit == TEXT_UNIT or (is_code and unit == "1"):
        return arrow.dictionary(arrow.int32(), arrow.string())
    return arrow.float64()


def _numbers(column: Any) -> FloatArray:
    """A column of numbers (n,), NaN where it has none; ``to_numpy`` loads pandas, where this needs none."""
    values, end = np.empty(len(column)), 0
    for chunk in column.chunks:
        begin, end = end, end + len(chunk)
        values[begin:end] = np.from_dlpack(chunk.fill_null(np.nan) if chunk.null_count else chunk)
    return values


def _column(arrow: Any, column: Any) -> Any:
    """A column as numbers, dates or codes (n,)."""
    if not arrow.types.is_dictionary(column.type):
        values = _numbers(column) if arrow.types.is_float64(column.type) else column.to_numpy()
        if values.dtype.kind == "f" and np.isinf(values).any():  # a number with too many digits, or the word
            raise _UnusualError
        return values
    joined = column.unify_dictionaries().combine_chunks()
    texts = tuple(joined.dictionary.to_pylist())
    if any(len(text) > LONGEST_CELL for text in texts):
        raise _UnusualError
    return Coded(texts, joined.indices.to_numpy().astype(np.int64))
