"""Inputs before a log begins: at their first value, or at their declared default.

A log of a step often begins with the step: a heater is on from the first sample, and all is still cold. A law by which
its command acts late asks what the command was before, and with the first value a cold machine has been heated for
ever. Of a hot-air blower that cost a delay 490 nats of 1930, and a law that is none made up for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.initial import Initial, initial_states
from bondgraph.estimate.objective import FloatArray
from bondgraph.simulate.late import first_inputs, given_rows, late_rows
from bondgraph.simulate.model import Model

#: Share of the rates that an input adds, below which the rates without it count as rest. Nearer to rest than to
#: half-way: a convention.
_AT_REST = 0.25


def with_inputs_before(
    model: Model, logs: Sequence[MatchedLog], theta: FloatArray, rule: Initial, *, whatever_follows: bool = False
) -> tuple[MatchedLog, ...]:
    """The logs, each with its inputs that began with it; before it these have their declared default.

    An input began with a log where all states that it drives are at rest without it, and not with it. States are those
    of the first sample. Inputs of which a log knows already what they were stay as they are.

    Parameters
    ----------
    model, theta
        The model and its parameters (n_theta,).
    logs
        Matched logs.
    rule
        Where initial states come from.
    whatever_follows
        True: also of inputs that nothing in this model follows late, for laws that may be added to it.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.declare.functions import delay
    >>> g = bg.BondGraph("pot")
    >>> water = g.zero_junction("water", bg.THERMAL)
    >>> _ = g.flow_source("plate", delay(g.input("power", "W", hold=True), 20.0), at=water)
    >>> _ = g.compliance("heat", displacement=4000.0, at=water, initial=293.0 * 4000.0)
    >>> _ = g.resistance("lid", flow=lambda T: 2.0 * (T - 293.0), at=water)
    >>> g.measure_effort("T", water, unit="K")
    >>> model, time = bg.build(g).model, 10.0 * np.arange(3)
    >>> def begun(power, shown):
    ...     return bg.MatchedLog("run", time, np.full((1, 3), power), np.full((1, 3), shown))
    >>> logs = [begun(500.0, 293.0), begun(500.0, 543.0), begun(500.0, 420.0)]  # cold, hot for long, in between
    >>> [dict(one.before) for one in with_inputs_before(model, logs, model.theta(), "measured")]
    [{'power': 0.0}, {}, {}]
    """
    followed = {row.source for row in late_rows(model)}
    rows = [row for row in given_rows(model) if whatever_follows or row in followed]
    rows = [row for row in rows if model.inputs[row].letters is None and not model.inputs[row].rate_of]
    if not rows:
        return tuple(logs)
    starts = initial_states(model, logs, theta, rule)
    return tuple(_begun(model, log, theta, x0, rows) for log, x0 in zip(logs, starts, strict=True))


def _begun(model: Model, log: MatchedLog, theta: FloatArray, x0: FloatArray, rows: Sequence[int]) -> MatchedLog:
    known = theta.copy()
    for name, value in log.theta_overrides.items():
        known[model.index("parameter", name)] = value
    names, late = model.names("input"), late_rows(model)
    found = dict(log.before)
    on = first_inputs(model, replace(log, before={}))
    for row in rows:
        off = on.copy()
        off[[row, *(one.row for one in late if one.source == row)]] = model.inputs[row].default
        if names[row] not in found and _began(*(model.rhs(0.0, x0, u, known) for u in (on, off))):
            found[names[row]] = float(model.inputs[row].default)
    return replace(log, before=found) if found != dict(log.before) else log


def _began(with_input: FloatArray, without: FloatArray) -> bool:
    """True where states that an input drives are at rest without it."""
    added = with_input - without
    driven = np.isfinite(added) & (added != 0.0)
    return bool(driven.any() and (np.abs(without[driven]) < _AT_REST * np.abs(added[driven])).all())
