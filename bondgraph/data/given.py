"""Logs as a user gives them: read, matched to a model already, or the file that holds them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bondgraph.data.log import Log, MatchedLog
from bondgraph.data.matching import match
from bondgraph.data.read import read_log
from bondgraph.data.signals import Signals

GivenLog = Log | MatchedLog | str | Path


def matched(
    log: GivenLog,
    model: Signals,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
) -> MatchedLog:
    """A log in the order and units of a model; one that is matched already is taken as it is.

    Parameters
    ----------
    log
        As read, matched, or a file.
    model
        The model.
    columns
        Name of a column -> name in the model, where they differ.
    constants
        Values (or letters) of inputs that the log lacks.

    Raises
    ------
    DataError
        If the file cannot be read or the log does not fit the model.
    """
    if isinstance(log, str | Path):
        log = read_log(log)
    return match(log, model, columns, constants) if isinstance(log, Log) else log


def all_matched(
    logs: GivenLog | Sequence[GivenLog],
    model: Signals,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
) -> list[MatchedLog]:
    """One or several logs in the order and units of a model; arguments and errors as for :func:`matched`."""
    listed = [logs] if isinstance(logs, Log | MatchedLog | str | Path) else logs
    return [matched(log, model, columns, constants) for log in listed]
