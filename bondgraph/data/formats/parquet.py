"""Parquet files, read by pyarrow."""

from __future__ import annotations

from pathlib import Path

from bondgraph.data.formats.table import Table, check_size, extra
from bondgraph.data.header import Reading
from bondgraph.errors import DataError


def read_parquet(path: Path, _: Reading) -> Table:
    """Columns of a Parquet file; its column names are the headers."""
    parquet = extra("pyarrow.parquet", path, "parquet")
    try:
        shape = parquet.read_metadata(path)
        check_size(8 * shape.num_rows * shape.num_columns, path)
        table = parquet.read_table(path)
    except (OSError, ValueError) as error:  # pyarrow's errors derive from these
        raise DataError(f"{path.name}: this is not a readable Parquet file ({error})", where=(path.name,)) from None
    columns = tuple((title, table[title].to_numpy()) for title in table.column_names)
    extra("pyarrow", path, "parquet").default_memory_pool().release_unused()  # what unpacking took
    return Table(columns)
