"""A model that does not explain a log is reported, one that is right is not: power and false alarms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.build import build
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.initial import initial_states
from bondgraph.estimate.setup import filter_setup
from bondgraph.filter.consistency import consistency, innovation_tests, joined_innovations, misfits
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.misfit import ChannelInnovations, channel_misfits
from bondgraph.filter.robust import Robust
from bondgraph.filter.runs import run
from bondgraph.filter.whiteness import first_autocorrelation
from bondgraph.report.misfits import filter_sentences
from bondgraph.simulate.example import pendulum
from bondgraph.simulate.simulation import simulate
from vehicle_graphs.driveline import driveline

NOISE = 0.02


def _log(seed: int, theta: dict[str, float] | None = None, samples: int = 150, noise: float = NOISE) -> MatchedLog:
    """A pendulum that swings from a start drawn from the prior, and its measured deflection."""
    rng = np.random.default_rng(seed)
    start = np.array([0.5, 0.0]) + 0.1 * rng.standard_normal(2)
    truth = simulate(pendulum(), 0.05 * np.arange(samples), None, theta, start, method="rk4", substeps=2)
    return MatchedLog(f"run{seed}", truth.time, truth.u, truth.y + noise * rng.standard_normal(truth.y.shape))


def _filter(noise: float = NOISE) -> FilterModel:
    return FilterModel(pendulum(), {}, {"deflection": noise}, {"angle": 0.1, "rate": 0.1}, substeps=2)


def test_a_right_model_is_reported_no_more_often_than_stated() -> None:
    """At a level of 0.2 there is a chance of 0.005 that more than 30 of 100 right models are reported."""
    runs = [run(_filter(), _log(seed)) for seed in range(100)]
    assert not any(one.misfits for one in runs)
    assert sum(bool(misfits([one], level=0.2)) for one in runs) <= 30
    assert not misfits(runs)


@pytest.mark.parametrize("samples", [20, 60, 100, 300, 1000])
def test_white_innovations_are_rejected_no_more_often_than_stated(samples: int) -> None:
    """The chi-square of the portmanteau statistic alone rejects 2.5 times too often at 0.01 for 100 values."""
    rng = np.random.default_rng(samples)
    series = rng.standard_normal((4000, 2, samples))
    rejected = 0
    for rows in series:
        channels = [ChannelInnovations(f"y{k}", "1", row, row) for k, row in enumerate(rows)]
        rejected += bool(channel_misfits(channels, ("run",), {}, level=0.02))
    assert rejected <= 0.02 * 4000 + 3 * np.sqrt(0.02 * 4000)


def test_a_wrong_parameter_is_reported_with_its_error_and_noise() -> None:
    (found,) = run(_filter(), _log(1, {"length": 1.3})).misfits
    assert found.is_coloured and found.is_large and found.channel == "deflection" and found.logs == ("run1",)
    assert found.whiteness_p < 1e-20 and found.error == pytest.approx(found.ratio * NOISE)
    assert str(found).startswith("run1: deflection: one-step error 0.") and "times its noise 0.02 m" in str(found)
    assert str(found).endswith("the model does not explain this log")


def test_noise_that_is_larger_than_declared_is_reported_as_that_and_smaller_is_none() -> None:
    (found,) = run(_filter(), _log(2, noise=2 * NOISE)).misfits
    assert found.is_large and not found.is_coloured and 3.0 < found.nis_mean < 5.0
    assert "coloured" not in str(found)
    assert not run(_filter(), _log(2, noise=0.3 * NOISE)).misfits


@pytest.mark.parametrize("kind", ["student", "gate"])
def test_outliers_that_a_robust_filter_weighs_are_no_error_of_a_channel(kind: str) -> None:
    """Three readings of 50 sigma in 150 are seven times the noise in a mean of squares."""
    log, robust = _log(1), replace(_filter(), robust=Robust(kind))
    y = log.y.copy()
    y[0, [40, 80, 120]] += 50.0 * NOISE
    (clean,), (struck,) = (joined_innovations([run(robust, one)]) for one in (log, replace(log, y=y)))
    assert struck.rmse == pytest.approx(clean.rmse, rel=0.15)
    assert clean.rmse == pytest.approx(NOISE, rel=0.2)
    assert not run(robust, replace(log, y=y)).misfits


def test_colour_that_contradicts_nothing_is_said_with_its_size() -> None:
    """A page said that no channel contradicts the model beside a whiteness of p < 1e-100."""
    eager = replace(_filter(), process_noise={"rate": 1.0})
    (one,) = innovation_tests([run(eager, _log(4, samples=1500))])
    assert not one.contradicts and one.whiteness_p < 1e-30 and -0.5 < one.autocorrelation < -0.3
    first, colour = filter_sentences([one])
    assert first == "No channel contradicts the model."
    assert f"first autocorrelation {one.autocorrelation:.2g}: after an error the next one takes back" in colour
    assert "noises that are taken too large" in colour and f"NIS {one.nis_mean:.2g}" in colour
    (white,) = innovation_tests([run(_filter(), _log(4, samples=1500))])
    assert filter_sentences([white]) == ["No channel contradicts the model."]
    rare = replace(white, whiteness_p=1e-5)
    assert "which chance alone brings in one of 506 channels" in filter_sentences([rare])[1]


def test_the_first_autocorrelation_is_that_of_neighbouring_readings() -> None:
    chance = np.random.default_rng(3).standard_normal(6001)
    series = chance[1:] - 0.5 * chance[:-1]
    slow = np.full(5 * series.size, np.nan)
    slow[::5] = series
    assert first_autocorrelation(series) == pytest.approx(-0.4, abs=0.04)
    assert first_autocorrelation(slow) == pytest.approx(first_autocorrelation(series), rel=1e-3)
    assert np.isnan(first_autocorrelation(np.full(9, np.nan))) and np.isnan(first_autocorrelation(np.ones(9)))


def test_a_noise_widened_to_the_misfit_does_not_hide_it() -> None:
    wide = run(_filter(0.2), _log(3, {"length": 1.3}))
    (found,) = misfits([wide], noise={"deflection": NOISE})
    assert found.is_coloured and found.noise == NOISE and found.ratio > 3.0


def test_logs_are_joined_without_correlation_across_their_ends() -> None:
    runs = [run(_filter(), _log(seed, samples=40)) for seed in range(3)]
    (joined,) = joined_innovations(runs)
    assert joined.count == 120
    np.testing.assert_array_equal(
        joined.errors[~np.isnan(joined.errors)], np.concatenate([r.innovation[0] for r in runs])
    )
    gap = np.flatnonzero(np.isnan(joined.errors))
    assert gap[0] == 40 and gap.size == 150


def test_many_channels_share_the_level() -> None:
    """One channel at a p-value of 0.002 is a misfit alone at 0.02, but none among twenty."""
    rng = np.random.default_rng(5)
    white = rng.standard_normal((20, 200))
    from scipy.special import gammainccinv

    white[0] *= np.sqrt(2.0 * gammainccinv(100.0, 0.002) / np.sum(white[0] ** 2))
    channels = [ChannelInnovations(f"y{k}", "1", row, row) for k, row in enumerate(white)]
    assert [one.channel for one in channel_misfits(channels[:1], ("run",), {}, level=0.02)] == ["y0"]
    assert channel_misfits(channels, ("run",), {}, level=0.02) == ()


def _driven(seed: int, theta: dict[str, float] | None = None) -> tuple[FilterModel, MatchedLog, np.ndarray]:
    """A driveline without process noise, its sensors 1 % noisy, filtered with noises guessed from the log alone."""
    built = build(driveline())
    rng, time = np.random.default_rng(seed), 0.02 * np.arange(600)
    u = np.zeros((len(built.model.inputs), time.size))
    u[0] = 20.0 + 15.0 * np.sin(1.3 * time) + 10.0 * np.sign(np.sin(0.9 * time))
    truth = simulate(built.model, time, u, theta, compiled=True)
    noise = 0.01 * np.std(truth.y, axis=1, keepdims=True)
    log = MatchedLog("run", time, u, truth.y + noise * rng.standard_normal(truth.y.shape))
    (start,) = initial_states(built.model, [log], built.model.theta(), "measured")
    return filter_setup(built.model, built.driven, [log]).filter_model, log, start


@pytest.mark.slow
def test_guessed_noises_raise_no_alarm_about_a_right_model_and_hide_no_wrong_one() -> None:
    """Too much process noise colours the shaft's torque (p = 3e-15) with a NIS of 0.5: no fault of the model."""
    for seed in range(8):
        filter_model, log, start = _driven(seed)
        record = run(filter_model, log, x0=start)
        assert misfits([record], guessed=True) == ()
    assert min(channel.whiteness_p for channel in consistency(record).channels) < 1e-6
    filter_model, log, start = _driven(0, {"m_vehicle": 400.0})
    assert "speed" in {one.channel for one in misfits([run(filter_model, log, x0=start)], guessed=True)}


def test_a_misfit_is_told_in_the_unit_in_which_the_channel_is_shown() -> None:
    g = BondGraph("sled")
    body = g.one_junction("body", TRANSLATION)
    g.inertance("mass", g.parameter("m", 80.0, "kg"), at=body, state="v")
    g.measure_flow("speed", body, unit="km/h")
    time = 0.1 * np.arange(200)
    log = MatchedLog("run", time, np.zeros((0, 200)), np.sin(time)[np.newaxis])
    (found,) = run(FilterModel(build(g).model, {"v": 0.01}, {"speed": 0.05}, {"v": 0.1}), log).misfits
    assert (found.unit, found.noise) == ("km/h", pytest.approx(0.18))
