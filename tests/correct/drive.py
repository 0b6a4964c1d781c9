"""A drive that reverses slowly, and sticks where its torque does not overcome a dry friction that nobody declared.

Its logs are made by scipy, not by this toolkit; the friction changes its sign over a width of the maker's own.
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.integrate import solve_ivp

from bondgraph.build import BuiltModel, build
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import ROTATION
from bondgraph.declare.graph import BondGraph

INERTIA, DRAG = 0.05, 0.1
#: Missing dry friction, N m, and the speed over which it changes its sign, rad/s: 2 % of the largest speed over 8.
FRICTION, WIDTH = 0.8, 0.06
NOISE = 0.02


def drive() -> BondGraph:
    """The declared drive: inertia and viscous drag, both free."""
    g = BondGraph("drive", doc="a motor turns a table to and fro")
    torque = g.input("torque", "N m", "torque of the motor")
    inertia = g.parameter("inertia", INERTIA, "kg m^2", "rotor and table", (0.02, 0.1))
    drag = g.parameter("drag", DRAG, "N m s", "bearings", (0.02, 0.4))
    table = g.one_junction("table", ROTATION)
    g.effort_source("motor", torque, at=table)
    g.inertance("rotor", inertia, at=table, state="w")
    g.resistance("bearings", lambda w: drag * w, at=table)
    g.measure_flow("speed", table, "tachometer")
    return g


@functools.cache
def built() -> BuiltModel:
    return build(drive())


def turned(
    seed: int, friction: float = FRICTION, width: float = WIDTH, samples: int = 1000, name: str = "", rise: float = 0.0
) -> MatchedLog:
    """A log, Radau at a relative tolerance of 1e-10, white sensor noise; ``rise`` is friction added at standstill."""
    rng = np.random.default_rng([seed, 41])
    time = 0.02 * np.arange(samples)
    rates, phases, sizes = rng.uniform(0.3, 2.5, 4), rng.uniform(0.0, 6.3, 4), rng.uniform(0.5, 1.5, 4)
    torque = (sizes[:, np.newaxis] * np.sin(rates[:, np.newaxis] * time + phases[:, np.newaxis])).sum(axis=0)

    def rate(t: float, w: np.ndarray) -> np.ndarray:
        level = friction + rise * np.exp(-((w / 2.0) ** 2))
        return (np.interp(t, time, torque) - DRAG * w - level * np.tanh(w / width)) / INERTIA

    w = np.empty(samples)
    w[0] = 0.0
    for k in range(samples - 1):  # the input has a kink at each sample
        span = (time[k], time[k + 1])
        w[k + 1] = solve_ivp(rate, span, [w[k]], "Radau", rtol=1e-10, atol=1e-12).y[0, -1]
    return MatchedLog(name or f"turn{seed}", time, torque[np.newaxis], (w + NOISE * rng.standard_normal(samples))[None])
