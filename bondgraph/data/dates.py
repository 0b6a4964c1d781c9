"""Times written as dates, ISO 8601, as seconds from the first of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from bondgraph.errors import DataError

_DATE = re.compile(r"(\d{4}-\d{2}-\d{2}[T ]\d{2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?)\s?(Z|[+-]\d{2}(?::?\d{2})?|)")
_NANOSECOND = 1e-9


def split_date(text: str) -> tuple[str, str] | None:
    """Date with time, and time zone, of an ISO 8601 text; None of any other text.

    Examples
    --------
    >>> split_date("2024-05-01 12:00:00.25+02:00"), split_date("0.25")
    (('2024-05-01 12:00:00.25', '+02:00'), None)
    """
    match = _DATE.fullmatch(text)
    return None if match is None else (match[1], match[2])


def parsed_dates(cells: Sequence[str], where: str, first_row: int) -> npt.NDArray[np.datetime64]:
    """Dates (n,) in UTC, or as they stand where they have no time zone; empty cells are no date.

    Raises
    ------
    DataError
        If a cell is no date, or some have a time zone and some have none.
    """
    found = np.full(len(cells), np.datetime64("NaT", "ns"))
    zoned = None
    for row, cell in enumerate(cells):
        if not cell:
            continue
        parts = split_date(cell)
        if parts is None or zoned not in (None, bool(parts[1])):
            problem = "is no date like the others" if parts is None else "differs from those before it in its time zone"
            raise DataError(
                f"{where}: column 'time' has {cell!r} (row {row + first_row}), which {problem} - write all times like "
                "2024-05-01T12:00:00.250, with a time zone everywhere or nowhere",
                where=(where, "time"),
            )
        zoned = bool(parts[1])
        try:
            found[row] = np.datetime64(parts[0].replace(",", "."), "ns") - np.timedelta64(_minutes(parts[1]), "m")
        except ValueError:
            raise DataError(
                f"{where}: column 'time' has {cell!r} (row {row + first_row}), which is no day or time of a calendar",
                where=(where, "time"),
            ) from None
    return found


def _minutes(zone: str) -> int:
    digits = zone.replace(":", "")[1:].ljust(4, "0")
    return 0 if zone in ("", "Z") else (-1 if zone[0] == "-" else 1) * (60 * int(digits[:2]) + int(digits[2:]))


def seconds_since_first(dates: npt.NDArray[Any]) -> tuple[npt.NDArray[np.float64], str]:
    """Seconds (n,) from the first of the dates, NaN where there is none, and that first date as text.

    Examples
    --------
    >>> dates = np.array(["2024-05-01T12:00:00", "2024-05-01T12:00:00.025"], dtype="datetime64[ns]")
    >>> seconds_since_first(dates)
    (array([0.   , 0.025]), '2024-05-01T12:00:00.000000000')
    """
    passed = (dates - dates[0]).astype("timedelta64[ns]")
    seconds = passed.astype(np.int64) * _NANOSECOND
    return np.where(np.isnat(passed), np.nan, seconds), str(dates[0])
