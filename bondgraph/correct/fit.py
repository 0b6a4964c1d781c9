"""Fitting a model to logs on the way of a correction: the optimum with everything that tests and reports need of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.gauss_newton import GaussNewtonSettings, gauss_newton
from bondgraph.estimate.objective import Expansion, SearchOutcome, central_differences
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.likelihood import run

#: Coefficients of candidates are probed at this share of their bounds.
_PROBE = 1e-4
#: Free parameters are probed at this share of their standard deviation.
_PROBE_STD = 0.05

Report = Callable[[str, int, int], None]


def no_report(stage: str, done: int, total: int) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Fit:
    """A fitted model: the problem, the coordinates of its optimum, and the expansion of the likelihood there."""

    problem: EstimationProblem
    point: FloatArray
    nll: float
    expansion: Expansion
    evaluations: int
    outcome: SearchOutcome

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name, in the units of the model."""
        return dict(zip(self.problem.names, map(float, self.problem.values(self.point)), strict=True))

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the coordinates by name (of the logarithm, where that is the coordinate)."""
        return dict(zip(self.problem.names, standard_deviations(self.expansion), strict=True))

    @property
    def theta(self) -> FloatArray:
        """Parameters of the model at the optimum, shape (n_theta,)."""
        theta: FloatArray = self.problem.batch(self.point[:, np.newaxis]).theta[:, 0]
        return theta

    def runs(self, logs: Sequence[MatchedLog]) -> list[FilterRun]:
        """The filter over logs (these or others) at the optimum."""
        problem = EstimationProblem(
            self.problem.filter_model, tuple(logs), shared(self.problem.free), self.problem.initial
        )
        kept = [i for i, parameter in enumerate(self.problem.free) if parameter in problem.free]
        batch = problem.batch(self.point[kept][:, np.newaxis])
        return [
            run(
                problem.filter_model, log, batch.theta[:, 0],
                noise_std=batch.noise_std[:, 0], process_std=batch.process_std[:, 0], x0=x0[:, 0],
            )
            for log, x0 in zip(logs, batch.x0, strict=True)
        ]  # fmt: skip


def shared(free: Sequence[FreeParameter]) -> tuple[FreeParameter, ...]:
    """Free parameters that do not belong to one log."""
    return tuple(parameter for parameter in free if parameter.target.log is None)


def standard_deviations(expansion: Expansion) -> FloatArray:
    """Standard deviations from the Fisher information, shape (n,); infinite where there is none."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(expansion.information), np.finfo(float).tiny))
    scaled = scale[:, np.newaxis] * expansion.information * scale
    values, vectors = np.linalg.eigh(scaled)
    kept = values > 1e-12 * max(float(values.max(initial=0.0)), np.finfo(float).tiny)
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    std: FloatArray = scale * np.sqrt(np.maximum(np.diag(inverse), 0.0))
    return std


def fit(
    filter_model: FilterModel,
    logs: Sequence[MatchedLog],
    free: Sequence[FreeParameter],
    iterations: int = 40,
    tolerance: float = 1e-3,
) -> Fit:
    """Estimate the free parameters from their starts by Gauss-Newton, to ``tolerance`` nats.

    Raises
    ------
    EstimationError
        If the model diverges at the start.
    """
    problem = EstimationProblem(filter_model, tuple(logs), tuple(free))
    settings = GaussNewtonSettings(iterations=iterations, tolerance=tolerance)
    state = gauss_newton(problem, problem.start, settings=settings)
    best = state.best
    outcome = state.outcomes[best] or SearchOutcome.ITERATION_LIMIT
    if not np.isfinite(state.values[best]):
        raise EstimationError(
            f"{filter_model.model.name}: the model diverges at its declared parameters on {', '.join(log.name for log in logs)}"
            f" with {filter_model.substeps} substeps - check units and initial states, or raise the substeps"
        )
    point = state.points[:, best]
    expansion = expand(problem, point, state.steps[:, best])
    return Fit(problem, point, float(state.values[best]), expansion, state.evaluations, outcome)


def expand(problem: EstimationProblem, point: FloatArray, steps: FloatArray) -> Expansion:
    """Gradient, information and terms at one point."""
    (expansion,) = central_differences(problem, point[:, np.newaxis], steps[:, np.newaxis])
    return expansion


def expand_with(fitted: Fit, coefficients: Sequence[FreeParameter]) -> Expansion:
    """The expansion of a fit, extended by coefficients that are not yet free, at their start values."""
    problem = EstimationProblem(
        fitted.problem.filter_model, fitted.problem.logs, (*fitted.problem.free, *coefficients), fitted.problem.initial
    )
    added = np.array([parameter.coordinate(parameter.start) for parameter in coefficients])
    widths = np.array([_PROBE * (parameter.upper - parameter.lower) for parameter in coefficients])
    std = standard_deviations(fitted.expansion)
    span = fitted.problem.upper - fitted.problem.lower
    steps = np.clip(_PROBE_STD * std, 1e-7 * span, 1e-2 * span)
    return expand(problem, np.concatenate([fitted.point, added]), np.concatenate([steps, widths]))


def time_blocks(problem: EstimationProblem, seconds: float) -> np.ndarray:
    """Block of time of each term of a problem, shape (n_terms,); -1 for priors, which have no time."""
    blocks: list[np.ndarray] = []
    first = 0
    for log in problem.logs:
        own = first + ((log.time - log.time[0]) / seconds).astype(np.int64)
        blocks += [own] * log.y.shape[0]
        first = int(own.max()) + 1
    priors = sum(parameter.prior_mean is not None for parameter in problem.free)
    return np.concatenate([*blocks, np.full(priors, -1)])
