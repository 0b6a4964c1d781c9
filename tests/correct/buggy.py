"""A buggy that coasts down: rolling resistance and air are declared, a viscous loss of the axle is not.

Its logs are made by scipy, not by this toolkit.
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.integrate import solve_ivp

from bondgraph.build import BuiltModel, build
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph

MASS, RADIUS, INERTIA, ROLLING, AIR = 250.0, 0.28, 1.1, 0.012, 0.35
#: The missing loss, N m s/rad: at 12 m/s three times all that is declared.
LOSS = 1.22
NOISE = {"speed": 0.05, "wheel_speed": 0.2}


def buggy() -> BondGraph:
    """The declared buggy; it has no input."""
    g = BondGraph("buggy", doc="a buggy coasts down")
    mass, radius = g.parameter("mass", MASS, "kg", "weighed"), g.parameter("radius", RADIUS, "m", "wheel")
    inertia = g.parameter("inertia", INERTIA, "kg m^2", "wheels and driveline")
    rolling = g.parameter("rolling", ROLLING, "1", "rolling resistance", (0.008, 0.018))
    air = g.parameter("air", AIR, "N/(m/s)^2", "half rho cd A", (0.25, 0.45))
    axle, body = g.one_junction("axle", ROTATION), g.one_junction("body", TRANSLATION)
    g.inertance("driveline", inertia, at=axle)
    g.transformer("wheel", radius, axle, body)
    g.inertance("chassis", mass, at=body, state="v", initial=12.0)
    g.resistance("tyres", lambda v: rolling * mass * 9.81 + 0 * v, at=body)
    g.resistance("drag", lambda v: air * v * abs(v), at=body)
    g.measure_flow("speed", body, "GPS")
    g.measure_flow("wheel_speed", axle, "encoder")
    return g


@functools.cache
def built() -> BuiltModel:
    return build(buggy())


def coast(seed: int, start: float, loss: float = LOSS, seconds: float = 12.0, name: str = "") -> MatchedLog:
    """A coast-down from a speed [m/s], Radau at a relative tolerance of 1e-10, white sensor noise."""
    rng = np.random.default_rng([seed, 31])
    time = np.arange(0.0, seconds, 0.05)
    whole = MASS + INERTIA / RADIUS**2

    def rate(t: float, v: np.ndarray) -> np.ndarray:
        return -(ROLLING * MASS * 9.81 + AIR * v * np.abs(v) + loss * v / RADIUS**2) / whole

    v = solve_ivp(rate, (0.0, time[-1]), [start], "Radau", time, rtol=1e-10, atol=1e-12).y[0]
    noise = np.array(list(NOISE.values()))[:, np.newaxis] * rng.standard_normal((2, time.size))
    return MatchedLog(name or f"coast{seed}", time, np.empty((0, time.size)), np.array([v, v / RADIUS]) + noise)
