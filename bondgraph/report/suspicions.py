"""What is suspected of a log after a model has been tried on it: units, times, sampling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.data.suspicions import (
    Agreement,
    agreement,
    looks_like_milliseconds,
    sampling_notes,
    scale_suspicion,
    time_suspicion,
)
from bondgraph.errors import BondGraphError
from bondgraph.estimate.initial import Initial, initial_states
from bondgraph.filter.filter_model import FilterModel
from bondgraph.report.offset_suspicions import offset_suspicions
from bondgraph.simulate.late import first_inputs, inputs_of
from bondgraph.simulate.model import Model
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.simulation import simulate


def sampling_suspicions(model: Model, log: MatchedLog, initial: Initial = "measured") -> list[str]:
    """Modes of the machine, linearised at the start of a log, that its samples cannot show."""
    theta = _theta(model, log)
    start = initial_states(model, [log], theta, initial)[0]
    with np.errstate(all="ignore"):
        slopes = model.jacobian_x(float(log.time[0]), start, first_inputs(model, log), theta)
    if not np.isfinite(slopes).all():
        return []
    return sampling_notes(log.time, np.linalg.eigvals(slopes).astype(np.complex128))


def unit_suspicions(filter_model: FilterModel, log: MatchedLog, initial: Initial = "measured") -> list[str]:
    """Channels and times that fit the model, at its declared values, when read in another unit.

    Every hypothesis is a free simulation from a start that follows it: a filter would follow the wrong unit.
    """
    model = filter_model.model
    found = []
    as_read = _answers(filter_model, log, initial)
    for row, info in enumerate(model.outputs):
        if np.isfinite(log.y[row]).any():

            def answer(factor: float, row: int = row) -> FloatArray | None:
                modelled = as_read if factor == 1.0 else _answers(filter_model, _scaled(log, row, factor), initial)
                return None if modelled is None else modelled[row]

            found.append(scale_suspicion(info.name, info.unit, log.y[row], answer))
    offsets = offset_suspicions(model, log, initial, lambda one, rule: _answers(filter_model, one, rule))
    # a machine that is 273 K off from where its log begins rushes there, which times in ms would explain too
    found += offsets or [_time_suspicion(filter_model, log, initial)]
    return [one for one in found if one is not None]


def _time_suspicion(filter_model: FilterModel, log: MatchedLog, initial: Initial) -> str | None:
    if not looks_like_milliseconds(log.time):
        return None
    quicker = replace(log, time=log.time / 1000.0)
    as_read, scaled = (_agreements(log, _answers(filter_model, one, initial)) for one in (log, quicker))
    return time_suspicion(log.time, as_read, scaled)


def _agreements(log: MatchedLog, modelled: FloatArray | None) -> Sequence[Agreement]:
    if modelled is None:
        return ()
    each = (agreement(measured, row) for measured, row in zip(log.y, modelled, strict=True))
    return [one for one in each if one is not None]


def _scaled(log: MatchedLog, row: int, factor: float) -> MatchedLog:
    y = log.y.copy()
    y[row] /= factor
    return replace(log, y=y)


def _answers(filter_model: FilterModel, log: MatchedLog, initial: Initial) -> FloatArray | None:
    """Outputs of the free simulation of a log from its own start, shape (n_y, n); None where it fails."""
    model = filter_model.model
    theta = _theta(model, log)
    try:
        start = initial_states(model, [log], theta, initial)[0]
        run = simulate(
            model, log.time, inputs_of(model, log), theta, start,
            method=filter_model.method, substeps=filter_model.substeps, compiled=True,
        )  # fmt: skip
    except BondGraphError:  # no equilibrium or step from a start in another unit: this hypothesis says nothing
        return None
    return run.y if run.outcome is Outcome.OK else None


def _theta(model: Model, log: MatchedLog) -> FloatArray:
    return model.theta(**dict(log.theta_overrides))
