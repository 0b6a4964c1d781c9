"""Sigma points: moments, the usual weights, and factors of semi-definite matrices."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.errors import FilterError
from bondgraph.filter.sigma_points import MerweScaled, lower_factor, lower_factors
from bondgraph.simulate.outcome import Outcome

ALPHAS = (1e-3, 1e-2, 0.1, 0.5, 1.0)


def random_covariance(n: int, rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-2, 2, n)[:, np.newaxis]
    return root @ root.T + 1e-3 * np.diag(np.diag(root @ root.T))


@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_points_reproduce_mean_and_covariance(n: int, alpha: float) -> None:
    rng = np.random.default_rng(n)
    points = MerweScaled(n, alpha, beta=2.0, kappa=0.5)
    mean, cov = rng.normal(size=n), random_covariance(n, rng)
    scale = np.sqrt(np.diag(cov))
    moments = points.moments(points.draw(mean, lower_factor(cov).lower))
    np.testing.assert_allclose(moments.mean / scale, mean / scale, atol=1e-12 / alpha**2)
    np.testing.assert_allclose(moments.cov / np.outer(scale, scale), cov / np.outer(scale, scale), atol=1e-12 / alpha)


@settings(max_examples=60, deadline=None)
@given(
    n=st.integers(1, 6),
    alpha=st.floats(0.05, 1.5),
    beta=st.floats(0.0, 3.0),
    kappa=st.floats(-0.5, 3.0),
    seed=st.integers(0, 10**6),
)
def test_deviation_form_equals_the_usual_weights(n: int, alpha: float, beta: float, kappa: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = MerweScaled(n, alpha, beta, kappa)
    mixing = rng.normal(size=(3, n))
    drawn = points.draw(rng.normal(size=n), np.tril(rng.normal(size=(n, n))))
    moved = np.sin(mixing @ drawn) + (mixing @ drawn) ** 2
    moments = points.moments(moved)
    mean = moved @ points.mean_weights
    cov = (moved - mean[:, None]) @ np.diag(points.cov_weights) @ (moved - mean[:, None]).T
    size = np.max(np.abs(moved)) ** 2 / alpha**2
    np.testing.assert_allclose(moments.mean, mean, atol=1e-12 * size)
    np.testing.assert_allclose(moments.cov, cov, atol=1e-12 * size)


def test_cross_covariance_of_a_linear_map() -> None:
    rng = np.random.default_rng(2)
    points = MerweScaled(4, alpha=0.3)
    cov, matrix = random_covariance(4, rng), rng.normal(size=(3, 4))
    lower = lower_factor(cov).lower
    moments = points.moments(matrix @ points.draw(rng.normal(size=4), lower))
    np.testing.assert_allclose(points.cross_cov(lower, moments.deviations), cov @ matrix.T, rtol=1e-9)


def test_covariance_stays_semi_definite_where_the_usual_weights_do_not() -> None:
    """A strongly bent function and a small spread: the central weight is -1e6, the deviation form has none."""
    points = MerweScaled(3, alpha=1e-3, beta=2.0)
    drawn = points.draw(np.zeros(3), np.eye(3))
    moments = points.moments(np.vstack([drawn.sum(axis=0) ** 2, drawn.sum(axis=0) ** 2]))
    assert np.linalg.eigvalsh(moments.cov)[0] >= -1e-12 * np.linalg.eigvalsh(moments.cov)[1]


@pytest.mark.parametrize("n", [1, 4, 9])
def test_factor_of_a_definite_matrix_is_its_cholesky_factor(n: int) -> None:
    cov = random_covariance(n, np.random.default_rng(n))
    factor = lower_factor(cov, required=n)
    np.testing.assert_allclose(factor.lower, np.linalg.cholesky(cov), rtol=1e-7)
    assert (factor.floored, factor.outcome) == (0, Outcome.OK)


def test_factor_of_a_singular_matrix_floors_and_counts() -> None:
    root = np.array([[1.0, 0.0], [2.0, 1.0], [3.0, -1.0], [0.0, 0.0]])
    cov = root @ root.T
    factor = lower_factor(cov)
    np.testing.assert_allclose(factor.lower @ factor.lower.T, cov, atol=1e-12)
    assert (factor.floored, factor.outcome) == (1, Outcome.OK)  # the last row is known exactly, which is no loss


def test_factors_of_a_stack_are_those_one_by_one() -> None:
    rng = np.random.default_rng(7)
    roots = rng.standard_normal((6, 4, 4)) * [1.0, 1e-9, 1.0, 1e3]
    roots[3, :, 1] = 0.0
    matrices = roots @ np.swapaxes(roots, 1, 2)
    one_by_one = np.array([lower_factor(matrix).lower for matrix in matrices])
    assert lower_factors(matrices) == pytest.approx(one_by_one, rel=1e-9, abs=1e-12)
    matrices[2, 1, 1] = np.nan
    assert np.isnan(lower_factors(matrices)[2]).any()
    assert np.isfinite(lower_factors(matrices)[[0, 1, 3, 4, 5]]).all()


def test_factor_tells_what_is_wrong() -> None:
    assert lower_factor(np.array([[1.0, 2.0], [2.0, 1.0]]), required=2).outcome is Outcome.NOT_POSITIVE
    assert lower_factor(np.array([[1.0, 0.0], [np.nan, 1.0]])).outcome is Outcome.DIVERGED


@pytest.mark.parametrize(("alpha", "kappa"), [(0.0, 0.0), (-1.0, 0.0), (1.0, -3.0), (np.nan, 0.0)])
def test_impossible_spreads_are_refused(alpha: float, kappa: float) -> None:
    with pytest.raises(FilterError, match="alpha must be positive and kappa above minus the number of states"):
        MerweScaled(3, alpha=alpha, kappa=kappa)
