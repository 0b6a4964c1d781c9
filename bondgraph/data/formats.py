"""Files as tables of columns with headers ``name [unit]``, one function per format.

Formats beyond CSV need a further package each; where it is missing the message says what to install.
"""

from __future__ import annotations

import csv
import gzip
import importlib
import io
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from bondgraph.data.log import FIRST_ROW
from bondgraph.errors import DataError

#: Pairs of header and column.
Table = list[tuple[str, Any]]

#: Times of two sensors closer than this [s] are one sample.
_SAME_TIME = 1e-9
#: Bytes of a file, or of what it holds when unpacked, beyond which it is no log that fits into memory.
_LARGEST = 1 << 30


def check_size(size: int, path: Path) -> None:
    """Refuse what would not fit into memory, before it is read.

    Raises
    ------
    DataError
        With the size.
    """
    if size > _LARGEST:
        raise DataError(
            f"{path.name}: holds {size / 1e9:.1f} GB, at most {_LARGEST / 1e9:.1f} GB are read - cut the log into "
            "parts, or take fewer samples",
            where=(path.name,),
        )


def read_whole(reader: Callable[[Path], Table], path: Path, kind: str) -> Table:
    """The columns of a file; whatever a library says of a damaged one becomes one message.

    Raises
    ------
    DataError
        If it is too large or cannot be read.
    """
    try:
        check_size(path.stat().st_size, path)
        return reader(path)
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


def read_csv(path: Path) -> Table:
    """Columns of a comma-separated file, gzipped or not, as text."""
    rows = _csv_rows(path)
    header, cells = rows[0], rows[1:]
    if len(header) == 1 and ";" in header[0]:
        raise DataError(f"{path.name}: cells are separated by semicolons - save it with commas", where=(path.name,))
    for number, row in enumerate(cells, start=FIRST_ROW):
        if len(row) != len(header):
            raise DataError(
                f"{path.name}: row {number} has {len(row)} cells under {len(header)} headers"
                " - complete or delete the line",
                where=(path.name,),
            )
    columns = zip(*cells, strict=True) if cells else ([] for _ in header)
    return list(zip(header, columns, strict=True))


def _csv_rows(path: Path) -> list[list[str]]:
    """Header and rows of cells; empty lines at the end do not count."""
    try:
        text = (_unpacked(path) if path.name.lower().endswith(".gz") else path.read_bytes()).decode("utf-8-sig")
        rows = list(csv.reader(io.StringIO(text, newline="")))
    except (UnicodeDecodeError, gzip.BadGzipFile, zlib.error, EOFError, csv.Error) as error:
        raise DataError(
            f"{path.name}: this is not a readable CSV file ({error}) - save it as UTF-8 text", where=(path.name,)
        ) from None
    if "\x00" in text:  # which numpy would drop, and so take for nothing measured
        raise DataError(
            f"{path.name}: holds zero bytes, so that it is damaged or no text - write it again", where=(path.name,)
        )
    while rows and not rows[-1]:
        rows.pop()
    if not rows:
        raise DataError(f"{path.name}: the file is empty", where=(path.name,))
    return rows


def _unpacked(path: Path) -> bytes:
    """The content of a gzipped file, no more of it than fits into memory."""
    with gzip.open(path) as file:
        content = file.read(_LARGEST + 1)
    check_size(len(content), path)
    return content


def read_parquet(path: Path) -> Table:
    """Columns of a Parquet file; its column names are the headers."""
    parquet = extra("pyarrow.parquet", path)
    try:
        shape = parquet.read_metadata(path)
        check_size(8 * shape.num_rows * shape.num_columns, path)
        table = parquet.read_table(path)
    except (OSError, ValueError) as error:  # pyarrow's errors derive from these
        raise DataError(f"{path.name}: this is not a readable Parquet file ({error})", where=(path.name,)) from None
    return [(title, table[title].to_numpy()) for title in table.column_names]


def read_mat(path: Path) -> Table:
    """Variables of a MATLAB file: ``time``, one per signal, and ``units``, a struct of texts with the same names."""
    try:
        variables = _mat_v5(path)
    except NotImplementedError:  # scipy's way to say that the file is v7.3, which is HDF5
        variables = _mat_v73(path)
    units = variables.pop("units", None)
    if not isinstance(units, dict):
        raise DataError(
            f"{path.name}: variable 'units' is missing - save a struct with one unit per signal, "
            "such as units.engine_speed = 'rad/s'",
            where=(path.name, "units"),
        )
    if "time" not in variables:
        raise DataError(f"{path.name}: variable 'time' is missing", where=(path.name, "time"))
    names = ["time", *(name for name in variables if name != "time")]
    missing = [name for name in names if name not in units]
    if missing:
        raise DataError(f"{path.name}: struct 'units' has no field {missing[0]!r}", where=(path.name, missing[0]))
    for name in names:
        if isinstance(variables[name], str | dict) or np.ndim(variables[name]) != 1:
            raise DataError(
                f"{path.name}: variable {name!r} is no vector - save one value for each time, and nothing else",
                where=(path.name, name),
            )
    sizes = {name: len(variables[name]) for name in names}
    for name, size in sizes.items():
        if size != sizes["time"]:
            raise DataError(
                f"{path.name}: variable {name!r} has {size} values for {sizes['time']} times", where=(path.name, name)
            )
    return [(f"{name} [{units[name]}]", variables[name]) for name in names]


def _mat_v5(path: Path) -> dict[str, Any]:
    try:
        content = scipy.io.loadmat(str(path), squeeze_me=True, struct_as_record=True, chars_as_strings=True)
    except ValueError as error:
        raise DataError(f"{path.name}: this is not a readable MATLAB file ({error})", where=(path.name,)) from None
    variables: dict[str, Any] = {}
    for name, value in content.items():
        if name.startswith("__"):
            continue
        if isinstance(value, str):
            variables[name] = value
        elif getattr(value, "dtype", np.dtype(float)).names:
            variables[name] = {title: str(value[title][()]) for title in value.dtype.names}
        else:
            variables[name] = _mat_column(np.atleast_1d(value))
    return variables


def _mat_column(value: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    # An empty text in a cell array arrives as an array of size 0.
    return np.array([str(cell) if np.size(cell) else "" for cell in value]) if value.dtype.kind == "O" else value


def _mat_v73(path: Path) -> dict[str, Any]:
    h5py = extra("h5py", path)
    with h5py.File(path, "r") as file:
        return {
            name: {key: _hdf_value(file, node) for key, node in item.items()}
            if isinstance(item, h5py.Group)
            else _hdf_value(file, item)
            for name, item in file.items()
            if not name.startswith("#")
        }


def _hdf_value(file: Any, dataset: Any) -> Any:
    """A text, a list of texts or a numeric column of an HDF5 data set as MATLAB writes them."""
    kind = dataset.attrs.get("MATLAB_class", b"double")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if dataset.attrs.get("MATLAB_empty"):
        return "" if kind == "char" else np.zeros(0)
    check_size(dataset.size * dataset.dtype.itemsize, Path(file.filename))
    values = dataset[()]
    if kind == "cell":
        return np.array([_hdf_value(file, file[reference]) for reference in values.ravel()])
    if kind == "char":
        rows = ["".join(map(chr, row)) for row in np.atleast_2d(values.T)]
        return rows[0] if len(rows) == 1 else np.array([row.strip() for row in rows])
    return values.ravel()


def read_mdf(path: Path) -> Table:
    """Channels of an ASAM MDF file; where sensors have their own times, cells of the others stay empty."""
    mdf = extra("asammdf", path)
    with mdf.MDF(str(path)) as file:
        signals = [signal for signal in file.iter_channels(skip_master=True) if len(signal.timestamps)]
    if not signals:
        raise DataError(f"{path.name}: the file has no channel with samples", where=(path.name,))
    time = _merge_times([np.asarray(signal.timestamps, dtype=np.float64) for signal in signals])
    return [("time [s]", time), *((f"{signal.name} [{signal.unit or 1}]", _spread(signal, time)) for signal in signals)]


def _merge_times(times: Sequence[np.ndarray[Any, Any]]) -> np.ndarray[Any, Any]:
    merged = np.unique(np.concatenate(times))
    keep = np.concatenate(([True], np.diff(merged) > _SAME_TIME))
    return merged[keep]


def _spread(signal: Any, time: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Samples of one sensor at their rows of the merged table, nothing in between."""
    rows = np.searchsorted(time, np.asarray(signal.timestamps) + _SAME_TIME, side="right") - 1
    samples = np.asarray(signal.samples)
    if samples.dtype.kind in "SUO":
        column = np.full(time.size, "", dtype=object)
        column[rows] = [cell.decode() if isinstance(cell, bytes) else str(cell) for cell in samples]
        return column
    column = np.full(time.size, np.nan)
    column[rows] = samples.astype(np.float64)
    return column


def extra(module: str, path: Path) -> Any:
    """A module of the extra ``data``.

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
            f"{path.name}: this format needs {package}, which is not installed - run: pip install 'bondloop[data]'",
            where=(path.name, package),
        ) from None
