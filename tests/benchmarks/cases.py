"""What is timed: the vehicle on a drive of 40 samples per second, and chains of masses of any length."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.filter.filter_model import FilterModel
from bondgraph.generate.module import render
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulate import simulate

RANGER = Path(__file__).resolve().parents[2] / "generated" / "ranger_full.py"

#: The parameters whose estimates are watched.
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
