"""Tables of published measurements: plain CSV files with a header line, some of them gzipped.

Shared by the importers of benchmark data; a file that is not what its description says is refused with the row.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import io
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bondgraph.data.log import Log
from bondgraph.data.write import write_log
from bondgraph.errors import BondGraphError, DataError, suggest

FloatArray = npt.NDArray[np.float64]


def read_table(path: Path, numeric: Sequence[str], text: Sequence[str] = ()) -> dict[str, np.ndarray]:
    r"""Columns of a table by name; an empty cell of a numeric column is NaN.

    Raises
    ------
    DataError
        If the file or a column is missing, a row is too short or long, or a cell is not a number.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "run.csv"
    ...     _ = path.write_text("t_s,u_V\n0.0,1.5\n0.1,\n")
    ...     read_table(path, ("t_s", "u_V"))["u_V"].tolist()
    [1.5, nan]
    """
    if not path.is_file():
        raise DataError(f"{path.name}: not found in {path.parent} - give the folder of the records", (str(path),))
    header, rows = _rows(path)
    for name in (*numeric, *text):
        if name not in header:
            raise DataError(f"{path.name}: no column {name!r}{suggest(name, header)}", where=(path.name, name))
    if not rows:
        raise DataError(f"{path.name}: no samples below the header", where=(path.name,))
    uneven = next((line for line, row in enumerate(rows, start=2) if len(row) != len(header)), None)
    if uneven is not None:
        raise DataError(f"{path.name}: row {uneven} does not have {len(header)} cells", where=(path.name,))
    cells = dict(zip(header, zip(*rows, strict=True), strict=True))
    columns: dict[str, np.ndarray] = {name: _numbers(cells[name], path.name, name) for name in numeric}
    return columns | {name: np.array(cells[name]) for name in text}


def _rows(path: Path) -> tuple[list[str], list[list[str]]]:
    raw = path.read_bytes()
    try:
        content = (gzip.decompress(raw) if path.suffix == ".gz" else raw).decode("utf-8")
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise DataError(f"{path.name}: is not a readable table ({error}) - copy it again", (path.name,)) from None
    rows = [row for row in csv.reader(io.StringIO(content)) if row]
    return ([cell.strip() for cell in rows[0]], rows[1:]) if rows else ([], [])


def _numbers(cells: Sequence[str], file: str, column: str) -> FloatArray:
    try:
        return np.array([float(cell) if cell.strip() else np.nan for cell in cells])
    except ValueError:
        for row, cell in enumerate(cells, start=2):
            try:
                float(cell or "nan")
            except ValueError:
                raise DataError(
                    f"{file}: row {row}: {column} is {cell!r} - a number is needed", where=(file, column)
                ) from None
        raise


def write_logs(logs: Mapping[str, Log], out: str | Path) -> tuple[Path, ...]:
    """Write logs as ``out/<name>`` (a name ends in ``.csv`` or ``.csv.gz``); the files written."""
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    return tuple(write_log(out / name, log) for name, log in logs.items())


def run_importer(
    importer: Callable[[Path], Mapping[str, Log]], module: str, doc: str | None, arguments: Sequence[str] | None
) -> int:
    """The command line of an importer ``FOLDER --out DIR``; 0 when done, 2 with a message for bad input."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=(doc or "").split("\n")[0])
    parser.add_argument("folder", type=Path, help="folder with the published files")
    parser.add_argument("--out", type=Path, required=True, help="folder for the logs, made if absent")
    options = parser.parse_args(arguments)
    try:
        written = write_logs(importer(options.folder), options.out)
    except BondGraphError as error:
        print(error, file=sys.stderr)
        return 2
    for path in written:
        print(path)
    return 0
