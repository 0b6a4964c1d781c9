"""Expansions of an estimation problem by exact derivatives of the filter, for the searches' ``jacobian``.

Central differences filter twice for every free parameter. The filter with derivatives takes all of them along, at the
cost of a few evaluations. Where it does not apply (appended parameters, another likelihood than the filter's, no
numba) central differences serve.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bondgraph.compile.lanes.load import load_tangents
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.objective import (
    BoolArray,
    Expansion,
    FloatArray,
    Objective,
    Terms,
    expansion_of,
)
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.execute.threads import in_threads, thread_count
from bondgraph.filter.choice import choose_method
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.gradient import Directions, has_exact_gradient, innovation_tangents
from bondgraph.filter.samples import Samples
from bondgraph.filter.ukf import Member

#: What one expansion counts, in evaluations: measured on the vehicle with ten free parameters, and one to compare.
_EVALUATIONS = 5

#: Relative difference up to which two values of a likelihood are the same.
_SAME = 1e-7

#: Integration steps of a filtering times sigma points times free numbers from which exact derivatives repay the
#: seconds that compiling them takes once: central differences then take about a second for each gradient.
_REPAYS = 1_000_000


def derivatives(objective: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
    """Expansions at points (n, members): exact where a search is long enough to repay their compilation.

    The choice depends on nothing but the problem, so a search can be repeated.
    """
    if isinstance(objective, Problem) and repays_exact(objective):
        return exact_derivatives(objective, points, steps)
    return central_differences(objective, points, steps)


def repays_exact(problem: Problem) -> bool:
    """True for a search so long that compiled derivatives repay their compilation."""
    return filtering_work(problem) * len(problem.names) >= _REPAYS


def filtering_work(problem: Problem) -> int:
    """What one value takes, without asking a clock: integration steps over all logs times sigma points."""
    work = 0
    for part in problem.parts:
        filter_model = choose_method(part.filter_model, part.logs)
        taken = sum(int(Samples.of(filter_model, log).substeps.sum()) for log in part.logs)
        work += taken * (2 * len(filter_model.state_names) + 1)
    return work


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
    if not isinstance(objective, Problem) or (filter_models := _exact_filters(objective)) is None:
        return central_differences(objective, points, steps)
    terms = objective.terms(points)
    found = []
    for m, known in enumerate(_expansions(objective, filter_models, points)):
        seen, expansion = terms.members(np.array([m])), known
        if expansion is None or not _agrees(expansion, float(seen.sums()[0])):
            (expansion,) = central_differences(objective, points[:, [m]], steps[:, [m]])
        found.append(_about(seen, expansion))
    return tuple(found)


def exact_expansion(problem: Problem, point: FloatArray, known: Terms | None = None) -> Expansion | None:
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
    filter_models = _exact_filters(problem)
    if filter_models is None:
        return None
    expansion = _expand(problem, filter_models, point, _threads(problem))
    seen = problem.terms(point[:, np.newaxis]) if known is None else known
    if expansion is None or not _agrees(expansion, float(seen.sums()[0])):
        return None
    return _about(seen, expansion)


def compile_exact(problem: Problem) -> None:
    """Compile what :func:`exact_expansion` needs, before threads start: CPython 3.11 cannot parse text in two."""
    for part, filter_model in zip(problem.parts, _exact_filters(problem) or (), strict=False):
        model = filter_model.model
        moved = {target.name for target, _ in part.numbers(part.start) if target.kind == "parameter"}
        load_tangents(model, tuple(sorted(model.index("parameter", name) for name in moved)), filter_model.method)


def _exact_filters(problem: Problem) -> list[FilterModel] | None:
    """The filter of each part with its method decided; None where one has no exact derivatives."""
    found = []
    for part in problem.parts:
        if not isinstance(part.likelihood, FilterLikelihood) or not part.likelihood.compiled:
            return None
        found.append(choose_method(part.filter_model, part.logs))
    return found if all(map(has_exact_gradient, found)) else None


def _threads(problem: Problem) -> int:
    likelihood = problem.parts[0].likelihood
    return thread_count(likelihood.threads if isinstance(likelihood, FilterLikelihood) else None)


def _expansions(problem: Problem, filter_models: Sequence[FilterModel], points: FloatArray) -> list[Expansion | None]:
    """Expansions at points (n, members), as many at once as there are threads; each is the same however many."""
    threads = _threads(problem)
    members = points.shape[1]
    # The first alone: what is compiled when it is first used is compiled in one thread.
    found = [_expand(problem, filter_models, points[:, 0], threads)] if members else []
    if threads == 1 or members < 3:
        return found + [_expand(problem, filter_models, points[:, m], threads) for m in range(1, members)]
    own = max(1, threads // (members - 1))
    rest = in_threads(threads, lambda m: _expand(problem, filter_models, points[:, m], own), range(1, members))
    return found + rest


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


def _expand(
    problem: Problem, filter_models: Sequence[FilterModel], point: FloatArray, threads: int
) -> Expansion | None:
    """The expansion at a point (n,); None where a filter fails."""
    rows = [np.empty((0, 1 + point.size))], [np.empty((0, 1 + point.size))]
    for part, places, filter_model in zip(problem.parts, problem.rows, filter_models, strict=True):
        free = (problem.upper > problem.lower)[places]
        for kept, block in zip(rows, _blocks(part, filter_model, point[places], free, threads), strict=True):
            wide = np.zeros((block.shape[0], 1 + point.size))
            wide[:, np.concatenate([[0], 1 + places])] = block
            kept.append(wide)
    priors = np.hstack([problem.prior_terms(point[:, np.newaxis]), problem.prior_slopes(point)])
    innovations, log_scales = np.vstack([*rows[0], priors]), np.vstack([*rows[1], np.zeros(priors.shape)])
    if not (np.isfinite(innovations).all() and np.isfinite(log_scales).all()):
        return None
    return expansion_of(innovations, log_scales, _EVALUATIONS)


def _blocks(
    problem: EstimationProblem, filter_model: FilterModel, point: FloatArray, free: BoolArray, threads: int
) -> tuple[FloatArray, FloatArray]:
    """Innovations and log scales of the logs with their derivatives by the free coordinates, each (n_terms, 1 + n)."""
    here, moved = problem.batch(point[:, np.newaxis]), problem.batch_slopes(point)
    stds = (here.initial_std, here.process_std, here.noise_std)
    correlations = (here.initial_correlation, here.process_correlation, here.noise_correlation)
    members = [
        Member(here.theta[:, 0], x0[:, 0], *(array[..., 0] for array in (*stds, *correlations))) for x0 in here.x0
    ]

    def turned(array: FloatArray) -> FloatArray | None:
        return np.where(free, array, 0.0) if array.any() else None

    levels = [np.where(free, std, 0.0) for std in (moved.initial_std, moved.process_std, moved.noise_std)]
    pairs = [turned(a) for a in (moved.initial_correlation, moved.process_correlation, moved.noise_correlation)]
    directions = [
        Directions(np.where(free, moved.theta, 0.0), np.where(free, x0, 0.0), *levels, *pairs) for x0 in moved.x0
    ]
    found = innovation_tangents(filter_model, problem.logs, members, directions, threads)
    columns = [np.hstack([f.values.reshape(-1, 1), f.d_values.reshape(-1, point.size)]) for f in found]
    scales = [np.hstack([f.log_scales.reshape(-1, 1), f.d_log_scales.reshape(-1, point.size)]) for f in found]
    return np.vstack(columns), np.vstack(scales)
