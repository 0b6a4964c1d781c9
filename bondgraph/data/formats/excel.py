"""Excel files, read by openpyxl: the first sheet, headers in its first row, units there or in the second."""

from __future__ import annotations

import datetime
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.data.formats.table import Table, check_size, extra
from bondgraph.data.header import Reading, units_row
from bondgraph.data.log import FIRST_ROW
from bondgraph.errors import DataError


def read_excel(path: Path, _: Reading) -> Table:
    """Columns of the first sheet; cells are numbers, text or dates, and formulas count by their stored values.

    Raises
    ------
    DataError
        If the sheet is empty.
    """
    openpyxl = extra("openpyxl", path, "excel")
    with zipfile.ZipFile(path) as packed:
        check_size(sum(member.file_size for member in packed.infolist()), path)
    book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    try:
        rows = [list(row) for row in book.worksheets[0].iter_rows(values_only=True)]
    finally:
        book.close()
    while rows and all(cell is None for cell in rows[-1]):
        rows.pop()
    if not rows:
        raise DataError(f"{path.name}: the first sheet is empty", where=(path.name,))
    width = max(k for row in rows for k, cell in enumerate(row, start=1) if cell is not None)
    cells = [[*row[:width], *[None] * (width - len(row))] for row in rows]
    header = ["" if cell is None else str(cell) for cell in cells[0]]
    titles = units_row(header, ["" if cell is None else str(cell) for cell in cells[1]]) if len(cells) > 1 else None
    first = 1 if titles is None else 2
    columns = zip(*cells[first:], strict=True) if len(cells) > first else ([] for _ in header)
    return Table(
        tuple((title, _column(column)) for title, column in zip(titles or header, columns, strict=True)),
        FIRST_ROW - 1 + first,
    )


def _column(cells: Any) -> Any:
    """Cells as numbers or dates (n,) where all are, else as they stand."""
    kinds = {type(cell) for cell in cells if cell is not None}
    if kinds <= {int, float, bool}:
        return np.array([np.nan if cell is None else float(cell) for cell in cells])
    if kinds == {datetime.datetime}:
        return np.array(cells, dtype="datetime64[ns]")
    return cells
