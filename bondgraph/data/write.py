"""Write logs as CSV, gzipped CSV or Parquet, such that reading gives the same value again."""

from __future__ import annotations

import csv
import io
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from bondgraph.data.formats.table import extra
from bondgraph.data.log import Log, LogChannel
from bondgraph.errors import DataError, require_kind
from bondgraph.files import write_bytes

#: Rows that are turned into text at a time.
_ROWS = 50_000
#: Window of zlib with the header of a gzip file.
_GZIP = 31


def write_log(path: str | Path, log: Log) -> Path:
    """Write a log; the suffix of the file chooses the format.

    Numbers are written in the shortest form that reads back exactly; the same log gives the same bytes.

    Parameters
    ----------
    path
        ``.csv``, ``.csv.gz`` or ``.parquet`` (needs the extra ``parquet``).
    log
        The log.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    DataError
        If the suffix is another one, or the package for it is not installed.

    Examples
    --------
    >>> import bondgraph as bg
    >>> import tempfile
    >>> log = bg.Log("run", np.array([0.0, 0.1]), {"v": LogChannel("v", "m/s", np.array([1.5, np.nan]))})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     print(bg.write_log(Path(folder) / "run.csv", log).read_text(), end="")
    time [s],v [m/s]
    0.0,1.5
    0.1,
    """
    require_kind("write_log", path, (str, Path), "file")
    require_kind("write_log", log, Log, "log")
    path = Path(path)
    name = path.name.lower()
    if name.endswith(".parquet"):
        return _write_parquet(path, log)
    if name.endswith(".csv.gz"):
        write_bytes(path, _zipped(piece.encode() for piece in _csv_pieces(log)))
    elif name.endswith(".csv"):
        write_bytes(path, (piece.encode() for piece in _csv_pieces(log)))
    else:
        raise DataError(
            f"{path.name}: this kind of file is not written - use .csv, .csv.gz or .parquet", where=(str(path),)
        )
    return path


def csv_text(log: Log) -> str:
    """A log as CSV text; numbers are written so that they read back exactly."""
    return "".join(_csv_pieces(log))


def _csv_pieces(log: Log) -> Iterator[str]:
    """The text of a log, some rows at a time: of a day of a machine it takes twenty times the memory of the log."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["time [s]", *(f"{channel.name} [{channel.unit}]" for channel in log.channels.values())])
    for first in range(0, len(log), _ROWS):
        own = slice(first, first + _ROWS)
        cells = (_csv_cells(channel, own) for channel in log.channels.values())
        writer.writerows(zip([repr(float(value)) for value in log.time[own]], *cells, strict=True))
        yield stream.getvalue()
        stream.seek(0)
        stream.truncate()
    yield stream.getvalue()


def _csv_cells(channel: LogChannel, own: slice) -> list[str]:
    if channel.is_text:
        return [str(value) for value in channel.values[own]]
    return ["" if np.isnan(value) else repr(float(value)) for value in channel.values[own].astype(np.float64)]


def _zipped(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """Pieces as one gzip file; without a time stamp, so that the same log gives the same file."""
    packer = zlib.compressobj(9, wbits=_GZIP)
    for piece in pieces:
        yield packer.compress(piece)
    yield packer.flush()


def _write_parquet(path: Path, log: Log) -> Path:
    arrow, parquet = extra("pyarrow", path, "parquet"), extra("pyarrow.parquet", path, "parquet")
    columns = {"time [s]": log.time}
    for channel in log.channels.values():
        # Missing cells are nulls in the file, so that other programs see them as missing too.
        values = channel.values.tolist() if channel.is_text else channel.values.astype(np.float64)
        columns[f"{channel.name} [{channel.unit}]"] = arrow.array(values, mask=channel.missing)
    content = io.BytesIO()
    parquet.write_table(arrow.table(columns), content)
    write_bytes(path, content.getvalue())
    return path
