"""Columns of a pandas data frame as a log holds them: time in seconds, then names, units and values.

Nothing of pandas is imported: who holds a data frame has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bondgraph.data.dates import parsed_dates, seconds_since_first, split_date
from bondgraph.data.header import TEXT_UNIT, convert_unit, require_unit, split_header
from bondgraph.errors import DataError, suggest

if TYPE_CHECKING:
    import pandas

FloatArray = npt.NDArray[np.float64]
#: Name, unit and values (n,) of a column: numbers, or text with "" for a missing cell.
Column = tuple[str, str, FloatArray | npt.NDArray[np.str_]]


def frame_columns(
    table: pandas.DataFrame, name: str, units: Mapping[str, str], time: str | None
) -> tuple[FloatArray, list[Column]]:
    """Times (n,) in seconds from the start of a dated index or as they are, and the other columns.

    Parameters
    ----------
    table
        Columns called ``name [unit]``, or ``name`` with its unit in ``units``.
    name
        Of the log, for messages.
    units
        By column, and by ``time`` for that of the index.
    time
        The column with the time; None: the one called ``time``, else the index.

    Raises
    ------
    DataError
        If there is no time, or a column has no known unit, stands twice or holds neither numbers nor text.
    """
    unknown = [column for column in units if column not in (*map(str, table.columns), table.index.name, "time")]
    if unknown:
        known = [str(column) for column in table.columns]
        raise DataError(
            f"{name}: units names {unknown[0]!r}, which is no column{suggest(unknown[0], known)} - the columns are "
            f"{', '.join(known)}",
            where=(name, unknown[0]),
        )
    if not len(table):
        raise DataError(f"{name}: the log has no samples", where=(name,))
    headers = {
        position: (str(column), "s")
        if str(column) == time and _is_dated(table.iloc[:, position])
        else _header(str(column), units, name)
        for position, column in enumerate(table.columns)
    }
    found = _time_position(table, headers, name, time)
    times = _index_time(table, units, name) if found is None else _time(table.iloc[:, found], headers[found][1], name)
    columns = [
        (label, unit, _values(table.iloc[:, position], label, unit, name))
        for position, (label, unit) in headers.items()
        if position != found
    ]
    labels = [label for label, _, _ in columns]
    twice = next((label for label in labels if labels.count(label) > 1), None)
    if twice is not None:
        raise DataError(f"{name}: column {twice!r} stands twice - rename or drop one", where=(name, twice))
    return times, columns


def _header(column: str, units: Mapping[str, str], name: str) -> tuple[str, str]:
    if column in units:
        label = column.partition("[")[0].strip() if column.endswith("]") else column
        unit = units[column]
    elif column == "time":  # dated, or in seconds
        return column, "s"
    else:
        try:
            label, unit = split_header(column, name)
        except DataError:
            raise DataError(
                f"{name}: column {column!r} has no unit - call it '{column} [unit]' or give units={{{column!r}: unit}} "
                "to bg.Log.from_dataframe, with '1' for a number without dimension and 'text' for codes",
                where=(name, column),
            ) from None
    require_unit(label, unit, name)
    return label, unit


def _time_position(
    table: pandas.DataFrame, headers: Mapping[int, tuple[str, str]], name: str, time: str | None
) -> int | None:
    """Position of the column with the time; None for the index."""
    if time is None:
        found = next((position for position, (label, _) in headers.items() if label == "time"), None)
        if found is None and type(table.index).__name__ == "RangeIndex":
            raise DataError(
                f"{name}: no column is called 'time', and the index counts rows - name the column with time=, or make "
                "the time the index",
                where=(name, "time"),
            )
        return found
    for position, (label, _) in headers.items():
        if time in (label, str(table.columns[position])):
            return position
    known = [label for label, _ in headers.values()]
    raise DataError(
        f"{name}: no column {time!r}{suggest(time, known)} - the columns are {', '.join(known)}", where=(name, time)
    )


def _index_time(table: pandas.DataFrame, units: Mapping[str, str], name: str) -> FloatArray:
    label = str(table.index.name or "time")
    unit = units.get(label) or units.get("time") or (split_header(label, name)[1] if "[" in label else "s")
    return _time(table.index, unit, name)


def _time(values: Any, unit: str, name: str) -> FloatArray:
    """Times in seconds: dates and durations from the first, numbers from their unit."""
    if values.dtype.kind in "mM":
        start = values[0] if hasattr(values, "total_seconds") or not hasattr(values, "iloc") else values.iloc[0]
        passed: FloatArray = (values - start).to_numpy() / np.timedelta64(1, "s")
        return passed
    if _is_dated(values):
        return seconds_since_first(parsed_dates(list(map(str, values)), name, first_row=0))[0]
    if values.dtype.kind not in "fiu":
        raise DataError(f"{name}: the time is {values.dtype}, neither numbers nor dates", where=(name, "time"))
    factor, offset = convert_unit("time", unit, "s", name)
    seconds: FloatArray = values.to_numpy(dtype=np.float64, na_value=np.nan) * factor + offset
    return seconds


def _is_dated(values: Any) -> bool:
    """True for values that are dates or durations, or text whose first is a date; they need no unit."""
    first = next(iter(values))
    return values.dtype.kind in "mM" or (isinstance(first, str) and bool(split_date(first)))


def _values(column: Any, label: str, unit: str, name: str) -> FloatArray | npt.NDArray[np.str_]:
    if column.dtype.kind in "fiub":
        numbers: FloatArray = column.to_numpy(dtype=np.float64, na_value=np.nan)
        return numbers if unit != TEXT_UNIT else np.array(["" if np.isnan(one) else f"{one:g}" for one in numbers])
    if unit not in (TEXT_UNIT, "1"):
        raise DataError(
            f"{name}: column {label!r} is {column.dtype} where numbers in {unit} are needed - convert it, or give "
            "codes the unit 'text'",
            where=(name, label),
        )
    return np.where(column.isna(), "", column.astype(str)).astype(np.str_)
