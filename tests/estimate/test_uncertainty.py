"""Covariances, profiles, and the naming of what data cannot tell apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.objective import Expansion, Terms
from bondgraph.estimate.profile import profile_interval
from bondgraph.estimate.uncertainty import UncertaintyOutcome, uncertainty, weak_groups


class Quadratic:
    """A parabola with a given Hessian, as a sum of squares of its factor's rows."""

    def __init__(self, hessian: np.ndarray, reach: float = 50.0) -> None:
        self.factor = np.linalg.cholesky(hessian).T
        self.lower, self.upper = np.full(len(hessian), -reach), np.full(len(hessian), reach)

    def terms(self, points: np.ndarray) -> Terms:
        z = self.factor @ points
        return Terms(z, np.zeros(z.shape))

    def nll(self, points: np.ndarray) -> np.ndarray:
        return self.terms(points).sums()


def random_hessian(seed: int, size: int = 4) -> np.ndarray:
    factor = np.random.default_rng(seed).normal(size=(size, size)) * 10.0 ** np.arange(size)
    return factor.T @ factor + np.diag(10.0 ** (2 * np.arange(size)))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), wrong=st.floats(0.3, 3.0))
def test_covariance_is_the_inverse_curvature_whatever_the_fisher_information(seed: int, wrong: float) -> None:
    hessian = random_hessian(seed)
    # The Fisher information only scales the differences; a wrong one must not change the result.
    expansion = Expansion(np.zeros(4), wrong * hessian + np.diag(np.diag(hessian)), 0)
    known = uncertainty(Quadratic(hessian), np.zeros(4), expansion)
    assert known.outcome is UncertaintyOutcome.CURVATURE
    np.testing.assert_allclose(known.covariance @ hessian, np.eye(4), atol=1e-5)
    assert known.evaluations == 1 + 4 + 4**2


def test_a_likelihood_with_jumps_is_told_from_a_smooth_one() -> None:
    class Stepped(Quadratic):
        """Derivatives are those of the bowl wherever they exist; a jump of 0.1 nats lies next to its lowest point."""

        def nll(self, points: np.ndarray) -> np.ndarray:
            return super().nll(points) + 0.1 * (points[1] > 1e-9)

    hessian = np.diag([4.0, 25.0])
    away = np.array([0.05, 0.0])
    expansion = Expansion(hessian @ away, hessian, 0)
    smooth = uncertainty(Quadratic(hessian), away, expansion)
    assert smooth.roughness < 1e-9
    rough = uncertainty(Stepped(hessian), away, expansion)
    # half of the jump over the reach of 0.3 standard deviations
    assert rough.roughness == pytest.approx(0.05 / 0.3, rel=1e-6)
    assert np.isnan(uncertainty(Stepped(hessian), away, expansion, curvature=False).roughness)


def test_without_curvature_the_fisher_information_counts() -> None:
    class Saddle(Quadratic):
        def nll(self, points: np.ndarray) -> np.ndarray:
            return points[0] ** 2 - points[1] ** 2

    expansion = Expansion(np.zeros(2), np.diag([4.0, 25.0]), 0)
    known = uncertainty(Saddle(np.eye(2)), np.zeros(2), expansion)
    assert known.outcome is UncertaintyOutcome.FISHER
    np.testing.assert_allclose(known.covariance, np.diag([0.25, 0.04]))
    asked = uncertainty(Quadratic(np.eye(2)), np.zeros(2), expansion, curvature=False)
    assert asked.outcome is UncertaintyOutcome.FISHER and asked.evaluations == 0
    broken = uncertainty(Quadratic(np.eye(2)), np.zeros(2), Expansion(np.zeros(2), np.full((2, 2), np.nan), 0))
    assert broken.outcome is UncertaintyOutcome.NOT_AVAILABLE and np.isnan(broken.covariance).all()


def test_a_coordinate_at_its_bound_is_marked_and_the_others_are_conditional() -> None:
    hessian = np.array([[4.0, 1.0], [1.0, 9.0]])
    objective = Quadratic(hessian)
    objective.lower[0] = 0.0
    known = uncertainty(objective, np.zeros(2), Expansion(np.zeros(2), hessian, 0))
    assert known.at_bound.tolist() == [True, False]
    assert known.covariance[1, 1] == pytest.approx(1.0 / 9.0)
    assert known.covariance[0, 1] == 0.0
    assert known.covariance[0, 0] == pytest.approx(np.linalg.inv(hessian)[0, 0])


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), noise=st.floats(0.0, 1e-9))
def test_groups_do_not_depend_on_the_basis_of_weak_directions(seed: int, noise: float) -> None:
    # Of six coordinates, 0 and 3 act only together, 2 and 5 only together, 4 not at all.
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(20, 6))
    rows[:, 3], rows[:, 5], rows[:, 4] = rows[:, 0], -2.0 * rows[:, 2], 0.0
    information = 1e5 * rows.T @ rows
    assert weak_groups(information * (1.0 + noise * rng.normal())) == ((0, 3), (2, 5), (4,))


@pytest.mark.parametrize("share", [0.07, 0.02])
def test_a_small_share_of_what_is_not_told_at_all_leaves_a_coordinate_unknown(share: float) -> None:
    # Two compartments of which one is measured: the rate a21 moves by 7 % along the line that the data do not tell. It
    # was taken as known, its standard deviation that of the other directions alone.
    direction = np.array([-1.0, 1.0, share, 0.0]) / np.sqrt(2.0 + share**2)
    rows = np.random.default_rng(0).normal(size=(60, 4))
    rows -= np.outer(rows @ direction, direction)
    information = 1e10 * rows.T @ rows
    assert weak_groups(information) == ((0, 1, 2),)
    # Where the line is told to within the bounds, though not the pair on it, a share of it is known.
    assert weak_groups(information + 3.0 * np.outer(direction, direction)) == ((0, 1),)


def test_nearly_collinear_parameters_keep_the_digits_of_their_deviations() -> None:
    # As in Bennett5 of NIST; by eigenvalues, which are right to the rounding of the largest, they were 2e-5 off.
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(150, 1)) + 1e-4 * rng.normal(size=(150, 3))
    rows = 1e5 * rows * np.array([1.0, 10.0, 100.0])
    inverse = np.linalg.inv(np.linalg.qr(rows)[1])
    wide = Quadratic(np.eye(3), reach=1.0)
    known = uncertainty(wide, np.zeros(3), Expansion(np.zeros(3), rows.T @ rows, 0), curvature=False)
    expected = np.sqrt((inverse**2).sum(axis=1))
    np.testing.assert_allclose(np.sqrt(np.diag(known.covariance)), expected, rtol=1e-6)


def test_weak_coordinates_get_no_variance_and_the_others_keep_theirs() -> None:
    rows = np.random.default_rng(0).normal(size=(20, 3))
    rows[:, 1] = rows[:, 0]
    information = rows.T @ rows * 100.0

    class Flat(Quadratic):
        def terms(self, points: np.ndarray) -> Terms:
            z = 10.0 * rows @ points
            return Terms(z, np.zeros(z.shape))

    known = uncertainty(Flat(np.eye(3), reach=1.0), np.zeros(3), Expansion(np.zeros(3), information, 0))
    assert known.groups == ((0, 1),)
    assert np.isnan(known.covariance[:2]).all()
    merged = np.array([[rows[:, 0] @ rows[:, 0] * 2, rows[:, 0] @ rows[:, 2]], [0, rows[:, 2] @ rows[:, 2]]]) * 100.0
    merged[1, 0] = merged[0, 1]
    expected = np.linalg.inv(np.array([[merged[0, 0] / 2, merged[0, 1]], [merged[0, 1], merged[1, 1]]]))[1, 1]
    assert known.covariance[2, 2] == pytest.approx(expected, rel=1e-6)


def test_profiles_of_a_parabola_are_its_wald_intervals() -> None:
    hessian = random_hessian(3, size=3)
    objective = Quadratic(hessian)
    std = float(np.sqrt(np.linalg.inv(hessian)[1, 1]))
    for guess in (std, 0.1 * std, 5.0 * std):
        interval = profile_interval(objective, np.zeros(3), 1, guess)
        assert (interval.lower, interval.upper) == pytest.approx((-1.959964 * std, 1.959964 * std), rel=2e-3)
    narrow = profile_interval(objective, np.zeros(3), 1, std, level=0.68)
    assert narrow.upper == pytest.approx(0.994458 * std, rel=2e-3)


def test_profiles_follow_a_skewed_likelihood_and_end_at_bounds() -> None:
    # Exponential sample: nll = n (log m + mean / m); its profile ends are known to be skewed.
    class Exponential:
        lower, upper = np.array([0.1]), np.array([10.0])

        def nll(self, points: np.ndarray) -> np.ndarray:
            return 20.0 * (np.log(points[0]) + 1.0 / points[0])

        def terms(self, points: np.ndarray) -> Terms:
            root = np.sqrt(2.0 * np.maximum(self.nll(points) - 20.0, 0.0))
            return Terms(np.sign(points - 1.0) * root, np.zeros(points.shape))

    interval = profile_interval(Exponential(), np.array([1.0]), 0, std=1.0 / np.sqrt(20.0))
    for end in (interval.lower, interval.upper):
        assert Exponential().nll(np.array([[end]]))[0] - 20.0 == pytest.approx(1.92073, abs=5e-3)
    assert interval.upper - 1.0 > 1.3 * (1.0 - interval.lower)
    tight = Exponential()
    tight.upper = np.array([1.2])
    assert profile_interval(tight, np.array([1.0]), 0, std=0.2).upper == 1.2
    with pytest.raises(EstimationError, match="the first must be above zero, the second"):
        profile_interval(tight, np.array([1.0]), 0, std=float("nan"))


def test_fisher_information_from_differences_is_that_of_the_parabola() -> None:
    hessian = random_hessian(5)
    (expansion,) = central_differences(Quadratic(hessian), np.ones((4, 1)), np.full((4, 1), 1e-4))
    np.testing.assert_allclose(expansion.information, hessian, rtol=1e-8)
    np.testing.assert_allclose(expansion.gradient, hessian @ np.ones(4), rtol=1e-8)
