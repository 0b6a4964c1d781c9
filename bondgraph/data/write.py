"""Write logs as CSV, gzipped CSV or Parquet, such that reading gives the same value again."""

from __future__ import annotations

import csv
import gzip
import io
from pathlib import Path

import numpy as np

from bondgraph.data.formats.table import extra
from bondgraph.data.log import Log, LogChannel
from bondgraph.errors import DataError
from bondgraph.files import write_bytes, write_text


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
    path = Path(path)
    name = path.name.lower()
    if name.endswith(".parquet"):
        return _write_parquet(path, log)
    if name.endswith(".csv.gz"):
        # Without a time stamp the same log gives the same file.
        write_bytes(path, gzip.compress(csv_text(log).encode(), mtime=0))
    elif name.endswith(".csv"):
        write_text(path, csv_text(log))
    else:
        raise DataError(
            f"{path.name}: this kind of file is not written - use .csv, .csv.gz or .parquet", where=(str(path),)
        )
    return path


def csv_text(log: Log) -> str:
    """A log as CSV text; numbers are written so that they read back exactly."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["time [s]", *(f"{channel.name} [{channel.unit}]" for channel in log.channels.values())])
    columns = [[repr(float(value)) for value in log.time], *(_csv_cells(channel) for channel in log.channels.values())]
    writer.writerows(zip(*columns, strict=True))
    return stream.getvalue()


def _csv_cells(channel: LogChannel) -> list[str]:
    if channel.is_text:
        return [str(value) for value in channel.values]
    return ["" if np.isnan(value) else repr(float(value)) for value in channel.numbers]


def _write_parquet(path: Path, log: Log) -> Path:
    arrow, parquet = extra("pyarrow", path, "parquet"), extra("pyarrow.parquet", path, "parquet")
    columns = {"time [s]": log.time}
    for channel in log.channels.values():
        # Missing cells are nulls in the file, so that other programs see them as missing too.
        columns[f"{channel.name} [{channel.unit}]"] = arrow.array(channel.values.tolist(), mask=channel.missing)
    content = io.BytesIO()
    parquet.write_table(arrow.table(columns), content)
    write_bytes(path, content.getvalue())
    return path
