"""The object of the bridge in ordinary scripts of filterpy: what they find is what the toolkit's own runs find."""

from __future__ import annotations

import sys

import filterpy
import numpy as np
import pytest

from bondgraph.errors import FilterError, ModelError, OptionError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.filterpy_bridge import filterpy_filter
from bondgraph.filter.robust import Robust
from bondgraph.filter.runs import run
from bondgraph.filter.smoother import smooth
from tests.filter.logs import PlainLog, circuit_filter, driveline_filter, pendulum_filter, rolling_inputs

DT = 0.05


def sampled(model: FilterModel, time: np.ndarray, seed: int = 0) -> PlainLog:
    """Measurements about what the model starts at, with inputs that move."""
    u = rolling_inputs(model.model, time)
    rng = np.random.default_rng(seed)
    start = model.model.output(0.0, model.model.x0(), u[:, 0], model.model.theta())
    y = start[:, np.newaxis] + model.noise_std[:, np.newaxis] * rng.standard_normal((start.size, time.size))
    return PlainLog("log", time, u, y)


def same(filtered: np.ndarray, own: FilterRun, **tolerance: float) -> None:
    np.testing.assert_allclose(filtered, own.filtered_mean.T, **{"rtol": 1e-10, "atol": 1e-12, **tolerance})


def test_an_ordinary_script_finds_what_a_run_finds() -> None:
    model = pendulum_filter(noise_scheme="sampled")
    time = np.arange(60) * DT
    log = sampled(model, time)
    own = run(model, log, compiled=False)
    ukf = filterpy_filter(model, DT)
    found, nll = [], 0.0
    for k, z in enumerate(log.y.T):
        if k > 0:
            ukf.predict(u=log.u[:, k - 1], u_end=log.u[:, k], t=time[k - 1])
        ukf.update(z, u=log.u[:, k])
        found.append(ukf.x)
        nll -= ukf.log_likelihood
    same(np.array(found), own)
    assert nll == pytest.approx(own.nll, rel=1e-12)
    np.testing.assert_allclose(ukf.P, own.filtered_cov[..., -1], rtol=1e-10, atol=1e-14)


def test_steps_of_any_length_and_inputs_by_name() -> None:
    model = circuit_filter(noise_scheme="sampled")
    time = np.array([0.0, 0.05, 0.1, 0.25, 0.3, 0.35])
    log = sampled(model, time)
    name = model.model.names("input")[0]
    held = PlainLog("log", time, np.repeat(model.model.u0(**{name: 3.0})[:, np.newaxis], 6, axis=1), log.y)
    own = run(model, held, compiled=False)
    ukf = filterpy_filter(model, DT, u={name: 3.0})
    ukf.update(log.y[:, 0])
    for step, z in zip(np.diff(time), log.y.T[1:], strict=True):
        ukf.Q = step * ukf.noise_per_second
        ukf.predict(step)
        ukf.update(z)
    np.testing.assert_allclose(ukf.x, own.filtered_mean[:, -1], rtol=1e-10)
    np.testing.assert_allclose(ukf.P, own.filtered_cov[..., -1], rtol=1e-9)


def test_batch_filter_and_smoother_are_those_of_a_log_that_begins_a_step_earlier() -> None:
    model = pendulum_filter(noise_scheme="sampled")
    time = np.arange(31) * DT
    log = sampled(model, time)
    u = np.repeat(model.model.u0()[:, np.newaxis], 31, axis=1)
    y = log.y.copy()
    y[:, 0] = np.nan
    own = run(model, PlainLog("log", time, u, y), compiled=False)
    ukf = filterpy_filter(model, DT)
    means, covs = ukf.batch_filter(list(log.y.T[1:]))
    np.testing.assert_allclose(means, own.filtered_mean.T[1:], rtol=1e-10, atol=1e-12)
    smoothed, widths, _ = ukf.rts_smoother(means, covs)
    expected = smooth(own)
    np.testing.assert_allclose(smoothed, expected.smoothed_mean.T[1:], rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(widths, np.moveaxis(expected.smoothed_cov, 2, 0)[1:], rtol=1e-7, atol=1e-11)


def test_a_script_may_bring_functions_and_noise_of_its_own() -> None:
    model = pendulum_filter()
    ukf = filterpy_filter(model, DT)
    ukf.predict(dt=0.1, fx=lambda x, dt: x + dt)
    np.testing.assert_allclose(ukf.x, model.model.x0() + 0.1)
    ukf.update([0.3], R=4.0, hx=lambda x: x[:1])
    assert ukf.S[0, 0] == pytest.approx(4.0 + ukf.P_prior[0, 0])


def test_outputs_that_the_filter_does_not_use_are_no_measurements() -> None:
    model = driveline_filter(measurement_noise={"wheel_speed": 0.3})
    ukf = filterpy_filter(model, 0.1)
    ukf.predict()
    ukf.update([float(model.model.x0()[model.model.index("state", "omega_wheel")])])
    np.testing.assert_allclose(ukf.R, [[0.09]])
    assert ukf.x.shape == (4,) and np.isfinite(ukf.log_likelihood)


def test_appended_parameters_are_states_of_the_object() -> None:
    model = pendulum_filter(appended={"damping": 0.02}, noise_scheme="sampled")
    log = sampled(model, np.arange(20) * DT)
    own = run(model, PlainLog("log", log.time, 0.0 * log.u, log.y), compiled=False)
    ukf = filterpy_filter(model, DT, u=np.zeros(log.u.shape[0]))
    ukf.update(log.y[:, 0])
    for z in log.y.T[1:]:
        ukf.predict()
        ukf.update(z)
    np.testing.assert_allclose(ukf.x, own.filtered_mean[:, -1], rtol=1e-10)


def test_the_object_has_the_noises_of_the_filter_model() -> None:
    ukf = filterpy_filter(pendulum_filter(alpha=0.4), DT)
    np.testing.assert_allclose(ukf.P, np.diag([0.04, 0.25]))
    np.testing.assert_allclose(ukf.R, [[0.0025]])
    np.testing.assert_allclose(ukf.Q, DT * np.diag([0.0004, 0.09]))
    assert ukf.points_fn.alpha == 0.4


def test_parameters_are_given_by_name_or_as_a_vector() -> None:
    model = pendulum_filter()
    by_name, as_vector = (filterpy_filter(model, DT, one) for one in ({"length": 2.0}, [2.0, *model.model.theta()[1:]]))
    by_name.predict()
    as_vector.predict()
    np.testing.assert_array_equal(by_name.P, as_vector.P)


def test_what_filterpy_cannot_have_is_refused() -> None:
    with pytest.raises(OptionError, match="Model was given where a filter model is expected"):
        filterpy_filter(pendulum_filter().model, DT)  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="did you mean 'drive'"):
        filterpy_filter(pendulum_filter(), DT, u={"driev": 1.0})
    with pytest.raises(FilterError, match="no robust='gate'"):
        filterpy_filter(pendulum_filter(robust=Robust("gate")), DT)
    with pytest.raises(FilterError, match=r"give choose_method\(filter_model, logs\)"):
        filterpy_filter(pendulum_filter(method="auto"), DT)
    with pytest.raises(FilterError, match=r"dt = 0\.0 - give the seconds"):
        filterpy_filter(pendulum_filter(), 0.0)
    with pytest.raises(FilterError, match=r"inputs of shape \(3,\) - give 1 numbers in the order"):
        filterpy_filter(pendulum_filter(), DT).predict(u=np.zeros(3))


def test_older_versions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filterpy, "__version__", "1.4.5")
    with pytest.raises(FilterError, match=r"filterpy 1\.4\.5 does not draw the sigma points anew"):
        filterpy_filter(pendulum_filter(), DT)


def test_its_absence_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "filterpy", None)
    with pytest.raises(FilterError, match="filterpy is not installed"):
        filterpy_filter(pendulum_filter(), DT)
