"""Sums over blocks of time whose scatter is that of the long run."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.correct.fits.times import Times, term_times
from tests.correct.sled import fitted, pull, sled


def autoregression(rng: np.random.Generator, correlation: float, samples: int) -> np.ndarray:
    z = rng.standard_normal((samples, 1))
    for k in range(1, samples):
        z[k] = correlation * z[k - 1] + np.sqrt(1.0 - correlation**2) * z[k]
    return z


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_a_colour_that_outlasts_the_blocks_is_seen(correlation: float) -> None:
    """Blocks of 15 samples hold half of the long-run variance of a correlation of 0.9, which is (1 + a)/(1 - a)."""
    rng, samples = np.random.default_rng(3), 600
    times = Times(np.arange(samples), np.arange(samples) // 15, np.zeros(samples, dtype=int))
    found = [float(np.sum(times.sums(autoregression(rng, correlation, samples)) ** 2)) for _ in range(200)]
    assert np.mean(found) / samples == pytest.approx((1.0 + correlation) / (1.0 - correlation), rel=0.15)


def test_nothing_is_carried_from_one_log_to_the_next() -> None:
    series = np.array([[1.0], [1.0], [-1.0], [-1.0]])
    apart = Times(np.arange(4), np.arange(4), np.array([0, 0, 1, 1]))
    whole = Times(np.arange(4), np.arange(4), np.zeros(4, dtype=int))
    assert not np.allclose(apart.sums(series), whole.sums(series))
    assert np.abs(apart.sums(series)[0]) == pytest.approx(np.abs(apart.sums(series)[2]))


def test_terms_of_all_outputs_at_a_sample_share_its_time() -> None:
    base = fitted([pull(sled(), 1, samples=50, name="first"), pull(sled(), 2, samples=30, name="second")])
    times = term_times(base.problem, blocks=8)
    assert times.sample.tolist() == [*range(50), *range(50), *range(50, 80), *range(50, 80)]
    assert times.log.tolist() == [0] * 50 + [1] * 30
    assert times.block[49] < times.block[50] and times.block.max() in (7, 8)
