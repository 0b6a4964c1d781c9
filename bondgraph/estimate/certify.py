"""Is an estimate free of its integration steps? It is looked at again with finer ones, where it was found.

A step that is too long does not crash, it shifts the likelihood, and often by an amount that moves no estimate. So the
search may use a cheap discretisation, and its end is judged by what matters: one Gauss-Newton step with a finer one
says how far each parameter would move, in units of its standard deviation. Beyond a tenth the search goes on with the
finer steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from bondgraph.estimate.joint import Problem
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.objective import Expand, FloatArray
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.filter.choice import plan_again
from bondgraph.filter.conditioning import Conditioning, conditioning
from bondgraph.filter.discretisation import explicit_substeps
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.runs import run

#: ``"step"``: against halved steps; ``"full"``: also against the classical Runge-Kutta method; ``"none"``: never.
Depth = Literal["none", "step", "full"]

#: A shift that does not matter, in standard deviations.
NEGLIGIBLE_SHIFT = 0.1

#: Step times rate at which the Runge-Kutta method of the full check is accurate as well as stable.
_ACCURATE = 1.0


@dataclass(frozen=True)
class Check:
    """What another discretisation would change: the likelihood in nats, and the estimate in standard deviations."""

    method: str
    substeps: int
    nats: float
    shift: float
    parameter: str

    def __str__(self) -> str:
        return (
            f"{self.method} with {self.substeps} substeps: likelihood {self.nats:+.3g} nats, "
            f"{self.parameter} moves by {self.shift:.2g} standard deviations"
        )


@dataclass(frozen=True)
class Certification:
    """How an estimate was integrated, what finer discretisations would change, and how often the search went on.

    ``conditioning`` says how much rounding moves the likelihood there; None where that was not looked at.
    """

    method: str
    substeps: int
    checks: tuple[Check, ...]
    continued: int
    conditioning: Conditioning | None = None

    @property
    def shift(self) -> float:
        """The largest shift of any parameter in any check, in standard deviations."""
        return max((check.shift for check in self.checks), default=math.nan)

    @property
    def certified(self) -> bool:
        """Whether checks were made and none would move the estimate noticeably, nor would rounding."""
        return bool(self.checks) and self.shift <= NEGLIGIBLE_SHIFT and not self.is_ill_conditioned

    @property
    def is_ill_conditioned(self) -> bool:
        """Whether the likelihood depends on rounding at the estimate."""
        return self.conditioning is not None and not self.conditioning.negligible

    @property
    def verdict(self) -> str:
        """One word or two."""
        return "certified" if self.certified else "not certified" if self.checks else "not checked"

    def __str__(self) -> str:
        doubt = [str(self.conditioning)] if self.is_ill_conditioned else []
        return "\n  ".join(
            [f"{self.method} with {self.substeps} substeps: {self.verdict}", *doubt, *map(str, self.checks)]
        )

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "method": self.method,
            "substeps": self.substeps,
            "certified": self.certified,
            "continued": self.continued,
            "ill_conditioned": self.is_ill_conditioned,
            "checks": [
                {"method": c.method, "substeps": c.substeps, "nats": c.nats, "shift": c.shift, "parameter": c.parameter}
                for c in self.checks
            ],
        }


def finer_problems(problem: Problem, point: FloatArray, depth: Depth) -> Iterator[Problem]:
    """The problem with the filters that a result at a point (n,) is compared with, of all its parts."""
    if depth == "none":
        return
    yield problem.with_filters(part.filter_model.with_halved_steps() for part in problem.parts)
    if depth == "full":
        pairs = zip(problem.parts, problem.rows, strict=True)
        explicit = [_explicit(part, point[rows]) for part, rows in pairs]
        if any(explicit):
            used = zip(problem.parts, explicit, strict=True)
            yield problem.with_filters(finer or part.filter_model for part, finer in used)


def _explicit(problem: EstimationProblem, point: FloatArray) -> FilterModel | None:
    """The filter with Runge-Kutta steps that are stable and accurate along its logs; None where it has them already."""
    used = problem.filter_model
    if used.method == "rk4":
        return None
    batch = problem.batch(point[:, np.newaxis])
    theta = batch.theta[:, 0]
    needed = max(
        explicit_substeps(run(used, log, theta, x0=x0[:, 0]), log, theta, _ACCURATE)
        for log, x0 in zip(problem.logs, batch.x0, strict=True)
    )
    if not math.isfinite(needed):
        return None
    return replace(used, method="rk4", substeps=max(1, math.ceil(needed)), plan=None)


def rounding(problem: Problem, point: FloatArray) -> Conditioning | None:
    """How much rounding moves the likelihood at a point (n,); None for another likelihood than that of the filter.

    Of several filters the one that rounding moves most.
    """
    found = []
    for part, rows in zip(problem.parts, problem.rows, strict=True):
        if isinstance(part.likelihood, FilterLikelihood):
            batch, compiled = part.batch(point[rows, np.newaxis]), part.likelihood.compiled
            values = batch.values(0)
            found.append(conditioning(part.filter_model, part.logs, batch.theta[:, 0], compiled=compiled, **values))
    return max(found, key=lambda one: one.nats / (1.0 + abs(one.nll)), default=None)


def planned_again(problem: Problem, point: FloatArray) -> Problem:
    """The problem with steps planned at a point (n,): noises and events are others there than at the start."""
    planned = []
    for part, rows in zip(problem.parts, problem.rows, strict=True):
        batch = part.batch(point[rows, np.newaxis])
        planned.append(plan_again(part.filter_model, part.logs, batch.theta[:, 0], **batch.values(0)))
    return problem.with_filters(planned)


def steps_of(problem: Problem) -> tuple[str, int]:
    """Methods of integration, and the most steps between samples."""
    used = [part.filter_model for part in problem.parts]
    return " and ".join(dict.fromkeys(one.method for one in used)), max(one.typical_substeps for one in used)


def check(
    problem: Problem,
    point: FloatArray,
    covariance: FloatArray,
    finer: FilterModel | Problem,
    jacobian: Expand,
    *,
    converged: bool = True,
) -> Check:
    """What a finer filter would change at the estimate.

    Parameters
    ----------
    problem
        As it was solved.
    point, covariance
        The estimate and its covariance in the coordinates of the problem, (n,) and (n, n); NaN for what is not
        identifiable, which cannot be shifted.
    finer
        The filter to compare with, or the problem with finer filters.
    jacobian
        How the gradient is formed.
    converged
        Whether the estimate is an optimum; of another point the gradient that it has anyway moves nothing.
    """
    known = np.nan_to_num(covariance)
    std = np.sqrt(np.diag(known))
    span = problem.upper - problem.lower
    steps = np.clip(0.1 * std, 1e-9 * span, 1e-4 * span)
    again = problem.with_filters([finer]) if isinstance(finer, FilterModel) else finer
    (expansion,) = jacobian(again, point[:, np.newaxis], steps[:, np.newaxis])
    gradient = expansion.gradient
    if not converged:
        gradient = gradient - jacobian(problem, point[:, np.newaxis], steps[:, np.newaxis])[0].gradient
    moved = np.clip(point - known @ gradient, problem.lower, problem.upper) - point
    both = [float(objective.nll(point[:, np.newaxis])[0]) for objective in (problem, again)]
    return _shifted(*steps_of(again), problem.names, moved, known, both[0] - both[1])


def check_of(finer: FilterModel, names: Sequence[str], moved: FloatArray, covariance: FloatArray, nats: float) -> Check:
    """The check that found coordinates of some names moved (n,), with their covariance (n, n), and the likelihood."""
    return _shifted(finer.method, finer.typical_substeps, names, moved, covariance, nats)


def _shifted(
    method: str, substeps: int, names: Sequence[str], moved: FloatArray, covariance: FloatArray, nats: float
) -> Check:
    std = np.sqrt(np.diag(covariance))
    in_std = np.divide(np.abs(moved), std, out=np.zeros_like(std), where=std > 0.0)
    shift = float(np.max(in_std, initial=0.0)) if np.isfinite(in_std).all() and math.isfinite(nats) else math.inf
    worst = names[int(np.argmax(np.nan_to_num(in_std, nan=np.inf)))] if names else "nothing"
    return Check(method, substeps, nats, shift, worst)
