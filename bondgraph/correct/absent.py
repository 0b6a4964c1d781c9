"""Absent means absent: a candidate whose coefficient is zero must leave the model as it is.

An element added to a graph can change which variables its loops are solved for, and a loop that divides by a modulus
that reaches zero (an open clutch, a gear in neutral) gives no number any more although nothing was added. Such a
candidate cannot be scored, and is named instead of silently spoiling the model that holds all candidates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bondgraph.correct.build import BuiltModel
from bondgraph.correct.candidates import Candidate, Refused, superset
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.filter.filter_run import FilterRun
from bondgraph.simulate.model import Model

#: States of each log at which the models are compared.
_POINTS = 60
#: Largest difference of a rate, relative to the largest rate of its state.
_TOLERANCE = 1e-6


def absent_when_zero(
    built: BuiltModel, found: Sequence[Candidate], logs: Sequence[MatchedLog], runs: Sequence[FilterRun]
) -> tuple[list[Candidate], list[Refused]]:
    """Candidates that leave the model alone with a zero coefficient, at the filtered states; and the others.

    Candidates that bring a state of their own cannot vanish and are not asked to.
    """
    vanishing = [candidate for candidate in found if not candidate.effect.adds_state]
    if not vanishing or _same(built, superset(built, vanishing).model, logs, runs):
        return list(found), []
    spoiling = [c for c in vanishing if not _same(built, superset(built, [c]).model, logs, runs)]
    why = (
        "would change the model even where it is absent: its loop divides by a modulus that reaches zero in these logs"
    )
    kept = [candidate for candidate in found if candidate not in spoiling]
    return kept, [Refused(candidate.effect.name, candidate.place.label, why) for candidate in spoiling]


def _same(built: BuiltModel, extended: Model, logs: Sequence[MatchedLog], runs: Sequence[FilterRun]) -> bool:
    return all(
        bool(np.all(np.abs(a - b) <= _TOLERANCE * np.abs(a).max(axis=1, keepdims=True) + np.finfo(float).tiny))
        for log, run in zip(logs, runs, strict=True)
        for a, b in [(_rates(built.model, log, run), _rates(extended, log, run))]
    )


def _rates(model: Model, log: MatchedLog, run: FilterRun) -> FloatArray:
    """Rates of the states at some filtered states of a log, shape (n_x, points); both models share their states."""
    picked = np.unique(np.linspace(0, log.time.size - 1, _POINTS).astype(int))
    theta = model.theta(**dict(log.theta_overrides))
    states = run.filtered_mean[: len(model.states), picked]
    with np.errstate(all="ignore"):
        rates = model.rhs(log.time[picked], states, log.u[:, picked], theta)
    return rates
