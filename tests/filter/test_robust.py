"""Robust measurements: densities, twins, derivatives, bounds, and estimates with outliers."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

import bondgraph as bg
from bondgraph.errors import FilterError
from bondgraph.filter.degrees import with_likeliest_degrees
from bondgraph.filter.draw import draw_logs
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filterpy_bridge import filterpy_run
from bondgraph.filter.gradient import Directions, innovation_tangents
from bondgraph.filter.kernel_robust import _loss, _precision, _precision_slope, _residual, _residual_slope, _score
from bondgraph.filter.likelihood import likelihood
from bondgraph.filter.robust import KINDS, Robust, parse_robust
from bondgraph.filter.runs import run
from bondgraph.filter.ukf import Member
from bondgraph.simulate.example import pendulum
from tests.filter.logs import PlainLog, driveline_filter, pendulum_filter, simulated_log, uneven_times

ALL = pytest.mark.parametrize("kind", [*KINDS])


def with_outliers(log: PlainLog, size: float = 20.0) -> PlainLog:
    """A value missing and two that no noise explains, one of them beside a good value of the same sample."""
    y = log.y.copy()
    y[1, 10] += size
    y[0, 20] -= size
    y[2, 5] = np.nan
    return replace(log, y=y)


def density(robust: Robust, z: float) -> float:
    return float(np.exp(-_loss(robust.numbers, z) - robust.numbers.constant) / np.sqrt(2.0 * np.pi))


@pytest.mark.parametrize("robust", [Robust("student", 1.5), Robust("student", 30.0), Robust("huber", 0.7)])
def test_densities_of_student_and_huber_are_normalised(robust: Robust) -> None:
    assert 2.0 * quad(lambda z: density(robust, z), 0.0, np.inf, epsabs=1e-10)[0] == pytest.approx(1.0, abs=1e-8)


def test_the_student_density_is_scipys() -> None:
    numbers = Robust("student", 4.0).numbers
    scale = np.sqrt(1.0 / (4.0 * numbers.second))
    for z in (0.0, 0.4, -2.0, 9.0):
        assert density(Robust("student", 4.0), z) == pytest.approx(stats.t.pdf(z, 4.0, scale=scale), rel=1e-12)


@ALL
def test_no_loss_biases_the_width_of_a_gaussian(kind: str) -> None:
    robust = Robust(kind)
    edges = np.array([-12.0, -robust.numbers.first, robust.numbers.first, 12.0])
    pieces = [
        quad(lambda z: z * _score(robust.numbers, z) * stats.norm.pdf(z), *pair, epsabs=1e-12)[0]
        for pair in itertools.pairwise(edges)
    ]
    assert sum(pieces) == pytest.approx(1.0, abs=1e-8)


@ALL
def test_residuals_and_slopes_belong_to_the_loss(kind: str) -> None:
    numbers = Robust(kind).numbers
    for z in (-7.0, -1.1, -1e-12, 0.3, 2.0, 5.0):
        step = 1e-6
        assert 0.5 * _residual(numbers, z) ** 2 == pytest.approx(_loss(numbers, z), rel=1e-14)
        for value, slope in ((_loss, _score), (_residual, _residual_slope), (_precision, _precision_slope)):
            expected = (value(numbers, z + step) - value(numbers, z - step)) / (2.0 * step)
            assert slope(numbers, z) == pytest.approx(expected, abs=1e-6)


@ALL
def test_compiled_and_numpy_runs_agree_and_lanes_do_too(kind: str) -> None:
    model = driveline_filter(robust=Robust(kind))
    log = with_outliers(simulated_log(driveline_filter(), uneven_times(40, 0.03, seed=6), seed=6))
    ours, plain = run(model, log), run(model, log, compiled=False)
    for name in ("filtered_mean", "filtered_cov", "output_cov", "whitened", "log_scales"):
        a, b = getattr(ours, name), getattr(plain, name)
        np.testing.assert_allclose(a, b, atol=1e-8 * np.nanmax(np.abs(b)), rtol=1e-7, err_msg=name)
    theta = model.model.theta()[:, np.newaxis] * np.linspace(0.99, 1.01, 9)
    assert likelihood(model, log, theta, threads=1).nll[4] == pytest.approx(ours.nll, rel=1e-12)


def test_many_degrees_of_freedom_are_a_gaussian() -> None:
    plain = driveline_filter()
    log = simulated_log(plain, np.arange(60) * 0.025, seed=7)
    robust = run(replace(plain, robust=Robust("student", 1e4)), log)
    assert robust.nll == pytest.approx(run(plain, log).nll, abs=0.05)


def test_a_gate_forgets_what_it_rejects() -> None:
    gated = driveline_filter(robust=Robust("gate", 0.9999999))
    log = simulated_log(driveline_filter(), np.arange(60) * 0.025, seed=7)
    spoilt, missing = (replace(log, y=log.y.copy()) for _ in range(2))
    spoilt.y[:, 30] += 1e3
    missing.y[:, 30] = np.nan
    ours, without = run(gated, spoilt), run(driveline_filter(), missing)
    np.testing.assert_allclose(ours.filtered_mean, without.filtered_mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(ours.filtered_cov, without.filtered_cov, rtol=1e-9, atol=1e-12)


@ALL
def test_derivatives_are_those_of_the_value(kind: str) -> None:
    model = pendulum_filter(robust=Robust(kind))
    log = simulated_log(pendulum_filter(), uneven_times(30, 0.05, seed=2), seed=2)
    log.y[0, 12] += 3.0
    size = len(model.model.parameters)
    zero = np.zeros((2, 3))
    moves = Directions(np.eye(size)[:, :3] * [1.0, 1.0, 0.0], zero, zero, zero, np.array([[0.0, 0.0, 1.0]]))
    (found,) = innovation_tangents(model, [log], [Member.of(model)], [moves], 1)
    for d, slope in enumerate(found.gradient):
        values = [
            run(model, log, model.model.theta() + s * moves.theta[:, d],
                noise_std=model.noise_std + s * moves.noise_std[:, d]).nll for s in (1e-6, -1e-6)
        ]  # fmt: skip
        assert slope == pytest.approx((values[0] - values[1]) / 2e-6, rel=1e-6)


@ALL
def test_ceilings_give_up_nobody_who_is_good(kind: str) -> None:
    model = driveline_filter(robust=Robust(kind))
    log = with_outliers(simulated_log(driveline_filter(), np.arange(80) * 0.025, seed=3))
    theta = model.model.theta()[:, np.newaxis] * np.linspace(0.7, 1.3, 11)
    values = likelihood(model, log, theta).nll
    below = likelihood(model, log, theta, ceilings=float(np.median(values)))
    good = values <= np.median(values)
    np.testing.assert_array_equal(below.nll[good], values[good])


def spoilt_logs(count: int) -> tuple[FilterModel, tuple[bg.MatchedLog, ...], list[bg.MatchedLog]]:
    """Drawn logs of a pendulum that is pushed to and fro, and the same with one value in a hundred 20 sigma off."""
    swing = FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.2, "rate": 0.3}, 2)
    time = np.arange(400) * 0.05
    pattern = bg.MatchedLog("swing", time, 1.5 * np.sign(np.sin(0.9 * time))[np.newaxis], np.zeros((1, time.size)))
    logs, chance = draw_logs(swing, pattern, count, seed=1).logs, np.random.default_rng(9)
    spoilt = []
    for log in logs:
        hit = chance.random(log.y.shape) < 0.01
        spoilt.append(replace(log, y=log.y + np.where(hit, chance.choice([-1.0, 1.0], log.y.shape), 0.0)))
    return swing, logs, spoilt


def test_outliers_do_not_widen_the_estimated_noise() -> None:
    swing, clean, spoilt = spoilt_logs(1)

    def found(kind: str, logs: Sequence[bg.MatchedLog]) -> Mapping[str, float]:
        filter_model = replace(swing, robust=Robust(kind) if kind else None)
        settings = bg.Settings(method="gradient", starts=1, certify="none")
        return bg.estimate(filter_model, logs, ["length", "std(deflection)"], settings).values

    known = found("", clean)
    assert found("", spoilt)["std(deflection)"] > 1.4 * known["std(deflection)"]
    for kind in ("student", "gate"):
        ours = found(kind, spoilt)
        assert ours["std(deflection)"] == pytest.approx(known["std(deflection)"], rel=0.1)
        assert ours["length"] == pytest.approx(known["length"], abs=0.003)


def test_texts_and_impossible_losses() -> None:
    assert parse_robust("student:2.5") == Robust("student", 2.5)
    for text, message in (
        ("student:many", "'many' in 'student:many' is no number - write student:NUMBER"),
        ("cauchy", "kind 'cauchy' is not known - use student, huber, gate"),
        ("gate:1.5", "probability of 'gate' is 1.5 - give a number from 0.5 to 1"),
    ):
        with pytest.raises(FilterError, match=message):
            parse_robust(text)
    correlated = {("engine_speed", "wheel_speed"): 0.3}
    with pytest.raises(FilterError, match="so sensors must be independent"):
        driveline_filter(robust=Robust("gate"), measurement_correlation=correlated)
    log = simulated_log(driveline_filter(), np.arange(9) * 0.025, seed=7)
    with pytest.raises(FilterError, match="filterpy has no robust='gate' - leave it out"):
        filterpy_run(driveline_filter(robust=Robust("gate")), log)
    with pytest.raises(FilterError, match="noise_correlation with robust='gate'"):
        run(driveline_filter(robust=Robust("gate")), log, noise_correlation=np.eye(3)[::-1])


def test_a_robust_filter_model_says_so_and_is_another_one() -> None:
    plain, robust = driveline_filter(), driveline_filter(robust=Robust("huber"))
    assert "huber" in repr(robust)
    assert plain.digest != robust.digest != driveline_filter(robust=Robust("huber", 2.0)).digest


def test_degrees_of_freedom_are_those_of_the_noise() -> None:
    model = pendulum_filter(process_noise={"rate": 0.02})
    log, chance = simulated_log(model, np.arange(900) * 0.05, seed=5), np.random.default_rng(6)
    gaussian = with_likeliest_degrees(model, log).robust
    assert gaussian is not None and gaussian.value > 12.0
    tailed = replace(log, y=log.y + 0.15 * chance.standard_t(2.5, log.y.shape))
    wider = replace(model, measurement_noise={"deflection": 0.2})
    student = with_likeliest_degrees(wider, tailed).robust
    assert student is not None and 1.7 < student.value < 5.0
