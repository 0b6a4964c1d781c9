"""Prediction over a horizon: k steps ahead from the filtered state, restarted along a log.

One step ahead a filter corrects almost any model; from the first sample on an unknown disturbance drowns it. Between
the two lies the horizon at which a model shows what it is worth: its slowest time constant, restarted so often that the
errors tell their own scatter.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from bondgraph.correct.constants import WINDOWS
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.errors import BondGraphError
from bondgraph.estimate.fitted import Fit
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.linear.intervals import integrator, simulation_steps
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.simulation import simulate

#: Samples of each log at which its rates are looked at.
_RATES = 25
#: A rate below this share of the fastest one is that of an integral, which has no time constant.
_INTEGRAL = 1e-6


def horizon(fitted: Fit, logs: Sequence[MatchedLog]) -> float:
    """Seconds over which predictions are compared: the slowest time constant, at most one window of all the time."""
    total = sum(float(log.time[-1] - log.time[0]) for log in logs)
    slowest = 0.0
    for log, run in zip(logs, fitted.runs(logs), strict=True):
        slowest = max(slowest, _slowest(fitted, log, run))
    return min(slowest or math.inf, total / WINDOWS)


def _slowest(fitted: Fit, log: MatchedLog, run: FilterRun) -> float:
    """The slowest time constant of a model along a log, s; zero where it only integrates."""
    found = []
    for slopes in slopes_along(fitted, log, run):
        if np.isfinite(slopes).all() and slopes.size:
            rates = np.abs(np.linalg.eigvals(slopes).real)
            known = rates[rates > _INTEGRAL * max(float(rates.max()), np.finfo(float).tiny)]
            found += [1.0 / float(known.min())] if known.size else []
    return float(np.median(found)) if found else 0.0


def slopes_along(fitted: Fit, log: MatchedLog, run: FilterRun) -> Iterator[FloatArray]:
    """Jacobians (n_x, n_x) of a model at samples along a log, at the filtered states."""
    model, theta = fitted.problem.filter_model.model, log_theta(fitted, log)
    for k in np.unique(np.linspace(0, log.time.size - 1, _RATES).astype(int)):
        x = run.filtered_mean[: len(model.states), k]
        with np.errstate(all="ignore"):
            yield model.jacobian_x(float(log.time[k]), x, inputs_of(model, log)[:, k], theta)


def log_theta(fitted: Fit, log: MatchedLog) -> FloatArray:
    """The parameters of a fit as they hold in a log, shape (n_theta,)."""
    model, theta = fitted.problem.filter_model.model, fitted.theta.copy()
    for name, value in log.theta_overrides.items():
        theta[model.index("parameter", name)] = value
    return theta


def windows(log: MatchedLog, seconds: float) -> list[tuple[int, int]]:
    """First and last sample of the windows of a log, each about so long and of two samples at least.

    Examples
    --------
    >>> log = MatchedLog("run", 0.1 * np.arange(11), np.empty((0, 11)), np.empty((0, 11)))
    >>> windows(log, 0.35)
    [(0, 3), (3, 7), (7, 10)]
    """
    last = log.time.size - 1
    length = float(log.time[-1] - log.time[0])
    count = max(1, min(round(length / max(seconds, 1e-12)), last // 2))
    edges = [round(last * k / count) for k in range(count + 1)]
    return list(itertools.pairwise(edges))


def predicted(fitted: Fit, log: MatchedLog, run: FilterRun, parts: Sequence[tuple[int, int]]) -> FloatArray:
    """Outputs predicted inside windows from the filtered state at the first sample of each, shape (n_y, n).

    What is not predicted, the first sample and what follows a failure, is not a number.
    """
    filter_model, theta = fitted.problem.filter_model, log_theta(fitted, log)
    model = filter_model.model
    y = np.full((len(model.outputs), log.time.size), np.nan)
    for first, last in parts:
        rows = slice(first, last + 1)
        try:
            piece = simulate(
                model, log.time[rows], inputs_of(model, log)[:, rows], theta,
                run.filtered_mean[: len(model.states), first],
                method=integrator(filter_model), substeps=simulation_steps(filter_model, log.time[rows]), compiled=True,
            )  # fmt: skip
        except BondGraphError:
            continue
        y[:, first + 1 : last + 1] = piece.y[:, 1:]
    return y
