"""Expansions of the likelihood of a stiff model from one run of its filter, linearised along itself.

A likelihood of a vehicle whose belt grips costs a second, and differences need one per free parameter. The linearised
filter gives all of them at the cost of about two: responses to parameters with gains held (see ``response``), and to
noise levels through the covariances (see ``levels``). What it leaves out is how parameters move the gains, whose part
in the gradient vanishes on average where innovations are white. The filter's own differences besides have spikes where
single sigma points pass a kink of a law (a wheel that starts to roll), which say nothing about neighbouring parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bondgraph.compile.machine_code import has_numba
from bondgraph.data.log import FloatArray
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.objective import Expansion, SearchOutcome, expansion_of
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.steps import damped_step, newton_decrement, promised_gain
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
#: Damping of the first step relative to the information, its limits, and by how much it falls and rises.
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING, _DAMP_LESS, _DAMP_MORE = 1e-2, 1e-6, 1e5, 10.0, 30.0
#: It falls where a step gained more than this share of what it promised.
_AS_PROMISED = 0.5
#: No step is worth less than so many nats: what is left is for exact derivatives (``polish``).
_FINEST = 1.0
#: Nor are more trials for a step that gains, after so many that did not, where the best promises less than this.
_HARDLY, _VAIN = 2.0, 3
#: What kicks of the states leave is the costly part. It depends on the parameters and on the course of the states,
#: which measurements hold: it is asked anew once a parameter has moved by more than this share of its bounds, and far
#: from the optimum, where a step promises more than so many nats.
_UNMOVED, _NEAR = 0.01, 50.0
#: Longest steps: of the logarithm of a noise level, and of other coordinates as a share of their bounds. A level of
#: which the data say nothing is else thrown to where they say a lot.
_LONGEST_LEVEL, _LONGEST = 1.5, 0.3


def is_linearised(problem: EstimationProblem) -> bool:
    """Whether a problem is expanded in this way: stiff, and nothing free but parameters and noise levels."""
    kinds = {parameter.target.kind for parameter in problem.free}
    return problem.filter_model.is_stiff and has_numba() and kinds <= {"parameter", "std", "process"}


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
    for filtered, linear in zip(runs, every, strict=True):
        columns_z, columns_s = _columns(problem, point, linear, filtered)
        innovations.append(np.concatenate([filtered.whitened.reshape(-1, 1), columns_z], axis=1))
        scales.append(np.concatenate([filtered.log_scales.reshape(-1, 1), columns_s], axis=1))
    priors = _priors(problem, point)
    return expansion_of(
        np.concatenate([*innovations, priors]), np.concatenate([*scales, np.zeros(priors.shape)]), len(runs)
    )


@dataclass(frozen=True)
class Reached:
    """Where a search ended: the point (n,), its negative log-likelihood and expansion, and what it took."""

    point: FloatArray
    nll: float
    expansion: Expansion
    evaluations: int
    outcome: SearchOutcome


def linear_search(
    problem: EstimationProblem, start: FloatArray, iterations: int, tolerance: float, beat: float, hopeless: float
) -> Reached:
    """Damped scoring steps from a start (n,), each from one run of the filter that also serves the next expansion.

    Parameters
    ----------
    problem, start
        What to fit, and from where.
    iterations, tolerance
        Most steps, and how many nats a further one must promise.
    beat, hopeless
        Give up where the value is behind ``beat`` by more than ``hopeless`` times what a step promises or gains.
    """
    tolerance = max(tolerance, _FINEST)
    point = np.clip(start, problem.lower, problem.upper)
    runs = filter_runs(problem, point)
    value, evaluations, damping = value_of(problem, point, runs), 1, _DAMPING
    kicked, there = _kicked(problem, point, runs), point
    expansion = linear_expansion(problem, point, runs, kicked)
    outcome = SearchOutcome.ITERATION_LIMIT
    longest = longest_steps(problem)
    idle = vain = 0
    for _ in range(iterations):
        if not expansion.is_finite:
            outcome = SearchOutcome.NO_DERIVATIVES
            break
        promise = newton_decrement(problem, point, expansion)
        if promise < tolerance or idle == 2 or damping > _MOST_DAMPING:
            outcome = SearchOutcome.CONVERGED
            break
        step = np.clip(damped_step(problem, point, expansion, damping) - point, -longest, longest)
        trial = point + step
        tried = filter_runs(problem, trial)
        reached, evaluations = value_of(problem, trial, tried), evaluations + 1
        gained = value - reached
        if not gained > 0.0:
            vain += 1
            if promise < _HARDLY and vain == _VAIN:
                outcome = SearchOutcome.CONVERGED
                break
            damping *= _DAMP_MORE
            continue
        vain = 0
        kept = gained / max(promised_gain(expansion, step), gained, 1e-300)
        point, value, runs = trial, reached, tried
        damping = max(damping / _DAMP_LESS, _LEAST_DAMPING) if kept > _AS_PROMISED else damping
        idle = idle + 1 if gained < tolerance else 0
        if promise > _NEAR or _moved(problem, point, there) > _UNMOVED:
            kicked, there = _kicked(problem, point, runs), point
        expansion = linear_expansion(problem, point, runs, kicked)
        if value - beat > hopeless * max(gained, promise):
            break
    return Reached(point, value, expansion, evaluations, outcome)


def _moved(problem: EstimationProblem, point: FloatArray, before: FloatArray) -> float:
    """How far parameters are from where they were, at most, as a share of their bounds."""
    share = np.abs(point - before) / (problem.upper - problem.lower)
    return float(share[~problem.noise_levels].max(initial=0.0))


def _kicked(problem: EstimationProblem, point: FloatArray, runs: Sequence[FilterRun]) -> list[Kicks]:
    theta = problem.batch(point[:, np.newaxis]).theta[:, 0]
    return [kicked_along(run.raise_if_failed(), log, theta) for log, run in zip(problem.logs, runs, strict=True)]


def longest_steps(problem: EstimationProblem) -> FloatArray:
    """How far a step may go in each coordinate, shape (n,)."""
    return np.where(problem.noise_levels, _LONGEST_LEVEL, _LONGEST * (problem.upper - problem.lower))


def value_of(problem: EstimationProblem, point: FloatArray, runs: Sequence[FilterRun]) -> float:
    """The negative log-likelihood with the priors; infinite where the filter failed."""
    total = sum(one.nll for one in runs) + 0.5 * float(np.sum(_priors(problem, point)[:, 0] ** 2))
    return total if np.isfinite(total) else float("inf")


def _columns(
    problem: EstimationProblem, point: FloatArray, linear: LinearLog, filtered: FilterRun
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of innovations and of log scales of one log, (n_y * n, n)."""
    columns_z = np.zeros((linear.slope.shape[0] * linear.slope.shape[1], len(problem.free)))
    columns_s = np.zeros(columns_z.shape)
    values = problem.values(point)
    own = [k for k, one in enumerate(problem.free) if one.target.kind == "parameter"]
    known = [k for k in own if problem.free[k].target.name not in linear.path.log.theta_overrides]
    levels = [k for k, one in enumerate(problem.free) if one.target.kind in ("std", "process")]

    def by_parameters() -> None:
        if known:
            changes = together([_shift(problem.free[k], float(values[k]), linear, filtered) for k in known])
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


def _priors(problem: EstimationProblem, point: FloatArray) -> FloatArray:
    """Terms of the priors and their derivatives, (priors, 1 + n)."""
    rows = []
    for k, (parameter, value) in enumerate(zip(problem.free, problem.values(point), strict=True)):
        if parameter.prior_mean is not None and parameter.prior_std is not None:
            row = np.zeros(1 + point.size)
            row[0] = (float(value) - parameter.prior_mean) / parameter.prior_std
            row[1 + k] = parameter.slope(float(value)) / parameter.prior_std
            rows.append(row)
    return np.array(rows).reshape(len(rows), 1 + point.size)


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
