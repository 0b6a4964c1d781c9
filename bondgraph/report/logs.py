"""Logs as a command gets them: read, matched, decimated, split."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bondgraph.data.given import all_matched
from bondgraph.data.log import Log, MatchedLog
from bondgraph.data.read import read_log
from bondgraph.data.select import decimate, split
from bondgraph.errors import OptionError
from bondgraph.simulate.model import Model


@dataclass(frozen=True)
class Splits:
    """Training and held-out logs, and what must be said about how they came about.

    ``split`` is the part of that which a report must say: that held-out data are parts of the training logs.
    """

    training: tuple[MatchedLog, ...]
    held_out: tuple[MatchedLog, ...]
    said: tuple[str, ...]
    split: tuple[str, ...] = ()


def training_and_held_out(
    model: Model,
    data: Sequence[Path | str],
    holdout: Sequence[Path | str],
    mapping: Mapping[str, str],
    rate: float | None = None,
    given: Mapping[str, float | str] | None = None,
    reader: Callable[[Path | str], Log] = read_log,
    across_gaps: bool = False,
) -> Splits:
    """Read and match logs; without held-out logs the last quarter of each training log is held out, and this is said.

    ``given`` are values of inputs that the logs lack; ``reader`` makes a log of a file. Each part between jumps in time
    is a log of its own, unless the model is to lead ``across_gaps``.

    Raises
    ------
    DataError
        If a log cannot be used.
    OptionError
        If a log is both trained on and held out.
    """
    both = {str(path) for path in data} & {str(path) for path in holdout}
    if both:
        raise OptionError(
            f"{sorted(both)[0]} is given to --data and to --holdout - a log that was trained on confirms nothing",
            where=("--data", "--holdout"),
        )

    def read(path: Path | str) -> list[MatchedLog]:
        whole = reader(path)
        logs = all_matched(whole, model, mapping, given, split_gaps=not across_gaps)
        return logs if rate is None else [decimate(log, rate) for log in logs]

    training, held_out = ([log for path in paths for log in read(path)] for paths in (data, holdout))
    said = grouped_notes((*training, *held_out))
    if not held_out:
        pairs = [split(log, 0.75) for log in training]
        training, held_out = [first for first, _ in pairs], [last for _, last in pairs]
        parted = "no --holdout given: the last quarter of each training log is held out instead"
        return Splits(tuple(training), tuple(held_out), (*said, parted), (parted,))
    return Splits(tuple(training), tuple(held_out), tuple(said))


def grouped_notes(logs: Sequence[MatchedLog]) -> list[str]:
    """What is to be said about logs, each thing once, with the names of the logs it holds for.

    Examples
    --------
    >>> import numpy as np
    >>> def log(name):
    ...     return MatchedLog(name, np.arange(2.0), np.zeros((0, 2)), np.zeros((0, 2)), notes=("no brake",))
    >>> grouped_notes([log("run1"), log("run2")])
    ['run1, run2: no brake']
    """
    names: dict[str, list[str]] = {}
    for log in logs:
        for note in log.notes:
            names.setdefault(note, []).append(log.name)
    return [f"{', '.join(where)}: {note}" for note, where in names.items()]
