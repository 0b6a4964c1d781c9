"""Absent means absent: a candidate whose coefficients are zero must leave the model as it is.

An element added to a graph can change which variables its loops are solved for, and a loop that divides by a modulus
that reaches zero (an open clutch, a gear in neutral) gives no number any more although nothing was added. Such a
candidate cannot be scored, and is named instead.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bondgraph.build import BuiltModel
from bondgraph.correct.models.candidates import Candidate, Refused
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.effect import is_shipped
from bondgraph.filter.filter_run import FilterRun
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.model import Model

#: States of each log at which the models are compared.
_POINTS = 60
#: Largest difference of a rate, relative to the largest rate of its state.
_TOLERANCE = 1e-6


def absent_when_zero(
    built: BuiltModel, found: Sequence[Candidate], logs: Sequence[MatchedLog], runs: Sequence[FilterRun]
) -> tuple[list[Candidate], list[Refused]]:
    """Candidates that leave the model alone with zero coefficients, at the filtered states; and the others.

    Candidates that bring a storage of their own cannot vanish and are not asked to.
    """
    declared = [_rates(built.model, built.model, log, run) for log, run in zip(logs, runs, strict=True)]
    kept, refused = [], []
    why = (
        "would change the model even where it is absent: its loop divides by a modulus that reaches zero in these logs"
    )
    for candidate in found:
        if candidate.effect.adds_state or _same(declared, built.model, candidate.model, logs, runs):
            kept.append(candidate)
        else:
            refused.append(Refused(candidate.effect.name, candidate.place.label, why, is_shipped(candidate.function)))
    return kept, refused


def _same(
    declared: Sequence[FloatArray],
    model: Model,
    extended: Model,
    logs: Sequence[MatchedLog],
    runs: Sequence[FilterRun],
) -> bool:
    found = [_rates(extended, model, log, run) for log, run in zip(logs, runs, strict=True)]
    return all(
        bool(np.all(np.abs(a - b) <= _TOLERANCE * np.abs(a).max(axis=1, keepdims=True) + np.finfo(float).tiny))
        for a, b in zip(declared, found, strict=True)
    )


def _rates(model: Model, declared: Model, log: MatchedLog, run: FilterRun) -> FloatArray:
    """Rates of the declared states at some filtered states of a log, shape (n_x, points)."""
    picked = np.unique(np.linspace(0, log.time.size - 1, _POINTS).astype(int))
    theta = model.theta(**dict(log.theta_overrides))
    rows = [model.index("state", name) for name in declared.names("state")]
    states = np.repeat(model.x0()[:, np.newaxis], picked.size, axis=1)
    states[rows] = run.filtered_mean[: len(rows), picked]
    with np.errstate(all="ignore"):
        rates: FloatArray = model.rhs(log.time[picked], states, inputs_of(model, log)[:, picked], theta)[rows]
    return rates
