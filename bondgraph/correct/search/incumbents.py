"""Incumbents: finished fits, from which it is predicted what fits of other candidates would reach.

A likelihood has several optima, so one fit alone says too little. The fit of the declared model hides what it lacks in
process noise and in parameters far from their truth; the same with little process noise shows it; at the declared
values parameters stand in for nothing; and the fit with a candidate in it has noise and parameters about right,
whichever of several neighbours is the true one. Each says by its quadratic expansion which candidate would gain how
much, and from where its fit should start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.build import build
from bondgraph.correct.evidence.context import Context, coefficients, declared_point, inside
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import Candidate, Variant
from bondgraph.correct.models.failures import FAILURES
from bondgraph.correct.scores.score import solve
from bondgraph.correct.scores.scoring import Linearisation, Scored, linearisation, score_candidates
from bondgraph.correct.search.refit import SHARES
from bondgraph.correct.search.storages import storage_problem
from bondgraph.correct.search.swap import swaps
from bondgraph.data.log import FloatArray
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.local import fit
from bondgraph.estimate.noise_starts import noisy_starts
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.searches import expand
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings
from bondgraph.filter.filter_model import FilterModel

#: Noise levels at declared values are where scores are taken, no result: nats, iterations.
_TOLERANCE, _MOST_ITERATIONS = 0.5, 60


@dataclass(frozen=True)
class Prediction:
    """Gain in nats that an incumbent predicts for the fit of a candidate, and points (n,) from which that may start.

    ``blind``: nothing is predicted, and the gain says only that a fit is due.
    """

    gain: float
    starts: tuple[FloatArray, ...]
    blind: bool = False


def predicted_by_scores(
    fitted: Fit, linear: Linearisation, scored: Scored, context: Context
) -> list[Prediction | None]:
    """Predictions of a fit without any candidate, for each of those that were scored on it.

    Gains count from the fit of the declared model; those of a fit with fewer free coordinates from itself.
    """
    free_gain = _free_gain(linear)
    held = len(fitted.problem.free) < len(context.base.problem.free)
    gains = scored.scores.gain + context.base.nll - (fitted.nll - free_gain)
    found: list[Prediction | None] = []
    for j, candidate in enumerate(scored.candidates):
        if not scored.scores.gain[j] > 0.0:
            found.append(None)
            continue
        gain = float(scored.scores.gain[j] if held else gains[j])
        found.append(Prediction(gain, tuple(_starts(fitted, scored, j, candidate, context))))
    return found


def scaled(predictions: Sequence[Prediction | None], best: float) -> list[Prediction | None]:
    """Predictions whose largest gain is ``best``, in their order."""
    most = max((one.gain for one in predictions if one is not None), default=0.0)
    if most <= 0.0:
        return list(predictions)
    return [None if one is None else replace(one, gain=best * one.gain / most) for one in predictions]


def predicted_by_swap(
    found: Trial, others: Sequence[Candidate], variants: Sequence[Variant], context: Context
) -> list[Prediction | None]:
    """Predictions of a fit with a candidate in it, for others in its place; None where it can say nothing."""
    assert found.fit is not None  # else it is no incumbent
    shared = context.base.point.size
    told = swaps(found, others, variants, found.fit.problem.logs, shared)
    gain = context.base.nll - found.fit.nll
    predictions: list[Prediction | None] = []
    for one, other, variant in zip(told, others, variants, strict=True):
        if one is None:
            predictions.append(None)
            continue
        own = coefficients(other, replace(found.fit.problem.filter_model, model=other.model), variant)
        literal = _as_it_is(found, other, own, shared)
        predictions.append(Prediction(gain - one.loss, (*one.starts, *literal)))
    return predictions


def predicted_in_its_place(found: Trial, other: Trial, context: Context) -> Prediction | None:
    """The prediction of a fit with a storage in it, for another at its place with a size of the same kind.

    A delay and a lag of one sensor are both told by a time. The value with the other one's size is all that is
    predicted: from the parameters of the fit without either a delay of 70 ms promised a sixth of its gain. None where
    it says nothing.
    """
    assert found.fit is not None  # else it is no incumbent
    shared = context.base.point.size
    problem = storage_problem(other, build(other.candidate.apply(context.built.graph)), context)
    points = _as_it_is(found, other.candidate, problem.free[shared:], shared)
    value = float(problem.nll(points[0][:, np.newaxis])[0]) if points else np.inf
    return Prediction(context.base.nll - value, tuple(points)) if np.isfinite(value) else None


def at_declared_values(context: Context) -> tuple[Fit, Linearisation] | None:
    """The declared values with noise levels that suit them, linearised; None where the fit is as good as there.

    With wide bounds a model that lacks something is fitted far from its truth, and what is found would depend on how
    wide somebody declared the bounds.
    """
    problem, point = context.base.problem, declared_point(context.base)
    moving = np.array([one.target.kind == "parameter" for one in problem.free])
    if not moving.any() or moving.all():
        return None
    values = dict(zip(problem.names, map(float, problem.values(point)), strict=True))
    rest = [replace(one, start=values[one.name]) for one, moves in zip(problem.free, moving, strict=True) if not moves]
    try:
        levels = replace(problem, free=tuple(rest))
        noise = fit(levels, _MOST_ITERATIONS, _TOLERANCE, noisy_starts(rest), journal=context.journal)
        if noise.nll - context.base.nll < context.required:
            return None
        point[~moving] = noise.point
        steps = GaussNewtonSettings().difference * (problem.upper - problem.lower)
        expansion = expand(problem, point, steps)
        there = Fit(problem, point, noise.nll, expansion, noise.evaluations, SearchOutcome.CONVERGED)
        return there, linearisation(there, context.train)
    except FAILURES:
        return None


def scored_at_declared_values(context: Context, found: Sequence[Candidate]) -> list[Prediction | None]:
    """Predictions of :func:`at_declared_values`; None for all where there are none."""
    there = at_declared_values(context)
    if there is None:
        return [None] * len(found)
    fitted, linear = there
    return predicted_by_scores(fitted, linear, score_candidates(linear, found), context)


def _free_gain(linear: Linearisation) -> float:
    """Nats that a step of the free coordinates alone promises; none at an optimum."""
    if not linear.count:
        return 0.0
    expansion = linear.expansion(np.zeros((linear.free.shape[0], 0)))
    gradient = expansion.gradient[:, np.newaxis]
    return 0.5 * float(gradient[:, 0] @ solve(expansion.information, gradient)[:, 0])


def _starts(fitted: Fit, scored: Scored, j: int, candidate: Candidate, context: Context) -> list[FloatArray]:
    """Points along the step of a score, from a fit without the candidate."""
    base, problem = context.base, context.base.problem
    model: FilterModel = replace(problem.filter_model, model=candidate.model)
    own = coefficients(candidate, model, scored.variants[j])
    shared = np.array([name in problem.names for name in fitted.problem.names])  # a position may walk there
    rows = [problem.names.index(name) for name in fitted.problem.names if name in problem.names]
    point = base.point.copy()
    point[rows] = fitted.point[shared]
    if len(rows) < point.size:  # process noise is held at its bounds there
        point[[k for k in range(point.size) if k not in rows]] = _others(base, rows)
    moves = np.zeros(fitted.point.size)
    moves[~fitted.held] = scored.scores.follows(j)
    kinds = np.array([one.target.kind == "parameter" for one in fitted.problem.free])
    step = scored.scores.steps[j]
    shapes = [one.coordinate(one.start) for one in own[step.size :]]
    found = []
    for share in SHARES:
        reached = np.array([inside(one, share * value) for one, value in zip(own, step, strict=False)])
        cut = min((abs(a / (share * b)) for a, b in zip(reached, step, strict=True) if b != 0.0), default=1.0)
        moved = point.copy()
        moved[rows] += share * min(cut, 1.0) * np.where(kinds, moves, 0.0)[shared]
        found.append(np.concatenate([moved, reached, shapes]))
    return found


def _others(base: Fit, rows: Sequence[int]) -> FloatArray:
    """Lower bounds of the coordinates that are not among ``rows``."""
    lower: FloatArray = base.problem.lower[[k for k in range(base.point.size) if k not in rows]]
    return lower


def _as_it_is(found: Trial, other: Candidate, own: Sequence[FreeParameter], shared: int) -> list[FloatArray]:
    """The incumbent's point with its coefficient in a unit of the other's as that one's coefficient, if it has one."""
    fitted = found.fit
    assert fitted is not None  # it is an incumbent
    units = {name: _unit(found.candidate, name) for name in found.candidate.effect.coefficients}
    start = [one.coordinate(one.start) for one in own]
    matched = False
    for k, one in enumerate(own):
        if one.name not in other.effect.coefficients:
            continue
        same = [name for name, unit in units.items() if unit == _unit(other, one.name)]
        if same:
            value = max((fitted.values[name] for name in same), key=abs)
            start[k] = one.coordinate(inside(one, value - one.start))
            matched = True
    return [np.concatenate([fitted.point[:shared], start])] if matched else []


def _unit(candidate: Candidate, name: str) -> str:
    model = candidate.model
    return model.parameters[model.index("parameter", name)].unit
