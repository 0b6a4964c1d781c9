"""Process noise between samples: against closed forms, an exact Kalman filter, and itself with finer nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from bondgraph.data.log import MatchedLog
from bondgraph.errors import FilterError
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.problem import pose
from bondgraph.filter.discretisation import step_times_rate
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filterpy_bridge import filterpy_run
from bondgraph.filter.gradient import Directions, innovation_tangents
from bondgraph.filter.likelihood import likelihood
from bondgraph.filter.noise_choice import exponentials, gathered_noise, with_noise_nodes
from bondgraph.filter.noise_nodes import continuous_nodes, sampled_nodes
from bondgraph.filter.runs import run
from bondgraph.filter.samples import Samples
from bondgraph.filter.smoother import smooth
from bondgraph.filter.ukf import Member
from tests.filter.kalman import runge_kutta_map
from tests.filter.logs import PlainLog, circuit_filter, driveline_filter, pendulum_filter, simulated_log, uneven_times
from tests.simulate.samples import decay

RATE = 6.0
BOTH = pytest.mark.parametrize("compiled", [False, True])


def forgetful(**changes: object) -> FilterModel:
    """One state that forgets at 6/s, driven by noise of intensity one, measured nearly exactly."""
    noise = {"process_noise": {"level": 1.0}, "measurement_noise": {"reading": 0.01}, "initial_std": {"level": 0.01}}
    return FilterModel(decay(rate=RATE, initial=0.0), **{**noise, "substeps": 8, **changes})  # type: ignore[arg-type]


def unmeasured(time: np.ndarray) -> PlainLog:
    return PlainLog("nothing", time, np.zeros((2, time.size)), np.full((1, time.size), np.nan))


def drawn_exactly(seed: int, interval: float, count: int) -> MatchedLog:
    """The state at the samples by its exact transition and variance, and readings with noise of 0.01."""
    rng = np.random.default_rng(seed)
    keep = np.exp(-RATE * interval)
    std = np.sqrt((1.0 - keep**2) / (2.0 * RATE))
    x = np.zeros(count)
    for k in range(1, count):
        x[k] = keep * x[k - 1] + std * rng.standard_normal()
    y = x + 0.01 * rng.standard_normal(count)
    return MatchedLog(f"every_{interval:g}", np.arange(count) * interval, np.zeros((2, count)), y[np.newaxis])


@BOTH
@pytest.mark.parametrize("interval", [0.025, 0.1, 0.4])
def test_a_rate_forgets_what_has_driven_it(interval: float, compiled: bool) -> None:
    """The variance of the next sample; adding std^2 dt at its end gave 0.4 instead of 0.083 at 400 ms."""
    time = np.arange(8) * interval
    model = forgetful(initial_std={}, noise_nodes=8, noise_reach=RATE)
    variance = run(model, unmeasured(time), compiled=compiled).predicted_cov[0, 0]
    np.testing.assert_allclose(variance, (1.0 - np.exp(-2.0 * RATE * time)) / (2.0 * RATE), rtol=1e-3)
    whole = run(replace(model, noise_scheme="sampled"), unmeasured(time), compiled=compiled).predicted_cov[0, 0]
    assert whole[1] == pytest.approx(interval, rel=1e-12)


@BOTH
def test_a_gap_is_as_uncertain_as_it_is(compiled: bool) -> None:
    """After five seconds the predicted variance was 5.0, where the state has long come to its 1/12."""
    time = np.append(np.arange(30) * 0.05, 1.45 + 5.0)
    variance = run(forgetful(), unmeasured(time), compiled=compiled).predicted_cov[0, 0, -1]
    assert variance == pytest.approx(1.0 / (2.0 * RATE), rel=0.01)


@pytest.mark.parametrize("interval", [0.025, 0.05, 0.1, 0.2, 0.4])
def test_the_level_is_estimated_whatever_the_sampling(interval: float) -> None:
    """At these rates a true level of one was estimated as 0.93, 0.86, 0.77, 0.63, 0.45, each time certified."""
    log = drawn_exactly(seed=5, interval=interval, count=1200)
    problem = pose(with_noise_nodes(forgetful(), [log]), log, ["process(level)"])
    found = estimate(problem, Settings(method="gradient"))
    std = float(np.sqrt(found.covariance[0, 0])) * found.values["process(level)"]
    assert found.certification.certified
    assert abs(found.values["process(level)"] - 1.0) < 3.0 * std
    assert std < 0.05


@st.composite
def linear_models(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, float]:
    """A stable matrix, a covariance per second, and an interval over which it moves by up to a few time constants."""
    size = draw(st.integers(1, 4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    matrix = rng.normal(size=(size, size))
    matrix -= (np.max(np.linalg.eigvals(matrix).real) + 0.1) * np.eye(size)
    root = rng.normal(size=(size, size))
    return matrix, root @ root.T, draw(st.floats(0.01, 1.0))


@given(linear_models())
@settings(deadline=None, max_examples=60)
def test_nodes_gather_the_covariance_of_van_loan(case: tuple[np.ndarray, np.ndarray, float]) -> None:
    """Every two nodes more take nine tenths of the error, down to what the matrix exponential gives."""
    matrix, noise, interval = case
    exact = gathered_noise(matrix, noise, interval)
    errors = []
    for inside in (2, 4, 6):
        nodes = continuous_nodes(np.array([0.0, interval]), inside, 0.0)
        gathered = np.zeros(noise.shape)
        for length, start, end in zip(np.diff(nodes.time), nodes.start, nodes.end, strict=True):
            move = expm(matrix * length)
            gathered = move @ (gathered + start * noise) @ move.T + end * noise
        errors.append(np.abs(gathered - exact).max() / np.abs(exact).max())
    assert errors[1] < max(0.1 * errors[0], 1e-9) and errors[2] < max(0.1 * errors[1], 1e-9)


def test_exponentials_of_a_stack_are_those_of_scipy() -> None:
    rng = np.random.default_rng(5)
    scales = np.array([0.0, 1e-8, 0.3, 1.0, 20.0])
    matrices = scales[:, np.newaxis, np.newaxis] * rng.standard_normal((5, 4, 4))
    expected = np.array([expm(matrix) for matrix in matrices])
    sizes = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert exponentials(matrices) / sizes == pytest.approx(expected / sizes, abs=1e-12)
    assert exponentials(np.zeros((0, 3, 3))).shape == (0, 3, 3)


@given(linear_models(), st.floats(1e-3, 1e4))
@settings(deadline=None, max_examples=40)
def test_the_gathered_covariance_solves_its_equation(case: tuple[np.ndarray, np.ndarray, float], longer: float) -> None:
    """Over two intervals it is what the first leaves of itself and what the second adds; for ever, Lyapunov's."""
    matrix, noise, interval = case
    first, second = gathered_noise(matrix, noise, interval), gathered_noise(matrix, noise, longer)
    move = expm(matrix * longer)
    whole = gathered_noise(matrix, noise, interval + longer)
    np.testing.assert_allclose(whole, move @ first @ move.T + second, atol=1e-9 * np.abs(whole).max())


@given(st.integers(0, 6), st.sampled_from([0.5, 1.0, 2.0]), st.integers(0, 1000))
def test_nodes_hold_every_sample_and_all_of_the_noise(steps: int, grading: float, seed: int) -> None:
    time = uneven_times(12, 0.1, seed)
    nodes = continuous_nodes(time, steps, grading)
    assert np.all(np.diff(nodes.time) > 0.0)
    np.testing.assert_array_equal(nodes.time[nodes.sample], time)
    entered = np.zeros(time.size - 1)
    np.add.at(entered, nodes.interval, nodes.start + nodes.end)
    np.testing.assert_allclose(entered, np.diff(time), rtol=1e-12)
    assert np.all(sampled_nodes(time).start == 0.0)


def exact_filter(model: FilterModel, log: PlainLog) -> tuple[np.ndarray, np.ndarray, float]:
    """Predicted means and covariances and the likelihood of a Kalman filter with the noise of Van Loan."""
    own, n = Member.of(model), len(model.model.states)
    slope = np.column_stack(
        [model.model.rhs(0.0, e, log.u[:, 0] * 0, own.theta) for e in np.eye(n)]
    )  # fmt: skip
    h = np.column_stack([model.model.output(0.0, e, log.u[:, 0] * 0, own.theta) for e in np.eye(n)])
    mean, cov = own.x0, own.initial_lower @ own.initial_lower.T
    means, covs, nll = [], [], 0.0
    for k in range(log.time.size):
        if k > 0:
            f, offset = runge_kutta_map(model, log, k, 64)
            mean = f @ mean + offset
            cov = f @ cov @ f.T + gathered_noise(slope, own.process_cov, log.time[k] - log.time[k - 1])
        means.append(mean)
        covs.append(cov)
        there = ~np.isnan(log.y[:, k])
        if there.any():
            hk, noise = h[there], own.noise_cov[np.ix_(there, there)]
            s = hk @ cov @ hk.T + noise
            innovation = log.y[there, k] - hk @ mean
            gain = cov @ hk.T @ np.linalg.inv(s)
            mean, cov = mean + gain @ innovation, cov - gain @ s @ gain.T
            quadratic = innovation @ np.linalg.solve(s, innovation)
            nll += 0.5 * (quadratic + np.linalg.slogdet(s)[1] + there.sum() * np.log(2 * np.pi))
    return np.array(means).T, np.array(covs).transpose(1, 2, 0), nll


CORRELATED: dict[str, object] = {
    "process_correlation": {("i_coil", "u_capacitor"): 0.6},
    "measurement_correlation": {("current", "voltage"): -0.7},
    "initial_correlation": {("u_capacitor", "i_coil"): 0.4},
}


@BOTH
@pytest.mark.parametrize("correlations", [{}, CORRELATED])
def test_on_a_linear_model_it_is_the_exact_filter(correlations: dict, compiled: bool) -> None:
    model = circuit_filter(alpha=1.0, substeps=64, noise_nodes=8, **correlations)
    log = simulated_log(model, uneven_times(25, 0.1, seed=1), seed=1)
    log.y[0, 5:9] = np.nan
    log.y[:, 20] = np.nan
    mean, cov, nll = exact_filter(model, log)
    ours = run(model, log, compiled=compiled).raise_if_failed()
    np.testing.assert_allclose(ours.predicted_mean, mean, atol=1e-6)
    np.testing.assert_allclose(ours.predicted_cov, cov, atol=1e-6)
    assert ours.nll == pytest.approx(nll, abs=1e-4)


@pytest.mark.parametrize("make", [pendulum_filter, driveline_filter])
def test_numpy_kernel_and_filterpy_agree_at_the_nodes(make) -> None:
    model = make(noise_nodes=2, noise_reach=10.0)
    log = simulated_log(model, uneven_times(30, 0.02, seed=3), seed=2)
    ours, slow, theirs = run(model, log), run(model, log, compiled=False), filterpy_run(model, log)
    assert ours.nll == pytest.approx(slow.nll, rel=1e-10)
    assert ours.nll == pytest.approx(theirs.nll, rel=1e-8)
    np.testing.assert_allclose(ours.cross_cov, slow.cross_cov, rtol=1e-6, atol=1e-9)


def test_correlations_of_a_nonlinear_model_are_those_of_filterpy() -> None:
    model = driveline_filter(
        process_correlation={("omega_engine", "v_body"): 0.5},
        measurement_correlation={("engine_speed", "acceleration"): 0.6},
        initial_correlation={("omega_engine", "omega_wheel"): -0.3},
    )
    log = simulated_log(model, np.arange(30) * 0.02, seed=2)
    assert run(model, log).nll == pytest.approx(filterpy_run(model, log).nll, rel=1e-8)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"measurement_correlation": {("current", "volt"): 0.1}}, "measurement_correlation names 'volt'"),
        ({"process_correlation": {("i_coil", "u_capacitor"): 1.0}}, "between -1 and 1"),
        ({"initial_correlation": {("i_coil", "i_coil"): 0.5}}, "two different quantities"),
        ({"noise_scheme": "discrete"}, "use continuous, sampled"),
        ({"noise_nodes": -1}, "whole number from 0 to 8"),
        ({"noise_nodes": 9}, "whole number from 0 to 8"),
        ({"noise_reach": -1.0}, "finite number from 0"),
    ],
)
def test_what_cannot_be_is_refused(changes: dict, problem: str) -> None:
    with pytest.raises(FilterError, match=problem):
        circuit_filter(**changes)


def test_correlations_that_contradict_each_other_are_refused() -> None:
    pairs = {("omega_engine", "omega_wheel"): 0.9, ("omega_wheel", "v_body"): 0.9, ("omega_engine", "v_body"): -0.9}
    with pytest.raises(FilterError, match="cannot hold together"):
        driveline_filter(process_correlation=pairs)


def test_a_level_for_a_model_that_nothing_drives_is_refused() -> None:
    model = circuit_filter(process_noise={})
    log = simulated_log(model, np.arange(5) * 0.1, seed=1)
    with pytest.raises(FilterError, match="process_noise names none"):
        likelihood(model, log, process_std=np.ones(2))


def test_derivatives_by_correlations_equal_central_differences() -> None:
    model = circuit_filter(alpha=1.0, **CORRELATED)
    log = simulated_log(model, np.arange(40) * 0.05, seed=4)
    names = {"initial_correlation": 2, "process_correlation": 2, "noise_correlation": 2}
    turn = np.array([[0.0, 1.0], [1.0, 0.0]])
    still = (np.zeros((len(model.model.parameters), 3)), *(np.zeros((2, 3)) for _ in range(4)))
    moves = {name: np.stack([turn * (i == k) for k in range(3)], axis=-1) for i, name in enumerate(names)}
    (found,) = innovation_tangents(model, [log], [Member.of(model)], [Directions(*still, **moves)])
    h = 1e-5
    own = Member.of(model)
    for k, name in enumerate(names):
        at = getattr(own, name)
        both = [likelihood(model, log, **{name: at + sign * h * turn}).nll[0] for sign in (1.0, -1.0)]  # type: ignore[arg-type]
        assert found.gradient[k] == pytest.approx((both[0] - both[1]) / (2.0 * h), rel=1e-6)


def test_correlated_sensors_are_estimated() -> None:
    model = circuit_filter(measurement_correlation={("current", "voltage"): -0.7}, substeps=4)
    plain = simulated_log(model, np.arange(600) * 0.05, seed=8)
    log = MatchedLog(plain.name, plain.time, plain.u, plain.y)
    declared = replace(model, measurement_correlation={})
    free = ["corr(voltage, current)", "std(current)", "std(voltage)"]
    found = estimate(pose(declared, log, free), Settings(method="gradient"))
    std = np.sqrt(np.diag(found.covariance))
    assert std[0] < 0.05
    assert abs(found.values[free[0]] + 0.7) < 3.0 * std[0]
    assert abs(np.log(found.values["std(current)"] / 0.2)) < 3.0 * std[1]
    assert found.filter_model.noise_correlations[0, 1] == found.values[free[0]]


@pytest.mark.parametrize(("interval", "inside"), [(0.002, 0), (0.4, 1), (20.0, 2)])
def test_nodes_are_as_many_as_the_rate_asks_for(interval: float, inside: int) -> None:
    log = drawn_exactly(seed=3, interval=interval, count=60)
    model = with_noise_nodes(forgetful(substeps=max(1, int(interval * RATE * 2))), [log])
    assert model.noise_nodes >= inside
    variance = run(model, log).predicted_cov[0, 0, 30]
    keep = np.exp(-2.0 * RATE * interval)
    before = run(model, log).filtered_cov[0, 0, 29]
    assert variance == pytest.approx(keep * before + (1.0 - keep) / (2.0 * RATE), rel=0.01)


def test_a_smoothed_gap_is_that_of_finer_nodes() -> None:
    model = circuit_filter(noise_nodes=2)
    time = np.append(np.arange(20) * 0.05, 1.6 + np.arange(20) * 0.05)
    log = simulated_log(model, time, seed=6)
    coarse, fine = smooth(run(model, log)), smooth(run(replace(model, noise_nodes=8), log))
    np.testing.assert_allclose(coarse.smoothed_mean, fine.smoothed_mean, atol=2e-3)
    np.testing.assert_allclose(coarse.smoothed_cov, fine.smoothed_cov, atol=2e-3)


def test_halved_steps_have_more_nodes_too() -> None:
    model = circuit_filter()
    log = simulated_log(model, np.arange(10) * 0.1, seed=1)
    assert (model.with_halved_steps().noise_nodes, Samples.of(model.with_halved_steps(), log).time.size) == (3, 37)
    assert Samples.of(model, log).substeps.tolist() == [2] * 18
    assert Samples.of(model.with_halved_steps(), log).substeps.tolist() == [2] * 36


def test_the_longest_interval_of_an_uneven_log_decides() -> None:
    """Evenly chosen samples missed a gap; the free run over it diverged unseen."""
    model = forgetful(substeps=1)
    time = np.concatenate([np.arange(100) * 0.01, 0.99 + np.arange(1, 4) * 0.0149, 1.1 + np.arange(100) * 0.01])
    log = unmeasured(time)
    longest = np.max(np.diff(Samples.of(model, log).time) / Samples.of(model, log).substeps)
    assert step_times_rate(run(model, log), log, None) == pytest.approx(RATE * longest, rel=1e-6)
