"""Continuation in process noise: a search that starts far away begins with a filter that believes its model less.

With little process noise a filter follows its model, and a wrong parameter makes it miss a whole drive: the likelihood
far from its optimum is then steep, high and full of local optima. Noise that drives the states lets the filter return
to the measurements, so that every sample speaks for itself, and the likelihood becomes nearly quadratic. It is least
certain of what the unknown parameters do, so the noise stands for just that: of each state, how far one sample goes
astray when the free parameters are off by as much as their bounds (or priors) leave open. A search with this noise ends
closer to the optimum, the next with less noise closer still, and the last is with the declared noise: the result is
that of the declared problem, only the way to it is another.

How much noise is next is asked of the data: the likeliest multiple, at least a step smaller than the one before, until
the declared noise alone is as likely.

References: Ye, Rey, Kadakia, Eldridge, Morone, Rozdeba, Abarbanel, Quinn (2015), Systematic variational method for
statistical nonlinear state and parameter estimation, Physical Review E 92, 052901 (annealing in the model error);
Vyasarayani, Uchida, Carvalho, McPhee (2012), Parameter identification in dynamic systems using the homotopy
optimization approach, Multibody System Dynamics 26(4), 411-424.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.objective import FloatArray
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings, GaussNewtonState
from bondgraph.filter.choice import choose_method
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.runs import run
from bondgraph.simulate.batch import simulate_batch
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.stiff import Rosenbrock

Continuation = Literal["none", "process-noise"]

#: Searches on the way need not be finished: they stop where a step promises less than a nat, or after a few steps.
ON_THE_WAY = GaussNewtonSettings(iterations=4, tolerance=1.0)

#: Multiples of the noise that are asked for, each 4.6 times (two thirds of a decade) smaller than the one before, then
#: none. Variances below a millionth of the first no longer help.
SCALES = (*(float(10.0 ** (-2.0 * k / 3.0)) for k in range(5)), 0.0)

#: The declared noise is taken when no more than this many nats speak against it.
_AS_LIKELY = 1.0

#: Samples of each log at which the effect of the parameters is looked at.
_SAMPLES = 100

#: Standard deviation of a uniform distribution over its width.
_UNIFORM = 12.0**-0.5


@dataclass(frozen=True)
class Stage:
    """One search on the way: the multiple of the noise, and where the best start ended."""

    scale: float
    values: Mapping[str, float]
    nll: float
    evaluations: int


@dataclass(frozen=True)
class Way:
    """The declared problem, and of each part the noise std (n_states,) per sqrt(s) with which a continuation begins."""

    problem: Problem
    noise: tuple[FloatArray, ...]

    def at(self, scale: float) -> Problem:
        """The problem with a multiple of the noise added to the declared one; levels that are free stay free."""
        if scale == 0.0:
            return self.problem
        pairs = zip(self.problem.parts, self.noise, strict=True)
        return self.problem.with_filters(_noisier(part.filter_model, scale * added) for part, added in pairs)

    def next_scale(self, points: FloatArray, above: float) -> tuple[float, int]:
        """The likeliest scale below ``above`` at the best of points (n, starts), and the evaluations this took."""
        scales = [scale for scale in SCALES if scale < above]
        values = np.array([np.min(_finite(self.at(scale).nll(points))) for scale in scales])
        if not np.isfinite(values).any() or values[-1] <= values.min() + _AS_LIKELY:
            return 0.0, len(scales) * points.shape[1]
        return scales[int(np.argmin(values))], len(scales) * points.shape[1]

    def stage(self, scale: float, state: GaussNewtonState) -> Stage:
        """What a finished search is remembered by."""
        values = self.problem.values(state.points[:, state.best])
        named = {name: float(value) for name, value in zip(self.problem.names, values, strict=True)}
        return Stage(scale, named, float(state.values.min()), state.evaluations)


def _noisier(declared: FilterModel, added: FloatArray) -> FilterModel:
    """A filter model with noise (n_states,) added to its own."""
    total = {
        name: float(np.hypot(declared.process_noise.get(name, 0.0), extra))
        for name, extra in zip(declared.model.names("state"), added, strict=True)
    }
    wide = {name: std for name, std in total.items() if std > 0.0}
    # steps planned for the declared noise are too few where sigma points spread wider
    return replace(declared, process_noise=wide, plan=None)


def way(problem: Problem) -> Way:
    """The way to a problem, with noise that stands for what is not known of its free parameters at their start.

    Examples
    --------
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> ((angle, rate),) = way(pose(swing, log, ["length"])).noise
    >>> bool(rate > 10 * angle > 0.0)
    True
    """
    spreads = [_spread(problem, index) for index in range(len(problem.free))]
    moves = np.diag(spreads)[:, np.array(spreads) > 0.0]
    around = np.concatenate([problem.start[:, np.newaxis], problem.start[:, np.newaxis] + moves], axis=1)
    around = np.concatenate([around, problem.start[:, np.newaxis] - moves], axis=1)
    around = np.clip(around, problem.lower[:, np.newaxis], problem.upper[:, np.newaxis])
    parts = zip(problem.parts, problem.rows, strict=True)
    return Way(problem, tuple(_unknown(part, around[rows]) for part, rows in parts))


def _unknown(problem: EstimationProblem, around: FloatArray) -> FloatArray:
    """Noise std (n_states,) per sqrt(s) that stands for moves of the coordinates, at points (n, 1 + 2 moves)."""
    batch = problem.batch(around)
    filter_model = choose_method(problem.filter_model, problem.logs)
    squares = [
        _astray(filter_model, log, batch.theta, x0[:, 0]) for log, x0 in zip(problem.logs, batch.x0, strict=True)
    ]
    together = np.concatenate(squares, axis=1)
    known = together[:, np.isfinite(together).all(axis=0)]
    noise: FloatArray = np.sqrt(known.mean(axis=1)) if known.shape[1] else np.zeros(together.shape[0])
    return noise


def _spread(problem: Problem, index: int) -> float:
    """What is open about one coordinate, as a standard deviation; zero for what moves no state."""
    free = problem.free[index]
    if free.target.kind != "parameter":
        return 0.0
    open_ = _UNIFORM * float(problem.upper[index] - problem.lower[index])
    told = [prior.spread(free.name) for prior in problem.all_priors if free.name in prior.names]
    return min([open_, *(std / free.slope(free.start) for std in told)])


def _astray(filter_model: FilterModel, log: MatchedLog, theta: FloatArray, x0: FloatArray) -> FloatArray:
    """Mean squares per second by which samples of a log go astray, (n_x, samples); theta (n_theta, 1 + 2 moves).

    From the filtered state before a sample, the model runs on to it with every parameter set; the first column is the
    one that the others are compared with.
    """
    model = filter_model.model
    known = theta.copy()
    for name, value in log.theta_overrides.items():
        known[model.index("parameter", name)] = value
    filtered = run(filter_model, log, theta[:, 0], x0=x0).filtered_mean[: len(model.states)]
    stiff = filter_model.is_stiff
    method = Rosenbrock(filter_model.method, filter_model.substeps, filter_model.grading) if stiff else "rk4"
    chosen = np.unique(np.linspace(0, len(log) - 2, min(_SAMPLES, len(log) - 1)).astype(int))
    squares = np.full((len(model.states), chosen.size), np.nan)
    for column, k in enumerate(chosen):
        if not np.isfinite(filtered[:, k]).all():
            continue
        start = np.repeat(filtered[:, k : k + 1], theta.shape[1], axis=1)
        time, inputs = log.time[k : k + 2], inputs_of(model, log)[:, k : k + 2]
        ends = simulate_batch(
            model, time, inputs, known, start, method=method, substeps=filter_model.substeps
        ).x[:, 1]  # fmt: skip
        astray = ends[:, 1:] - ends[:, :1]
        # Both directions of a move count half.
        squares[:, column] = 0.5 * np.sum(astray**2, axis=1) / (time[1] - time[0])
    return squares


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.inf)
