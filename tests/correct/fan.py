"""A fan on an elastic shaft behind a gearbox and a DC motor; its logs are made by scipy, not by this toolkit."""

from __future__ import annotations

import functools

import numpy as np
from scipy.integrate import solve_ivp

from bondgraph.build import BuiltModel, build
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import ELECTRICAL, ROTATION
from bondgraph.declare.graph import BondGraph

#: Declared and true values: the machine is declared exactly.
L, R, K, J_M, N, STIFF, DAMP, J_F, C_F = 2e-3, 0.6, 0.08, 4e-4, 4.0, 60.0, 0.15, 0.02, 4e-4
NOISE = {"current": 0.02, "motor_speed": 0.05, "fan_speed": 0.02}


def fan() -> BondGraph:
    """DC motor, gearbox, elastic shaft, fan; four states, of which the current and the shaft are fast."""
    g = BondGraph("fan", doc="DC motor, gearbox, elastic shaft, fan")
    voltage = g.input("voltage", "V", "terminal voltage")
    inductance = g.parameter("L", L, "H", "armature")
    resistance = g.parameter("R", R, "ohm", "armature", (0.3, 1.2))
    constant = g.parameter("K", K, "N m/A", "motor constant")
    J_motor = g.parameter("J_motor", J_M, "kg m^2", "rotor")
    ratio = g.parameter("ratio", N, "", "gear")
    stiffness = g.parameter("stiffness", STIFF, "N m/rad", "shaft")
    damping = g.parameter("damping", DAMP, "N m s/rad", "shaft", (0.02, 1.0))
    J_fan = g.parameter("J_fan", J_F, "kg m^2", "fan")
    drag = g.parameter("drag", C_F, "N m s^2", "air", (1e-4, 2e-3))
    coil = g.one_junction("coil", ELECTRICAL)
    motor, fast = g.one_junction("motor", ROTATION), g.one_junction("output", ROTATION)
    shaft, wheel = g.zero_junction("shaft", ROTATION), g.one_junction("wheel", ROTATION)
    twist = g.one_junction("twist", ROTATION)
    g.effort_source("supply", voltage, at=coil)
    g.inertance("armature", inductance, at=coil, state="i")
    g.resistance("winding", resistance, at=coil)
    g.gyrator("machine", constant, coil, motor)
    g.inertance("rotor", J_motor, at=motor, state="w_motor")
    g.transformer("gearbox", 1 / ratio, motor, fast)
    g.bond(fast, shaft)
    g.bond(shaft, twist)
    g.bond(shaft, wheel)
    g.compliance("spring", stiffness, at=twist, state="angle")
    g.resistance("damper", damping, at=twist)
    g.inertance("blades", J_fan, at=wheel, state="w_fan")
    g.resistance("air", lambda w: drag * w * abs(w), at=wheel)
    g.measure_flow("current", coil, "armature current")
    g.measure_flow("motor_speed", motor, "speed of the motor")
    g.measure_flow("fan_speed", wheel, "speed of the fan")
    return g


@functools.cache
def built() -> BuiltModel:
    return build(fan())


def drawn(seed: int, samples: int = 800, interval: float = 0.02, name: str = "run", scale: float = 1.0) -> MatchedLog:
    """A clean log: Radau at a relative tolerance of 1e-10, white sensor noise."""
    rng = np.random.default_rng([seed, 29])
    time = interval * np.arange(samples)
    voltage = np.repeat(rng.uniform(2.0, 24.0, samples // 20 + 1), 20)[:samples]

    def rates(t: float, x: np.ndarray) -> list[float]:
        i, w_m, angle, w_f = x
        u = float(np.interp(t, time, voltage))
        slip = w_m / N - w_f
        torque = STIFF * angle + DAMP * slip
        return [
            (u - R * i - K * w_m) / L, (K * i - torque / N) / J_M, slip, (torque - C_F * w_f * abs(w_f)) / J_F,
        ]  # fmt: skip

    states = [np.zeros(4)]
    for k in range(samples - 1):  # the input has a kink at each sample
        span = (time[k], time[k + 1])
        states.append(solve_ivp(rates, span, states[-1], "Radau", rtol=1e-10, atol=1e-12).y[:, -1])
    x = np.array(states).T
    y = x[[0, 1, 3]]
    noise = scale * np.array(list(NOISE.values()))[:, np.newaxis] * rng.standard_normal(y.shape)
    return MatchedLog(name, time, voltage[np.newaxis], y + noise)
