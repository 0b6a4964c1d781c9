"""Fitting a model to logs on the way of a correction: the optimum with everything that tests and reports need of it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bondgraph.correct.fits.differences import forward_differences
from bondgraph.correct.fits.excerpts import excerpt
from bondgraph.correct.fits.journal import Journal, Noted, fit_key
from bondgraph.correct.fits.linear_steps import (
    Reached,
    divergence,
    expansion_along,
    is_linearised,
    linear_expansion,
    linear_search,
)
from bondgraph.correct.fits.polish import polished
from bondgraph.correct.fits.setup import unknown_drives
from bondgraph.correct.fits.widening import MOST_WIDENINGS, widened
from bondgraph.correct.responses.response import LinearLog, linearise
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.exact import exact_expansion
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.objective import BoolArray, Expansion, Objective, SearchOutcome
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.gauss_newton import (
    GaussNewtonSettings,
    GaussNewtonState,
    finish_starts,
    initial_starts,
    starts_ended,
    step_starts,
)
from bondgraph.estimate.solvers.steps import newton_decrement
from bondgraph.estimate.symmetric import scaled_eigen
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.runs import run
from bondgraph.simulate.model import Model
from bondgraph.text import few

#: Blocks of the sandwich variance over all training logs: enough for its distribution, long enough to be independent.
BLOCKS = 40
#: A fit that is to beat another gives up when it is behind by more than this many times what a step promises or gains.
_HOPELESS = 10.0
#: The exact steps that end the fit of a stiff model must promise so many nats. They begin where the linearised filter
#: promises less than the other number, of which it is sure no more.
_POLISHED, _HANDED_OVER = 0.1, 30.0
#: Along a ridge it once left 55 nats; one that is behind by less than this may still beat what it is to beat.
WITHIN_REACH = 60.0
#: Process noise this share of the way up from its lower bound stands in for nothing.
_LITTLE = 0.2
#: A search on a part of the logs ends where a further step promises less than so many nats.
_ROUGH, _ROUGH_ITERATIONS = 2.0, 30

Report = Callable[[str, int, int], None]


def no_report(stage: str, done: int, total: int) -> None:
    """Report nothing."""


@dataclass(frozen=True, repr=False)
class Fit:
    """A fitted model: the problem, the coordinates of its optimum, and the expansion of the likelihood there."""

    problem: EstimationProblem
    point: FloatArray
    nll: float
    expansion: Expansion
    evaluations: int
    outcome: SearchOutcome

    def __repr__(self) -> str:
        end = f"NLL {self.nll:.6g}; {self.outcome.value.partition(' - ')[0]}"
        return f"<Fit {self.problem.filter_model.model.name}: free {few(self.problem.names)}; {end}>"

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name, in the units of the model."""
        return dict(zip(self.problem.names, map(float, self.problem.values(self.point)), strict=True))

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the coordinates by name (of the logarithm, where that is the coordinate).

        What rests on a bound counts as known to the others; its own is that which it would have given the others.
        """
        free = ~self.held
        std = np.array(standard_deviations(self.expansion))
        std[free] = standard_deviations(restricted(self.expansion, free))
        return dict(zip(self.problem.names, map(float, std), strict=True))

    @property
    def held(self) -> BoolArray:
        """Which coordinates rest on a bound beyond which the likelihood would still rise, shape (n,)."""
        near = 1e-9 * (self.problem.upper - self.problem.lower)
        gradient = self.expansion.gradient
        low = (self.point <= self.problem.lower + near) & (gradient > 0.0)
        held: BoolArray = low | ((self.point >= self.problem.upper - near) & (gradient < 0.0))
        return held

    @property
    def theta(self) -> FloatArray:
        """Parameters of the model at the optimum, shape (n_theta,)."""
        theta: FloatArray = self.problem.batch(self.point[:, np.newaxis]).theta[:, 0]
        return theta

    def theta_of(self, model: Model) -> FloatArray:
        """Parameters of another model, shape (n_theta,): estimates where it has them, else declared values."""
        own = dict(zip(self.problem.filter_model.model.names("parameter"), map(float, self.theta), strict=True))
        known = model.names("parameter")
        return model.theta(**{name: value for name, value in own.items() if name in known})

    @property
    def elsewhere(self) -> FilterModel:
        """The filter for logs whose starts were not estimated: it is as unsure of them as the priors were."""
        wide = {one.target.name: one.prior_std for one in self.problem.free if one.target.log and one.prior_std}
        own = self.problem.filter_model
        return replace(own, initial_std={**own.initial_std, **wide}) if wide else own

    @functools.cached_property
    def own_runs(self) -> tuple[FilterRun, ...]:
        """The filter over the logs that were fitted, at the optimum: many ask for it, and it is costly."""
        return tuple(self._filtered(self.problem.logs))

    @functools.cached_property
    def linear_logs(self) -> tuple[LinearLog, ...]:
        """The filter linearised along its runs over the logs that were fitted: many ask for it, and it is costly."""
        pairs = zip(self.own_runs, self.problem.logs, strict=True)
        return tuple(linearise(one.raise_if_failed(), log, self.theta) for one, log in pairs)

    @functools.cached_property
    def linear_promise(self) -> float:
        """Nats that one more step promises by the filter of a stiff model, linearised along itself."""
        expansion = expansion_along(self.problem, self.point, self.own_runs, self.linear_logs)
        return newton_decrement(self.problem, self.point, expansion)

    @functools.cached_property
    def driven(self) -> float:
        """Nats that the fit loses where process noise that drives its states falls to its lower bounds.

        None is lost where it is hardly more than these (logarithms). A state that walks anyway, the slope of an unknown
        road, does not count.
        """
        problem = self.problem
        walking = unknown_drives(problem.filter_model.model, problem.logs)
        counted = np.array([one.target.kind == "process" and one.target.name not in walking for one in problem.free])
        risen = (self.point - problem.lower) / (problem.upper - problem.lower)
        if not np.any(risen[counted] > _LITTLE):
            return 0.0
        lowered = np.where(counted, problem.lower, self.point)
        return float(problem.nll(lowered[:, np.newaxis])[0]) - self.nll

    def fits(self, logs: Sequence[MatchedLog]) -> bool:
        """Whether it was these logs that were fitted."""
        own = self.problem.logs
        return len(logs) == len(own) and all(one is other for one, other in zip(logs, own, strict=True))

    def runs(self, logs: Sequence[MatchedLog]) -> list[FilterRun]:
        """The filter over logs (these or others) at the optimum."""
        if self.fits(logs):
            return list(self.own_runs)
        return self._filtered(logs) if logs else []

    def _filtered(self, logs: Sequence[MatchedLog]) -> list[FilterRun]:
        names = {log.name for log in logs}
        own = names <= {parameter.target.log for parameter in self.problem.free}
        filter_model = self.problem.filter_model if own else self.elsewhere
        kept = [k for k, one in enumerate(self.problem.free) if one.target.log is None or one.target.log in names]
        free = tuple(self.problem.free[k] for k in kept)
        problem = EstimationProblem(filter_model, tuple(logs), free, self.problem.initial)
        batch = problem.batch(self.point[kept][:, np.newaxis])
        return [
            run(
                problem.filter_model, log, batch.theta[:, 0],
                noise_std=batch.noise_std[:, 0], process_std=batch.process_std[:, 0], x0=x0[:, 0],
            )
            for log, x0 in zip(logs, batch.x0, strict=True)
        ]  # fmt: skip


def restricted(expansion: Expansion, kept: BoolArray) -> Expansion:
    """The expansion in some of its coordinates, the others held."""
    terms = expansion.terms
    if terms is not None:
        columns = np.flatnonzero(np.concatenate([[True], kept]))
        terms = terms.members(columns)
    return Expansion(expansion.gradient[kept], expansion.information[np.ix_(kept, kept)], expansion.evaluations, terms)


def standard_deviations(expansion: Expansion) -> FloatArray:
    """Standard deviations from the Fisher information, shape (n,); infinite where there is none."""
    found = scaled_eigen(expansion.information)
    inverse = found.inverse(found.values > 1e-12 * max(found.largest, np.finfo(float).tiny))
    known = found.scale > 0.0
    std: FloatArray = np.where(known, found.scale * np.sqrt(np.maximum(np.diag(inverse), 0.0)), np.inf)
    return std


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
        Where the search of a stiff model begins (n,), on the beginnings of long logs; ``starts`` are searched from only
        if one of them is better than where that ended.
    reach
        The search of a stiff model is finished by exact derivatives only if it ends behind ``beat`` by less than this
        (ahead of it by more, if negative).

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


def _noted(problem: EstimationProblem, journal: Journal | None, *how: Any) -> Fit:
    """One search inside its bounds, taken from the journal if it is there and noted in it if not."""
    if journal is None:
        return _search(problem, *how)[0]
    iterations, tolerance, starts, beat, first, reach = how
    options = (iterations, tolerance, [*starts, first], beat, reach)
    key = fit_key(problem.filter_model, problem.logs, problem.free, options)
    known = journal.find(key)
    if known is not None:
        expansion = expand(problem, known.point, known.steps)
        return Fit(problem, known.point, known.nll, expansion, known.evaluations, SearchOutcome[known.outcome])
    found, steps = _search(problem, *how)
    journal.note(key, Noted(found.point, steps, found.nll, found.evaluations, found.outcome.name))
    return found


def _search(
    problem: EstimationProblem,
    iterations: int,
    tolerance: float,
    starts: Sequence[FloatArray],
    beat: float,
    first: FloatArray | None,
    reach: float,
) -> tuple[Fit, FloatArray]:
    """The fit, and the difference steps of its expansion."""
    if is_linearised(problem):
        return _linear_search(problem, iterations, tolerance, starts, beat, first, reach)
    settings = GaussNewtonSettings(iterations=iterations, tolerance=tolerance)
    start, evaluations = _best_start(problem, starts)
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
        if float(state.values[0]) - beat > _HOPELESS * max(gained, differences.promise(problem)):
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
) -> tuple[Fit, FloatArray]:
    """The fit of a stiff model; its expansions need no difference steps."""
    polishes, part = tolerance < _ROUGH, excerpt(problem)
    if first is None:
        best, evaluations = _best_start(problem, starts)
        start = best[:, 0]
    else:
        rough = _rough(part or problem, _ROUGH_ITERATIONS, first, starts)
        if part is None and not polishes:  # nothing is left to do
            return _fit_of(problem, rough)
        start, evaluations = rough.point, rough.evaluations
    found = linear_search(problem, start, iterations, _HANDED_OVER if polishes else tolerance, beat, _HOPELESS)
    if polishes and found.nll < beat + reach:
        found = polished(problem, found, max(tolerance, _POLISHED))
    return _fit_of(problem, replace(found, evaluations=evaluations + found.evaluations))


def _fit_of(problem: EstimationProblem, found: Reached) -> tuple[Fit, FloatArray]:
    made = Fit(problem, found.point, found.nll, found.expansion, found.evaluations, found.outcome)
    return made, np.zeros(found.point.size)


def _rough(problem: EstimationProblem, iterations: int, first: FloatArray, starts: Sequence[FloatArray]) -> Reached:
    """Where a rough search from the first start or, if that is better, from another one ends."""
    found = linear_search(problem, first, iterations, _ROUGH, np.inf, _HOPELESS)
    evaluations = found.evaluations + len(starts)
    other, _ = _best_start(problem, starts)
    if starts and not problem.nll(other)[0] > found.nll:
        again = linear_search(problem, other[:, 0], iterations, _ROUGH, np.inf, _HOPELESS)
        evaluations += again.evaluations
        found = again if again.nll < found.nll else found
    return replace(found, evaluations=evaluations)


def _best_start(problem: EstimationProblem, starts: Sequence[FloatArray]) -> tuple[FloatArray, int]:
    if not starts:
        return problem.start[:, np.newaxis], 0
    points = np.clip(np.array(starts).T, problem.lower[:, np.newaxis], problem.upper[:, np.newaxis])
    if len(starts) == 1:
        return points, 0
    values = problem.nll(points)
    best = int(np.argmin(np.where(np.isfinite(values), values, np.inf)))
    return points[:, best : best + 1], len(starts)


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
) -> tuple[Fit, FloatArray]:
    point, outcome = state.points[:, 0], state.outcomes[0] or SearchOutcome.ITERATION_LIMIT
    evaluations += state.evaluations
    expansion, steps = known.expansion, known.steps
    if expansion is None or steps is None or known.point is None or not np.array_equal(known.point, point):
        steps = state.steps[:, 0]
        expansion = expand(problem, point, steps)
        evaluations += expansion.evaluations
    return Fit(problem, point, float(state.values[0]), expansion, evaluations, outcome), steps


def expand(problem: Objective, point: FloatArray, steps: FloatArray) -> Expansion:
    """Gradient, information and terms at one point: by differences, or by exact derivatives where a model is stiff."""
    if isinstance(problem, EstimationProblem) and is_linearised(problem):
        return exact_expansion(problem, point) or linear_expansion(problem, point)
    (expansion,) = forward_differences(problem, point[:, np.newaxis], steps[:, np.newaxis])
    return expansion
