"""The swarm finds known optima, stays in its box, and is the same for a seed however it is run."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.solvers.particle_swarm import ParticleSwarm, SwarmSettings, particle_swarm
from bondgraph.estimate.solvers.swarm_rules import Reflecting
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.example import pendulum
from tests.verification.optima import (
    FINE,
    Function,
    ackley,
    branin,
    hartmann3,
    rastrigin,
    rosenbrock,
    six_hump_camel,
    sphere,
    styblinski_tang,
)

PROBLEMS = {
    "sphere": (Function(sphere, [-100] * 5, [100] * 5), 0.0),
    "rosenbrock": (Function(rosenbrock, [-30] * 2, [30] * 2), 0.0),
    "rastrigin": (Function(rastrigin, [-5.12] * 3, [5.12] * 3), 0.0),
    "ackley": (Function(ackley, [-32.768] * 4, [32.768] * 4), 0.0),
    "branin": (Function(branin, [-5, 0], [10, 15]), 0.39788735772973816),
    "six-hump camel": (Function(six_hump_camel, [-3, -2], [3, 2]), -1.0316284534898774),
    "hartmann3": (Function(hartmann3, [0] * 3, [1] * 3), -3.86278214782076),
    "styblinski-tang": (Function(styblinski_tang, [-5] * 2, [5] * 2), -39.16616570377142 * 2),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_known_optima_are_found(name: str) -> None:
    problem, optimum = PROBLEMS[name]
    start = problem.lower + 0.9 * (problem.upper - problem.lower)
    state, outcome = particle_swarm(problem, start, seed=3, settings=FINE)
    assert state.swarm_best_nll == pytest.approx(optimum, abs=1e-6)
    assert outcome in (SearchOutcome.STALLED, SearchOutcome.ITERATION_LIMIT)


def test_a_seed_gives_one_search_and_another_seed_another() -> None:
    problem, _ = PROBLEMS["rastrigin"]
    runs = [particle_swarm(problem, np.zeros(3) + 3.0, seed=seed, settings=FINE)[0] for seed in (5, 5, 6)]
    assert runs[0].trace == runs[1].trace
    assert runs[0].trace != runs[2].trace


def test_threads_do_not_change_the_search() -> None:
    problem, _ = PROBLEMS["ackley"]

    class Threaded(Function):
        def nll(self, points: np.ndarray) -> np.ndarray:
            return np.concatenate(list(pool.map(self.function, np.array_split(points, 7, axis=1))))

    threaded = Threaded(ackley, problem.lower.tolist(), problem.upper.tolist())
    start = np.full(4, 20.0)
    one, _ = particle_swarm(problem, start, seed=2, settings=FINE)
    with ThreadPoolExecutor(4) as pool:
        many, _ = particle_swarm(threaded, start, seed=2, settings=FINE)
    assert one.trace == many.trace


def test_a_search_continues_from_any_state_as_if_never_stopped() -> None:
    problem, _ = PROBLEMS["hartmann3"]
    short = replace(FINE, iterations=20)
    search = ParticleSwarm(short, seed=4)
    state = search.init(problem, np.full((3, 1), 0.5))
    for _ in range(7):
        state = search.step(problem, state)
    while search.ended(state) is None:
        state = search.step(problem, state)
    assert state.trace == particle_swarm(problem, np.full(3, 0.5), seed=4, settings=short)[0].trace


def test_progress_tells_every_iteration_and_never_gets_worse() -> None:
    problem, _ = PROBLEMS["rastrigin"]
    rows = []
    state, _ = particle_swarm(problem, np.zeros(3) + 3.0, 1, replace(FINE, iterations=30), rows.append)
    assert tuple(rows) == state.trace
    assert [row.iteration for row in rows] == list(range(31))
    assert [row.evaluations for row in rows] == [60 * (k + 1) for k in range(31)]
    assert (np.diff([row.nll for row in rows]) <= 0.0).all()


def test_members_that_fail_do_not_stop_the_others() -> None:
    def partly(x: np.ndarray) -> np.ndarray:
        return np.where(x[0] > 0.0, np.nan, (x**2).sum(axis=0))

    state, _ = particle_swarm(Function(partly, [-4, -4], [4, 4]), np.array([3.0, 3.0]), 1, FINE)
    assert state.swarm_best_nll < 1e-6


def test_a_model_that_always_diverges_is_an_outcome() -> None:
    never = Function(lambda x: np.full(x.shape[1], np.inf), [0, 0], [1, 1])
    state, outcome = particle_swarm(never, np.array([0.5, 0.5]), 1, replace(FINE, patience=3))
    assert outcome is SearchOutcome.NO_FINITE_POINT and not outcome.succeeded
    assert state.iteration == 3


def swinging_problem(compiled: bool, samples: int) -> EstimationProblem:
    """Three logs of a pendulum: two parameters, the noise of the sensor and a start are free, one has a prior."""
    rng = np.random.default_rng(8)
    logs = []
    for number, count in enumerate((samples, samples // 2, samples)):
        time = np.arange(count) * 0.05
        angle = 0.5 * np.exp(-0.1 * time) * np.cos((2.6 + 0.2 * number) * time)
        y = np.where(rng.random(count) < 0.2, np.nan, angle + 0.03 * rng.normal(size=count))
        logs.append(MatchedLog(f"swing{number}", time, np.zeros((1, count)), y[np.newaxis]))
    swing = FilterModel(pendulum(), {"rate": 0.02}, {"deflection": 0.1}, {"angle": 0.6, "rate": 1.5}, substeps=2)
    known = FreeParameter("length", 0.5, 3.0, 1.0, prior_mean=1.2, prior_std=0.1)
    free = [known, "damping", "std(deflection)", FreeParameter("x0(angle)", -1.0, 1.0, 0.4)]
    return pose(swing, logs, free, likelihood=FilterLikelihood(compiled=compiled))


@pytest.mark.slow
@pytest.mark.parametrize(("compiled", "samples", "size"), [(True, 200, 37), (False, 40, 6)])
def test_a_search_that_ends_hopeless_evaluations_is_the_same_search(compiled: bool, samples: int, size: int) -> None:
    problem = swinging_problem(compiled, samples)
    limits = SwarmSettings(members=size, iterations=25 if compiled else 8, patience=100)
    short, whole = (
        particle_swarm(problem, problem.start, 3, replace(limits, abandon=abandon))[0] for abandon in (True, False)
    )
    assert short.trace == whole.trace
    for name in ("positions", "velocities", "personal_best", "personal_best_nll"):
        np.testing.assert_array_equal(getattr(short, name), getattr(whole, name))
    evaluations = size * (limits.iterations + 1)
    assert short.evaluations == whole.evaluations == whole.whole == evaluations
    assert whole.abandoned == 0
    assert short.abandoned > 0.2 * evaluations
    assert short.whole < 0.95 * evaluations


def test_evaluations_that_cannot_be_cut_short_are_whole() -> None:
    problem, _ = PROBLEMS["sphere"]
    state, _ = particle_swarm(problem, np.full(5, 50.0), 1, replace(FINE, iterations=5))
    assert (state.abandoned, state.whole) == (0, 360.0)


@settings(max_examples=50, deadline=None)
@given(
    positions=hnp.arrays(float, (2, 5), elements=st.floats(-50, 50)),
    velocities=hnp.arrays(float, (2, 5), elements=st.floats(-50, 50)),
)
def test_reflection_ends_inside_and_keeps_what_was_inside(positions: np.ndarray, velocities: np.ndarray) -> None:
    lower, upper = np.array([-1.0, 2.0]), np.array([1.0, 7.0])
    inside = (positions >= lower[:, None]) & (positions <= upper[:, None])
    after, speed = Reflecting().keep(positions, velocities, lower, upper)
    assert (after >= lower[:, None]).all() and (after <= upper[:, None]).all()
    np.testing.assert_array_equal(after[inside], positions[inside])
    np.testing.assert_array_equal(speed, np.where(inside, velocities, -velocities))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"members": 1}, "members = 1 must be at least 2"),
        ({"patience": 0}, "patience = 0 must be at least 1"),
        ({"cognitive": 3.0}, r"makes the swarm explode - keep .* below 3\.35"),
        ({"inertia_weight": 1.1}, "makes the swarm explode"),
    ],
)
def test_settings_that_cannot_work_are_refused(change: dict, message: str) -> None:
    with pytest.raises(EstimationError, match=message):
        SwarmSettings(**change)
