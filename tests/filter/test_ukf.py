"""The filter against a Kalman filter, against filterpy, against itself in its other form, and published results."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.filter.belief import Belief, predict, update
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filterpy_bridge import filterpy_run
from bondgraph.filter.runs import run
from bondgraph.filter.samples import interval_substeps
from bondgraph.filter.sigma_points import MerweScaled
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
from tests.module_text import STACK
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
def test_steady_state_of_a_random_walk(shared_data: Path, compiled: bool) -> None:
    case = _case(shared_data, "scalar_random_walk_riccati")
    model = FilterModel(
        decay(rate=0.0),
        {"level": np.sqrt(case["inputs"]["Q"])},
        {"reading": np.sqrt(case["inputs"]["R"])},
        {"level": 1.0},
    )
    walk = run(model, PlainLog("walk", np.arange(400.0), np.zeros((2, 400)), np.zeros((1, 400))), compiled=compiled)
    assert walk.predicted_cov[0, 0, -1] == pytest.approx(case["expected"]["P_predicted"], abs=case["tol"]["abs"])
    assert walk.filtered_cov[0, 0, -1] == pytest.approx(case["expected"]["P_filtered"], abs=case["tol"]["abs"])


@BOTH
def test_redrawn_points_give_the_kalman_filter_of_filterpy_issue_172(shared_data: Path, compiled: bool) -> None:
    case, inputs = (
        _case(shared_data, "filterpy_172_ukf_equals_kf"),
        _case(shared_data, "filterpy_172_ukf_equals_kf")["inputs"],
    )
    z, x, p = np.loadtxt(shared_data / "published" / case["data"], delimiter=",", skiprows=1).T
    spread = {name: inputs[name] for name in ("alpha", "beta", "kappa")}
    model = FilterModel(decay(rate=0.0, initial=0.0), {"level": 1.0}, {"reading": 1.0}, {"level": 1.0}, **spread)
    # the published run predicts before its first measurement: a first sample without one
    y = np.concatenate([[np.nan], z])[np.newaxis]
    ours = run(model, PlainLog("172", np.arange(z.size + 1.0), np.zeros((2, z.size + 1)), y), compiled=compiled)
    np.testing.assert_allclose(ours.filtered_mean[0, 1:], x, atol=case["tol"]["abs"])
    np.testing.assert_allclose(ours.filtered_cov[0, 0, 1:], p, atol=case["tol"]["abs"])


BALLISTIC = (
    """
import numpy as np
NAME = "ballistic"
FORMAT = "bondgraph-module/1"
STATES = (("x", "m", 0.0, ""), ("vx", "m/s", 0.0, ""), ("y", "m", 0.0, ""), ("vy", "m/s", 0.0, ""))
INPUTS = ()
PARAMETERS = (("g", "m/s^2", 9.81, None, None, ""),)
OUTPUTS = (("seen_x", "m", ""), ("seen_y", "m", ""))
def rhs(t, x, u, theta):
    return _stack(x, (x[1], 0.0, x[3], -theta[0]))
def output(t, x, u, theta):
    return _stack(x, (x[0], x[2]))
"""
    + STACK
)


@BOTH
def test_cannonball_without_process_noise(shared_data: Path, compiled: bool) -> None:
    case = _case(shared_data, "hipparchus_cannonball_zero_process_noise")
    table = np.genfromtxt(shared_data / "published" / case["data"], delimiter=",", names=True)
    start = 100.0 * np.sqrt(0.5)
    noise = {"seen_x": 30.0, "seen_y": 30.0}
    initial = {"x": 30.0, "vx": np.sqrt(1e-3), "y": 30.0, "vy": np.sqrt(1e-3)}
    model = FilterModel(Model.from_text(BALLISTIC), {}, noise, initial, alpha=1.0)
    n = table.size + 1
    y = np.hstack([np.full((2, 1), np.nan), [table["zx"], table["zy"]]])
    log = PlainLog("cannonball", 0.1 * np.arange(n), np.zeros((0, n)), y)
    ours = run(model, log, x0=[0.0, start, 0.0, start], compiled=compiled)
    for row, name in enumerate(("x", "vx", "y", "vy")):
        np.testing.assert_allclose(ours.filtered_mean[row, 1:], table[name], atol=case["tol"]["abs"])
        for column in range(row, 4):
            np.testing.assert_allclose(
                ours.filtered_cov[row, column, 1:], table[f"P{row}{column}"], atol=case["tol"]["abs"]
            )


def test_pendulum_of_sarkka_and_svensson(shared_data: Path) -> None:
    case = _case(shared_data, "sarkka_pendulum_rmse")
    inputs = case["inputs"]
    table = np.genfromtxt(shared_data / "published" / case["data"], delimiter=",", names=True)
    dt, g = inputs["dt"], inputs["g"]
    points = MerweScaled(2, **inputs["ukf"])
    belief = Belief.of(np.array(inputs["m0"], dtype=float), np.array(inputs["P0"], dtype=float))
    means, log_likelihood = [], 0.0
    for y in table["y"]:
        belief = predict(
            belief, lambda x: np.array([x[0] + dt * x[1], x[1] - g * dt * np.sin(x[0])]), np.array(inputs["Q"]), points
        ).belief
        updated = update(belief, np.array([y]), lambda x: np.sin(x[:1]), np.array([[inputs["R"]]]), points)
        belief, log_likelihood = updated.belief, log_likelihood + updated.log_likelihood
        means.append(belief.mean[0])
    rmse = np.sqrt(np.mean((np.array(means) - table["x1"]) ** 2))
    assert rmse == pytest.approx(case["expected"]["UKF"], abs=case["tol"]["abs"])
    assert log_likelihood == pytest.approx(case["extra"]["loglik_ukf_ours"], abs=1e-9)


def _case(shared_data: Path, name: str) -> dict:
    cases = json.loads((shared_data / "published" / "cases.json").read_text(encoding="utf-8"))["cases"]
    return next(case for case in cases if case["id"] == name)


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
