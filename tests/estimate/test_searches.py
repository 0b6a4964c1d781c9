"""Every search is a type with four functions: it finds an optimum, repeats itself, and goes on from a kept state."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bondgraph.cli import estimation_options
from bondgraph.errors import EstimationError, OptionError
from bondgraph.estimate.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.methods import METHODS
from bondgraph.estimate.objective import SearchOutcome, Terms
from bondgraph.estimate.problem import pose
from bondgraph.estimate.solvers.abstract import AbstractSearch, search_to_end
from bondgraph.estimate.solvers.covariance_adaptation import CovarianceAdaptation
from bondgraph.estimate.solvers.differential_evolution import Shade
from bondgraph.estimate.solvers.gauss_newton import GaussNewton
from bondgraph.estimate.solvers.particle_swarm import ParticleSwarm, SwarmSettings
from bondgraph.estimate.solvers.scipy_evolution import ScipyEvolution
from bondgraph.estimate.solvers.scipy_gradient import LBFGSB
from bondgraph.estimate.solvers.swarm_rules import Clipping, Constriction, FallingInertia, Periodic, Ring, VonNeumann
from bondgraph.filter import compiled
from bondgraph.filter.runs import run
from bondgraph.simulate.model import Model
from tests.estimate.linear import ExactLikelihood, lag, simulated


class Rosenbrock:
    """The valley of Rosenbrock as a sum of squares, least at (1, 1); it has no value in a corner."""

    lower, upper = np.full(2, -2.0), np.full(2, 2.0)

    def terms(self, points: np.ndarray) -> Terms:
        z = np.sqrt(2.0) * np.array([10.0 * (points[1] - points[0] ** 2), 1.0 - points[0]])
        return Terms(np.where(points[0] + points[1] < -3.5, np.nan, z), np.zeros(z.shape))

    def nll(self, points: np.ndarray) -> np.ndarray:
        return self.terms(points).sums()


def swarm(**rules: object) -> ParticleSwarm:
    return ParticleSwarm(SwarmSettings(20, 100, tolerance=1e-9, **rules))  # type: ignore[arg-type]


SEARCHES: dict[str, AbstractSearch] = {
    "swarm": swarm(),
    "ring": swarm(neighbourhood=Ring(), walls=Clipping(), schedule=Constriction()),
    "von Neumann": swarm(neighbourhood=VonNeumann(), walls=Periodic()),
    "falling inertia": swarm(schedule=FallingInertia()),
    "restarts": ParticleSwarm(SwarmSettings(20, 100, patience=10, tolerance=1e-3, restarts=2)),
    "L-SHADE": Shade(evaluations=3000, tolerance=0.0),
    "differential evolution": ScipyEvolution(members=20, generations=80),
    "CMA-ES": CovarianceAdaptation(evaluations=900),
    "L-BFGS-B": LBFGSB(),
    "Gauss-Newton": GaussNewton(),
}
#: Functions that the first evaluation of an estimation goes through to the compiled kernel, and those on the longest
#: way of any evaluation: through differences for derivatives, or below a ceiling. No more than these may come to lie
#: between, so that a reader reaches the arithmetic in few turns.
FIRST_HOPS, ESTIMATE_HOPS = 9, 12
#: Functions that a filter run goes through to the equations; a step of a stiff method is a function of its own.
FILTER_HOPS = {"rk4": 7, "ros3p": 8}

START = np.array([[-1.2, 0.5], [1.0, -1.0]])


@pytest.mark.parametrize("search", SEARCHES.values(), ids=SEARCHES)
def test_a_search_finds_the_optimum_and_is_the_same_from_a_kept_state(search: AbstractSearch, tmp_path: Path) -> None:
    state, outcome = search_to_end(search, Rosenbrock(), START)
    found = search.result(state)
    np.testing.assert_allclose(found.best, 1.0, atol=0.1)
    assert found.best_nll == pytest.approx(float(Rosenbrock().nll(found.best[:, np.newaxis])[0]), abs=1e-12)
    assert outcome is not SearchOutcome.NO_FINITE_POINT and state.trace[-1].nll == found.best_nll
    assert dataclasses.is_dataclass(state) and type(state).__dataclass_params__.frozen  # type: ignore[attr-defined]
    half = search.init(Rosenbrock(), START)
    while search.ended(half) is None and half.iteration < state.iteration // 2:
        half = search.step(Rosenbrock(), half)
    save_checkpoint(tmp_path, Checkpoint("digest", 0.0, {"stage": half}))
    kept = load_checkpoint(tmp_path, "digest")
    assert kept is not None
    again, _ = search_to_end(search, Rosenbrock(), START, state=kept.states["stage"])
    assert again.trace == state.trace and again.evaluations == state.evaluations
    np.testing.assert_array_equal(search.result(again).points, found.points)


def test_a_swarm_that_stalls_is_placed_anew_and_keeps_what_it_found() -> None:
    search = SEARCHES["restarts"]
    state, _ = search_to_end(search, Rosenbrock(), START)
    assert state.restarts == 2 and state.record is not None
    values = [row.nll for row in state.trace]
    assert values == sorted(values, reverse=True)


def test_weights_of_the_default_swarm_are_the_constriction_of_clerc_and_kennedy() -> None:
    """chi = 0.7298 and chi phi / 2 = 1.49618 for phi = 4.1."""
    own = SwarmSettings()
    expected = (own.inertia_weight, own.cognitive, own.social)
    assert Constriction().weights(0.0) == pytest.approx(expected, abs=1e-4)


class Rastrigin:
    """A hundred valleys, the deepest at zero."""

    lower, upper = np.full(4, -5.12), np.full(4, 5.12)

    def nll(self, points: np.ndarray) -> np.ndarray:
        return np.sum(points**2 - 10.0 * np.cos(2.0 * np.pi * points) + 10.0, axis=0)


def test_l_shade_finds_the_deepest_of_many_valleys() -> None:
    """In each of three runs; a population shrinks to four as Tanabe and Fukunaga have it."""
    for seed in range(3):
        search = Shade(evaluations=8000, tolerance=0.0, seed=seed)
        state, outcome = search_to_end(search, Rastrigin(), np.full(4, 3.0))
        assert search.result(state).best_nll < 1e-9 and outcome is SearchOutcome.ITERATION_LIMIT
        assert state.values.size == 4


@pytest.mark.parametrize("name", ["shade", "de+gradient", "cma+gradient"])
def test_methods_estimate_what_the_gradient_search_does(name: str) -> None:
    exact = ExactLikelihood()
    problem = pose(lag(), simulated("run1", 3, {"mass": 2.6}, 30), ["mass", "drag"], likelihood=exact)
    reference = estimate(problem, Settings(method="gradient", starts=1, certify="none"))
    fit = estimate(problem, Settings(method=name, starts=2, certify="none"))
    assert fit.outcome.succeeded and fit.nll == pytest.approx(reference.nll, abs=0.01)


def test_a_search_of_ones_own_takes_the_place_of_the_swarm() -> None:
    problem = pose(lag(), simulated("run1", 3, {"mass": 2.6}, 30), ["mass", "drag"], likelihood=ExactLikelihood())
    rows: list[str] = []
    own = Settings(search=Shade(evaluations=100, members=8), certify="none")
    estimate(problem, own, progress=lambda row: rows.append(row.stage))
    assert Shade.stage in rows and "gauss-newton" in rows and "swarm" not in rows


def test_the_command_line_knows_the_methods() -> None:
    assert tuple(estimation_options.METHODS) == tuple(METHODS)


def test_cma_refuses_a_single_coordinate() -> None:
    problem = pose(lag(), simulated("run1", 3, {}, 10), ["mass"], likelihood=ExactLikelihood())
    with pytest.raises(OptionError, match="at least two free parameters"):
        estimate(problem, Settings(method="cma"))


@pytest.mark.parametrize("make", [
    lambda: Shade(evaluations=0), lambda: Shade(members=3), lambda: Constriction(4.0),
    lambda: SwarmSettings(restarts=-1),
])  # fmt: skip
def test_impossible_searches_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(EstimationError):
        make()


def test_cma_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cma", None)
    with pytest.raises(OptionError, match=r"pip install 'bondloop\[searches\]'"):
        CovarianceAdaptation()


def watched(function: Callable[..., object], ways: list[list[str]]) -> Callable[..., object]:
    """A function that notes at each call which of the toolkit's functions called one another up to it."""

    def noting(*arguments: object) -> object:
        frame, way = sys._getframe(1), []
        while frame is not None:
            module, name = frame.f_globals.get("__name__", ""), frame.f_code.co_name
            if module.startswith("bondgraph.") and not name.startswith("<"):
                way.append(f"{module}.{name}")
            frame = frame.f_back  # type: ignore[assignment]
        ways.append(way[::-1])
        return function(*arguments)

    return noting


@pytest.mark.parametrize("method", ["gradient", "both"])
def test_few_hops_lead_from_an_estimation_to_the_compiled_kernel(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """On one thread, since the calls of another do not show who began it."""
    ways: list[list[str]] = []
    load = compiled.load_translated
    monkeypatch.setattr(compiled, "load_translated", lambda *modules: watched(load(*modules), ways))
    log = simulated("run1", 3, {"mass": 2.6})
    problem = pose(lag(), log, ["mass"], likelihood=FilterLikelihood(threads=1))
    estimate(problem, Settings(method=method, starts=2))
    assert all(way[0] == "bondgraph.estimate.estimation.estimate" for way in ways)
    assert len(ways[0]) <= FIRST_HOPS, ways[0]
    longest = max(ways, key=len)
    assert len(longest) <= ESTIMATE_HOPS, longest


@pytest.mark.parametrize("method", FILTER_HOPS)
def test_few_hops_lead_from_a_filter_run_to_the_equations(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ways: list[list[str]] = []
    log, filter_model = simulated("run1", 3, {"mass": 2.6}), dataclasses.replace(lag(), method=method)
    monkeypatch.setattr(Model, "rhs", watched(Model.rhs, ways))
    run(filter_model, log, compiled=False)
    assert all(way[0] == "bondgraph.filter.runs.run" for way in ways)
    longest = max(ways, key=len)
    assert len(longest) <= FILTER_HOPS[method], longest
