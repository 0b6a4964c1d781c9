"""NIS inside its band and white innovations on simulated truth; outside where the filter is wrong."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from bondgraph.errors import FilterError
from bondgraph.filter import whiteness
from bondgraph.filter.consistency import consistency, nis_band, normalised_innovations, whiteness_p
from bondgraph.filter.runs import run
from bondgraph.filter.whiteness import ljung_box
from tests.filter.logs import circuit_filter, driveline_filter, pendulum_filter, simulated_log


@pytest.mark.parametrize("make", [circuit_filter, pendulum_filter, driveline_filter])
def test_a_right_filter_is_consistent(make) -> None:
    """Seeded; bands of 99.9 %, since three models times several channels are looked at."""
    model = make()
    filtered = run(model, simulated_log(model, np.arange(1000) * 0.02, seed=11))
    result = consistency(filtered, confidence=0.999)
    assert result.nis_band[0] < result.nis_mean < result.nis_band[1]
    for channel in result.channels:
        assert channel.nis_band[0] < channel.nis_mean < channel.nis_band[1], channel
        assert channel.whiteness_p > 1e-3, channel
        assert channel.count == 1000


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_wrong_noise_is_found(factor: float) -> None:
    model = pendulum_filter()
    log = simulated_log(model, np.arange(1500) * 0.02, seed=12)
    wrong = replace(model, measurement_noise={"deflection": 0.05 * factor})
    result = consistency(run(wrong, log), confidence=0.999)
    assert (result.nis_mean < result.nis_band[0]) == (factor > 1)
    assert (result.nis_mean > result.nis_band[1]) == (factor < 1)


def test_a_wrong_parameter_colours_the_innovations() -> None:
    model = pendulum_filter(process_noise={"rate": 0.02})
    log = simulated_log(model, np.arange(800) * 0.02, seed=13)
    theta = model.model.theta(length=1.3)
    assert consistency(run(model, log)).channel("deflection").whiteness_p > 1e-3
    assert consistency(run(model, log, theta)).channel("deflection").whiteness_p < 1e-6


def test_missing_values_are_left_out() -> None:
    model = driveline_filter()
    log = simulated_log(model, np.arange(200) * 0.02, seed=14)
    log.y[0, ::2] = np.nan
    log.y[1] = np.nan
    filtered = run(model, log)
    result = consistency(filtered)
    assert [(channel.name, channel.count) for channel in result.channels] == [
        ("engine_speed", 100),
        ("acceleration", 200),
    ]
    assert result.nis_mean == pytest.approx(np.nansum(filtered.nis) / 300)
    assert np.isnan(normalised_innovations(filtered)[1]).all()
    with pytest.raises(FilterError, match="no innovations of 'wheel_speed' - measured were engine_speed, acceleration"):
        result.channel("wheel_speed")


def test_a_single_channel_has_the_nis_of_the_filter() -> None:
    model = pendulum_filter()
    filtered = run(model, simulated_log(model, np.arange(50) * 0.02, seed=15))
    np.testing.assert_allclose(normalised_innovations(filtered)[0] ** 2, filtered.nis, rtol=1e-9)


def test_the_band_holds_the_mean_as_often_as_it_says() -> None:
    rng = np.random.default_rng(16)
    means = np.mean(rng.standard_normal((4000, 30)) ** 2, axis=1)
    low, high = nis_band(30, 30, confidence=0.9)
    assert np.mean((means > low) & (means < high)) == pytest.approx(0.9, abs=0.02)


def test_whiteness_p_is_uniform_for_white_series() -> None:
    rng = np.random.default_rng(17)
    holes = rng.random((1000, 300)) < 0.3
    values = np.array([whiteness_p(series) for series in np.where(holes, np.nan, rng.standard_normal((1000, 300)))])
    for share in (0.05, 0.5, 0.95):
        assert np.mean(values < share) == pytest.approx(share, abs=0.05)
    assert np.isnan(whiteness_p(np.array([1.0, 2.0, np.nan])))


def test_a_sensor_at_odd_times_of_a_long_log_is_left_out_at_once() -> None:
    # each of 400 000 lags was looked at in turn, since none ever has enough pairs: over a minute
    rng = np.random.default_rng(0)
    series = np.where(rng.random(400_000) < 0.1, rng.standard_normal(400_000), np.nan)
    started = time.monotonic()
    assert ljung_box(series) == (0.0, 0) and time.monotonic() - started < 20.0


def test_whiteness_of_a_slow_sensor_is_judged_at_the_lags_it_has() -> None:
    rng = np.random.default_rng(3)
    below = 0
    for _ in range(200):
        series = np.full(800, np.nan)
        series[::8] = rng.standard_normal(100)
        below += whiteness_p(series) < 0.1
    assert 8 <= below <= 36
    series[::8] = np.convolve(rng.standard_normal(102), [1.0, 1.0, 1.0], "valid")
    assert whiteness_p(series) < 1e-3


def test_a_confidence_that_is_none_is_refused() -> None:
    model = pendulum_filter()
    with pytest.raises(FilterError, match=r"confidence=95 is no probability"):
        consistency(run(model, simulated_log(model, np.arange(5) * 0.02, seed=1)), confidence=95)


@pytest.mark.parametrize("every", [1, 3, 97])
def test_lags_are_counted_alike_one_by_one_and_all_at_once(every: int, monkeypatch: pytest.MonkeyPatch) -> None:
    series = np.full(3000, np.nan)
    series[::every] = np.random.default_rng(1).standard_normal(series[::every].size)
    series[100:130] = np.nan
    found = ljung_box(series)
    monkeypatch.setattr(whiteness, "_SHORTEST_LAGS", 0)
    assert ljung_box(series) == found
