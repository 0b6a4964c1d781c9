"""Global searches on the usual functions in ten dimensions: medians over seeds at a number of evaluations.

Rastrigin, Rosenbrock, Ackley and Griewank over their usual boxes (Suganthan et al. 2005, CEC benchmark; Molga and
Smutnicki 2005, Test functions for optimization needs). Every search sees the functions as an estimation would: values
of a batch of points. The default of ``estimate`` takes part as it is: the function is the likelihood of a problem with
ten parameters, its gradient search takes differences, and the best of the first evaluations counts, whoever asked for
it. pyswarms takes part where it is installed.
"""

from __future__ import annotations

import importlib.util
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import differential_evolution

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.likelihoods import Batch
from bondgraph.estimate.objective import FloatArray, Terms, TraceRow
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.solvers.abstract import AbstractSearch, search_to_end
from bondgraph.estimate.solvers.covariance_adaptation import CovarianceAdaptation
from bondgraph.estimate.solvers.differential_evolution import Shade
from bondgraph.estimate.solvers.particle_swarm import ParticleSwarm, SwarmSettings
from bondgraph.estimate.solvers.swarm_rules import Constriction, FallingInertia, Ring, VonNeumann
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.state_space import state_space

SIZE, EVALUATIONS, SEEDS = 10, 20_000, 20

#: Members of swarms and of scipy's population.
_MEMBERS = 40


@dataclass(frozen=True)
class Function:
    """A test function over a box that is the same in every coordinate; its least value is zero."""

    value: Callable[[FloatArray], FloatArray]
    half_width: float

    @property
    def lower(self) -> FloatArray:
        """Lower bounds, shape (10,)."""
        return np.full(SIZE, -self.half_width)

    @property
    def upper(self) -> FloatArray:
        """Upper bounds, shape (10,)."""
        return np.full(SIZE, self.half_width)

    def nll(self, points: FloatArray) -> FloatArray:
        """Values at points (10, members)."""
        return self.value(points)


def _summed(terms: FloatArray) -> FloatArray:
    """Sums over the first axis, one term after the other: numpy's own order depends on how many members there are."""
    total: FloatArray = np.cumsum(terms, axis=0)[-1]
    return total


def _rastrigin(x: FloatArray) -> FloatArray:
    return _summed(x**2 - 10.0 * np.cos(2.0 * np.pi * x) + 10.0)


def _rosenbrock(x: FloatArray) -> FloatArray:
    return _summed(100.0 * (x[1:] - x[:-1] ** 2) ** 2 + (1.0 - x[:-1]) ** 2)


def _ackley(x: FloatArray) -> FloatArray:
    hollow = -20.0 * np.exp(-0.2 * np.sqrt(_summed(x**2) / SIZE))
    return hollow - np.exp(_summed(np.cos(2.0 * np.pi * x)) / SIZE) + 20.0 + np.e


def _griewank(x: FloatArray) -> FloatArray:
    waves = np.cos(x / np.sqrt(np.arange(1, SIZE + 1))[:, np.newaxis])
    return _summed(x**2) / 4000.0 - np.cumprod(waves, axis=0)[-1] + 1.0


FUNCTIONS: Mapping[str, Function] = {
    "rastrigin": Function(_rastrigin, 5.12), "rosenbrock": Function(_rosenbrock, 5.0),
    "ackley": Function(_ackley, 32.0), "griewank": Function(_griewank, 600.0),
}  # fmt: skip


def _swarm(**rules: object) -> Callable[[int, int], AbstractSearch]:
    def make(evaluations: int, seed: int) -> ParticleSwarm:
        iterations = evaluations // _MEMBERS - 1
        settings = SwarmSettings(_MEMBERS, iterations, patience=iterations + 1, **rules)  # type: ignore[arg-type]
        return ParticleSwarm(settings, seed)

    return make


#: Searches of the toolkit that stand alone, by name.
SEARCHES: Mapping[str, Callable[[int, int], AbstractSearch]] = {
    "L-SHADE": lambda evaluations, seed: Shade(evaluations, tolerance=0.0, seed=seed),
    "swarm, global": _swarm(),
    "swarm, ring": _swarm(neighbourhood=Ring(), schedule=Constriction()),
    "swarm, von Neumann": _swarm(neighbourhood=VonNeumann(), schedule=Constriction()),
    "swarm, falling inertia": _swarm(schedule=FallingInertia()),
    "CMA-ES, restarts": lambda evaluations, seed: CovarianceAdaptation(evaluations, tolerance=0.0, seed=seed),
}


def _own(name: str, function: Function, evaluations: int, seed: int) -> float:
    search = SEARCHES[name](evaluations, seed)
    start = np.random.default_rng([seed, 9]).uniform(function.lower, function.upper)
    state, _ = search_to_end(search, function, start)  # type: ignore[arg-type]
    return search.result(state).best_nll


class Asked:
    """A function as a likelihood that knows the best of its first evaluations and tells nothing of its structure.

    It is one term whose log scale is the value, so that its slope is all that a gradient search sees.
    """

    def __init__(self, function: Function, names: Sequence[str], evaluations: int) -> None:
        self._function, self._names, self.left, self.best = function, names, evaluations, np.inf

    def nll(self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch) -> FloatArray:
        """Values (members,)."""
        points = batch.theta[[filter_model.model.index("parameter", name) for name in self._names]]
        values = self._function.nll(points)
        counted = values[: self.left]
        self.left -= counted.size
        self.best = min(self.best, float(counted.min(initial=np.inf)))
        return values

    def terms(self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch) -> Terms:
        """The value as a log scale, shape (1, members)."""
        values = self.nll(filter_model, logs, batch)[np.newaxis]
        return Terms(np.zeros(values.shape), values)


def function_problem(function: Function, start: FloatArray, evaluations: int) -> tuple[EstimationProblem, Asked]:
    """A problem with the function as its likelihood, ten parameters that begin at a start (10,), and what it knows."""
    names = [f"x{k}" for k in range(SIZE)]
    values = {name: float(value) for name, value in zip(names, start, strict=True)}
    model = state_space(
        "still", states={"s": 0.0}, rates={"s": "0*" + "*".join(names)}, outputs={"seen": "s"}, parameters=values
    )
    asked, width = Asked(function, names, evaluations), function.half_width
    free = [FreeParameter(name, -width, width, value) for name, value in values.items()]
    log = MatchedLog("none", np.array([0.0, 1.0]), np.zeros((0, 2)), np.zeros((1, 2)))
    return pose(FilterModel(model, {"s": 1.0}, {"seen": 1.0}, {"s": 1.0}), log, free, likelihood=asked), asked


def by_default(function: Function, evaluations: int, seed: int) -> float:
    """Value that ``estimate`` finds by default; Ctrl-C, as a user would end it, where the evaluations are spent."""
    start = np.random.default_rng([seed, 9]).uniform(function.lower, function.upper)
    problem, asked = function_problem(function, start, evaluations)

    def spent(row: TraceRow) -> None:
        if not asked.left:
            raise KeyboardInterrupt

    estimate(problem, Settings(seed=seed, certify="none"), progress=spent, jacobian=central_differences)
    return asked.best


def by_scipy(function: Function, evaluations: int, seed: int) -> float:
    """The public function with 40 members, without its polishing."""
    found = differential_evolution(
        function.nll, list(zip(function.lower, function.upper, strict=True)), popsize=_MEMBERS // SIZE,
        maxiter=evaluations // _MEMBERS - 1, tol=0.0, atol=0.0, polish=False, updating="deferred", vectorized=True,
        rng=seed,
    )  # fmt: skip
    return float(found.fun)


def _pyswarms(function: Function, evaluations: int, seed: int) -> float:
    """Its global swarm with the same constriction; it writes a log where it stands, so it stands in a folder apart."""
    from pyswarms.single.global_best import GlobalBestPSO

    np.random.seed(seed)
    options = {"c1": 1.49618, "c2": 1.49618, "w": 0.7298}
    swarm = GlobalBestPSO(_MEMBERS, SIZE, options, bounds=(function.lower, function.upper))
    best, _ = swarm.optimize(lambda points: function.nll(points.T), evaluations // _MEMBERS, verbose=False)
    return float(best)


def optimisers(seeds: int = SEEDS, evaluations: int = EVALUATIONS) -> list[dict[str, object]]:
    """A row per search: the median over seeds of what each function ended at."""
    entrants: dict[str, Callable[[Function, int, int], float]] = {
        name: (lambda function, evaluations, seed, name=name: _own(name, function, evaluations, seed))
        for name in SEARCHES
    }
    entrants = {"default of estimate": by_default, **entrants, "scipy, DE of 40": by_scipy}
    home, apart = os.getcwd(), tempfile.mkdtemp()
    if importlib.util.find_spec("pyswarms") is not None:
        entrants["pyswarms, global"] = _pyswarms
    rows: list[dict[str, object]] = []
    try:
        os.chdir(apart)
        for name, run in entrants.items():
            medians = {
                title: float(np.median([run(function, evaluations, seed) for seed in range(seeds)]))
                for title, function in FUNCTIONS.items()
            }
            rows.append({"search": name, **medians})
    finally:
        os.chdir(home)
    return rows
