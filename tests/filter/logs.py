"""Logs and models for filter tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.samples import Samples
from bondgraph.filter.ukf import transition
from bondgraph.simulate.model import Model
from tests.simulate.samples import sample


@dataclass(frozen=True)
class PlainLog:
    name: str
    time: FloatArray
    u: FloatArray
    y: FloatArray
    theta_overrides: Mapping[str, float] = field(default_factory=dict)


def pendulum_filter(**changes: object) -> FilterModel:
    settings: dict[str, object] = {
        "process_noise": {"angle": 0.02, "rate": 0.3},
        "measurement_noise": {"deflection": 0.05},
        "initial_std": {"angle": 0.2, "rate": 0.5},
        "substeps": 2,
    }
    return FilterModel(sample("pendulum"), **{**settings, **changes})  # type: ignore[arg-type]


def circuit_filter(**changes: object) -> FilterModel:
    settings: dict[str, object] = {
        "process_noise": {"i_coil": 0.3, "u_capacitor": 0.1},
        "measurement_noise": {"current": 0.2, "voltage": 0.1},
        "initial_std": {"i_coil": 1.0, "u_capacitor": 0.5},
        "substeps": 3,
    }
    return FilterModel(sample("rlc"), **{**settings, **changes})  # type: ignore[arg-type]


def driveline_filter(**changes: object) -> FilterModel:
    settings: dict[str, object] = {
        "process_noise": {"omega_engine": 3.0, "omega_wheel": 0.5, "v_body": 0.1},
        "measurement_noise": {"engine_speed": 1.0, "wheel_speed": 0.3, "acceleration": 0.2},
        "initial_std": {"omega_engine": 10.0, "omega_wheel": 1.0, "q_shaft": 0.01, "v_body": 0.3},
        "substeps": 10,  # with 5 the step is unstable in the low gear, which only shows in the innovations
    }
    return FilterModel(sample("driveline"), **{**settings, **changes})  # type: ignore[arg-type]


def rolling_inputs(model: Model, time: FloatArray) -> FloatArray:
    """Inputs that move: the first one waves, codes change now and then."""
    u = np.repeat(model.u0()[:, np.newaxis], time.size, axis=1)
    u[0] += 0.4 * np.sin(3.0 * time)
    for row, info in enumerate(model.inputs):
        if info.letters:
            u[row, time > time.mean()] = list(info.letters.values())[1]
    return u


def simulated_log(filter_model: FilterModel, time: FloatArray, seed: int, name: str = "simulated") -> PlainLog:
    """A log drawn from exactly what the filter assumes: prior, process noise and measurement noise."""
    model, rng = filter_model.model, np.random.default_rng(seed)
    theta = model.theta()
    u = rolling_inputs(model, time)
    nothing = PlainLog(name, time, u, np.full((len(model.outputs), time.size), np.nan))
    samples = Samples.of(filter_model, nothing)
    n_x = len(model.states)
    state = filter_model.start_mean(theta, model.x0()) + filter_model.start_std * rng.standard_normal(
        filter_model.start_std.size
    )
    y, row = np.empty_like(nothing.y), 0
    root = np.linalg.cholesky(filter_model.process_correlations)

    def kick(seconds: float) -> FloatArray:
        noise: FloatArray = filter_model.process_std * (root @ rng.standard_normal(state.size))
        return noise * np.sqrt(seconds)

    for k in range(samples.time.size):
        if k > 0:
            move = transition(filter_model, samples, k, theta)
            state = state + kick(samples.noise_start[k - 1])
            state = move(state[:, np.newaxis])[:, 0] + kick(samples.noise_end[k - 1])
        if k in samples.sample:
            known = theta.copy()
            known[filter_model.appended_index] = state[n_x:]
            y[:, row] = model.output(float(samples.time[k]), state[:n_x], u[:, row], known)
            row += 1
    sensors = np.linalg.cholesky(filter_model.noise_correlations)
    y += filter_model.noise_std[:, np.newaxis] * (sensors @ rng.standard_normal(y.shape))
    return PlainLog(name, time, u, y)


def uneven_times(n: int, interval: float, seed: int) -> FloatArray:
    """Jittered times with a gap in the middle."""
    rng = np.random.default_rng(seed)
    steps = interval * rng.uniform(0.8, 1.2, n)
    steps[n // 2] = 4.0 * interval
    return np.cumsum(steps) - steps[0]
