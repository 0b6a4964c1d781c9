"""Logs as a user gives them: read, matched to a model already, or the file that holds them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeGuard, Union

from bondgraph.data.log import Log, MatchedLog
from bondgraph.data.matching import match, match_inputs, match_outputs, renamed
from bondgraph.data.read import read_log
from bondgraph.data.select import split_at_gaps
from bondgraph.data.signals import Signals
from bondgraph.data.suspicions import JUMPS, time_gaps
from bondgraph.errors import require_kind

if TYPE_CHECKING:
    import pandas

GivenLog = Union[Log, MatchedLog, str, Path, "pandas.DataFrame"]


def matched(
    log: GivenLog,
    model: Signals,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    name: str = "log",
) -> MatchedLog:
    """A log in the order and units of a model; one that is matched already is taken as it is.

    Parameters
    ----------
    log
        As read, matched, a file, or a data frame whose columns are called ``name [unit]``.
    model
        The model.
    columns
        Name of a column -> name in the model, where they differ.
    constants
        Values (or letters) of inputs that the log lacks.
    name
        Of a data frame, which has none.

    Raises
    ------
    DataError
        If the file cannot be read or the log does not fit the model.
    OptionError
        If it is no log.
    """
    if isinstance(log, MatchedLog) or _is_matched(log):
        return log
    return match(as_read(log, name), model, columns, constants)


def inputs_matched(
    log: GivenLog,
    model: Signals,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    name: str = "log",
) -> MatchedLog:
    """A log of which the times and inputs matter; arguments and errors as for :func:`matched`.

    It may measure nothing at all, and whatever else it holds is left alone.
    """
    if isinstance(log, MatchedLog) or _is_matched(log):
        return log
    read = as_read(log, name)
    require_kind("design", read, Log, "log")
    known = renamed(read, model, columns or {})
    return MatchedLog(known.name, known.time, match_inputs(known, model, constants), match_outputs(known, model))


def all_matched(
    logs: GivenLog | Sequence[GivenLog],
    model: Signals,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    name: str = "log",
    split_gaps: bool = False,
) -> list[MatchedLog]:
    """One or several logs in the order and units of a model; arguments and errors as for :func:`matched`.

    Data frames are called ``name`` and their place among the logs. ``split_gaps``: the parts of a log between jumps in
    time are logs of their own.
    """
    listed = logs if isinstance(logs, Iterable) and not isinstance(logs, str) and not is_table(logs) else [logs]
    taken = parts_matched if split_gaps else lambda *given: [matched(*given)]
    named = ((log, f"{name}{k}") for k, log in enumerate(listed, start=1))
    return [part for log, own in named for part in taken(log, model, columns, constants, own)]


def parts_matched(
    log: GivenLog,
    model: Signals,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    name: str = "log",
) -> list[MatchedLog]:
    """The parts of a log between jumps in time, with a note; arguments and errors as for :func:`matched`."""
    if isinstance(log, MatchedLog):
        return _with_note(split_at_gaps(log), time_gaps(log.time, apart=True))
    if _is_matched(log):
        return [log]
    whole = as_read(log, name)
    parts = [match(one, model, columns, constants) for one in split_at_gaps(whole)]
    return _with_note(parts, time_gaps(whole.time, whole.first_row, apart=True))


def _with_note(parts: Sequence[MatchedLog], jumps: Sequence[str]) -> list[MatchedLog]:
    """The parts of a log, of which the first tells that time jumps, if it does."""
    if not jumps:
        return list(parts)
    notes = [note for note in parts[0].notes if not note.startswith(JUMPS)]
    return [replace(parts[0], notes=(*notes, *jumps)), *parts[1:]]


def as_read(log: GivenLog, name: str) -> Log:
    """The log of a file or a data frame."""
    if isinstance(log, str | Path):
        return read_log(log)
    return Log.from_dataframe(log, name) if is_table(log) else log  # type: ignore[return-value]


def _is_matched(log: object) -> TypeGuard[MatchedLog]:
    """True for a log of another class that filters can read, see :class:`bondgraph.filter.samples.MeasuredLog`."""
    return all(hasattr(log, part) for part in ("name", "time", "u", "y", "theta_overrides"))


def is_table(log: object) -> TypeGuard[pandas.DataFrame]:
    """True for a data frame of pandas, which need not be installed."""
    return type(log).__module__.partition(".")[0] == "pandas" and hasattr(log, "columns")
