"""The gradient search: closed forms, bounds, noise levels, curvature and failures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.objective import Expansion, Objective, SearchOutcome, Terms
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings, gauss_newton

EXACT = GaussNewtonSettings(iterations=1000, tolerance=1e-15, difference=1e-5)


class Regression:
    """Residuals of a vector function as an objective, with unit noise."""

    def __init__(self, residuals: object, lower: np.ndarray, upper: np.ndarray) -> None:
        self.residuals, self.lower, self.upper = residuals, np.asarray(lower, float), np.asarray(upper, float)

    def terms(self, points: np.ndarray) -> Terms:
        with np.errstate(all="ignore"):
            z = self.residuals(points)
        return Terms(z, np.zeros(z.shape))

    def nll(self, points: np.ndarray) -> np.ndarray:
        return self.terms(points).sums()


class Sample:
    """A normal sample with its mean and its log standard deviation free."""

    def __init__(self, sample: np.ndarray) -> None:
        self.sample, self.lower, self.upper = sample[:, None], np.array([-50.0, -8.0]), np.array([50.0, 8.0])

    def terms(self, points: np.ndarray) -> Terms:
        mean, log_std = points
        return Terms((self.sample - mean) / np.exp(log_std), np.broadcast_to(log_std, (len(self.sample), len(mean))))

    def nll(self, points: np.ndarray) -> np.ndarray:
        return self.terms(points).sums()


class Added(Sample):
    """A normal sample whose variance is 1 and an unknown one, the log of whose root is free and known to be that."""

    noise_levels = np.array([True])

    def __init__(self, sample: np.ndarray) -> None:
        self.sample, self.lower, self.upper = sample[:, None], np.array([-9.0]), np.array([9.0])

    def terms(self, points: np.ndarray) -> Terms:
        log_std = 0.5 * np.log1p(np.exp(2.0 * points[0]))
        return Terms(self.sample / np.exp(log_std), np.broadcast_to(log_std, (len(self.sample), len(log_std))))


@pytest.mark.parametrize("start", [-9.0, -5.0, 0.0, 3.0])
def test_a_noise_among_others_is_found_from_next_to_nothing_in_a_few_steps(start: float) -> None:
    sample = 3.0 * np.random.default_rng(0).normal(size=400)
    state = gauss_newton(Added(sample), np.array([start]))
    assert state.outcomes == (SearchOutcome.CONVERGED,)
    assert np.exp(2.0 * state.points[0, 0]) == pytest.approx(np.mean(sample**2) - 1.0, rel=1e-5)
    assert state.iteration <= 4


def line(rows: int = 20, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, 3)), rng.normal(size=rows)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000))
def test_linear_least_squares_is_solved_in_closed_form(seed: int) -> None:
    matrix, right = line(seed=seed)
    problem = Regression(lambda x: right[:, None] - matrix @ x, np.full(3, -10.0), np.full(3, 10.0))
    state = gauss_newton(problem, np.array([3.0, -2.0, 1.0]), EXACT)
    np.testing.assert_allclose(state.points[:, 0], np.linalg.lstsq(matrix, right)[0], atol=1e-7)
    assert state.outcomes == (SearchOutcome.CONVERGED,)


def test_noise_level_and_mean_converge_to_the_maximum_likelihood() -> None:
    sample = np.random.default_rng(1).normal(3.0, 0.2, 400)
    starts = np.array([[-5.0, 3.1, 40.0], [3.0, -6.0, 0.0]])
    state = gauss_newton(Sample(sample), starts, EXACT)
    for column in range(3):
        np.testing.assert_allclose(state.points[:, column], [sample.mean(), np.log(sample.std())], atol=1e-7)
    assert state.iteration < 12


def test_differences_give_the_exact_gradient_and_information_also_at_a_bound() -> None:
    sample = np.random.default_rng(1).normal(3.0, 0.2, 50)
    problem = Sample(sample)
    problem.lower = np.array([2.5, -1.5])  # the point below lies on it
    mean, log_std = point = np.array([2.5, -1.5])
    (expansion,) = central_differences(problem, point[:, None], np.full((2, 1), 1e-5))
    z = (sample - mean) / np.exp(log_std)
    np.testing.assert_allclose(expansion.gradient, [-z.sum() / np.exp(log_std), 50 - (z**2).sum()], rtol=1e-6)
    np.testing.assert_allclose(expansion.information, np.diag([50 / np.exp(2 * log_std), 100.0]), rtol=1e-6, atol=1e-4)


def test_bounds_are_kept_and_the_rest_is_optimal_given_them() -> None:
    matrix, right = line()
    free = np.linalg.lstsq(matrix, right)[0]
    lower, upper = np.full(3, -10.0), np.full(3, 10.0)
    upper[0] = free[0] - 0.3
    seen = []

    def residuals(x: np.ndarray) -> np.ndarray:
        seen.append(x)
        return right[:, None] - matrix @ x

    state = gauss_newton(Regression(residuals, lower, upper), np.array([-9.0, 0.0, 9.0]), EXACT)
    assert state.outcomes == (SearchOutcome.CONVERGED,)
    rest = np.linalg.lstsq(matrix[:, 1:], right - upper[0] * matrix[:, 0])[0]
    np.testing.assert_allclose(state.points[:, 0], [upper[0], *rest], atol=1e-8)
    tried = np.concatenate(seen, axis=1)
    assert (tried >= lower[:, None]).all() and (tried <= upper[:, None]).all()


def test_a_coordinate_with_equal_bounds_stays() -> None:
    matrix, right = line()
    lower, upper = np.array([0.25, -10.0, -10.0]), np.array([0.25, 10.0, 10.0])
    problem = Regression(lambda x: right[:, None] - matrix @ x, lower, upper)
    state = gauss_newton(problem, np.array([9.0, 0.0, 0.0]), EXACT)
    rest = np.linalg.lstsq(matrix[:, 1:], right - 0.25 * matrix[:, 0])[0]
    np.testing.assert_allclose(state.points[:, 0], [0.25, *rest], atol=1e-8)


def test_several_starts_keep_apart_and_list_both_optima() -> None:
    problem = Regression(lambda x: np.array([x[0] ** 2 - 4.0, 0.1 * (x[0] - 2.0)]), [-5.0], [5.0])
    state = gauss_newton(problem, np.array([[-3.0, 3.0]]), EXACT)
    np.testing.assert_allclose(state.points[0], [-1.997, 2.0], atol=1e-2)
    assert state.best == 1
    alone = gauss_newton(problem, np.array([-3.0]), EXACT)
    assert alone.points[0, 0] == state.points[0, 0]


def test_a_curved_valley_is_followed_in_few_iterations() -> None:
    problem = Regression(lambda x: np.array([30.0 * (x[1] - x[0] ** 2), 1.0 - x[0]]), [-40.0] * 2, [40.0] * 2)
    state = gauss_newton(problem, np.array([-3.0, 9.0]), EXACT)
    np.testing.assert_allclose(state.points[:, 0], 1.0, atol=1e-7)
    assert state.iteration <= 8  # straight steps alone need 93


def test_failing_points_are_avoided() -> None:
    problem = Regression(lambda x: np.where(x > 1.0, np.nan, np.array(x) - 3.0), [-5.0], [5.0])
    state = gauss_newton(problem, np.array([-4.0]))
    assert 0.5 < state.points[0, 0] <= 1.0
    nowhere = gauss_newton(Regression(lambda x: x * np.nan, [-5.0], [5.0]), np.array([[1.0, 2.0]]))
    assert nowhere.outcomes == (SearchOutcome.NO_FINITE_POINT,) * 2


def test_a_gradient_from_elsewhere_takes_the_place_of_differences() -> None:
    matrix, right = line()
    calls = []

    def exact(objective: Objective, points: np.ndarray, steps: np.ndarray) -> tuple[Expansion, ...]:
        calls.append(points.shape[1])
        return tuple(Expansion(matrix.T @ (matrix @ point - right), matrix.T @ matrix, 1) for point in points.T)

    problem = Regression(lambda x: right[:, None] - matrix @ x, np.full(3, -10.0), np.full(3, 10.0))
    state = gauss_newton(problem, np.array([3.0, -2.0, 1.0]), EXACT, jacobian=exact)
    np.testing.assert_allclose(state.points[:, 0], np.linalg.lstsq(matrix, right)[0], atol=1e-8)
    assert set(calls) == {1}


def test_iteration_limit_is_an_outcome() -> None:
    problem = Regression(lambda x: np.array([1e3 * (x[1] - x[0] ** 2), 1.0 - x[0]]), [-5.0] * 2, [25.0] * 2)
    state = gauss_newton(problem, np.array([-3.0, 9.0]), replace(EXACT, iterations=2))
    assert state.outcomes == (SearchOutcome.ITERATION_LIMIT,) and state.iteration == 2


def test_a_start_that_gains_next_to_nothing_stalls() -> None:
    valley = Regression(lambda x: np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]]), np.full(2, -5.0), np.full(2, 5.0))
    starts = np.array([[-1.2, 1.0], [1.0, 1.0]])
    patient = gauss_newton(valley, starts, replace(EXACT, patience=3, least_gain=0.0))
    assert patient.outcomes == (SearchOutcome.CONVERGED,) * 2
    demanding = gauss_newton(valley, starts, replace(EXACT, patience=3, least_gain=100.0))
    assert demanding.outcomes == (SearchOutcome.STALLED, SearchOutcome.CONVERGED)
    assert demanding.iteration == 3 and demanding.values[0] < valley.nll(starts)[0]
    with pytest.raises(EstimationError, match="patience = -1"):
        GaussNewtonSettings(patience=-1)


def test_a_search_from_beside_a_wall_has_converged_there() -> None:
    """The draws of a swarm ended 1e-12 from a bound: what the full step promised, no step gained, "not smooth here"."""
    objective = Regression(
        lambda points: np.stack([points[0] - 1.0, 0.1 * (points[1] + 5.0), 1e4 + 0.0 * points[0]]), [-10, 0], [10, 10]
    )
    state = gauss_newton(objective, np.array([[1.0], [1e-12]]))
    assert state.outcomes == (SearchOutcome.CONVERGED,)
