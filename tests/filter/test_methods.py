"""The compiled filter with every integration method: equal to filterpy 2.0.0 and to numpy, and robust where stiff."""

from __future__ import annotations

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from bondgraph.compile import machine_code as compile
from bondgraph.errors import FilterError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filterpy_bridge import filterpy_run
from bondgraph.filter.likelihood import innovations, likelihood
from bondgraph.filter.runs import run
from bondgraph.simulate.outcome import Outcome
from tests.filter.logs import PlainLog, circuit_filter, driveline_filter, pendulum_filter, simulated_log
from tests.simulate.samples import decay

STIFF = pytest.mark.parametrize("method", ["ros3p", "rodas4"])


@pytest.mark.parametrize("alpha", [1e-3, 1e-2, 0.1, 1.0])
@pytest.mark.parametrize("make", [circuit_filter, pendulum_filter, driveline_filter])
def test_likelihoods_equal_those_of_filterpy(make, alpha: float) -> None:
    """At small alpha filterpy's weights cancel: it keeps the digits that 1/alpha^2 leaves it."""
    model = make(alpha=alpha)
    log = simulated_log(model, np.arange(80) * 0.02, seed=1)
    log = replace(log, y=np.where(np.random.default_rng(4).random(log.y.shape) < 0.2, np.nan, log.y))
    expected = filterpy_run(model, log).nll
    assert likelihood(model, log).nll[0] == pytest.approx(expected, rel=1e-8)
    batch = likelihood(model, log, np.repeat(model.model.theta()[:, np.newaxis], 9, axis=1))
    np.testing.assert_allclose(batch.nll, expected, rtol=1e-8)


@STIFF
@pytest.mark.parametrize("make", [circuit_filter, pendulum_filter, driveline_filter])
def test_stiff_methods_are_the_same_compiled_and_in_numpy(make, method: str) -> None:
    plain = make()
    model = replace(plain, method=method, grading=1.5, substeps=4, appended={plain.model.parameters[1].name: 0.01})
    log = simulated_log(model, np.arange(30) * 0.02, seed=2)
    compiled, reference = (likelihood(model, log, compiled=compiled) for compiled in (True, False))
    assert compiled.nll[0] == pytest.approx(reference.nll[0], rel=1e-9)
    assert compiled.method == method
    both = [run(model, log, compiled=compiled) for compiled in (True, False)]
    np.testing.assert_allclose(both[0].filtered_mean, both[1].filtered_mean, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(both[0].cross_cov, both[1].cross_cov, rtol=1e-6, atol=1e-9)


@STIFF
def test_stiff_methods_agree_with_fine_explicit_steps(method: str) -> None:
    model = driveline_filter()
    log = simulated_log(model, np.arange(200) * 0.02, seed=3)
    fine = likelihood(replace(model, substeps=80), log).nll[0]
    stiff = likelihood(replace(model, method=method, substeps=16, grading=1.2), log).nll[0]
    assert abs(stiff - fine) < 0.1


@STIFF
@pytest.mark.parametrize("alpha", [1e-3, 0.1, 1.0])
def test_a_stiff_model_is_bounded_at_any_step(method: str, alpha: float) -> None:
    """Step times rate of 1e4, at which explicit steps diverge at once."""
    model = FilterModel(
        decay(rate=1e5),
        {"level": 0.1},
        {"reading": 0.05},
        {"level": 1.0},
        noise_scheme="sampled",
        method=method,
        substeps=1,
        alpha=alpha,
    )
    time = np.arange(50) * 0.1
    log = PlainLog("stiff", time, np.stack([1e5 * np.sin(time), 0.0 * time]), np.sin(time)[None])
    result = likelihood(model, log)
    assert result.outcomes == (Outcome.OK,)
    assert not result.refined[0]
    assert likelihood(replace(model, method="rk4"), log).outcomes == (Outcome.DIVERGED,)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_diverging_member_is_tried_with_twice_the_steps(compiled: bool) -> None:
    """A step of 4.5 time constants is unstable, half of it is not; unmeasured, the state runs away."""
    model = FilterModel(decay(), {"level": 0.1}, {"reading": 0.1}, {"level": 0.1}, noise_scheme="sampled", substeps=1)
    time = np.arange(900) * 1.0
    log = PlainLog("a", time, np.zeros((2, 900)), np.where(time < 1.0, 1.0, np.nan)[None])
    rates = np.array([[1.0, 4.5, 40.0]])
    result = likelihood(model, log, rates, compiled=compiled)
    assert result.outcomes == (Outcome.OK, Outcome.OK, Outcome.DIVERGED)
    assert result.refined.tolist() == [False, True, True]
    finer = likelihood(replace(model, substeps=2), log, rates[:, :2], compiled=compiled)
    assert result.nll[1] == finer.nll[1]
    (record,) = innovations(model, log, rates, compiled=compiled)
    assert np.isfinite(record.values[..., :2]).all()
    assert np.isnan(record.values[..., 2]).all()


def test_members_that_fail_do_not_touch_their_neighbours() -> None:
    model = driveline_filter()
    log = simulated_log(model, np.arange(40) * 0.02, seed=5)
    theta = model.model.theta()[:, None] * np.random.default_rng(1).uniform(0.9, 1.1, (len(model.model.parameters), 16))
    good = likelihood(model, log, theta)
    broken = theta.copy()
    broken[:, [0, 7, 15]] = np.nan
    mixed = likelihood(model, log, broken)
    kept = [m for m in range(16) if m not in (0, 7, 15)]
    np.testing.assert_array_equal(mixed.nll[kept], good.nll[kept])
    assert all(mixed.outcomes[m] is Outcome.DIVERGED for m in (0, 7, 15))


@pytest.mark.parametrize("settings", [{"grading": 0.05}, {"method": "ros3p", "grading": 0.0}, {"method": "ros4p"}])
def test_methods_out_of_range_are_told(settings: dict) -> None:
    with pytest.raises(FilterError, match=r"grading|ros4p"):
        pendulum_filter(**settings)


@pytest.mark.parametrize("method", ["rk4", "ros3p"])
def test_without_numba_the_numbers_are_the_same(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model = pendulum_filter(method=method)
    log = simulated_log(model, np.arange(20) * 0.05, seed=1)
    theta = np.stack([model.model.theta(length=length) for length in (0.9, 1.1)], axis=1)
    expected = likelihood(model, log, theta)
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "numba" else found(name, *rest)
    )
    compile._say_fallback.cache_clear()
    with pytest.warns(UserWarning, match="numba is not installed"):
        plain = likelihood(model, log, theta)
    np.testing.assert_allclose(plain.nll, expected.nll, rtol=1e-9)
    assert plain.method == method
