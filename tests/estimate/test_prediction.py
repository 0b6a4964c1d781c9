"""Prediction bands against a closed form, against draws, and by how often they hold the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.errors import OptionError
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.prediction import predict
from bondgraph.estimate.problem import pose
from bondgraph.estimate.result import Estimate
from bondgraph.filter.filter_model import FilterModel
from tests.estimate.lag_covariance import STD, one_sensor, pushed, unit_course

ONE = Settings(method="gradient", starts=1, certify="none")
GAIN = FreeParameter("gain", 0.2, 5.0, 1.0)


def exact() -> FilterModel:
    """The lag without process noise, its start known."""
    return one_sensor(process_noise={}, initial_std={})


def noisy(seed: int, gain: float = 1.0) -> MatchedLog:
    log = pushed()
    speed = gain * unit_course(log) + STD * np.random.default_rng(seed).normal(size=len(log))
    return replace(log, y=np.array([speed, np.full(len(log), np.nan)]))


def fitted(seed: int, free: list[str | FreeParameter]) -> Estimate:
    return estimate(pose(exact(), noisy(seed), free, initial="model"), ONE)


def test_the_band_of_a_gain_is_its_deviation_times_the_course() -> None:
    fit = fitted(1, [GAIN])
    other = pushed("other", seed=2)
    (band,) = predict(fit, other)
    np.testing.assert_allclose(band.std[0], fit.std["gain"] * np.abs(unit_course(other)), rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(band.y[0], fit.values["gain"] * unit_course(other), rtol=1e-6, atol=1e-9)
    lower, upper = band.interval(0.95, measured=True)
    np.testing.assert_allclose((upper - lower)[0], 2 * 1.959964 * np.hypot(band.std[0], STD), rtol=1e-6)


def test_a_band_reaches_what_is_tied() -> None:
    """Gain twice a number that the model does not have, which only its tie carries into the simulation."""
    half = FreeParameter("half", 0.1, 2.5, 0.5)
    fit = estimate(pose(exact(), noisy(1), [half], initial="model", ties={"gain": "2*half"}), ONE)
    other = pushed("other", seed=2)
    (band,) = predict(fit, other)
    np.testing.assert_allclose(band.y[0], 2 * fit.values["half"] * unit_course(other), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(band.std[0], 2 * fit.std["half"] * np.abs(unit_course(other)), rtol=1e-6, atol=1e-12)


def test_the_delta_method_agrees_with_draws() -> None:
    fit = fitted(1, ["mass", "drag"])
    (delta,), (drawn,) = predict(fit), predict(fit, draws=4000, seed=3)
    later = slice(5, None)
    # four standard errors of a deviation of so many draws
    np.testing.assert_allclose(drawn.std[0, later], delta.std[0, later], rtol=4.0 / np.sqrt(2 * 4000) + 0.02)
    np.testing.assert_allclose(drawn.y[0], delta.y[0], atol=0.1 * float(delta.std[0].max()))


def test_bands_hold_the_true_course_as_often_as_they_say() -> None:
    """Of 40 logs with other noise; fewer than 34 of 40 would be one chance in a hundred and fifty."""
    truth, held = unit_course(pushed()), 0
    for seed in range(40):
        (band,) = predict(fitted(seed, [GAIN]))
        lower, upper = band.interval(0.95)
        held += bool(lower[0, -1] <= truth[-1] <= upper[0, -1])
    assert 34 <= held <= 40


def test_a_parameter_that_the_data_do_not_tell_leaves_the_band_of_what_they_do() -> None:
    """Mass, drag and gain act as two ratios only: none is known, yet the course is."""
    (band,) = predict(fitted(1, ["mass", "drag", "gain"]))
    assert np.isfinite(band.std[0]).all() and band.std[0].max() < STD


def test_tables_pictures_and_names() -> None:
    fit = fitted(1, [GAIN])
    (band,) = predict(fit)
    assert list(band.to_dataframe().columns)[:2] == ["speed [m/s]", "std(speed) [m/s]"]
    assert band.plot("speed").get_ylabel() == "speed [m/s]"
    with pytest.raises(OptionError, match="did you mean 'speed'"):
        band.plot("sped")
    with pytest.raises(OptionError, match="a share between 0 and 1"):
        band.interval(95.0)
