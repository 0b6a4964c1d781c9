"""A machine with a sensor that is late, or follows slowly, or with a motor that acts late."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.data.log import FloatArray, MatchedLog
from tests.effects.machines.machine import steps

STEP, SAMPLES, NOISE = 0.02, 700, (0.02, 0.2)


def hoist() -> bg.BondGraph:
    """A drum whose speed is measured by a slow bus, and the torque of its brake."""
    g = bg.BondGraph("hoist", doc="A drum with an oil brake.")
    torque = g.input("torque", "N m")
    drum = g.one_junction("drum", bg.ROTATION)
    g.effort_source("motor", torque, at=drum)
    g.inertance("inertia", g.parameter("J", 0.9, "kg m^2", "drum", (0.2, 4.0)), at=drum, state="omega")
    brake = g.resistance("brake", g.parameter("d", 3.4, "N m s", "brake", (0.5, 20.0)), at=drum)
    g.measure_flow("speed", drum, "speed of the drum")
    g.measure_effort("brake_torque", brake, "torque of the brake")
    return g


def log(seed: int, delay: float = 0.0, lag: float = 0.0, acting: float = 0.0) -> MatchedLog:
    """A log in which the speed comes late by a time, or follows in one, and the motor acts late by another.

    Before it begins the drum rests.
    """
    chance = np.random.default_rng(seed)
    time = STEP * np.arange(SAMPLES)
    u = np.where(time < 0.4, 0.0, steps(time, chance, -20.0, 20.0, 0.4))

    def rates(t: float, x: FloatArray) -> FloatArray:
        given = np.interp(t - acting, time, u, left=0.0) if acting else np.interp(t, time, u)
        follows = (x[0] - x[1]) / lag if lag else 0.0
        return np.asarray([(given - 3.0 * x[0]) / 1.0, follows])

    run = solve_ivp(
        rates, (0.0, time[-1]), [0.0, 0.0], method="Radau", rtol=1e-8, atol=1e-9, max_step=STEP, dense_output=True
    )
    ago = time - delay
    speed = np.where(ago > 0.0, run.sol(np.maximum(ago, 0.0))[1 if lag else 0], 0.0)
    y = np.array([speed, 3.0 * run.sol(time)[0]])
    return MatchedLog(f"run{seed}", time, u[np.newaxis], y + np.array([NOISE]).T * chance.normal(size=y.shape))
