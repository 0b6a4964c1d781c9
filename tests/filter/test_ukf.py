"""The filter against a Kalman filter, against filterpy, and against itself in its other form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filterpy_bridge import filterpy_run
from bondgraph.filter.runs import run
from bondgraph.filter.samples import interval_substeps
from bondgraph.simulate.model import Model
from tests.filter.kalman import kalman_run
from tests.filter.logs import (
    PlainLog,
    circuit_filter,
    driveline_filter,
    pendulum_filter,
    rolling_inputs,
    simulated_log,
    uneven_times,
)
from tests.simulate.samples import decay, text_of

ALPHAS = (1e-3, 1e-2, 0.1, 1.0)
BOTH = pytest.mark.parametrize("compiled", [False, True])


def with_missing(log: PlainLog, seed: int) -> PlainLog:
    """A third of the values missing, some samples altogether, among them the first."""
    y = np.where(np.random.default_rng(seed).random(log.y.shape) < 0.3, np.nan, log.y)
    y[:, [0, 7, 8]] = np.nan
    return replace(log, y=y)


@BOTH
@pytest.mark.parametrize("alpha", ALPHAS)
def test_on_a_linear_model_it_is_the_kalman_filter(alpha: float, compiled: bool) -> None:
    model = circuit_filter(alpha=alpha, noise_scheme="sampled")
    log = with_missing(simulated_log(model, uneven_times(60, 0.05, seed=1), seed=1), seed=2)
    exact = kalman_run(model, log, interval_substeps(log.time, model.substeps))
    ours = run(model, log, compiled=compiled).raise_if_failed()
    np.testing.assert_allclose(ours.filtered_mean, exact.mean, atol=1e-13 / alpha**2 + 1e-11)
    np.testing.assert_allclose(ours.filtered_cov, exact.cov, atol=1e-13 / alpha**2 + 1e-11)
    assert ours.nll == pytest.approx(exact.nll, rel=1e-13 / alpha**2 + 1e-11)
    assert ours.floored_pivots == 0


@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize("make", [pendulum_filter, driveline_filter])
def test_on_nonlinear_models_it_is_filterpy(make, alpha: float) -> None:
    model = make(alpha=alpha)
    log = simulated_log(model, np.arange(40) * 0.025, seed=3)
    theirs = filterpy_run(model, log)
    ours = run(model, log).raise_if_failed()
    assert ours.nll == pytest.approx(theirs.nll, rel=1e-8)
    scale = np.sqrt(np.einsum("iik->ik", theirs.filtered_cov))
    assert np.max(np.abs(ours.filtered_mean - theirs.filtered_mean) / scale) < 1e-12 / alpha**2 + 1e-8
    relative = np.abs(ours.filtered_cov - theirs.filtered_cov) / (scale[:, None] * scale[None])
    assert np.max(relative) < 1e-12 / alpha**2 + 1e-7


def test_filterpy_agrees_with_missing_values_uneven_times_and_other_numbers() -> None:
    model = driveline_filter(alpha=0.3, appended={"tau_grip": 2.0}, kappa=0.5, beta=1.5)
    log = with_missing(simulated_log(model, uneven_times(50, 0.02, seed=5), seed=4), seed=3)
    values = {"noise_std": np.array([2.0, 0.5, 0.3]), "initial_std": np.array([5.0, 1.0, 0.01, 0.3, 10.0])}
    theta = model.model.theta(c_engine=0.02)
    theirs = filterpy_run(model, log, theta, **values)
    assert run(model, log, theta, **values).nll == pytest.approx(theirs.nll, rel=1e-9)


@pytest.mark.parametrize("make", [circuit_filter, pendulum_filter, driveline_filter])
def test_compiled_and_numpy_runs_agree_in_everything(make) -> None:
    model = make()
    log = with_missing(simulated_log(model, uneven_times(40, 0.03, seed=6), seed=6), seed=6)
    ours, plain = run(model, log), run(model, log, compiled=False)
    assert (ours.outcome, ours.ended_at, ours.floored_pivots) == (plain.outcome, plain.ended_at, plain.floored_pivots)
    for name in (
        "predicted_mean", "predicted_cov", "filtered_mean", "filtered_cov", "cross_cov", "output_mean", "output_cov",
        "whitened", "log_scales", "innovation", "nis", "log_likelihood",
    ):  # fmt: skip
        a, b = getattr(ours, name), getattr(plain, name)
        assert a.shape == b.shape, name
        size = np.nanmax(np.abs(b).reshape(-1, b.shape[-1]), initial=1e-12)
        np.testing.assert_allclose(a, b, atol=1e-8 * size, rtol=1e-7, err_msg=name)


@BOTH
def test_a_channel_that_is_always_missing_is_a_filter_without_it(compiled: bool) -> None:
    full = driveline_filter()
    log = simulated_log(full, np.arange(60) * 0.025, seed=7)
    blind = replace(log, y=np.where(np.array([True, False, True])[:, None], log.y, np.nan))
    fewer = driveline_filter(measurement_noise={"engine_speed": 1.0, "acceleration": 0.2})
    assert run(full, blind, compiled=compiled).nll == run(fewer, blind, compiled=compiled).nll


@BOTH
def test_without_measurements_it_only_predicts(compiled: bool) -> None:
    model = circuit_filter()
    log = simulated_log(model, np.arange(30) * 0.05, seed=8)
    silent = run(model, replace(log, y=np.full_like(log.y, np.nan)), compiled=compiled)
    np.testing.assert_array_equal(silent.filtered_mean, silent.predicted_mean)
    assert silent.nll == 0.0
    assert np.isnan(silent.nis).all()
    assert np.isnan(silent.innovation).all()
    assert np.isfinite(silent.output_cov).all()


@BOTH
def test_the_prior_is_at_the_first_sample(compiled: bool) -> None:
    model = circuit_filter()
    log = PlainLog("one", np.array([5.0]), np.zeros((1, 1)), np.array([[2.0], [np.nan]]))
    one = run(model, log, compiled=compiled)
    gain = 1.0 / (1.0 + 0.2**2)
    np.testing.assert_allclose(one.filtered_mean[:, 0], [2.0 * gain, 0.0], atol=1e-12)
    np.testing.assert_allclose(one.filtered_cov[..., 0], np.diag([1.0 - gain, 0.25]), atol=1e-12)
    np.testing.assert_array_equal(one.predicted_mean[:, 0], [0.0, 0.0])


@BOTH
def test_an_appended_parameter_is_a_state_with_derivative_zero(compiled: bool) -> None:
    text = text_of("rlc")
    text = text.replace('    ("u_capacitor", "V", 0.0', '    ("u_capacitor", "V", 0.0', 1)
    as_state = Model.from_text(
        text.replace(
            '"voltage of the capacitor"),\n)', '"voltage of the capacitor"),\n    ("R_state", "ohm", 0.5, "wire"),\n)'
        )
        .replace("R_wire = theta[0]", "R_wire = x[2]")
        .replace("_stack(x, (dx0, dx1))", "_stack(x, (dx0, dx1, 0.0))")
    )
    appended = circuit_filter(appended={"R_wire": 0.05}, initial_std={"i_coil": 1.0, "u_capacitor": 0.5, "R_wire": 0.2})
    state = FilterModel(
        as_state, {**appended.process_noise, "R_state": 0.05}, appended.measurement_noise,
        {"i_coil": 1.0, "u_capacitor": 0.5, "R_state": 0.2}, substeps=3,
    )  # fmt: skip
    log = simulated_log(appended, np.arange(80) * 0.05, seed=9)
    one, two = run(appended, log, compiled=compiled), run(state, log, compiled=compiled)
    np.testing.assert_allclose(one.filtered_mean, two.filtered_mean, atol=1e-12)
    assert one.nll == pytest.approx(two.nll, rel=1e-12)


def test_a_constant_parameter_is_learnt_on_line() -> None:
    model = circuit_filter(
        process_noise={"i_coil": 0.02, "u_capacitor": 0.02},
        measurement_noise={"current": 0.05, "voltage": 0.05},
        appended={"L_coil": 0.0},
        initial_std={"i_coil": 0.1, "u_capacitor": 0.1, "L_coil": 0.05},
    )
    time = np.arange(400) * 0.02
    truth = 0.13
    plain = replace(model, appended={}, initial_std={"i_coil": 0.1, "u_capacitor": 0.1})
    generating = replace(plain, model=Model.from_text(text_of("rlc").replace('"H", 0.1,', f'"H", {truth},')))
    learnt = run(model, simulated_log(generating, time, seed=10)).raise_if_failed()
    estimate, std = learnt.mean("L_coil")[-1], learnt.std("L_coil")[-1]
    assert std < 0.02
    assert abs(estimate - truth) < 3.0 * std


def test_inputs_are_held_or_linear_as_declared() -> None:
    model = FilterModel(decay(rate=0.0, initial=0.0), {}, {"reading": 1.0}, {})
    u = np.array([[0.0, 2.0, 2.0], [5.0, 0.0, 0.0]])
    moved = run(model, PlainLog("inputs", np.arange(3.0), u, np.full((1, 3), np.nan)))
    np.testing.assert_allclose(moved.filtered_mean[0], [0.0, 6.0, 8.0], rtol=1e-14)


def test_measured_outputs_may_depend_on_inputs() -> None:
    model = driveline_filter(measurement_noise={"acceleration": 0.1})
    time = np.arange(5) * 0.02
    u = rolling_inputs(model.model, time)
    up, level = u.copy(), u.copy()
    up[2, 0] = 0.3
    y = np.full((3, 5), np.nan)
    difference = (
        run(model, PlainLog("a", time, up, y)).output_mean - run(model, PlainLog("b", time, level, y)).output_mean
    )[2, 0]
    assert difference == pytest.approx(-0.3 * 9.81, rel=1e-9)
