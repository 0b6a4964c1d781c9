"""Columns that a model follows as soon as their numbers are read in a unit with an offset: degrees Celsius.

A free simulation from a start that follows each reading tells most; a model whose equations know differences of
temperatures only follows any reading, and then the start that is declared tells.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.data.offsets import (
    OffsetReading,
    is_clearly_better,
    is_lost,
    offset_readings,
    offset_sentence,
    squared_errors,
    tells_offset,
)
from bondgraph.estimate.initial import Initial
from bondgraph.simulate.late import given_rows
from bondgraph.simulate.model import Model

#: Outputs (n_y, n) of the free simulation of a log from a start by a rule; None where it fails.
Answers = Callable[[MatchedLog, Initial], FloatArray | None]


@dataclass(frozen=True)
class _Columns:
    """Columns of a log that may be in another unit: rows of inputs and of outputs of the model."""

    names: tuple[str, ...]
    inputs: tuple[int, ...] = ()
    outputs: tuple[int, ...] = ()

    def values(self, log: MatchedLog) -> FloatArray:
        """All values, shape (n_columns, n)."""
        return np.vstack([log.u[list(self.inputs)], log.y[list(self.outputs)]])

    def read(self, log: MatchedLog, reading: OffsetReading) -> MatchedLog:
        """The log with these columns in another unit."""
        u, y = log.u.copy(), log.y.copy()
        for values, rows in ((u, self.inputs), (y, self.outputs)):
            values[list(rows)] = reading.of(values[list(rows)])
        return replace(log, u=u, y=y)


def offset_suspicions(model: Model, log: MatchedLog, initial: Initial, answers: Answers) -> list[str]:
    """Sentences on columns of a log that look like numbers of a unit with an offset; the likeliest of them.

    Parameters
    ----------
    model
        At its declared values.
    log
        Matched to it.
    initial
        Rule by which states start.
    answers
        Free simulations.
    """
    units = {info.unit for info in model.outputs if offset_readings(info.unit)}
    found = [one for unit in sorted(units) for one in _of_unit(model, log, initial, answers, unit)]
    return [sentence for _, sentence in sorted(found)[:1]]


def _of_unit(
    model: Model, log: MatchedLog, initial: Initial, answers: Answers, unit: str
) -> Iterator[tuple[float, str]]:
    """Errors that are left and sentences, of columns of one coherent unit."""
    seen = [row for row, info in enumerate(model.outputs) if info.unit == unit and np.isfinite(log.y[row]).any()]

    def errors(one: MatchedLog, rule: Initial) -> FloatArray | None:
        modelled = answers(one, rule)
        if modelled is None or (rule == "model" and not modelled[seen, 0].all()):
            return None  # a start at absolute zero is none that was declared
        return squared_errors(one.y[seen], modelled[seen])

    rules: list[Initial] = [initial, *(["model"] if initial != "model" else [])]  # type: ignore[list-item]
    as_read = [(rule, found) for rule in rules if seen and (found := errors(log, rule)) is not None]
    for columns in _candidates(model, log, seen, unit) if as_read else ():
        values = columns.values(log)
        for reading in offset_readings(unit):
            if not any(is_lost(one, reading) for _, one in as_read):
                continue
            other = columns.read(log, reading)
            pairs = [(before, errors(other, rule)) for rule, before in as_read]
            told = _told(pairs, reading)
            if told is not None:
                yield told[1], offset_sentence(columns.names, reading, values, unit, told)


def _told(pairs: Sequence[tuple[FloatArray, FloatArray | None]], reading: OffsetReading) -> tuple[float, float] | None:
    """Errors (rms) as read and read otherwise from the start that tells most; None where a start contradicts."""
    found = []
    for before, after in pairs:
        if after is None or is_clearly_better(before, after):
            return None
        if tells_offset(before, after, reading):
            found.append((math.sqrt(before.sum()), math.sqrt(after.sum())))
    return max(found, default=None)


def _candidates(model: Model, log: MatchedLog, seen: list[int], unit: str) -> list[_Columns]:
    """Single columns of a unit, and all together: a logger writes all in one unit."""
    given = [row for row in given_rows(model) if model.inputs[row].unit == unit and not model.inputs[row].rate_of]
    single = [_Columns((model.inputs[row].name,), inputs=(row,)) for row in given]
    single += [_Columns((model.outputs[row].name,), outputs=(row,)) for row in seen]
    if len(single) == 1:
        return single
    every = tuple(name for one in single for name in one.names)
    return [*single, _Columns(every, tuple(given), tuple(seen))]
