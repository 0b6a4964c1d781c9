"""Integrators: their order, known solutions, and failures as outcomes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from bondgraph.errors import OptionError
from bondgraph.simulate.inputs import InputSegment
from bondgraph.simulate.integrators import RK4, AbstractIntegrator, Adaptive, Equations
from bondgraph.simulate.outcome import Outcome


def rest(end: float) -> InputSegment:
    return InputSegment(0.0, end, np.empty(0), np.empty(0))


@dataclass(frozen=True)
class Problem:
    rhs: Equations
    solution: Callable[[np.ndarray], np.ndarray]
    end: float
    stiff: bool = False

    def error(self, method: AbstractIntegrator) -> float:
        """Largest error relative to the largest value of each state."""
        times = np.linspace(0.0, self.end, 13)[1:]
        start = self.solution(np.zeros(1))[:, 0]
        x, state = method.step(self.rhs, rest(self.end), times, method.init(0.0, start))
        assert state.outcome is Outcome.OK
        exact = self.solution(times)
        scale = np.max(np.abs(np.column_stack([start, exact])), axis=1, keepdims=True)
        return float(np.max(np.abs(x - exact) / scale))


def forced(t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    return np.array([x[0] * np.cos(t)])


def tracking(t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Prothero and Robinson (1974), Math. Comp. 28: relaxes to cos t at the rate 1e4."""
    return np.array([-1e4 * (x[0] - np.cos(t)) - np.sin(t)])


PROBLEMS = {
    "decay": Problem(lambda t, x, u: -2.0 * x, lambda t: np.exp(-2.0 * t)[None], 3.0),
    "oscillator": Problem(
        lambda t, x, u: np.array([x[1], -25.0 * x[0]]), lambda t: np.array([np.cos(5 * t), -5 * np.sin(5 * t)]), 8.0
    ),
    "logistic": Problem(lambda t, x, u: x * (1.0 - x), lambda t: (1.0 / (1.0 + 9.0 * np.exp(-t)))[None], 10.0),
    "forced": Problem(forced, lambda t: np.exp(np.sin(t))[None], 6.0),
    "tiny and huge": Problem(
        lambda t, x, u: np.array([-x[0], 1e12 * x[0]]),
        lambda t: np.array([1e-6 * np.exp(-t), 1e6 * (1 - np.exp(-t))]), 4.0,
    ),
    "tracking": Problem(tracking, lambda t: np.cos(t)[None], 5.0, stiff=True),
}  # fmt: skip


def scaled(method: str, problem: Problem) -> Adaptive:
    sizes = np.max(np.abs(problem.solution(np.linspace(0.0, problem.end, 50))), axis=1)
    return Adaptive(method, scale=tuple(sizes))


EXPLICIT, IMPLICIT = ("RK45", "DOP853"), ("LSODA", "Radau", "BDF")
PAIRS = [
    (method, name)
    for name, problem in PROBLEMS.items()
    for method in (IMPLICIT if problem.stiff else (*IMPLICIT, *EXPLICIT))
]


@pytest.mark.parametrize(("method", "name"), PAIRS)
def test_adaptive_methods_reach_known_solutions(method: str, name: str) -> None:
    problem = PROBLEMS[name]
    assert problem.error(scaled(method, problem)) < 1e-6


@pytest.mark.parametrize("name", [name for name, problem in PROBLEMS.items() if not problem.stiff])
def test_rk4_has_order_four(name: str) -> None:
    problem = PROBLEMS[name]
    errors = np.array([problem.error(RK4(substeps)) for substeps in (16, 32, 64)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(np.abs(orders - 4.0) < 0.3), orders


def test_rk4_is_exact_for_polynomials_of_degree_four_in_time() -> None:
    x, _ = RK4(1).step(lambda t, x, u: np.array([4 * t**3]), rest(2.0), np.array([2.0]), RK4().init(0.0, np.zeros(1)))
    np.testing.assert_allclose(x[0, 0], 16.0, rtol=1e-15)


def test_rk4_advances_a_batch_as_it_advances_one() -> None:
    start = np.random.default_rng(0).normal(size=(2, 5))
    rhs = PROBLEMS["oscillator"].rhs
    times = np.array([0.1, 0.3])
    batch, _ = RK4(3).step(rhs, rest(0.3), times, RK4().init(0.0, start))
    for m in range(5):
        one, _ = RK4(3).step(rhs, rest(0.3), times, RK4().init(0.0, start[:, m]))
        np.testing.assert_allclose(batch[..., m], one, rtol=1e-15)


@pytest.mark.parametrize("method", ["LSODA", "Radau", "BDF", "RK45"])
def test_a_solution_that_escapes_is_an_outcome(method: str) -> None:
    adaptive = Adaptive(method)
    times = np.array([0.5, 2.0])
    x, state = adaptive.step(lambda t, x, u: x**2, rest(2.0), times, adaptive.init(0.0, np.ones(1)))
    assert state.outcome is Outcome.DIVERGED
    assert state.time == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(x[0, 0], 2.0, rtol=1e-6)
    assert np.isnan(x[0, 1])


@pytest.mark.parametrize("method", ["LSODA", "Radau", "BDF", "RK45"])
def test_equations_that_stop_being_finite_are_an_outcome(method: str) -> None:
    def rhs(t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.array([np.nan if t > 1.0 else -1.0])

    adaptive = Adaptive(method, max_steps=100_000)
    _, state = adaptive.step(rhs, rest(2.0), np.array([2.0]), adaptive.init(0.0, np.ones(1)))
    assert state.outcome is Outcome.NON_FINITE
    _, state = adaptive.step(rhs, rest(2.0), np.array([2.0]), adaptive.init(1.5, np.ones(1)))
    assert (state.outcome, state.time) == (Outcome.NON_FINITE, 1.5)


def test_a_step_limit_is_an_outcome() -> None:
    adaptive = Adaptive("RK45", max_steps=20)
    _, state = adaptive.step(
        PROBLEMS["oscillator"].rhs, rest(8.0), np.array([8.0]), adaptive.init(0.0, np.array([1.0, 0.0]))
    )
    assert (state.outcome, state.steps) == (Outcome.STEP_LIMIT, 20)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"method": "Radu"}, "did you mean 'Radau'"),
        ({"rtol": 0.0}, "must be positive"),
        ({"atol": (1.0, -1.0)}, "must be positive"),
    ],
)
def test_bad_settings_are_told(settings: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Adaptive(**settings)  # type: ignore[arg-type]
