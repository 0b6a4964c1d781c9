"""Fitting a model to logs on the way of a correction: the optimum with everything that tests and reports need of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.differences import forward_differences
from bondgraph.estimate.derivatives.exact import exact_expansion
from bondgraph.estimate.derivatives.formed import Formed, Scheme, formed_again
from bondgraph.estimate.derivatives.linearised import divergence, is_linearised, linear_expansion
from bondgraph.estimate.excerpt import excerpt
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.journal import Journal, Noted, fit_key
from bondgraph.estimate.objective import Expansion, Objective, SearchOutcome
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.exact_newton import ENOUGH, newton_steps, polished
from bondgraph.estimate.solvers.gauss_newton import (
    GaussNewtonSettings,
    GaussNewtonState,
    finish_starts,
    initial_starts,
    starts_ended,
    step_starts,
)
from bondgraph.estimate.solvers.linearised import HOPELESS, LinearisedScoring, Reached, linear_search
from bondgraph.estimate.solvers.steps import newton_decrement
from bondgraph.estimate.widening import MOST_WIDENINGS, widened
from bondgraph.filter.filter_model import FilterModel

#: The exact steps that end the fit of a stiff model must promise so many nats. They begin where the linearised filter
#: promises less than the other number, of which it is sure no more.
_POLISHED, _HANDED_OVER = 0.1, 30.0
#: Along a ridge it once left 55 nats; one that is behind by less than this may still beat what it is to beat.
WITHIN_REACH = 60.0
#: A search on a part of the logs ends where a further step promises less than so many nats.
ROUGH, ROUGH_ITERATIONS = 2.0, 30

#: Most iterations of a fit with other steps, and what a further one must promise: one that is worth 0.005 nats lies a
#: tenth of a standard deviation off by that alone.
_AGAIN, _FINISHED = 20, 1e-3

Report = Callable[[str, int, int], None]
#: Point, value, expansion, evaluations and outcome of a fit.
_Ended = tuple[FloatArray, float, Expansion, int, SearchOutcome]


def no_report(stage: str, done: int, total: int) -> None:
    """Report nothing."""


def fit(
    filter_model: FilterModel,
    logs: Sequence[MatchedLog],
    free: Sequence[FreeParameter],
    iterations: int = 40,
    tolerance: float = 1e-3,
    starts: Sequence[FloatArray] = (),
    beat: float = np.inf,
    journal: Journal | None = None,
    first: FloatArray | None = None,
    reach: float = WITHIN_REACH,
) -> Fit:
    """Estimate the free parameters by Gauss-Newton, until a step promises less than ``tolerance`` or two gain less.

    Bounds that only scale a search (:attr:`FreeParameter.widens`) are widened, and the search continued, as long as it
    ends on one: a scale that was taken from a model without the effect may be far too small.

    Parameters
    ----------
    filter_model, logs, free
        What is fitted to what, and what may move.
    iterations, tolerance
        Most iterations, and how many nats a further one must be worth.
    starts
        Coordinates to start from, each (n,); the best of them counts. None: the starts of the free parameters.
    beat
        A negative log-likelihood to be reached: the search ends early where it clearly will not be.
    journal
        Finished fits, from which this one is taken if it is there, and where it is noted if not.
    first
        Where a rough search begins (n,) whatever its value, of a stiff model on the beginnings of long logs; ``starts``
        are searched from only if one of them is better than where that ended.
    reach
        The search of a stiff model is finished by exact derivatives only if it ends behind ``beat`` by less than this
        (ahead of it by more, if negative), and by less than it gained or a further step promises: what hardly moved
        left little.

    Raises
    ------
    EstimationError
        If the model diverges at every start.
    """
    problem = EstimationProblem(filter_model, tuple(logs), tuple(free))
    found = _noted(problem, journal, iterations, tolerance, starts, beat, first, reach)
    for _ in range(MOST_WIDENINGS):
        wider = widened(found.problem, found.point, found.held)
        if wider is None:
            break
        try:
            found = _noted(replace(problem, free=wider), journal, iterations, tolerance, (), beat, None, reach)
        except EstimationError:  # nothing is beyond the bound
            break
    return found


def refitted(fitted: Fit, filter_model: FilterModel, journal: Journal | None = None) -> Fit:
    """The fit with a filter close to its own (shorter steps), from where it is.

    That of a stiff model is found with the derivatives that the fit has, which a filter close by shares: formed anew
    they cost ten values of the likelihood each. Where these do not lead to an optimum the whole search is done.

    Raises
    ------
    EstimationError
        If the model diverges there.
    """
    free = at_optimum(fitted)
    problem = replace(fitted.problem, filter_model=filter_model, free=free)
    journal = journal or Journal()
    key = fit_key(problem, ["by known derivatives", fitted.point])
    noted = journal.find(key)
    if noted is not None:
        around = fitted.expansion.around(problem.terms(noted.point[:, np.newaxis]))
        return Fit(problem, noted.point, noted.nll, around, noted.evaluations, SearchOutcome[noted.outcome])
    found = _by_known_derivatives(fitted, problem) if is_linearised(problem) else None
    if found is None:
        return fit(filter_model, problem.logs, free, _AGAIN, _FINISHED, journal=journal)
    journal.note(key, Noted(found.point, found.formed, found.nll, found.evaluations, found.outcome.name))
    return _fit_of(problem, found)[0]


def _by_known_derivatives(fitted: Fit, problem: EstimationProblem) -> Reached | None:
    """Where steps with the derivatives of a fit lead in a problem close to its own; None if that is no optimum."""
    if fitted.expansion.terms is None:
        return None
    seen = problem.terms(fitted.point[:, np.newaxis])
    nll = fitted.nll + float(seen.sums()[0]) - fitted.expansion.sum
    if not np.isfinite(nll):
        return None
    formed = Formed(Scheme.EXACT, fitted.point)
    begun = Reached(fitted.point, nll, fitted.expansion.around(seen), 1, SearchOutcome.CONVERGED, formed)
    found = newton_steps(problem, begun, _POLISHED, fitted.expansion)
    return found if newton_decrement(problem, found.point, found.expansion) < ENOUGH else None


def left_open(problem: EstimationProblem) -> float:
    """Nats that a rough search may leave: by the linearised filter of a stiff model far more than by differences."""
    return WITHIN_REACH if is_linearised(problem) else ROUGH


def _noted(problem: EstimationProblem, journal: Journal | None, *how: Any) -> Fit:
    """One search inside its bounds, taken from the journal if it is there and noted in it if not."""
    if journal is None:
        return _search(problem, *how)[0]
    iterations, tolerance, starts, beat, first, reach = how
    key = fit_key(problem, [iterations, tolerance, [*starts, first], beat, reach])
    known = journal.find(key)
    if known is not None:
        expansion = formed_again(problem, known.point, known.formed)
        return Fit(problem, known.point, known.nll, expansion, known.evaluations, SearchOutcome[known.outcome])
    (point, nll, expansion, evaluations, outcome), formed = journal.computed(_searched, problem, *how)
    found = Fit(problem, point, nll, expansion, evaluations, outcome)
    journal.note(key, Noted(found.point, formed, found.nll, found.evaluations, found.outcome.name))
    return found


def _searched(problem: EstimationProblem, *how: Any) -> tuple[_Ended, Formed]:
    """The end of a search without its problem, whose logs need not come back from a worker; and its derivatives."""
    found, formed = _search(problem, *how)
    return (found.point, found.nll, found.expansion, found.evaluations, found.outcome), formed


def _search(
    problem: EstimationProblem,
    iterations: int,
    tolerance: float,
    starts: Sequence[FloatArray],
    beat: float,
    first: FloatArray | None,
    reach: float,
) -> tuple[Fit, Formed]:
    """The fit, and how its derivatives were formed."""
    if is_linearised(problem):
        return _linear_search(problem, iterations, tolerance, starts, beat, first, reach)
    settings = GaussNewtonSettings(iterations=iterations, tolerance=tolerance)
    if first is not None:
        begun = _search(problem, ROUGH_ITERATIONS, ROUGH, [first], np.inf, None, reach)[0]
        starts = [*(starts or [problem.start]), begun.point]
    start, _, evaluations = _best_start(problem, starts)
    differences = _Expansions()
    state = initial_starts(problem, start, settings)
    if not np.isfinite(state.values[0]):
        raise EstimationError(divergence(problem, start[:, 0]))
    idle = 0
    while not starts_ended(state, settings) and idle < 2:
        before = float(state.values[0])
        state = step_starts(problem, state, settings, differences)
        gained = before - float(state.values[0])
        idle = idle + 1 if 0.0 < gained < tolerance else 0
        if float(state.values[0]) - beat > HOPELESS * max(gained, differences.promise(problem)):
            break
    ended = SearchOutcome.CONVERGED if idle == 2 else SearchOutcome.ITERATION_LIMIT
    return _fit(problem, finish_starts(state, ended), differences, evaluations)


def _linear_search(
    problem: EstimationProblem,
    iterations: int,
    tolerance: float,
    starts: Sequence[FloatArray],
    beat: float,
    first: FloatArray | None,
    reach: float,
) -> tuple[Fit, Formed]:
    """The fit of a stiff model, and how its derivatives were formed."""
    polishes, part = tolerance < ROUGH, excerpt(problem)
    if first is None:
        best, _, evaluations = _best_start(problem, starts)
        start = best[:, 0]
    else:
        rough = _rough(part or problem, ROUGH_ITERATIONS, first, starts)
        if part is None and not polishes:  # nothing is left to do
            return _fit_of(problem, rough)
        start, evaluations = rough.point, rough.evaluations
    found = linear_search(LinearisedScoring(iterations, _HANDED_OVER if polishes else tolerance, beat), problem, start)
    left = max(found.gained, newton_decrement(problem, found.point, found.expansion))
    if polishes and found.nll < beat + min(reach, left):
        found = polished(problem, found, max(tolerance, _POLISHED))
    return _fit_of(problem, replace(found, evaluations=evaluations + found.evaluations))


def _fit_of(problem: EstimationProblem, found: Reached) -> tuple[Fit, Formed]:
    return Fit(problem, found.point, found.nll, found.expansion, found.evaluations, found.outcome), found.formed


def _rough(problem: EstimationProblem, iterations: int, first: FloatArray, starts: Sequence[FloatArray]) -> Reached:
    """Where a rough search from the first start or, if that is better, from another one ends."""
    search = LinearisedScoring(iterations, ROUGH)
    found = linear_search(search, problem, first)
    evaluations = found.evaluations + len(starts)
    other, value, _ = _best_start(problem, starts)
    if starts and not (problem.nll(other)[0] if value is None else value) > found.nll:
        again = linear_search(search, problem, other[:, 0])
        evaluations += again.evaluations
        found = again if again.nll < found.nll else found
    return replace(found, evaluations=evaluations)


def _best_start(problem: EstimationProblem, starts: Sequence[FloatArray]) -> tuple[FloatArray, float | None, int]:
    """The best start (n, 1), its value if it was asked, and how many were."""
    if not starts:
        return problem.start[:, np.newaxis], None, 0
    points = np.clip(np.array(starts).T, problem.lower[:, np.newaxis], problem.upper[:, np.newaxis])
    if len(starts) == 1:
        return points, None, 0
    values = problem.nll(points)
    best = int(np.argmin(np.where(np.isfinite(values), values, np.inf)))
    return points[:, best : best + 1], float(values[best]), len(starts)


class _Expansions:
    """Expansions of which the last is remembered: a search that has converged ends where it was made."""

    def __init__(self) -> None:
        self.point: FloatArray | None = None
        self.steps: FloatArray | None = None
        self.expansion: Expansion | None = None

    def __call__(self, objective: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
        self.expansion = expand(objective, points[:, 0], steps[:, 0])
        self.point, self.steps = points[:, 0].copy(), steps[:, 0].copy()
        return (self.expansion,)

    def promise(self, objective: Objective) -> float:
        """Nats that a full step from the last expansion would gain."""
        if self.point is None or self.expansion is None:
            return np.inf
        return newton_decrement(objective, self.point, self.expansion)


def _fit(
    problem: EstimationProblem, state: GaussNewtonState, known: _Expansions, evaluations: int
) -> tuple[Fit, Formed]:
    point, outcome = state.points[:, 0], state.outcomes[0] or SearchOutcome.ITERATION_LIMIT
    evaluations += state.evaluations
    expansion, steps = known.expansion, known.steps
    if expansion is None or steps is None or known.point is None or not np.array_equal(known.point, point):
        steps = state.steps[:, 0]
        expansion = expand(problem, point, steps)
        evaluations += expansion.evaluations
    return Fit(problem, point, float(state.values[0]), expansion, evaluations, outcome), Formed(
        Scheme.DIFFERENCES, steps
    )


def expand(problem: Objective, point: FloatArray, steps: FloatArray) -> Expansion:
    """Gradient, information and terms at one point: by differences, or by exact derivatives where a model is stiff."""
    if isinstance(problem, EstimationProblem) and is_linearised(problem):
        return exact_expansion(problem, point) or linear_expansion(problem, point)
    (expansion,) = forward_differences(problem, point[:, np.newaxis], steps[:, np.newaxis])
    return expansion
