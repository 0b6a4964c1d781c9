"""One search of the optimum of a likelihood inside its bounds: by long integration steps first, then by its own.

Of a stiff model it is led by its linearised filter and ended by exact derivatives, of another by differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.data.log import FloatArray
from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.differences import forward_differences
from bondgraph.estimate.derivatives.exact import exact_expansion
from bondgraph.estimate.derivatives.formed import Formed, Scheme
from bondgraph.estimate.derivatives.linearised import divergence, is_linearised, linear_expansion
from bondgraph.estimate.excerpt import ENOUGH, excerpt
from bondgraph.estimate.longer_steps import doubled, ladder, longest_that_lead, step_gain
from bondgraph.estimate.objective import Expansion, Objective, SearchOutcome
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.exact_newton import arrived, newton_steps, polished
from bondgraph.estimate.solvers.gauss_newton import GaussNewton, GaussNewtonSettings, finish_starts
from bondgraph.estimate.solvers.linearised import HOPELESS, VAIN, LinearisedScoring, Reached, linear_search
from bondgraph.estimate.solvers.steps import newton_decrement

#: The exact steps that end the fit of a stiff model must promise so many nats. They begin where the linearised filter
#: promises less than the other number, of which it is sure no more.
_POLISHED, _HANDED_OVER = 0.1, 30.0
#: Along a ridge it once left 55 nats; one that is behind by less than this may still beat what it is to beat.
WITHIN_REACH = 60.0
#: Of very long logs a search begins on one of so many parts, which costs little beside the whole.
_PARTS = 8
#: A search on a part of the logs ends where a further step promises less than so many nats.
ROUGH, ROUGH_ITERATIONS = 2.0, 30


@dataclass(frozen=True)
class Wish:
    """Order of a search, see :func:`bondgraph.estimate.local.fit`: points (n,) and numbers.

    ``longer``: it may go by way of longer integration steps, which may tell innovations otherwise by ``same`` nats.
    """

    iterations: int
    tolerance: float
    starts: Sequence[FloatArray] = ()
    beat: float = np.inf
    first: FloatArray | None = None
    reach: float = WITHIN_REACH
    longer: bool = True
    same: float = ROUGH

    @property
    def content(self) -> list[object]:
        """Plain values that tell this wish from every other."""
        own = [self.iterations, self.tolerance, [*self.starts, self.first], self.beat, self.reach, self.longer]
        return own if self.same == ROUGH else [*own, self.same]

    def from_point(self, point: FloatArray) -> Wish:
        """The same from another start (n,)."""
        return replace(self, starts=[point], first=None)


def search(problem: EstimationProblem, wish: Wish) -> Reached:
    """Where a search ends: by way of longer integration steps where these tell the same (see ``longer_steps``).

    Raises
    ------
    EstimationError
        If the model diverges at every start.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1}, substeps=4)
    >>> time = np.arange(80) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 80)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> problem = pose(swing, log, ["length"])
    >>> search(problem, Wish(20, 1e-3)).outcome.name
    'CONVERGED'
    """
    wish = _by_part(problem, wish)
    rungs = len(ladder(problem)) if wish.longer else 0
    if rungs:
        wish = replace(wish, starts=[_best_start(doubled(problem, rungs), wish.starts)[0][:, 0]])
    while rungs:
        rungs = longest_that_lead(problem, rungs, wish.starts[0])
        if not rungs:
            break
        try:
            found, ended = _by_longer_steps(problem, rungs, wish)
        except EstimationError:  # it diverges with steps that long
            rungs -= 1
            continue
        if ended:
            return found
        wish, rungs = replace(wish, starts=[found.point, *wish.starts], first=None), rungs - 1
    return _with_own_steps(problem, wish)


def with_longest_steps(problem: EstimationProblem, starts: Sequence[FloatArray]) -> EstimationProblem:
    """The problem with the longest steps by which a search may begin at the best of starts, each (n,).

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1}, substeps=8)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> with_longest_steps(pose(swing, log, ["length"]), []).filter_model.substeps
    1
    """
    rungs = len(ladder(problem))
    start = _best_start(doubled(problem, rungs), starts)[0][:, 0]
    return doubled(problem, longest_that_lead(problem, rungs, start))


def _by_part(problem: EstimationProblem, wish: Wish) -> Wish:
    """The wish with where a search on an eighth of very long logs led as its first start.

    That of a stiff model begins on a part of its logs anyway.
    """
    samples = sum(len(log) for log in problem.logs)
    if is_linearised(problem) or samples < _PARTS * ENOUGH:
        return wish
    part = excerpt(problem, samples / _PARTS)
    if part is None:
        return wish
    try:
        rough = replace(wish, iterations=ROUGH_ITERATIONS, tolerance=ROUGH, beat=np.inf)
        found = search(part, rough)
    except EstimationError:  # what has no value there may have one in the whole
        return wish
    return replace(wish, starts=[found.point, *(wish.starts or [problem.start])], first=None)


def _by_longer_steps(problem: EstimationProblem, times: int, wish: Wish) -> tuple[Reached, bool]:
    """The optimum of a problem by way of steps doubled so many times, and True; their own one where it is another."""
    longer, stiff = doubled(problem, times), is_linearised(problem)
    found = _approached(longer, wish)
    if not _tell_the_same(problem, found, wish.same):
        return found, False
    if stiff:
        found = _polished(longer, found, wish)
    found = replace(found, formed=replace(found.formed, near=found.point, doublings=times))
    carried = carried_on(problem, found, wish.tolerance)
    if carried is None:  # the own steps diverge there
        return found, False
    own, ended = carried
    if ended or found.outcome is SearchOutcome.ITERATION_LIMIT:
        return replace(own, outcome=found.outcome), True
    return _polished(problem, own, wish) if stiff else _with_own_steps(problem, wish.from_point(own.point)), True


def _tell_the_same(problem: EstimationProblem, found: Reached, nats: float) -> bool:
    """True where the end of a search with longer steps tells the innovations that a problem's own steps do."""
    known = found.expansion.terms
    seen = problem.terms(found.point[:, np.newaxis])
    return known is not None and step_gain(known.members(np.array([0])), seen) <= nats


def carried_on(problem: EstimationProblem, known: Reached, tolerance: float) -> tuple[Reached, bool] | None:
    """The end of steps with known derivatives in a problem close to theirs, and whether it is an optimum.

    None where the problem has no value at their point, or they are not known.
    """
    seen = problem.terms(known.point[:, np.newaxis])
    if known.expansion.terms is None or not np.isfinite(seen.sums()[0]):
        return None
    stiff, around = is_linearised(problem), known.expansion.around(seen)
    nll = known.nll + float(seen.sums()[0]) - known.expansion.sum
    begun = replace(known, nll=nll, expansion=around, evaluations=known.evaluations + 1)
    found = newton_steps(problem, begun, max(tolerance, _POLISHED) if stiff else tolerance, known.expansion)
    left, gained = newton_decrement(problem, found.point, found.expansion), nll - found.nll
    ended = left < tolerance or (stiff and arrived(newton_decrement(problem, known.point, around), gained, left))
    return replace(found, gained=gained), ended


def _with_own_steps(problem: EstimationProblem, wish: Wish) -> Reached:
    """The end of a search with the steps that the filter has."""
    found = _approached(problem, wish)
    return _polished(problem, found, wish) if is_linearised(problem) else found


def _approached(problem: EstimationProblem, wish: Wish) -> Reached:
    """The end of a search; of a stiff model what its linearised filter can tell of it."""
    return _linear(problem, wish) if is_linearised(problem) else _by_differences(problem, wish)


def _by_differences(problem: EstimationProblem, wish: Wish) -> Reached:
    """The end of damped Gauss-Newton steps by one-sided differences."""
    starts = wish.starts
    if wish.first is not None:
        rough = replace(wish, iterations=ROUGH_ITERATIONS, tolerance=ROUGH)
        starts = [*(starts or [problem.start]), _by_differences(problem, rough.from_point(wish.first)).point]
    start, _, evaluations = _best_start(problem, starts)
    known = _Expansions()
    search = GaussNewton(GaussNewtonSettings(iterations=wish.iterations, tolerance=wish.tolerance), known)
    state = search.init(problem, start)
    if not np.isfinite(state.values[0]):
        raise EstimationError(divergence(problem, start[:, 0]))
    end, idle, vain = SearchOutcome.ITERATION_LIMIT, 0, 0
    while search.ended(state) is None:
        before = float(state.values[0])
        state = search.step(problem, state)
        gained = before - float(state.values[0])
        idle, vain = idle + 1 if gained < wish.tolerance else 0, 0 if gained > 0.0 else vain + 1
        if idle >= 2 and gained > 0.0:
            end = SearchOutcome.CONVERGED
            break
        if vain == VAIN:  # each damps the next ten thousand times more: no step follows the gradient
            end = SearchOutcome.NO_PROGRESS
            break
        if float(state.values[0]) - wish.beat > HOPELESS * max(gained, known.promise(problem)):
            break
    state = finish_starts(state, end)
    point, evaluations = state.points[:, 0], evaluations + state.evaluations
    expansion, steps = known.at(point)
    if expansion is None:
        steps = state.steps[:, 0]
        expansion = expand(problem, point, steps)
        evaluations += expansion.evaluations
    outcome, formed = state.outcomes[0] or SearchOutcome.ITERATION_LIMIT, Formed(Scheme.DIFFERENCES, steps)
    return Reached(point, float(state.values[0]), expansion, evaluations, outcome, formed)


def _linear(problem: EstimationProblem, wish: Wish) -> Reached:
    """The end of steps by the linearised filter of a stiff model."""
    polishes, part = wish.tolerance < ROUGH, excerpt(problem)
    if wish.first is None:
        best, _, evaluations = _best_start(problem, wish.starts)
        start = best[:, 0]
    else:
        rough = _rough(part or problem, ROUGH_ITERATIONS, wish.first, wish.starts)
        if part is None and not polishes:  # nothing is left to do
            return rough
        start, evaluations = rough.point, rough.evaluations
    scoring = LinearisedScoring(wish.iterations, _HANDED_OVER if polishes else wish.tolerance, wish.beat)
    found = linear_search(scoring, problem, start)
    return replace(found, evaluations=evaluations + found.evaluations)


def _polished(problem: EstimationProblem, found: Reached, wish: Wish) -> Reached:
    """Where exact derivatives lead from the end of another search, if it is not rough and may beat what is to beat."""
    left = max(found.gained, newton_decrement(problem, found.point, found.expansion))
    if wish.tolerance < ROUGH and found.nll < wish.beat + min(wish.reach, left):
        return polished(problem, found, max(wish.tolerance, _POLISHED))
    return found


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
    """Expansions of which the last is remembered: a search that has converged ends where it was made.

    It is not formed again where a step has failed, unless differences are to be of clearly another size.
    """

    def __init__(self) -> None:
        self.point: FloatArray | None = None
        self.steps: FloatArray | None = None
        self.expansion: Expansion | None = None

    def __call__(self, objective: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
        known, used = self.at(points[:, 0])
        if known is not None and np.all((steps[:, 0] <= 2.0 * used) & (used <= 2.0 * steps[:, 0])):
            return (replace(known, evaluations=0),)
        self.expansion = expand(objective, points[:, 0], steps[:, 0])
        self.point, self.steps = points[:, 0].copy(), steps[:, 0].copy()
        return (self.expansion,)

    def promise(self, objective: Objective) -> float:
        """Nats that a full step from the last expansion would gain."""
        if self.point is None or self.expansion is None:
            return np.inf
        return newton_decrement(objective, self.point, self.expansion)

    def at(self, point: FloatArray) -> tuple[Expansion | None, FloatArray]:
        """The last expansion and its steps if they are those of a point (n,), else None."""
        if self.point is None or self.steps is None or not np.array_equal(self.point, point):
            return None, point
        return self.expansion, self.steps


def expand(problem: Objective, point: FloatArray, steps: FloatArray) -> Expansion:
    """Gradient, information and terms at one point: by differences, or by exact derivatives where a model is stiff."""
    if isinstance(problem, EstimationProblem) and is_linearised(problem):
        return exact_expansion(problem, point) or linear_expansion(problem, point)
    (expansion,) = forward_differences(problem, point[:, np.newaxis], steps[:, np.newaxis])
    return expansion
