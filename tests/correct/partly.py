"""Machines that lack a law which acts in part of their operating space only; truths by scipy, not by this toolkit.

What switches on does so over a straight ramp, no smooth step.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.domains import HYDRAULIC, ROTATION
from bondgraph.declare.graph import BondGraph

#: Bearings of the drive: inertia, drag, and the drag that comes above a speed; kg m^2, N m s, N m s, rad/s.
INERTIA, DRAG, RUB, ONSET = 0.05, 0.08, 0.03, 12.0
#: Drag of a fan that a clutch couples to the drive, N m s^2.
FAN = 2e-3
#: The tank: pressure over volume, outlet, and the flow over pressure of a float valve above a pressure; SI.
STIFFNESS, OUTLET, VALVE, LEVEL = 2e4, 2e7, 2e-8, 9e3


def drive() -> BondGraph:
    """The declared drive: inertia and viscous drag, both free; nothing in it follows the clutch, an input."""
    g = BondGraph("drive", doc="a motor turns a rotor in bearings")
    torque = g.input("torque", "N m", "torque of the motor")
    g.input("clutch", "1", "clutch of the fan, on or off")
    shaft = g.one_junction("shaft", ROTATION)
    g.effort_source("motor", torque, at=shaft)
    g.inertance("rotor", g.parameter("J", 0.06, "kg m^2", "rotor", (0.01, 0.3)), at=shaft, state="w")
    g.resistance("bearings", g.parameter("d", 0.1, "N m s", "bearings", (0.01, 1.0)), at=shaft)
    g.measure_flow("speed", shaft, "tachometer")
    return g


def tank() -> BondGraph:
    """The declared tank: water and an outlet, both free."""
    g = BondGraph("tank", doc="a tank that a pump fills, with an outlet")
    inflow = g.input("inflow", "m^3/s", "what the pump gives")
    level = g.zero_junction("level", HYDRAULIC)
    g.flow_source("pump", inflow, at=level)
    g.compliance("water", g.parameter("k", 1.8e4, "Pa/m^3", "pressure per volume", (5e3, 8e4)), at=level, state="V")
    g.resistance("outlet", g.parameter("R", 2.2e7, "Pa s/m^3", "outlet", (5e6, 1e8)), at=level)
    g.measure_effort("pressure", level, "pressure at the bottom")
    return g


def _over(value: float, level: float, width: float) -> float:
    """One above a level, zero below it, a straight line over a width between."""
    return min(max((value - level) / width + 0.5, 0.0), 1.0)


def _held(seed: int, time: FloatArray, lower: float, upper: float, every: float) -> FloatArray:
    """Levels that change at random, each over one sample."""
    rng = np.random.default_rng([seed, 7])
    count = int(time[-1] / every) + 2
    levels: FloatArray = rng.uniform(lower, upper, count)[(time / every).astype(int)]
    return levels


def _log(name: str, time: FloatArray, u: FloatArray, rate: Callable[[float, FloatArray], FloatArray],
         shown: Callable[[FloatArray], FloatArray], noise: float, seed: int, x0: float) -> MatchedLog:  # fmt: skip
    """A log of one state, by Radau at a relative tolerance of 1e-8, with white noise of the sensor."""
    step = time[1] - time[0]
    run = solve_ivp(rate, (0.0, time[-1]), [x0], "Radau", t_eval=time, rtol=1e-8, atol=1e-10, max_step=2.0 * step)
    y = shown(run.y[0]) + noise * np.random.default_rng([seed, 8]).standard_normal(time.size)
    return MatchedLog(f"{name}{seed}", time, u, y[np.newaxis])


@functools.cache
def driven(
    seed: int, rub: float = RUB, onset: float = ONSET, fan: float = 0.0, idle: float = 0.0, samples: int = 600
) -> MatchedLog:
    """A log of the drive; ``rub`` is drag that comes above the speed ``onset``.

    ``fan`` is the drag over speed that a fan adds where its clutch is on, and a share ``idle`` of it where it is off.
    """
    time = 0.05 * np.arange(samples)
    torque = _held(seed, time, 0.1, 2.4, 2.0)
    clutch = (_held(seed + 500, time, 0.0, 1.0, 5.0) > 0.5).astype(float)

    def rate(t: float, w: FloatArray) -> FloatArray:
        on = idle + (1.0 - idle) * float(np.interp(t, time, clutch))
        drag = DRAG + rub * _over(float(w[0]), onset, 1.0) + fan * on * abs(float(w[0]))
        found: FloatArray = (np.interp(t, time, torque) - drag * w) / INERTIA
        return found

    return _log("drive", time, np.array([torque, clutch]), rate, lambda w: w, 0.05, seed, 5.0)


@functools.cache
def filled(seed: int, valve: float = VALVE, level: float = LEVEL, samples: int = 800) -> MatchedLog:
    """A log of the tank; ``valve`` is flow over pressure that a float opens above a pressure."""
    time = 20.0 * np.arange(samples)
    inflow = _held(seed, time, 1e-4, 1.1e-3, 800.0)

    def rate(t: float, x: FloatArray) -> FloatArray:
        p = STIFFNESS * float(x[0])
        found: FloatArray = np.array([np.interp(t, time, inflow) - p / OUTLET - valve * p * _over(p, level, 500.0)])
        return found

    return _log("tank", time, inflow[np.newaxis], rate, lambda x: STIFFNESS * x, 20.0, seed, 0.2)
