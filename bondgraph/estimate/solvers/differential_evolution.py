"""Differential evolution: the global search that stands alone, with steps that learn and a population that shrinks.

L-SHADE of Tanabe and Fukunaga (2014), Improving the search performance of SHADE using linear population size reduction,
IEEE CEC, 1658-1665; the memory of successful steps is that of Tanabe and Fukunaga (2013), Success-history based
parameter adaptation for differential evolution, IEEE CEC, 71-78. Each member tries

    v = x + F (x_pbest - x) + F (x_r1 - x_r2),    u = v in some coordinates, x in the others,

and moves to u where that is no worse. x_pbest is one of the best, x_r2 may be one that was left behind; F and the share
of the coordinates are drawn around those that succeeded lately.

A trial need only be compared with its own member, so its evaluation may end as soon as it is certain to be worse, as in
the swarm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from bondgraph.errors import EstimationError
from bondgraph.estimate.objective import FloatArray, Objective, SearchOutcome, TraceRow, nll_below
from bondgraph.estimate.solvers.abstract import AbstractSearch, SearchResult
from bondgraph.estimate.solvers.hypercube import latin_hypercube

#: Members for each coordinate at first, and left behind ones for each member. Tanabe and Fukunaga tuned 18 and 2.6 for
#: 10 000 evaluations per coordinate; with 2000 smaller numbers are better (``python -m tests.benchmarks --only
#: optimisers``).
_PER_COORDINATE, _ARCHIVE = 10, 1.0

#: Least members at first; members at the end, the least that a step needs.
_LEAST, _LAST = 16, 4

#: Entries of the memory, and the share of the best to which members are drawn (Tanabe and Fukunaga 2014, table I).
_MEMORY, _BEST = 6, 0.11

#: Spread of the draws around an entry, of both laws.
_SPREAD = 0.1


@dataclass(frozen=True)
class ShadeState:
    """A population after a step: (n, members) with values (members,), those left behind (n, some), the memory (6,).

    ``crossovers`` holds NaN where only trials with a single new coordinate succeeded, which then stays so; ``entry`` is
    the next to be overwritten. ``abandoned`` evaluations were ended early.
    """

    iteration: int
    points: FloatArray
    values: FloatArray
    behind: FloatArray
    factors: FloatArray
    crossovers: FloatArray
    entry: int
    evaluations: int
    trace: tuple[TraceRow, ...]
    abandoned: int = 0


@dataclass(frozen=True)
class Shade(AbstractSearch[ShadeState]):
    """L-SHADE.

    Parameters
    ----------
    evaluations
        Over which the population shrinks to four; the search ends there.
    members
        At first; None: ten for each coordinate.
    patience, tolerance
        The search ends when the best value fell by less than ``tolerance`` in ``patience`` steps; a tolerance of zero
        never ends it.
    spread
        The search ends when all members are within so many nats of the best: they are in one valley, whose bottom they
        know as well. Zero never ends it.
    seed
        The same seed gives the same search.

    Raises
    ------
    EstimationError
        If a number is out of its range.
    """

    evaluations: int = 20_000
    members: int | None = None
    patience: int = 50
    tolerance: float = 1e-3
    spread: float = 0.0
    seed: int = 0

    stage: ClassVar[str] = "differential evolution"

    @property
    def most_evaluations(self) -> int:
        """As its hyper-parameters say."""
        return self.evaluations

    def __post_init__(self) -> None:
        for name, least in (("evaluations", 1), ("patience", 1), ("tolerance", 0.0), ("spread", 0.0)):
            if not getattr(self, name) >= least:
                raise EstimationError(
                    f"differential evolution: {name} = {getattr(self, name)} must be at least {least}", where=(name,)
                )
        if self.members is not None and self.members < _LAST:
            raise EstimationError(
                f"differential evolution: members = {self.members} must be at least {_LAST}", where=("members",)
            )

    def init(self, objective: Objective, starts: FloatArray) -> ShadeState:
        """A Latin hypercube over the box, the first of it at the first start."""
        lower, width = objective.lower[:, np.newaxis], (objective.upper - objective.lower)[:, np.newaxis]
        size = objective.lower.size
        members = self.members or max(_PER_COORDINATE * size, _LEAST)
        rng = np.random.default_rng([self.seed, 0])
        points = lower + width * latin_hypercube(size, members, rng)
        points[:, 0] = starts[:, 0]
        values = _finite(objective.nll(points))
        half = np.full(_MEMORY, 0.5)
        return _traced(ShadeState(0, points, values, np.empty((size, 0)), half, half, 0, members, ()))

    def step(self, objective: Objective, state: ShadeState) -> ShadeState:
        """A trial for every member."""
        rng = np.random.default_rng([self.seed, state.iteration + 1])
        factors, crossovers = _drawn(state, rng)
        trials = _trials(objective, state, factors, crossovers, rng)
        found = nll_below(objective, trials, state.values)
        values = _finite(found.nll)
        better, kept = values < state.values, values <= state.values
        behind = np.concatenate([state.behind, state.points[:, better]], axis=1)
        with np.errstate(invalid="ignore"):
            gains = np.where(np.isfinite(state.values), state.values - values, 1.0)[better]
        learnt = _learnt(state, factors[better], crossovers[better], gains)
        moved = replace(
            learnt,
            iteration=state.iteration + 1,
            points=np.where(kept, trials, state.points),
            values=np.where(kept, values, state.values),
            evaluations=state.evaluations + values.size,
            abandoned=state.abandoned + int(found.abandoned.sum()),
        )
        return _traced(self._shrunk(moved, behind, state, rng))

    def _shrunk(
        self, state: ShadeState, behind: FloatArray, before: ShadeState, rng: np.random.Generator
    ) -> ShadeState:
        """The best of the population, as many as the evaluations that are left deserve."""
        first = before.trace[0].evaluations
        share = min(state.evaluations / self.evaluations, 1.0)
        count = min(max(_LAST, round(first + (_LAST - first) * share)), state.values.size)
        chosen = np.sort(np.argsort(state.values, kind="stable")[:count])
        most = round(_ARCHIVE * count)
        if behind.shape[1] > most:
            behind = behind[:, rng.permutation(behind.shape[1])[:most]]
        return replace(state, points=state.points[:, chosen], values=state.values[chosen], behind=behind)

    def ended(self, state: ShadeState) -> SearchOutcome | None:
        """Why the search ends here, or None if it goes on."""
        best = float(state.values.min())
        if len(state.trace) > self.patience:
            if not np.isfinite(best):
                return SearchOutcome.NO_FINITE_POINT
            if state.trace[-1 - self.patience].nll - best < self.tolerance:
                return SearchOutcome.STALLED
        if self.spread > 0.0 and float(state.values.max()) - best < self.spread:
            return SearchOutcome.CONVERGED
        if state.evaluations < self.evaluations:
            return None
        return SearchOutcome.ITERATION_LIMIT if np.isfinite(best) else SearchOutcome.NO_FINITE_POINT

    def result(self, state: ShadeState) -> SearchResult:
        """The population."""
        return SearchResult(state.points, state.values, state.abandoned)


def _drawn(state: ShadeState, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Factor and share of new coordinates of each member: a Cauchy and a normal law around entries of the memory."""
    entries = rng.integers(_MEMORY, size=state.values.size)
    middles = state.crossovers[entries]
    shares = np.clip(rng.normal(np.nan_to_num(middles), _SPREAD), 0.0, 1.0)
    factors = state.factors[entries] + _SPREAD * rng.standard_cauchy(entries.size)
    while (low := factors <= 0.0).any():
        factors[low] = state.factors[entries[low]] + _SPREAD * rng.standard_cauchy(int(low.sum()))
    return np.minimum(factors, 1.0), np.where(np.isnan(middles), 0.0, shares)


def _trials(
    objective: Objective, state: ShadeState, factors: FloatArray, crossovers: FloatArray, rng: np.random.Generator
) -> FloatArray:
    points, count = state.points, state.values.size
    own = np.arange(count)
    ranked = np.argsort(state.values, kind="stable")
    best = points[:, ranked[rng.integers(max(2, round(_BEST * count)), size=count)]]
    first = rng.integers(count - 1, size=count)
    first += first >= own
    pool = np.concatenate([points, state.behind], axis=1)
    second = _others(pool.shape[1], own, first, rng)
    moved = points + factors * (best - points) + factors * (points[:, first] - pool[:, second])
    lower, upper = objective.lower[:, np.newaxis], objective.upper[:, np.newaxis]
    # Half of the way to the wall (Zhang and Sanderson 2009, JADE).
    moved = np.where(moved < lower, 0.5 * (lower + points), np.where(moved > upper, 0.5 * (upper + points), moved))
    new = rng.random(points.shape) < crossovers
    new[rng.integers(points.shape[0], size=count), own] = True
    return np.where(new, moved, points)


def _others(
    count: int, own: npt.NDArray[np.intp], first: npt.NDArray[np.int64], rng: np.random.Generator
) -> npt.NDArray[np.int64]:
    """A random place for each, neither its own nor the first."""
    found = rng.integers(count, size=own.size)
    while (same := (found == own) | (found == first)).any():
        found[same] = rng.integers(count, size=int(same.sum()))
    return found


def _learnt(state: ShadeState, factors: FloatArray, crossovers: FloatArray, gains: FloatArray) -> ShadeState:
    """The memory after trials that gained (some,): their Lehmer means, weighted by the gains."""
    if not gains.size:
        return state
    weights = gains / gains.sum() if gains.sum() > 0.0 else np.full(gains.size, 1.0 / gains.size)
    mean_factors, mean_crossovers = state.factors.copy(), state.crossovers.copy()
    mean_factors[state.entry] = (weights @ factors**2) / (weights @ factors)
    ended = np.isnan(mean_crossovers[state.entry]) or crossovers.max() == 0.0
    mean_crossovers[state.entry] = np.nan if ended else (weights @ crossovers**2) / (weights @ crossovers)
    return replace(state, factors=mean_factors, crossovers=mean_crossovers, entry=(state.entry + 1) % _MEMORY)


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.inf)


def _traced(state: ShadeState) -> ShadeState:
    best = int(np.argmin(state.values))
    point = tuple(float(v) for v in state.points[:, best])
    row = TraceRow(Shade.stage, state.iteration, state.evaluations, float(state.values[best]), point)
    return replace(state, trace=(*state.trace, row))
