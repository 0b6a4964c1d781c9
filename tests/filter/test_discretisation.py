"""The likelihood knows how far its integration step disturbs it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.filter.discretisation import discretisation_error, jacobian
from bondgraph.filter.filter_model import FilterModel
from tests.filter.logs import PlainLog, circuit_filter, driveline_filter, simulated_log
from tests.simulate.samples import decay, sample


def test_it_falls_with_the_fourth_power_of_the_step() -> None:
    model = circuit_filter(substeps=2, noise_scheme="sampled")
    log = simulated_log(circuit_filter(substeps=32, noise_scheme="sampled"), np.arange(60) * 0.1, seed=1)
    errors = [discretisation_error(replace(model, substeps=steps), log).nats for steps in (2, 4, 8)]
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.all(np.abs(np.log2(ratios) - 4.0) < 0.6), ratios


def test_step_times_rate_is_that_of_the_eigenvalues() -> None:
    """The circuit's eigenvalues are a complex pair of magnitude 1/sqrt(L C)."""
    model = circuit_filter(substeps=5, noise_scheme="sampled")
    log = simulated_log(model, np.arange(40) * 0.1, seed=2)
    assert discretisation_error(model, log).step_times_rate == pytest.approx(0.02 / np.sqrt(0.1 * 0.05), rel=1e-6)


def test_a_step_beyond_stability_is_said() -> None:
    model = FilterModel(
        decay(rate=40.0), {"level": 1.0}, {"reading": 0.1}, {"level": 0.1}, noise_scheme="sampled", substeps=1
    )
    time = np.arange(60) * 0.1
    coarse = discretisation_error(model, PlainLog("fast", time, np.zeros((2, 60)), 0.1 * np.sin(time)[None]))
    assert coarse.step_times_rate == pytest.approx(4.0, rel=1e-6)
    assert not coarse.negligible
    assert "beyond the 2.78 up to which the step is stable" in str(coarse)
    fine = discretisation_error(
        replace(model, substeps=50), PlainLog("fast", time, np.zeros((2, 60)), 0.1 * np.sin(time)[None])
    )
    assert fine.negligible
    assert "negligible" in str(fine)


def test_instability_that_saturates_is_said() -> None:
    """A saturating clutch keeps an unstable step bounded: nothing crashes, and the likelihood is wrong."""
    stable = driveline_filter()
    log = simulated_log(stable, np.arange(300) * 0.02, seed=12)
    unstable = discretisation_error(replace(stable, substeps=4), log)
    assert np.isfinite(unstable.nats)
    assert not unstable.negligible
    assert unstable.step_times_rate > 2.78
    assert discretisation_error(stable, log).step_times_rate < 2.78


def test_a_diverging_filter_has_an_infinite_error() -> None:
    model = FilterModel(decay(rate=1e9), {"level": 1.0}, {"reading": 0.1}, {"level": 0.1})
    error = discretisation_error(model, PlainLog("fast", np.arange(60.0), np.zeros((2, 60)), np.zeros((1, 60))))
    assert error.nats == np.inf
    assert error.step_times_rate == np.inf


def test_appended_parameters_take_part() -> None:
    model = driveline_filter(appended={"k_shaft": 1.0})
    log = simulated_log(model, np.arange(40) * 0.025, seed=3)
    plain = discretisation_error(driveline_filter(), log)
    assert discretisation_error(model, log).step_times_rate == pytest.approx(plain.step_times_rate, rel=0.05)


def test_jacobian_of_a_linear_model_is_its_matrix() -> None:
    model = sample("rlc")
    matrix = jacobian(model, 0.0, np.array([3.0, -2.0]), model.u0(), model.theta())
    np.testing.assert_allclose(matrix, [[-5.0, -10.0], [20.0, 0.0]], atol=1e-8)
