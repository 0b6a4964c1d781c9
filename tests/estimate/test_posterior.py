"""Draws from a posterior that is known, their form, and how they end."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.errors import OptionError
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.posterior import PosteriorOutcome, sample_posterior
from bondgraph.estimate.problem import pose
from bondgraph.estimate.result import Estimate
from tests.estimate.lag_covariance import covariance, one_sensor, pushed, unit_course

pytest.importorskip("emcee")
ONE = Settings(method="gradient", starts=1, certify="none")


def fitted(lower: float = 0.2) -> Estimate:
    log = pushed()
    log.y[0] = 1.1 * unit_course(log)
    return estimate(pose(one_sensor(), log, [FreeParameter("gain", lower, 5.0, 1.5)], initial="model"), ONE)


@pytest.mark.slow
def test_draws_of_a_gain_are_those_of_its_normal_law() -> None:
    """Measurements are N(gain h, V): the posterior is normal with the variance 1/(h' V^-1 h)."""
    course = unit_course(pushed())
    std = 1.0 / np.sqrt(course @ np.linalg.solve(covariance(pushed()), course))
    # rounding differs by machine, and with it the walk: twice the draws that fifty autocorrelation times took
    found = sample_posterior(fitted(), 4000, burn=100, walkers=8, seed=1)
    values = found.draws.ravel()
    error = 4.0 / np.sqrt(float(found.effective[0]))
    assert found.outcome is PosteriorOutcome.LONG_ENOUGH
    assert abs(values.mean() - 1.1) < error * std
    assert values.std(ddof=1) == pytest.approx(std, rel=error)
    # a quantile of 2.5 % of n draws has the standard error 2.67/sqrt(n)
    ends = np.quantile(values, [0.025, 0.975])
    np.testing.assert_allclose(ends, 1.1 + np.array([-1.96, 1.96]) * std, atol=2.67 * error * std)


def test_draws_stay_inside_bounds_and_repeat_with_their_seed() -> None:
    fit = fitted(lower=1.09)
    first, again, other = (sample_posterior(fit, 30, burn=5, seed=seed) for seed in (2, 2, 3))
    assert first.draws.min() >= 1.09
    np.testing.assert_array_equal(first.draws, again.draws)
    assert (first.draws != other.draws).any()
    assert first.outcome is PosteriorOutcome.TOO_SHORT and "take more steps" in first.summary()


def test_arviz_gets_chains_and_draws_by_name() -> None:
    pytest.importorskip("arviz_base")
    found = sample_posterior(fitted(), 20, burn=5)
    tree = found.to_inference_data()
    assert tree["posterior"]["gain"].shape == found.draws.shape[:2]
    np.testing.assert_array_equal(tree["posterior"]["gain"].values, found.draws[:, :, 0])
    np.testing.assert_array_equal(tree["sample_stats"]["lp"].values, found.log_density)
    assert found.to_dataframe().shape == (found.draws[:, :, 0].size, 1)


def test_impossible_wishes_are_refused() -> None:
    with pytest.raises(OptionError, match="an even number of walkers"):
        sample_posterior(fitted(), 10, walkers=3)
    found = sample_posterior(fitted(), 5, burn=0)
    with pytest.raises(OptionError, match="no parameter 'gian'"):
        found.plot("gian")
