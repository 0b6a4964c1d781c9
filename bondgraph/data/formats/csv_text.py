"""CSV files cell by cell: every kind of line and cell, slowly; names the row of whatever is wrong.

:mod:`bondgraph.data.formats.csv_quick` reads ordinary files by a library and leaves all others to this module.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np

from bondgraph.data.formats import table
from bondgraph.data.formats.table import Table, check_size
from bondgraph.data.header import EMPTY, LONGEST_CELL, TEXT_UNIT, Reading, resolve_headers, units_row
from bondgraph.data.log import FIRST_ROW
from bondgraph.errors import DataError

#: Rows whose cells are Python objects at one time.
_ROWS = 1 << 16
DELIMITERS = (",", ";", "\t")
#: A number with a comma for its decimal mark, and one with a point.
_DECIMAL_COMMA = re.compile(r"\s*[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?\s*")
_DECIMAL_POINT = re.compile(r"\s*[+-]?[\d.]*\.\d*([eE][+-]?\d+)?\s*")


def delimiter(header: str) -> str:
    r"""What separates the cells of a header line: a comma, a semicolon or a tab.

    Examples
    --------
    >>> delimiter("time [s];v [m/s]"), delimiter("time [s]\tv [m/s]"), delimiter("time [s],note; or code [text]")
    (';', '\t', ',')
    """
    bare = re.sub(r'"[^"]*"|\[[^\]]*\]', "", header)
    return max(DELIMITERS, key=bare.count)


def opened(path: Path) -> IO[bytes]:
    """The bytes of a file, unpacked where it is gzipped."""
    return gzip.open(path) if path.name.lower().endswith(".gz") else path.open("rb")  # type: ignore[return-value]


def read_csv_text(path: Path, reading: Reading) -> Table:
    """Columns of a CSV file, gzipped or not: numbers where the unit says so and all cells are, else text.

    Cells are separated by commas, semicolons or tabs; with the latter two decimal marks may be commas. Text is
    UTF-8, UTF-16 with its mark, or else Windows-1252, in which loggers of western Europe write degree and micro signs.

    Raises
    ------
    DataError
        If the file is empty, no text, has lines of other lengths than the header, or mixes decimal marks.
    """
    try:
        return _decoded(path, reading)
    except (UnicodeDecodeError, gzip.BadGzipFile, zlib.error, EOFError, csv.Error) as error:
        raise DataError(
            f"{path.name}: this is not a readable CSV file ({error}) - save it as UTF-8 text", where=(path.name,)
        ) from None


def _decoded(path: Path, reading: Reading) -> Table:
    with opened(path) as file:
        marked = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    try:
        return _read_as("utf-16" if marked else "utf-8-sig", path, reading)
    except UnicodeDecodeError as first:
        try:
            return _read_as("cp1252", path, reading)
        except UnicodeDecodeError:
            raise first from None


def _read_as(encoding: str, path: Path, reading: Reading) -> Table:
    with opened(path) as file, io.TextIOWrapper(file, encoding=encoding, newline="") as text:
        return _table(path, text, reading)


def _table(path: Path, file: io.TextIOWrapper, reading: Reading) -> Table:
    lines = _lines(path, file)
    first = next(lines, "")
    mark = delimiter(first)
    rows = csv.reader(_chained(first, lines), delimiter=mark)
    header = next(rows, [])
    if not header:
        rest = next((row for row in rows if row), None)
        problem = "the file is empty" if rest is None else "the first line is empty - it must hold the headers"
        raise DataError(f"{path.name}: {problem}", where=(path.name,))
    second = next(rows, None)
    titles = units_row(header, second) if second else None
    start = FIRST_ROW + (titles is not None)
    before = [] if second is None or titles is not None else [second]
    named = resolve_headers(titles or header, reading, path.name)
    columns = [_Column(title, unit, mark != ",") for title, (_, unit) in zip(titles or header, named, strict=True)]
    _fill(columns, before, rows, start, path.name)
    _require_one_mark(columns, path.name)
    return Table(tuple((one.header, one.cells()) for one in columns), start)


def _lines(path: Path, file: io.TextIOWrapper) -> Iterator[str]:
    """Lines of a text that is no larger than what fits into memory and holds no zero bytes."""
    size = 0
    for line in file:
        size += len(line)
        if size > table.LARGEST:
            check_size(size, path)
        if "\x00" in line:  # which numpy would drop, and so take for nothing measured
            raise DataError(
                f"{path.name}: holds zero bytes, so that it is damaged or no text - write it again", where=(path.name,)
            )
        yield line


def _chained(first: str, lines: Iterator[str]) -> Iterator[str]:
    yield first
    yield from lines


@dataclass
class _Column:
    """A column while it is read: blocks of numbers as long as all cells are, and of text."""

    header: str
    unit: str | None
    comma: bool
    blocks: list[Any] = field(default_factory=list)
    mark_rows: dict[str, int] = field(default_factory=dict)

    def add(self, cells: Sequence[str], row: int) -> None:
        """The next cells, of which the first stands in ``row``."""
        if self.comma and self.unit != TEXT_UNIT:
            cells = self._decimal(cells, row)
        is_number = self.unit not in (TEXT_UNIT, "1", None) and max(map(len, cells)) <= LONGEST_CELL
        self.blocks.append(_numbers(cells) if is_number else cells)

    def _decimal(self, cells: Sequence[str], row: int) -> Sequence[str]:
        """The cells with points for decimal marks; the rows of the first point and comma are kept."""
        for index, cell in enumerate(cells):
            if "," in cell and _DECIMAL_COMMA.fullmatch(cell):
                self.mark_rows.setdefault(",", row + index)
            elif "." in cell and _DECIMAL_POINT.fullmatch(cell):
                self.mark_rows.setdefault(".", row + index)
        if "," not in self.mark_rows:
            return cells
        return [cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in cells]

    def cells(self) -> Any:
        """The whole column: numbers (n,), or a list of text."""
        if self.blocks and all(isinstance(block, np.ndarray) for block in self.blocks):
            return np.concatenate(self.blocks)
        return [
            "" if isinstance(block, np.ndarray) and np.isnan(cell) else str(cell)
            for block in self.blocks
            for cell in block
        ]


def _numbers(cells: Sequence[str]) -> Any:
    """Cells as numbers, or as they are where one is none: which, is said where all formats are read."""
    try:
        return np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        pass
    try:
        return np.array([np.nan if cell.strip().lower() in EMPTY else float(cell) for cell in cells])
    except ValueError:
        return cells


def _fill(columns: Sequence[_Column], before: list[list[str]], rows: Any, start: int, where: str) -> None:
    """Read all lines; empty ones at the end do not count."""
    number, waiting = start, before
    while True:
        block = [*waiting, *islice(rows, _ROWS)]
        ended = len(block) == len(waiting)
        waiting = []
        while block and not block[-1]:
            waiting.append(block.pop())
        for row, cells in enumerate(block, start=number):
            if len(cells) != len(columns):
                raise DataError(
                    f"{where}: row {row} has {len(cells)} cells under {len(columns)} headers"
                    " - complete or delete the line",
                    where=(where,),
                )
        if block:
            for column, cells in zip(columns, zip(*block, strict=True), strict=True):
                column.add(cells, number)
        number += len(block)
        if ended:
            return


def _require_one_mark(columns: Sequence[_Column], where: str) -> None:
    rows: dict[str, int] = {}
    for column in columns:
        for mark, row in column.mark_rows.items():
            rows[mark] = min(row, rows.get(mark, row))
    if len(rows) > 1:
        raise DataError(
            f"{where}: numbers have a decimal comma in row {rows[',']} and a point in row {rows['.']}, so that one of "
            "them may separate thousands - write all with the same decimal mark and no other",
            where=(where,),
        )
