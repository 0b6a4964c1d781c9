"""The smoother against the exact posterior of a linear model."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.errors import FilterError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.runs import run
from bondgraph.filter.samples import interval_substeps
from bondgraph.filter.smoother import smooth, smoothed_start
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


def test_a_start_is_the_exact_posterior_given_the_beginning_of_a_log() -> None:
    model = circuit_filter(noise_scheme="sampled")
    log = simulated_log(model, uneven_times(30, 0.05, seed=2), seed=2)
    mean, _ = dense_posterior(model, PlainLog(log.name, log.time[:11], log.u[:, :11], log.y[:, :11]))
    found = smoothed_start(run(model, log), float(log.time[10]))
    np.testing.assert_allclose(found, mean[:, 0], atol=1e-9)
    assert np.abs(found - run(model, log).filtered_mean[:, 0]).max() > 1e-6


def test_the_start_of_a_failed_run_is_what_its_first_sample_says() -> None:
    model = circuit_filter()
    failed = run(model, simulated_log(model, np.arange(5) * 0.05, seed=1), x0=[np.inf, 0.0])
    np.testing.assert_array_equal(smoothed_start(failed, 1.0), failed.filtered_mean[:, 0])


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
