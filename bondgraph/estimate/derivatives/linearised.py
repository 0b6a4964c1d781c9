"""Expansions of the likelihood of a stiff model from one run of its filter, linearised along itself.

A likelihood of a vehicle whose belt grips costs a second, and differences need one per free parameter. The linearised
filter gives all of them at the cost of about two: responses to parameters with gains held (see ``response``), and to
noise levels through the covariances (see ``levels``). What it leaves out is how parameters move the gains, whose part
in the gradient vanishes on average where innovations are white. The filter's own differences besides have spikes where
single sigma points pass a kink of a law (a wheel that starts to roll), which say nothing about neighbouring parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bondgraph.compile.machine_code import has_numba
from bondgraph.data.log import FloatArray
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.objective import Expansion, expansion_of
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.execute.threads import available_cores, in_threads
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.linear.intervals import Kicks
from bondgraph.filter.linear.levels import LevelChanges, respond_to_levels
from bondgraph.filter.linear.recursion import respond
from bondgraph.filter.linear.response import (
    Change,
    LinearLog,
    kicked_along,
    linearise,
    model_change,
    together,
)
from bondgraph.filter.runs import run

#: Parameters are shifted by this share of their bounds.
_SHIFT = 1e-5


def is_linearised(problem: EstimationProblem) -> bool:
    """Whether a problem is expanded in this way: stiff, and nothing free but parameters and noise levels.

    What follows from free parameters by ties, robust losses and likelihoods other than the filter's are not.
    """
    own, kinds = problem.filter_model, {parameter.target.kind for parameter in problem.free}
    plain = isinstance(problem.likelihood, FilterLikelihood) and problem.likelihood.compiled
    told = not problem.ties and not own.robust and not own.appended and kinds <= {"parameter", "std", "process"}
    return own.is_stiff and has_numba() and plain and told


def filter_runs(problem: EstimationProblem, point: FloatArray) -> list[FilterRun]:
    """The filter over all logs at a point (n,), failed or not."""
    batch = problem.batch(point[:, np.newaxis])
    noise_std, process_std = batch.noise_std[:, 0], batch.process_std[:, 0]
    return [
        run(problem.filter_model, log, batch.theta[:, 0], noise_std=noise_std, process_std=process_std, x0=x0[:, 0])
        for log, x0 in zip(problem.logs, batch.x0, strict=True)
    ]


def linear_expansion(
    problem: EstimationProblem,
    point: FloatArray,
    runs: Sequence[FilterRun] | None = None,
    kicked: Sequence[Kicks] | None = None,
) -> Expansion:
    """Gradient, information and terms at a point (n,) inside the bounds; ``runs`` are those of the filter there.

    ``kicked`` is what :func:`bondgraph.filter.linear.response.kicked_along` gave for each log at a point next to
    this one.

    Raises
    ------
    FilterError
        If the filter diverges there.
    """
    theta = problem.batch(point[:, np.newaxis]).theta[:, 0]
    runs = filter_runs(problem, point) if runs is None else runs
    known = [None] * len(runs) if kicked is None else kicked
    linear = [
        linearise(filtered.raise_if_failed(), log, theta, own)
        for log, filtered, own in zip(problem.logs, runs, known, strict=True)
    ]
    return expansion_along(problem, point, runs, linear)


def expansion_along(
    problem: EstimationProblem, point: FloatArray, runs: Sequence[FilterRun], every: Sequence[LinearLog]
) -> Expansion:
    """As :func:`linear_expansion`, with the filter's runs along all logs already linearised."""
    innovations, scales = [], []
    starts = problem.batch_slopes(point).x0 if problem.beginnings.move else (None,) * len(runs)
    for filtered, linear, begun in zip(runs, every, starts, strict=True):
        columns_z, columns_s = _columns(problem, point, linear, filtered, begun)
        innovations.append(np.concatenate([filtered.whitened.reshape(-1, 1), columns_z], axis=1))
        scales.append(np.concatenate([filtered.log_scales.reshape(-1, 1), columns_s], axis=1))
    priors = np.hstack([problem.prior_terms(point[:, np.newaxis]), problem.prior_slopes(point)])
    return expansion_of(
        np.concatenate([*innovations, priors]), np.concatenate([*scales, np.zeros(priors.shape)]), len(runs)
    )


def kicks_along(problem: EstimationProblem, point: FloatArray, runs: Sequence[FilterRun]) -> list[Kicks]:
    """Remains of kicks of the states along the filter's runs at a point (n,), for each log.

    Raises
    ------
    FilterError
        If the filter diverged there.
    """
    theta = problem.batch(point[:, np.newaxis]).theta[:, 0]
    return [kicked_along(run.raise_if_failed(), log, theta) for log, run in zip(problem.logs, runs, strict=True)]


def value_of(problem: EstimationProblem, point: FloatArray, runs: Sequence[FilterRun]) -> float:
    """The negative log-likelihood with the priors; infinite where the filter failed."""
    total = sum(one.nll for one in runs) + float(problem.prior_values(point[:, np.newaxis])[0])
    return total if np.isfinite(total) else float("inf")


def _columns(
    problem: EstimationProblem, point: FloatArray, linear: LinearLog, filtered: FilterRun, begun: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of innovations and of log scales of one log, (n_y * n, n); of its start they are ``begun``."""
    columns_z = np.zeros((linear.slope.shape[0] * linear.slope.shape[1], len(problem.free)))
    columns_s = np.zeros(columns_z.shape)
    values = problem.values(point)
    own = [k for k, one in enumerate(problem.free) if one.target.kind == "parameter"]
    known = [k for k in own if problem.free[k].target.name not in linear.path.log.theta_overrides]
    levels = [k for k, one in enumerate(problem.free) if one.target.kind in ("std", "process")]

    def by_parameters() -> None:
        if known:
            changes = together([_shift(problem.free[k], float(values[k]), linear, filtered) for k in known])
            changes = changes if begun is None else replace(changes, begun=begun[:, known])
            columns_z[:, known] = respond(linear, changes)[0]

    def by_levels() -> None:
        if levels:
            wanted = _levels([problem.free[k] for k in levels], values[levels], filtered)
            columns_z[:, levels], columns_s[:, levels] = respond_to_levels(linear, filtered, wanted)

    in_threads(available_cores(), lambda work: work(), (by_parameters, by_levels))
    return columns_z, columns_s


def _shift(parameter: FreeParameter, value: float, linear: LinearLog, filtered: FilterRun) -> Change:
    """The change of the model by one coordinate."""
    model = filtered.filter_model.model
    size = _SHIFT * (parameter.upper - parameter.lower)
    size = -size if value + size > parameter.upper else size
    theta = linear.path.theta.copy()
    theta[model.index("parameter", parameter.target.name)] += size
    return model_change(linear.path, model, theta, size / parameter.slope(value))


def _levels(free: Sequence[FreeParameter], values: FloatArray, filtered: FilterRun) -> LevelChanges:
    """Derivatives of variances by the coordinates of noise levels."""
    model = filtered.filter_model.model
    process, measurement = np.zeros((len(free), len(model.states))), np.zeros((len(free), len(model.outputs)))
    for row, (parameter, value) in enumerate(zip(free, values, strict=True)):
        rate = 2.0 * float(value) * parameter.slope(float(value))
        if parameter.target.kind == "process":
            process[row, model.index("state", parameter.target.name)] = rate
        else:
            measurement[row, model.index("output", parameter.target.name)] = rate
    return LevelChanges(process, measurement)


def divergence(problem: EstimationProblem, point: FloatArray) -> str:
    """Why a model has no likelihood at a point (n,): a law without a value, or an integration that runs away."""
    name = problem.filter_model.model.name
    ended = next((one for one in filter_runs(problem, point) if one.cause), None)
    if ended is not None:
        return f"{name}, {ended.log_name}: {ended.cause}"
    return (
        f"{name}: the model diverges at its declared parameters on {', '.join(log.name for log in problem.logs)} with "
        f"{problem.filter_model.substeps} substeps between samples - check units, initial states and declared values"
    )
