"""Logs as values: what was measured, in the units in which it was written, and what a model sees of it.

A ``Log`` is a table with one time column; a ``MatchedLog`` is the same table in the order and units of one model. Both
are immutable. Every run-time room may use them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bondgraph.data.frame_columns import frame_columns
from bondgraph.errors import DataError, suggest, wrong_kind
from bondgraph.files import check_name
from bondgraph.frames import frame
from bondgraph.shown import Tabulated
from bondgraph.text import Table, count, few, instant, number

if TYPE_CHECKING:
    import pandas

FloatArray = npt.NDArray[np.float64]
TextArray = npt.NDArray[np.str_]

#: Row of a table in which its first sample stands: row 1 is the header.
FIRST_ROW = 2


@dataclass(frozen=True, repr=False)
class LogChannel:
    """One signal of a log.

    ``values`` has shape (n,): floats with NaN where nothing was measured, or text (gear codes) with ``""`` there.
    """

    name: str
    unit: str
    values: FloatArray | TextArray

    def __repr__(self) -> str:
        return f"<LogChannel {self.name} [{self.unit}]: {count(self.values.size, 'sample')}>"

    @property
    def is_text(self) -> bool:
        """Whether the channel holds codes rather than numbers."""
        return self.values.dtype.kind == "U"

    @property
    def missing(self) -> npt.NDArray[np.bool_]:
        """Where nothing was measured, shape (n,)."""
        empty: npt.NDArray[np.bool_] = self.values == "" if self.is_text else np.isnan(self.values)
        return empty

    @property
    def numbers(self) -> FloatArray:
        """The values of a numeric channel.

        Raises
        ------
        DataError
            If the channel holds text.
        """
        if self.is_text:
            first = int(np.argmax(~self.missing))
            raise DataError(
                f"column {self.name!r} holds text such as {str(self.values[first])!r} (row {first + FIRST_ROW}) "
                "where a number is needed",
                where=(self.name,),
            )
        return self.values.astype(np.float64, copy=False)


@dataclass(frozen=True, repr=False)
class Log(Tabulated):
    """A measured or simulated log: time in seconds, strictly increasing, and channels in their own units.

    Parameters
    ----------
    name
        Short name used in messages and reports.
    time
        Shape (n,), seconds.
    channels
        By name; each has n values.
    source
        File the log came from, empty for a simulated one.
    metadata
        Anything else worth keeping (vehicle, date, tune), as text.
    first_row
        Row of the first sample in the table from which it was read.

    Raises
    ------
    DataError
        If times do not strictly increase (with the rows), a channel has another length, or a value is infinite.

    Examples
    --------
    >>> log = Log("run", np.array([0.0, 0.1]), {"speed": LogChannel("speed", "km/h", np.array([36.0, np.nan]))})
    >>> log.channel("speed").missing.tolist()
    [False, True]
    """

    name: str
    time: FloatArray
    channels: Mapping[str, LogChannel]
    source: str = ""
    metadata: Mapping[str, str] = field(default_factory=dict)
    first_row: int = FIRST_ROW

    def __post_init__(self) -> None:
        _require_name(self.name)
        _require_increasing(self.name, self.time, self.first_row)
        for channel in self.channels.values():
            _require_fitting(self.name, channel, self.time.size, self.first_row)

    def __repr__(self) -> str:
        names = few([f"{channel.name} [{channel.unit}]" for channel in self.channels.values()])
        return f"<Log {self.name}: {_extent(self.time)}; {names}>"

    @classmethod
    def from_dataframe(
        cls,
        table: pandas.DataFrame,
        name: str = "log",
        *,
        units: Mapping[str, str] | None = None,
        time: str | None = None,
    ) -> Log:
        """A log from a pandas data frame.

        Parameters
        ----------
        table
            Columns called ``name [unit]`` as in files, or ``name`` with its unit in ``units``. Missing cells are
            missing measurements.
        name
            Of the log.
        units
            Units by column; that of an index or column of time as ``time``, seconds where it is omitted.
        time
            The column with the time; None: the one called ``time``, else the index. Dates count from the first.

        Raises
        ------
        DataError
            If there is no time or it does not increase, or a column has no unit, a wrong one, or no numbers.

        Examples
        --------
        >>> import pandas
        >>> table = pandas.DataFrame({"speed": [36.0, None], "gear": ["H", "L"]}, index=[0.0, 100.0])
        >>> log = Log.from_dataframe(table, "run7", units={"time": "ms", "speed": "km/h", "gear": "text"})
        >>> log
        <Log run7: 2 samples, 0 to 0.1 s; speed [km/h], gear [text]>
        """
        if not hasattr(table, "columns"):
            raise wrong_kind("Log.from_dataframe", table, "data frame")
        times, columns = frame_columns(table, name, units or {}, time)
        return cls(name, times, {label: LogChannel(label, unit, values) for label, unit, values in columns})

    def to_dataframe(self) -> pandas.DataFrame:
        """The log as a data frame: columns ``name [unit]``, indexed by ``time [s]``.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        columns = {f"{channel.name} [{channel.unit}]": channel.values for channel in self.channels.values()}
        return frame(columns, self.time, "time [s]")

    def table(self) -> Table:
        """A line for every channel: unit, count of values, least and largest."""
        rows = []
        for channel in self.channels.values():
            known = channel.values[~channel.missing]
            ends = [str(known.min()), str(known.max())] if channel.is_text and known.size else ["", ""]
            if known.size and not channel.is_text:
                ends = [number(float(known.min())), number(float(known.max()))]
            rows.append([channel.name, channel.unit, str(known.size), *ends])
        return ("channel", "unit", "values", "least", "largest"), rows

    def __len__(self) -> int:
        return int(self.time.size)

    def channel(self, name: str) -> LogChannel:
        """The channel called ``name``.

        Raises
        ------
        DataError
            If there is none.
        """
        if name not in self.channels:
            raise DataError(
                f"{self.name}: no column {name!r}{suggest(name, self.channels)} - the columns are "
                + ", ".join(self.channels),
                where=(self.name, name),
            )
        return self.channels[name]

    def rows(self, chosen: npt.NDArray[np.bool_]) -> Log:
        """The log at the chosen rows only, shape (n,) of truth values."""
        channels = {name: replace(channel, values=channel.values[chosen]) for name, channel in self.channels.items()}
        return replace(self, time=self.time[chosen], channels=channels)


@dataclass(frozen=True, repr=False)
class MatchedLog:
    """A log in the order and units of one model.

    Parameters
    ----------
    name
        Name of the log.
    time
        Shape (n,), seconds.
    u
        Inputs, shape (n_u, n), complete: between samples of a slower signal filled as the input declares.
    y
        Measured outputs, shape (n_y, n), NaN where nothing was measured; never interpolated.
    theta_overrides
        Parameters that this log knows (a tune, a payload), by name.
    unmatched
        Columns of the log that the model does not use.
    notes
        What deserves attention and did not stop the match.
    before
        What inputs were before the first sample, by name; of others their first value. See
        :func:`bondgraph.estimate.inputs_before.with_inputs_before`.
    """

    name: str
    time: FloatArray
    u: FloatArray
    y: FloatArray
    theta_overrides: Mapping[str, float] = field(default_factory=dict)
    unmatched: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    before: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _require_name(self.name)

    def __repr__(self) -> str:
        rows = f"{count(len(self.u), 'input')}, {count(len(self.y), 'output')}"
        return f"<MatchedLog {self.name}: {_extent(self.time)}; {rows}>"

    def __len__(self) -> int:
        return int(self.time.size)

    def rows(self, chosen: npt.NDArray[np.bool_]) -> MatchedLog:
        """The log at the chosen rows only, shape (n,) of truth values."""
        time = self.time[chosen]
        before = self.before if time.size and time[0] == self.time[0] else {}  # of a later part it is not known
        return replace(self, time=time, u=self.u[:, chosen], y=self.y[:, chosen], before=before)


def _extent(time: FloatArray) -> str:
    return f"{count(time.size, 'sample')}, {instant(float(time[0]))} to {instant(float(time[-1]))} s"


def _require_name(name: str) -> None:
    check_name(name, lambda problem: DataError(f"log: {problem}", where=(name,)))


def _require_increasing(name: str, time: FloatArray, first_row: int) -> None:
    if time.ndim != 1 or time.size == 0:
        raise DataError(f"{name}: the log has no samples", where=(name,))
    bad = np.flatnonzero(~np.isfinite(time))
    if bad.size:
        raise DataError(
            f"{name}: column 'time' has no value in {row_list(bad, first_row)} - every sample needs its time",
            where=(name, "time"),
        )
    back = np.flatnonzero(np.diff(time) <= 0) + 1
    if back.size:
        first = int(back[0])
        raise DataError(
            f"{name}: time does not increase in {row_list(back, first_row)} ({time[first - 1]:.10g} s, then "
            f"{time[first]:.10g} s) - sort the samples and drop repeated ones",
            where=(name, "time"),
        )


def _require_fitting(name: str, channel: LogChannel, size: int, first_row: int) -> None:
    if channel.values.shape != (size,):
        raise DataError(
            f"{name}: column {channel.name!r} has {channel.values.size} values for {size} times",
            where=(name, channel.name),
        )
    if not channel.is_text:
        infinite = np.flatnonzero(np.isinf(channel.numbers))
        if infinite.size:
            raise DataError(
                f"{name}: column {channel.name!r} is infinite in {row_list(infinite, first_row)}"
                " - leave the cell empty where nothing was measured",
                where=(name, channel.name),
            )


def row_list(indices: npt.NDArray[np.intp], first_row: int = FIRST_ROW, shown: int = 3) -> str:
    """Row numbers of samples as one reads them in a table, for messages.

    Examples
    --------
    >>> row_list(np.array([0])), row_list(np.array([3, 4, 8, 9, 11]))
    ('row 2', 'rows 5, 6, 10 and 2 more')
    """
    rows = [str(int(index) + first_row) for index in indices]
    if len(rows) == 1:
        return f"row {rows[0]}"
    more = f" and {len(rows) - shown} more" if len(rows) > shown else ""
    return "rows " + ", ".join(rows[:shown]) + more
