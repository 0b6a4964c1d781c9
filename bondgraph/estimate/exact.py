"""Expansions of an estimation problem by exact derivatives of the filter, for the searches' ``jacobian``.

Central differences filter twice for every free parameter. The filter with derivatives takes all of them along, at the
cost of a few evaluations. Where it does not apply (appended parameters, another likelihood than the filter's, no
numba) central differences serve.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from bondgraph.compile.lanes.load import load_tangents
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.objective import (
    Expansion,
    FloatArray,
    Objective,
    Terms,
    central_differences,
    expansion_of,
)
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.filter.choice import choose_method
from bondgraph.filter.compiled import thread_count
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.gradient import Directions, has_exact_gradient, innovation_tangents
from bondgraph.filter.samples import Samples
from bondgraph.filter.ukf import Member

#: What one expansion counts, in evaluations: measured on the vehicle with ten free parameters, and one to compare.
_EVALUATIONS = 5

#: Relative difference up to which two values of a likelihood are the same.
_SAME = 1e-7

#: Step by which the map from coordinates to numbers (straight or exponential) is differentiated, relative.
_STEP = 1e-5

#: Integration steps of a filtering times sigma points times free numbers from which exact derivatives repay the
#: seconds that compiling them takes once: central differences then take about a second for each gradient.
_REPAYS = 1_000_000


def derivatives(objective: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
    """Expansions at points (n, members): exact where a search is long enough to repay their compilation.

    The choice depends on nothing but the problem, so a search can be repeated.
    """
    if isinstance(objective, EstimationProblem) and filtering_work(objective) * len(objective.names) >= _REPAYS:
        return exact_derivatives(objective, points, steps)
    return central_differences(objective, points, steps)


def filtering_work(problem: EstimationProblem) -> int:
    """What one value takes, without asking a clock: integration steps over all logs times sigma points."""
    filter_model = choose_method(problem.filter_model, problem.logs)
    taken = sum(int(Samples.of(filter_model, log).substeps.sum()) for log in problem.logs)
    return taken * (2 * len(filter_model.state_names) + 1)


def exact_derivatives(objective: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
    """Expansions at points (n, members); ``steps`` are used where central differences must serve.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> problem = pose(swing, log, ["length", "std(deflection)"])
    >>> (expansion,) = exact_derivatives(problem, problem.start[:, np.newaxis], np.full((2, 1), 1e-4))
    >>> expansion.information.shape
    (2, 2)
    """
    if not isinstance(objective, EstimationProblem) or (filter_model := _exact_filter(objective)) is None:
        return central_differences(objective, points, steps)
    terms = objective.terms(points)
    found = []
    for m, known in enumerate(_expansions(objective, filter_model, points)):
        seen, expansion = terms.members(np.array([m])), known
        if expansion is None or not _agrees(expansion, float(seen.sums()[0])):
            (expansion,) = central_differences(objective, points[:, [m]], steps[:, [m]])
        found.append(_about(seen, expansion))
    return tuple(found)


def exact_expansion(problem: EstimationProblem, point: FloatArray, known: Terms | None = None) -> Expansion | None:
    """The expansion at a point (n,) by exact derivatives alone; None where there are none or the filter chatters.

    ``known`` are the terms (n_terms, 1) there, if somebody has them.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> problem = pose(swing, log, ["length"])
    >>> exact_expansion(problem, problem.start).information.shape
    (1, 1)
    """
    filter_model = _exact_filter(problem)
    if filter_model is None:
        return None
    expansion = _expand(problem, filter_model, point, _threads(problem))
    seen = problem.terms(point[:, np.newaxis]) if known is None else known
    if expansion is None or not _agrees(expansion, float(seen.sums()[0])):
        return None
    return _about(seen, expansion)


def compile_exact(problem: EstimationProblem) -> None:
    """Compile what :func:`exact_expansion` needs, before threads start: CPython 3.11 cannot parse text in two."""
    filter_model = _exact_filter(problem)
    if filter_model is None:
        return
    names = {one.target.name for one in problem.free if one.target.kind == "parameter"}
    model = filter_model.model
    load_tangents(model, tuple(sorted(model.index("parameter", name) for name in names)), filter_model.method)


def _exact_filter(problem: EstimationProblem) -> FilterModel | None:
    """The filter of a problem with its method decided; None where it has no exact derivatives."""
    if not isinstance(problem.likelihood, FilterLikelihood) or not problem.likelihood.compiled:
        return None
    filter_model = choose_method(problem.filter_model, problem.logs)
    return filter_model if has_exact_gradient(filter_model) else None


def _threads(problem: EstimationProblem) -> int:
    return thread_count(problem.likelihood.threads if isinstance(problem.likelihood, FilterLikelihood) else None)


def _expansions(problem: EstimationProblem, filter_model: FilterModel, points: FloatArray) -> list[Expansion | None]:
    """Expansions at points (n, members), as many at once as there are threads; each is the same however many."""
    threads = _threads(problem)
    members = points.shape[1]
    # The first alone: what is compiled when it is first used is compiled in one thread.
    found = [_expand(problem, filter_model, points[:, 0], threads)] if members else []
    if threads == 1 or members < 3:
        return found + [_expand(problem, filter_model, points[:, m], threads) for m in range(1, members)]
    own = max(1, threads // (members - 1))
    with ThreadPoolExecutor(min(threads, members - 1)) as executor:
        rest = executor.map(lambda m: _expand(problem, filter_model, points[:, m], own), range(1, members))
        return found + list(rest)


def _about(seen: Terms, expansion: Expansion) -> Expansion:
    """The expansion around the terms that the search sees: gains are told from these to the last digit."""
    slopes = expansion.terms
    if slopes is None or not np.isfinite(seen.sums()).all():
        return expansion
    innovations = np.hstack([seen.innovations, slopes.innovations[:, 1:]])
    return expansion_of(innovations, np.hstack([seen.log_scales, slopes.log_scales[:, 1:]]), expansion.evaluations)


def _agrees(expansion: Expansion, value: float) -> bool:
    """Whether derivatives belong to the likelihood that the search sees.

    Both take the same steps, so they differ by rounding. A filter whose integration steps are too long for a saturating
    law (a tyre, a belt: the step jumps across the zone where it grips) chatters and multiplies rounding by powers of
    ten per sample; then the two part, neither has a slope, and a search would gain from their difference for ever.
    """
    return abs(expansion.sum - value) <= _SAME * (1.0 + abs(value))


def _expand(problem: EstimationProblem, filter_model: FilterModel, point: FloatArray, threads: int) -> Expansion | None:
    """The expansion at a point (n,); None where the filter fails."""
    free = problem.upper > problem.lower
    step = _STEP * np.maximum(1.0, np.abs(point))
    moved = np.diag(np.where(free, step, 0.0))
    around = np.concatenate([point[:, np.newaxis], point[:, np.newaxis] + moved, point[:, np.newaxis] - moved], axis=1)
    batch = problem.batch(around)

    def slopes(array: FloatArray) -> FloatArray:
        n = point.size
        return np.asarray((array[..., 1 : n + 1] - array[..., n + 1 :]) / (2.0 * step))

    def turned(array: FloatArray) -> FloatArray | None:
        moved = slopes(array)
        return moved if moved.any() else None

    stds = (batch.initial_std, batch.process_std, batch.noise_std)
    correlations = (batch.initial_correlation, batch.process_correlation, batch.noise_correlation)
    members = [
        Member(batch.theta[:, 0], x0[:, 0], *(array[..., 0] for array in (*stds, *correlations))) for x0 in batch.x0
    ]
    levels = [np.nan_to_num(slopes(std)) for std in stds]
    pairs = [turned(array) for array in correlations]
    directions = [Directions(slopes(batch.theta), slopes(x0), *levels, *pairs) for x0 in batch.x0]
    found = innovation_tangents(filter_model, problem.logs, members, directions, threads)
    priors = problem._prior_terms(around)
    d_priors = slopes(priors)
    columns = [np.hstack([f.values.reshape(-1, 1), f.d_values.reshape(-1, point.size)]) for f in found]
    scales = [np.hstack([f.log_scales.reshape(-1, 1), f.d_log_scales.reshape(-1, point.size)]) for f in found]
    innovations = np.vstack([*columns, np.hstack([priors[:, :1], d_priors])])
    log_scales = np.vstack([*scales, np.zeros((priors.shape[0], 1 + point.size))])
    if not (np.isfinite(innovations).all() and np.isfinite(log_scales).all()):
        return None
    return expansion_of(innovations, log_scales, _EVALUATIONS)
