"""Filters over streams: the numbers of a whole log, late and repeated samples, saved states, followed noise levels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.errors import FilterError, ModelError, OptionError
from bondgraph.filter.adaptive import AdaptiveNoise, NoiseBelief, updated
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.online import OnlineFilter
from bondgraph.filter.online_state import FilterStep, OnlineState
from bondgraph.filter.robust import Robust
from bondgraph.filter.runs import run
from bondgraph.filter.smoother import smooth
from bondgraph.simulate.outcome import Outcome
from tests.filter.logs import (
    PlainLog,
    circuit_filter,
    driveline_filter,
    pendulum_filter,
    simulated_log,
    uneven_times,
)
from tests.filter.test_ukf import with_missing
from tests.simulate.samples import decay

#: Of the step, and of the run over a whole log.
SAME = {
    "predicted_mean": "predicted_mean", "predicted_cov": "predicted_cov", "mean": "filtered_mean",
    "cov": "filtered_cov", "output_mean": "output_mean", "output_cov": "output_cov", "whitened": "whitened",
    "log_scales": "log_scales", "innovation": "innovation", "nis": "nis", "log_likelihood": "log_likelihood",
}  # fmt: skip


def online_for(model: FilterModel, log: PlainLog, **choices: object) -> OnlineFilter:
    return OnlineFilter(model, interval=float(np.median(np.diff(log.time))), **choices)  # type: ignore[arg-type]


def streamed(online: OnlineFilter, log: PlainLog) -> list[FilterStep]:
    return [online.step(t, log.u[:, k], log.y[:, k]) for k, t in enumerate(log.time)]


@pytest.mark.parametrize(
    "model",
    [
        pendulum_filter(noise_nodes=3, noise_reach=30.0),
        circuit_filter(noise_scheme="sampled"),
        driveline_filter(appended={"tau_grip": 2.0}, robust=Robust("student")),
        driveline_filter(method="ros3p", grading=1.3, substeps=3),
    ],
    ids=["nodes", "sampled", "appended, robust", "stiff"],
)
def test_a_stream_has_the_bits_of_a_log(model: FilterModel) -> None:
    log = with_missing(simulated_log(model, uneven_times(40, 0.03, seed=6), seed=6), seed=6)
    whole, online = run(model, log), online_for(model, log)
    steps = streamed(online, log)
    for ours, theirs in SAME.items():
        found = np.stack([np.asarray(getattr(step, ours)) for step in steps], axis=-1)
        if ours in ("nis", "log_likelihood"):  # sums, which numpy takes in another order
            np.testing.assert_allclose(found, getattr(whole, theirs), rtol=1e-12, atol=1e-12)
        else:
            np.testing.assert_array_equal(found, getattr(whole, theirs), err_msg=ours)
    assert online.nll == pytest.approx(whole.nll, rel=1e-12)


def test_the_numpy_stream_has_the_numbers_of_the_numpy_filter() -> None:
    model = pendulum_filter(robust=Robust("huber"))
    log = with_missing(simulated_log(model, uneven_times(25, 0.03, seed=6), seed=6), seed=6)
    whole, steps = run(model, log, compiled=False), streamed(online_for(model, log, compiled=False), log)
    for ours, theirs in SAME.items():
        found = np.stack([np.asarray(getattr(step, ours)) for step in steps], axis=-1)
        np.testing.assert_allclose(found, getattr(whole, theirs), rtol=1e-12, atol=1e-13, err_msg=ours)


def test_channels_of_one_time_may_come_one_after_the_other() -> None:
    model = circuit_filter()  # linear, so that the order is no matter
    log = simulated_log(model, np.arange(30) * 0.05, seed=3)
    together, apart = online_for(model, log), online_for(model, log)
    for k, t in enumerate(log.time):
        whole = together.step(t, log.u[:, k], log.y[:, k])
        apart.step(t, log.u[:, k], {"current": log.y[0, k]})
        last = apart.step(t, y={"voltage": log.y[1, k]})
    np.testing.assert_allclose(last.mean, whole.mean, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(last.cov, whole.cov, rtol=1e-11, atol=1e-14)
    assert apart.nll == pytest.approx(together.nll, rel=1e-12)


@settings(max_examples=8, deadline=None)
@given(order=st.permutations(range(6)))
def test_late_samples_end_where_the_sorted_ones_do(order: list[int]) -> None:
    model = pendulum_filter()
    log = simulated_log(model, uneven_times(12, 0.03, seed=5), seed=5)
    sorted_filter, late = online_for(model, log), online_for(model, log, history=10.0)
    expected = streamed(sorted_filter, log)[-1]
    for k in [*range(4), *(4 + place for place in order), 10, 11]:
        found = late.step(log.time[k], log.u[:, k], log.y[:, k])
        assert found.accepted
    np.testing.assert_array_equal(found.mean, expected.mean)
    np.testing.assert_array_equal(found.cov, expected.cov)
    assert late.nll == sorted_filter.nll


def test_a_late_sample_takes_its_inputs_from_those_around_it() -> None:
    model = FilterModel(decay(rate=0.0, initial=0.0), {}, {"reading": 1.0}, {"level": 1.0})
    names = model.model.names("input")
    online = OnlineFilter(model, interval=1.0, history=5.0)
    online.step(0.0, dict(zip(names, (0.0, 5.0), strict=True)))
    online.step(2.0, dict(zip(names, (4.0, 0.0), strict=True)))
    found = online.step(1.0, y={"reading": 7.0})
    assert found.replayed == 1
    held_and_linear = online.state.remembered[1].u
    np.testing.assert_array_equal(held_and_linear, np.where(online._intervals.hold, [0.0, 5.0], [2.0, 2.5]))


def test_what_is_too_late_changes_nothing() -> None:
    model = pendulum_filter()
    log = simulated_log(model, np.arange(20) * 0.05, seed=5)
    for history, late, said in ((0.0, 0.01, "remembered for 0 s"), (0.2, 0.3, "remembered for 0.2 s")):
        online = online_for(model, log, history=history)
        before = streamed(online, log)[-1]
        refused = online.step(log.time[-1] - late, y=[9.0])
        assert not refused.accepted and said in refused.reason
        np.testing.assert_array_equal(refused.mean, before.mean)
        assert np.isnan(refused.nis)
        assert len(online.state.remembered) == (1 if not history else 6)  # those within, and the belief before them


def test_a_filter_that_would_diverge_keeps_its_belief() -> None:
    model = pendulum_filter()
    online = OnlineFilter(model, interval=0.05)
    good = online.step(0.0, y=[0.1])
    bad = online.step(0.05, u=[1e300])
    assert (bad.accepted, bad.outcome, "non-finite" in bad.reason) == (False, Outcome.DIVERGED, True)
    np.testing.assert_array_equal(bad.mean, good.mean)
    assert online.step(0.1, u=[0.0], y=[0.1]).accepted


def test_a_saved_state_goes_on_with_the_same_bits(tmp_path: Path) -> None:
    model = driveline_filter()
    log = with_missing(simulated_log(model, uneven_times(30, 0.03, seed=2), seed=2), seed=2)
    choices: dict[str, object] = {"history": 0.2, "adaptive": AdaptiveNoise(1.0)}
    first, second = online_for(model, log, **choices), online_for(model, log, **choices)
    for k in range(15):
        first.step(log.time[k], log.u[:, k], log.y[:, k])
    first.state.save(tmp_path / "state.json")
    second.restore(OnlineState.load(tmp_path / "state.json"))
    for k in (15, 16, 14, 17):  # 14 comes once more, late
        one, two = (online.step(log.time[k], log.u[:, k], log.y[:, k]) for online in (first, second))
        np.testing.assert_array_equal(one.mean, two.mean)
        np.testing.assert_array_equal(one.noise_std, two.noise_std)
    assert first.nll == second.nll
    with pytest.raises(FilterError, match="belongs to another filter model or other parameters"):
        online_for(model, log, theta={"k_shaft": 500.0}).restore(first.state)
    (tmp_path / "other.json").write_text('{"format": "photo"}')
    with pytest.raises(FilterError, match="no state of an on-line filter"):
        OnlineState.load(tmp_path / "other.json")


def test_noise_levels_of_a_linear_model_are_those_of_the_reference() -> None:
    """The variational update written out for one state, one sensor: equations 23 to 25 of the reference."""
    known, y, mean, var = NoiseBelief(np.array([3.0]), np.array([0.5])), 1.3, 0.2, 0.4
    shape, scale = 3.5, 0.5
    for _ in range(50):
        noise = scale / shape
        gain = var / (var + noise)
        after, left = mean + gain * (y - mean), var - gain * var
        scale = 0.5 + 0.5 * (y - after) ** 2 + 0.5 * left
    found = updated(known, np.array([y]), np.array([mean]), np.array([[var]]))
    assert found.scale[0] == pytest.approx(scale, rel=1e-5)
    assert found.shape[0] == shape


def test_a_step_in_the_noise_of_a_sensor_is_followed() -> None:
    model = circuit_filter(measurement_noise={"current": 0.05, "voltage": 0.05})
    time = np.arange(1200) * 0.05
    log = simulated_log(model, time, seed=4)
    worse = np.where(time > 30.0, 0.25, 0.0) * np.random.default_rng(3).standard_normal(time.size)
    log.y[1] += worse
    log.y[0, 500:520] = np.nan  # a sensor that is silent keeps its level
    steps = streamed(online_for(model, log, adaptive=AdaptiveNoise(8.0)), log)
    levels = np.array([step.noise_std for step in steps])
    truth = np.hypot(0.05, 0.25)
    assert np.median(levels[400:600], axis=0) == pytest.approx([0.05, 0.05], rel=0.25)
    assert np.median(levels[1000:, 1]) == pytest.approx(truth, rel=0.15)
    assert np.median(levels[1000:, 0]) == pytest.approx(0.05, rel=0.25)
    assert levels[601 + 4, 1] < 0.8 * truth  # it takes its time


def test_bad_input_is_refused_with_what_to_do() -> None:
    model = pendulum_filter()
    online = OnlineFilter(model, interval=0.05)
    for call, error, message in (
        (lambda: OnlineFilter(replace(model, method="auto")), FilterError, "choose one with choose_method"),
        (lambda: OnlineFilter(model, interval=-1.0), FilterError, "interval is -1.0 s - give a positive time"),
        (lambda: OnlineFilter(model, history=np.inf), FilterError, "history is inf s"),
        (lambda: OnlineFilter(model, theta=[1.0]), FilterError, r"theta has shape \(1,\), not \(3,\)"),
        (lambda: OnlineFilter(model, adaptive=AdaptiveNoise(1.0)), FilterError, "adaptive needs the interval"),
        (lambda: AdaptiveNoise(0.0), FilterError, "memory is 0.0 s"),
        (lambda: online.step(np.nan), FilterError, "step at t = nan"),
        (lambda: online.step(0.0, u={"driev": 1.0}), ModelError, "drive"),
        (lambda: online.step(0.0, u=[np.inf]), FilterError, "input 'drive' has no finite value"),
        (lambda: online.step(0.0, y={"angel": 1.0}), FilterError, "no output 'angel'"),
        (lambda: online.step(0.0, y=[1.0, 2.0]), FilterError, r"y has shape \(2,\), not \(1,\)"),
        (lambda: online.step(0.0, y={"deflection": np.inf}), FilterError, "output 'deflection' is inf - give a finite"),
        (lambda: online.step(0.0, y={"deflection": "high"}), FilterError, "'high' is no number"),
        (lambda: OnlineFilter(model.model), OptionError, "Model was given where a filter model is expected"),
    ):
        with pytest.raises(error, match=message):
            call()  # type: ignore[no-untyped-call]
    deaf = driveline_filter(measurement_noise={"engine_speed": 1.0})
    with pytest.raises(FilterError, match="'wheel_speed' is measured but measurement_noise does not name it"):
        OnlineFilter(deaf).step(0.0, y={"wheel_speed": 3.0})
    robust = replace(model, robust=Robust("gate"))
    with pytest.raises(FilterError, match="outliers would be noise - choose one"):
        OnlineFilter(robust, interval=0.1, adaptive=AdaptiveNoise(1.0))


def test_a_stream_of_a_log_is_shown_as_a_run_and_not_smoothed() -> None:
    model = driveline_filter(appended={"tau_grip": 2.0}, initial_std={"omega_engine": 10.0, "tau_grip": 5.0})
    log = simulated_log(model, np.arange(12) * 0.025, seed=7)
    found = online_for(model, log).follow(log)
    assert found.nll == pytest.approx(run(model, log).nll, rel=1e-12)
    assert "tau_grip" in found.summary()
    axes = found.plot()
    assert axes.get_ylabel() == "tau_grip [N m]"
    assert found.plot("v_body", axes) is axes
    with pytest.raises(FilterError, match="no state 'v_bdoy'; did you mean 'v_body'"):
        found.plot("v_bdoy")
    with pytest.raises(FilterError, match="filtered on line"):
        smooth(found)
    loaded = replace(log, theta_overrides={"m_vehicle": 300.0})
    with pytest.raises(FilterError, match="the log knows m_vehicle, and the filter has other values"):
        online_for(model, log).follow(loaded)
    assert online_for(model, log, theta={"m_vehicle": 300.0}).follow(loaded).time.size == 12
