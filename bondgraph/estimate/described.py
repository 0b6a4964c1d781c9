"""From the end of a search to the estimate with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.estimate.certify import Certification, steps_of
from bondgraph.estimate.continuation import Stage
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.objective import Expand, FloatArray, SearchOutcome, TraceRow, fitted_expansion
from bondgraph.estimate.result import Estimate, Optimum
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonState
from bondgraph.estimate.uncertainty import Uncertainty, UncertaintyOutcome, uncertainty

#: Optima whose coordinates all agree within this share of the bounds are one.
_SAME = 1e-3


@dataclass(frozen=True)
class Found:
    """The end of a search: its best point (n,) with value and outcome, its trace, the end of every start, the way."""

    point: FloatArray
    nll: float
    outcome: SearchOutcome
    evaluations: int
    trace: tuple[TraceRow, ...]
    ends: tuple[tuple[FloatArray, float], ...]
    steps: FloatArray | None
    way: tuple[Stage, ...] = ()
    abandoned: int = 0


def found_after(before: Estimate, state: GaussNewtonState) -> Found:
    """The end of a search that went on from an estimate."""
    rows = tuple(replace(row, evaluations=row.evaluations + before.evaluations) for row in state.trace)
    return Found(
        state.points[:, 0],
        float(state.values[0]),
        state.outcomes[0] or SearchOutcome.ITERATION_LIMIT,
        before.evaluations + state.evaluations,
        before.trace + rows,
        ((state.points[:, 0], float(state.values[0])),),
        state.steps[:, 0],
        before.way,
        before.abandoned,
    )


def describe(problem: Problem, found: Found, jacobian: Expand, seconds: Callable[[], float]) -> Estimate:
    """The estimate at the point that a search found, with its uncertainty."""
    size = found.point.size
    known = Uncertainty(np.full((size, size), np.nan), np.zeros(size, bool), (), UncertaintyOutcome.NOT_AVAILABLE, 0)
    evaluations = found.evaluations
    if math.isfinite(found.nll):
        if found.steps is None:
            expansion = fitted_expansion(problem, found.point, jacobian)
        else:
            (expansion,) = jacobian(problem, found.point[:, np.newaxis], found.steps[:, np.newaxis])
        known = uncertainty(problem, found.point, expansion, curvature=found.outcome is not SearchOutcome.INTERRUPTED)
        evaluations += known.evaluations + expansion.evaluations
    slopes = problem.slopes(found.point)
    covariance = known.covariance * np.outer(slopes, slopes)
    return Estimate(
        problem=problem,
        point=found.point,
        nll=found.nll,
        covariance=covariance,
        correlation=_correlation(covariance),
        at_bound=tuple(name for name, at in zip(problem.names, known.at_bound, strict=True) if at),
        not_identifiable=tuple(tuple(problem.names[index] for index in group) for group in known.groups),
        optima=_distinct_optima(problem, found),
        evaluations=evaluations,
        seconds=seconds(),
        trace=found.trace,
        outcome=found.outcome,
        uncertainty_outcome=known.outcome,
        roughness=known.roughness,
        certification=Certification(*steps_of(problem), (), 0),
        way=found.way,
        abandoned=found.abandoned,
    )


def _distinct_optima(problem: Problem, found: Found) -> tuple[Optimum, ...]:
    width = problem.upper - problem.lower
    groups: list[list[tuple[FloatArray, float]]] = []
    for point, value in sorted(found.ends, key=lambda end: end[1]):
        home = next((group for group in groups if np.all(np.abs(group[0][0] - point) < _SAME * width)), None)
        if home is None:
            groups.append([(point, value)])
        else:
            home.append((point, value))
    return tuple(
        Optimum(
            {name: float(value) for name, value in zip(problem.names, problem.values(group[0][0]), strict=True)},
            group[0][1],
            len(group),
        )
        for group in groups
    )


def _correlation(covariance: FloatArray) -> FloatArray:
    with np.errstate(invalid="ignore", divide="ignore"):
        std = np.sqrt(np.diag(covariance))
        correlation: FloatArray = covariance / np.outer(std, std)
    return correlation
