"""CMA-ES of the package ``cma`` as a search, with restarts from larger populations.

References: Hansen (2016), The CMA evolution strategy: a tutorial, arXiv:1604.00772; Auger and Hansen (2005), A restart
CMA evolution strategy with increasing population size, IEEE CEC, 1769-1776.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from bondgraph.errors import OptionError
from bondgraph.estimate.objective import FloatArray, Objective, SearchOutcome, TraceRow
from bondgraph.estimate.solvers.abstract import AbstractSearch, SearchResult

#: First standard deviation in shares of the box; a third of the way to the farthest wall (Hansen 2016, appendix B).
_SIGMA = 0.3


@dataclass(frozen=True)
class StrategyState:
    """A search after a generation: the best points (n, restarts + 1) of each restart with their values.

    ``strategy`` is the package's object as it pickles itself, with its random numbers: bytes.
    """

    iteration: int
    points: FloatArray
    values: FloatArray
    strategy: npt.NDArray[np.uint8]
    evaluations: int
    trace: tuple[TraceRow, ...]


@dataclass(frozen=True)
class CovarianceAdaptation(AbstractSearch[StrategyState]):
    """CMA-ES; the population doubles at every restart.

    Parameters
    ----------
    evaluations
        The search ends after so many.
    patience, tolerance
        The search ends when the best value fell by less than ``tolerance`` in ``patience`` generations; a tolerance of
        zero never ends it.
    seed
        The same seed gives the same search.

    Raises
    ------
    OptionError
        If the package is not installed.
    """

    evaluations: int = 20_000
    patience: int = 200
    tolerance: float = 1e-3
    seed: int = 0

    stage: ClassVar[str] = "CMA-ES"

    @property
    def most_evaluations(self) -> int:
        """As its hyper-parameters say."""
        return self.evaluations

    def __post_init__(self) -> None:
        _package()

    def init(self, objective: Objective, starts: FloatArray) -> StrategyState:
        """The first start evaluated.

        Raises
        ------
        OptionError
            If there is a single coordinate, for which the package has no strategy.
        """
        if objective.lower.size < 2:
            raise OptionError("CMA-ES needs at least two free parameters - take another method", where=("method",))
        points = starts[:, :1]
        width = objective.upper - objective.lower
        away = points[:, 0] - objective.lower
        shares = np.divide(away, width, out=np.full(width.size, 0.5), where=width > 0.0)
        begun = self._begun(np.clip(shares, 0.0, 1.0), 0)
        return _traced(StrategyState(0, points, _finite(objective.nll(points)), begun, 1, ()))

    def step(self, objective: Objective, state: StrategyState) -> StrategyState:
        """One generation, of a new strategy where the last has come to its end."""
        size, width = objective.lower.size, objective.upper - objective.lower
        strategy, points, bests = pickle.loads(state.strategy.tobytes()), state.points.copy(), state.values.copy()
        if strategy.stop():
            rng = np.random.default_rng([self.seed, bests.size])
            strategy = pickle.loads(self._begun(rng.random(size), bests.size).tobytes())
            points, bests = np.concatenate([points, points[:, -1:]], axis=1), np.append(bests, np.inf)
        asked = strategy.ask()
        tried = objective.lower[:, np.newaxis] + width[:, np.newaxis] * np.array(asked).T.reshape(size, -1)
        values = _finite(objective.nll(tried))
        strategy.tell(asked, values.tolist())
        best = int(np.argmin(values))
        if values[best] < bests[-1]:
            points[:, -1], bests[-1] = tried[:, best], values[best]
        kept = np.frombuffer(strategy.pickle_dumps(), dtype=np.uint8)
        evaluations = state.evaluations + values.size
        return _traced(StrategyState(state.iteration + 1, points, bests, kept, evaluations, state.trace))

    def _begun(self, first: FloatArray, restart: int) -> npt.NDArray[np.uint8]:
        """A strategy around a point (n,) in shares of the box."""
        members = (4 + int(3 * np.log(first.size))) * 2**restart  # the first as Hansen (2016) recommends
        own = int(np.random.default_rng([self.seed, restart]).integers(1, 2**31))
        options = {"bounds": [0.0, 1.0], "seed": own, "popsize": members, "verbose": -9}
        strategy = _package().CMAEvolutionStrategy(first, _SIGMA, options)
        return np.frombuffer(strategy.pickle_dumps(), dtype=np.uint8)

    def ended(self, state: StrategyState) -> SearchOutcome | None:
        """Why the search ends here, or None if it goes on."""
        best = float(state.values.min())
        if len(state.trace) > self.patience:
            if not np.isfinite(best):
                return SearchOutcome.NO_FINITE_POINT
            if state.trace[-1 - self.patience].nll - best < self.tolerance:
                return SearchOutcome.STALLED
        return SearchOutcome.ITERATION_LIMIT if state.evaluations >= self.evaluations else None

    def result(self, state: StrategyState) -> SearchResult:
        """The best of each restart."""
        return SearchResult(state.points, state.values)


def _package() -> Any:
    try:
        import cma
    except ImportError:
        raise OptionError("CMA-ES needs the package cma - pip install 'bondloop[searches]'", where=("cma",)) from None
    return cma


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.inf)


def _traced(state: StrategyState) -> StrategyState:
    best = int(np.argmin(state.values))
    point = tuple(float(v) for v in state.points[:, best])
    row = TraceRow(CovarianceAdaptation.stage, state.iteration, state.evaluations, float(state.values[best]), point)
    return replace(state, trace=(*state.trace, row))
