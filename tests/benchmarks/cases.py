"""What is timed: the vehicle on a drive of 40 samples per second, and chains of masses of any length."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.filter.draw import draw_logs
from bondgraph.filter.filter_model import FilterModel
from bondgraph.generate.module import render
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from vehicle_graphs.ranger_filters import NOISE

RANGER = Path(__file__).resolve().parents[2] / "generated" / "ranger_full.py"

#: The eight parameters of engine and CVT that the thesis estimates.
DRIVELINE = ("T_pk", "T_f0", "k_u", "m_fw", "F_p0", "k_p", "r_h", "mu_b")

#: Process noise that a filter may have beyond that of the road, per sqrt(s): m/s, rad/s, m.
MODERATE = {
    "forward_velocity": 0.02, "heave_rate": 0.02, "pitch_rate": 0.01, "rear_axle_speed": 0.1, "front_axle_speed": 0.1,
    "engine_speed": 1.0, "sheave_displacement": 2e-5,
}  # fmt: skip

#: Runge-Kutta steps per sample of simulated truths; the gripping belt has a rate of up to 12000 1/s.
_TRUE_STEPS = 300

#: Parameters by which a gradient is taken.
FREE = ("spring_gain", "CdA", "f_r", "r_d", "T_pk", "m_fw", "k_p", "r_h")


@dataclass(frozen=True)
class Case:
    """A filter model with a log and its initial state."""

    filter_model: FilterModel
    log: MatchedLog
    x0: np.ndarray

    def cut(self, samples: int) -> MatchedLog:
        """The first samples of the log."""
        log = self.log
        return MatchedLog(log.name, log.time[:samples], log.u[:, :samples], log.y[:, :samples])


def ranger(seconds: float) -> Case:
    """The whole vehicle: 11 states, a loop solved by Newton's method, rates to 4500 1/s."""
    model = Model.from_file(RANGER)
    time = np.arange(round(seconds * 40)) / 40.0
    u = np.repeat(model.u0()[:, np.newaxis], time.size, axis=1)
    u[model.index("input", "throttle")] = 0.25 + 0.2 * np.sin(0.6 * time)
    u[model.index("input", "brake")] = np.where(time % 20.0 > 17.0, 0.2, 0.0)
    u[model.index("input", "inclination_rate")] = 0.02 * np.sin(0.5 * time)
    x0 = model.x0(
        forward_velocity=5.0, rear_axle_speed=5.0 / 0.28, front_axle_speed=5.0 / 0.28, engine_speed=300.0,
        sheave_displacement=0.004,
    )  # fmt: skip
    filter_model = FilterModel(
        model,
        process_noise=dict.fromkeys(model.names("state"), 1e-3) | {
            "forward_velocity": 0.05, "heave_rate": 0.05, "pitch_rate": 0.02, "rear_axle_speed": 0.5,
            "front_axle_speed": 0.5, "engine_speed": 3.0, "sheave_displacement": 1e-4, "inclination": 5e-3,
        },
        measurement_noise={
            "engine_speed": 2.0, "axle_speed": 0.2, "forward_velocity": 0.1, "height": 0.5, "pitch": 0.01,
        },
        initial_std=dict.fromkeys(model.names("state"), 1e-3) | {
            "forward_velocity": 0.1, "rear_axle_speed": 0.5, "front_axle_speed": 0.5, "engine_speed": 3.0,
            "sheave_displacement": 2e-4, "inclination": 0.01, "pitch": 0.01, "heave": 0.01,
        },
        substeps=25,
    )  # fmt: skip
    return Case(filter_model, _log(filter_model, time, u, x0, 200), x0)


def driveline_drive(seconds: float, *, moderate: bool) -> Case:
    """The vehicle from rest at idle through a drive of changing throttle with pauses and braking.

    Drawn with its noises: the page's sensors, and the random walk of the inclination as the only process
    noise, or also :data:`MODERATE`.
    """
    model = Model.from_file(RANGER)
    filter_model = NOISE["ranger_full"].filter_model(model)
    if moderate:
        filter_model = replace(filter_model, process_noise={**filter_model.process_noise, **MODERATE})
    rng = np.random.default_rng(3)
    time = np.arange(round(seconds * 40)) / 40.0
    knots = np.arange(0.0, seconds + 5.0, 2.5)
    throttle = np.interp(time, knots, rng.uniform(0.05, 1.0, knots.size) * (rng.random(knots.size) > 0.25))
    brake = np.interp(time, knots, np.where(rng.random(knots.size) > 0.8, rng.uniform(0.1, 0.4, knots.size), 0.0))
    u = np.repeat(model.u0()[:, np.newaxis], time.size, axis=1)
    u[model.index("input", "throttle")] = throttle
    u[model.index("input", "brake")] = np.where(throttle < 0.05, brake, 0.0)
    pattern = MatchedLog("drive", time, u, np.zeros((len(model.outputs), time.size)))
    return Case(filter_model, draw_logs(filter_model, pattern, 1, 5, substeps=_TRUE_STEPS).logs[0], model.x0())


def masses(count: int, samples: int = 200) -> Case:
    """A chain of masses joined by springs and dampers and pushed at one end: two states each."""
    g = BondGraph("chain", doc="masses joined by springs and dampers")
    push = g.input("push", "N", "force at the free end")
    before = None
    for i in range(count):
        body = g.one_junction(f"body_{i}", TRANSLATION)
        g.inertance(f"mass_{i}", g.parameter(f"m_{i}", 1.0, "kg"), at=body)
        stretch = g.one_junction(f"stretch_{i}", TRANSLATION)
        joint = g.zero_junction(f"joint_{i}", TRANSLATION)
        g.bond(joint, stretch)
        g.bond(body if before is None else before, joint)
        if before is not None:
            g.bond(joint, body)
        g.compliance(f"spring_{i}", g.parameter(f"k_{i}", 100.0, "N/m"), at=stretch)
        damping = g.parameter(f"d_{i}", 1.0, "N s/m")
        g.resistance(f"damper_{i}", lambda v, d=damping: d * v, at=stretch)
        before = body
        if i in (0, count - 1):
            g.measure_flow(f"speed_{i}", body, "speed of an end")
    g.effort_source("pusher", push, at=before)
    model = Model.from_text(render(derive(assign_causality(g))))
    time = np.arange(samples) * 0.05
    states = model.names("state")
    filter_model = FilterModel(
        model, dict.fromkeys(states, 0.01), dict.fromkeys(model.names("output"), 0.05), dict.fromkeys(states, 0.01),
        substeps=10,
    )  # fmt: skip
    return Case(
        filter_model, _log(filter_model, time, 10.0 * np.sin(2.0 * time)[np.newaxis], model.x0(), 40), model.x0()
    )


def _log(filter_model: FilterModel, time: np.ndarray, u: np.ndarray, x0: np.ndarray, substeps: int) -> MatchedLog:
    model = filter_model.model
    truth = simulate(model, time, u, x0=x0, method="rk4", substeps=substeps, compiled=True)
    noise = np.random.default_rng(1).normal(size=truth.y.shape)
    return MatchedLog(model.name, time, u, truth.y + filter_model.noise_std[:, np.newaxis] * noise)
