"""Score tests and their robust variance, on terms whose likelihood is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from bondgraph.correct.fits.times import Times
from bondgraph.correct.scores.score import robust_variance, scores
from bondgraph.errors import EstimationError
from bondgraph.estimate.objective import Expansion, expansion_of

FREE, CANDIDATES = 3, 5


def least_squares(x: np.ndarray, z: np.ndarray) -> Expansion:
    """Expansion of |z - x c|^2 / 2 at c = 0, with its terms."""
    return expansion_of(np.column_stack([z, -x]), np.zeros((z.size, 1 + x.shape[1])), 1)


def drawn(seed: int, samples: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Regressors and residuals from which the free parameters have taken their share."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((samples, FREE + CANDIDATES)) @ rng.standard_normal((FREE + CANDIDATES,) * 2)
    z = x @ rng.standard_normal(FREE + CANDIDATES) * 0.1 + rng.standard_normal(samples)
    return x, z - x[:, :FREE] @ np.linalg.lstsq(x[:, :FREE], z)[0]


@pytest.mark.parametrize("seed", range(3))
def test_a_linear_model_gains_by_a_refit_what_its_score_says(seed: int) -> None:
    x, z = drawn(seed)
    found = scores(least_squares(x, z), FREE, np.zeros(CANDIDATES, dtype=bool))
    for j in range(CANDIDATES):
        columns = [*range(FREE), FREE + j]
        solution, rest, *_ = np.linalg.lstsq(x[:, columns], z)
        assert found.gain[j] == pytest.approx(0.5 * (z @ z - rest[0]), rel=1e-9)
        assert found.step[j] == pytest.approx(solution[-1], rel=1e-9)
        assert found.follow[:, j] * found.step[j] == pytest.approx(solution[:-1], rel=1e-6, abs=1e-9)
        assert found.p_value[j] == pytest.approx(stats.chi2.sf(2.0 * found.gain[j], 1))


def test_a_candidate_that_free_parameters_can_imitate_has_no_score() -> None:
    x, z = drawn(4)
    x[:, FREE] = x[:, :FREE] @ np.array([1.0, -2.0, 0.5])
    found = scores(least_squares(x, z), FREE, np.zeros(CANDIDATES, dtype=bool))
    assert (found.gain[0], found.information[0], found.step[0], found.p_value[0]) == (0.0, 0.0, 0.0, 1.0)
    assert (found.gain[1:] > 0.0).all()


def test_candidates_that_differ_by_a_factor_and_free_parameters_are_the_same() -> None:
    x, z = drawn(5)
    x[:, FREE + 1] = -4.0 * x[:, FREE] + x[:, 0]
    found = scores(least_squares(x, z), FREE, np.zeros(CANDIDATES, dtype=bool))
    assert found.correlation[0, 1] == pytest.approx(-1.0, abs=1e-9)
    assert found.gain[0] == pytest.approx(found.gain[1], rel=1e-9)
    assert np.abs(found.correlation[0, 2:]).max() < 0.99


def test_a_one_sided_candidate_gains_only_with_its_own_sign() -> None:
    x, z = drawn(6)
    both = scores(least_squares(x, z), FREE, np.zeros(CANDIDATES, dtype=bool))
    one = scores(least_squares(x, z), FREE, np.ones(CANDIDATES, dtype=bool))
    assert {True, False} == set((both.step > 0.0).tolist())
    assert one.gain.tolist() == np.where(both.step > 0.0, both.gain, 0.0).tolist()
    assert (one.p_value[both.step < 0.0] == 1.0).all()


def timed(samples: int, block: int) -> Times:
    """Times of one output over one log."""
    return Times(np.arange(samples), np.arange(samples) // block, np.zeros(samples, dtype=int))


def coloured(rng: np.random.Generator, correlation: float, samples: int) -> np.ndarray:
    z = rng.standard_normal(samples)
    for k in range(1, samples):
        z[k] = correlation * z[k - 1] + np.sqrt(1.0 - correlation**2) * z[k]
    return z


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.8, 0.95])
def test_block_sandwich_variance_is_that_of_the_mean_of_coloured_noise(correlation: float) -> None:
    """Var(mean) of a first-order autoregression is (1 + a) / (1 - a) / n in the limit; Box, Jenkins, Reinsel (2008)."""
    rng, samples = np.random.default_rng(1), 2000
    times = timed(samples, 50)
    expansions = [least_squares(np.ones((samples, 1)), coloured(rng, correlation, samples)) for _ in range(150)]
    estimated = np.mean([robust_variance(expansion, times)[0, 0] for expansion in expansions])
    assert estimated == pytest.approx((1.0 + correlation) / (1.0 - correlation) / samples, rel=0.12)
    naive = np.mean([1.0 / expansion.information[0, 0] for expansion in expansions])
    assert naive == pytest.approx(1.0 / samples)


def test_coloured_noise_deceives_the_naive_test_and_not_the_robust_one() -> None:
    rng, samples, level = np.random.default_rng(2), 1200, 0.05
    times = timed(samples, 30)
    wave = np.sin(np.arange(samples) / 60.0)[:, np.newaxis]
    alarms = np.zeros(2)
    for _ in range(300):
        expansion = least_squares(wave, coloured(rng, 0.8, samples))
        naive, robust = (scores(expansion, 0, np.array([False]), own).p_value[0] for own in (None, times))
        alarms += (naive < level, robust < level)
    assert alarms[0] / 300 > 0.3
    assert alarms[1] / 300 < 0.10


def test_robust_tests_need_terms() -> None:
    bare = Expansion(np.zeros(1), np.eye(1), 1)
    with pytest.raises(EstimationError, match="needs the terms"):
        robust_variance(bare, timed(1, 1))
