"""The smoother against the exact posterior of a linear model, and published results."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bondgraph.errors import FilterError
from bondgraph.filter.belief import Belief, Prediction, predict, update
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.runs import run
from bondgraph.filter.samples import interval_substeps
from bondgraph.filter.sigma_points import MerweScaled
from bondgraph.filter.smoother import smooth, smooth_step
from tests.filter.kalman import runge_kutta_map
from tests.filter.logs import PlainLog, circuit_filter, driveline_filter, simulated_log, uneven_times
from tests.simulate.samples import decay


def dense_posterior(model: FilterModel, log: PlainLog) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of all states at once, from one big linear regression."""
    n, size = log.time.size, len(model.model.states)
    substeps = interval_substeps(log.time, model.substeps)
    h = np.column_stack([model.model.output(0.0, e, np.zeros(1), model.model.theta()) for e in np.eye(size)])
    information, right = np.zeros((n * size, n * size)), np.zeros(n * size)

    def add(rows: np.ndarray, value: np.ndarray, cov: np.ndarray) -> None:
        nonlocal information, right
        weight = np.linalg.inv(cov)
        information += rows.T @ weight @ rows
        right += rows.T @ weight @ value

    def block(k: int) -> np.ndarray:
        rows = np.zeros((size, n * size))
        rows[:, k * size : (k + 1) * size] = np.eye(size)
        return rows

    add(block(0), model.model.x0(), np.diag(model.start_std**2))
    for k in range(1, n):
        f, offset = runge_kutta_map(model, log, k, int(substeps[k - 1]))
        noise = np.diag(model.process_std**2 * (log.time[k] - log.time[k - 1]))
        add(block(k) - f @ block(k - 1), offset, noise)
    for k in range(n):
        there = ~np.isnan(log.y[:, k])
        if there.any():
            add(h[there] @ block(k), log.y[there, k], np.diag(model.noise_std[there] ** 2))
    cov = np.linalg.inv(information)
    blocks = [cov[k * size : (k + 1) * size, k * size : (k + 1) * size] for k in range(n)]
    return (cov @ right).reshape(n, size).T, np.stack(blocks, axis=-1)


@pytest.mark.parametrize("compiled", [False, True])
def test_on_a_linear_model_it_is_the_exact_posterior(compiled: bool) -> None:
    model = circuit_filter(noise_scheme="sampled")
    log = simulated_log(model, uneven_times(30, 0.05, seed=2), seed=2)
    log.y[0, 5:9] = np.nan
    log.y[:, 20] = np.nan
    mean, cov = dense_posterior(model, log)
    smoothed = smooth(run(model, log, compiled=compiled))
    np.testing.assert_allclose(smoothed.smoothed_mean, mean, atol=1e-9)
    np.testing.assert_allclose(smoothed.smoothed_cov, cov, atol=1e-9)


def test_it_knows_more_than_the_filter_and_ends_with_it() -> None:
    model = driveline_filter()
    filtered = run(model, simulated_log(model, np.arange(80) * 0.025, seed=3))
    smoothed = smooth(filtered)
    np.testing.assert_array_equal(smoothed.smoothed_mean[:, -1], filtered.filtered_mean[:, -1])
    for name in model.state_names:
        assert np.all(smoothed.std(name) <= filtered.std(name) * (1.0 + 1e-6)), name
    assert np.mean(smoothed.std("v_body")) < 0.8 * np.mean(filtered.std("v_body"))


def test_states_known_exactly_stay_as_they_are() -> None:
    model = FilterModel(decay(), {}, {"reading": 0.1}, {})
    log = PlainLog("known", np.arange(5) * 0.1, np.zeros((2, 5)), np.zeros((1, 5)))
    filtered = run(model, log)
    np.testing.assert_array_equal(smooth(filtered).smoothed_mean, filtered.filtered_mean)


def test_a_failed_run_cannot_be_smoothed() -> None:
    model = circuit_filter()
    failed = run(model, simulated_log(model, np.arange(5) * 0.05, seed=1), x0=[np.inf, 0.0])
    with pytest.raises(FilterError, match="simulated: the state grew without bound"):
        smooth(failed)


def test_pendulum_of_sarkka_and_svensson(shared_data: Path) -> None:
    case = _case(shared_data, "sarkka_pendulum_rmse")
    inputs = case["inputs"]
    table = np.genfromtxt(shared_data / "published" / case["data"], delimiter=",", names=True)
    dt, g = inputs["dt"], inputs["g"]
    mean, _ = _smoothed(
        inputs, MerweScaled(2, **inputs["ukf"]), lambda x: np.array([x[0] + dt * x[1], x[1] - g * dt * np.sin(x[0])]),
        lambda x: np.sin(x[:1]), [np.array(inputs["Q"])] * table.size, table["y"],
    )  # fmt: skip
    rmse = np.sqrt(np.mean((mean[1:, 0] - table["x1"]) ** 2))
    assert rmse == pytest.approx(case["expected"]["URTS"], abs=case["tol"]["abs"])


def test_constant_velocity_of_hipparchus(shared_data: Path) -> None:
    case = _case(shared_data, "hipparchus_cv_rts")
    inputs = case["inputs"]
    table = np.genfromtxt(shared_data / "published" / case["data"], delimiter=",", names=True)
    steps = np.diff(table["t"])
    noise = [0.1 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) for dt in steps]
    (dt,) = set(steps.round(9))
    mean, cov = _smoothed(
        inputs, MerweScaled(2, inputs["alpha"], inputs["beta"], inputs["kappa"]),
        lambda x: np.array([x[0] + dt * x[1], x[1]]), lambda x: x[:1], noise, table["z"][1:],
    )  # fmt: skip
    expected = np.column_stack([table["x0"], table["x1"]])
    np.testing.assert_allclose(mean, expected, atol=10 * case["tol"]["abs"])
    for row, column in ((0, 0), (0, 1), (1, 1)):
        np.testing.assert_allclose(cov[:, row, column], table[f"P{row}{column}"], atol=10 * case["tol"]["abs"])


def _smoothed(inputs, points, transition, measurement, noise, measured):
    """Smoothed means and covariances, the initial state first: predict, update for each measurement, then backwards."""
    beliefs = [Belief.of(np.array(inputs["m0"], dtype=float), np.array(inputs["P0"], dtype=float))]
    predictions: list[Prediction] = []
    for y, process_cov in zip(measured, noise, strict=True):
        predictions.append(predict(beliefs[-1], transition, process_cov, points))
        after = update(predictions[-1].belief, np.array([y]), measurement, np.array([[inputs["R"]]]), points)
        beliefs.append(after.belief)
    means, covs = [beliefs[-1].mean], [beliefs[-1].cov]
    for belief, prediction in zip(beliefs[-2::-1], predictions[::-1], strict=True):
        mean, cov = smooth_step(
            belief.mean,
            belief.cov,
            prediction.cross_cov,
            prediction.belief.mean,
            prediction.belief.cov,
            means[0],
            covs[0],
        )
        means.insert(0, mean)
        covs.insert(0, cov)
    return np.array(means), np.array(covs)


def _case(shared_data: Path, name: str) -> dict:
    cases = json.loads((shared_data / "published" / "cases.json").read_text(encoding="utf-8"))["cases"]
    return next(case for case in cases if case["id"] == name)
