"""Machines that lack a law which acts in part of their operating space only; truths by scipy, not by this toolkit.

What switches on does so over a straight ramp, no smooth step.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import expit

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.domains import HYDRAULIC, ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph

#: Bearings of the drive: inertia, drag, and the drag that comes above a speed; kg m^2, N m s, N m s, rad/s.
INERTIA, DRAG, RUB, ONSET = 0.05, 0.08, 0.03, 12.0
#: Drag of a fan that a clutch couples to the drive, N m s^2.
FAN = 2e-3
#: The tank: pressure over volume, outlet, and the flow over pressure of a float valve above a pressure; SI.
STIFFNESS, OUTLET, VALVE, LEVEL = 2e4, 2e7, 2e-8, 9e3
#: The slide: mass, spring, drag; dry friction of a worn place in its guides, where that is and how far it reaches; SI.
MASS, SPRING, GUIDES, RUBBED, WORN, REACH = 20.0, 400.0, 30.0, 60.0, 0.11, 0.05


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


def slide() -> BondGraph:
    """The declared slide: a mass on a spring in guides, all free."""
    g = BondGraph("slide", doc="an actuator moves a slide on a spring")
    force = g.input("force", "N", "actuator")
    slide = g.one_junction("slide", TRANSLATION)
    g.effort_source("actuator", force, at=slide)
    g.inertance("mass", g.parameter("m", 22.0, "kg", "slide", (5.0, 80.0)), at=slide, state="v")
    spring = g.parameter("k", 420.0, "N/m", "spring", (100.0, 2000.0))
    g.compliance("spring", lambda x: spring * x, at=slide, state="x")
    g.resistance("guides", g.parameter("d", 25.0, "N s/m", "guides", (5.0, 200.0)), at=slide)
    g.measure_flow("speed", slide, "tachometer")
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
    seed: int, rub: float = RUB, onset: float = ONSET, fan: float = 0.0, idle: float = 0.0, samples: int = 600,
    soft: float = 0.0,
) -> MatchedLog:  # fmt: skip
    """A log of the drive; ``rub`` is drag that comes above the speed ``onset``.

    ``fan`` is the drag over speed that a fan adds where its clutch is on, and a share ``idle`` of it where it is off.
    With ``soft`` the clutch slips in part, and takes the fan along as a logistic curve of its position about 0.6 says.
    """
    time = 0.05 * np.arange(samples)
    torque = _held(seed, time, 0.1, 2.4, 2.0)
    position = _held(seed + 500, time, 0.0, 1.0, 5.0)
    clutch = position if soft else (position > 0.5).astype(float)

    def rate(t: float, w: FloatArray) -> FloatArray:
        shut = float(np.interp(t, time, clutch))
        on = float(expit((shut - 0.6) / soft)) if soft else idle + (1.0 - idle) * shut
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


@functools.cache
def slid(seed: int, samples: int = 1500) -> MatchedLog:
    """A log of the slide, which rubs at a worn place."""
    time = 0.02 * np.arange(samples)
    force = _held(seed, time, -160.0, 160.0, 0.6)

    def rate(t: float, x: FloatArray) -> FloatArray:
        v, place = float(x[0]), float(x[1])
        worn = RUBBED * np.exp(-(((place - WORN) / REACH) ** 2)) * np.tanh(v / 0.02)
        return np.array([(np.interp(t, time, force) - SPRING * place - GUIDES * v - worn) / MASS, v])

    run = solve_ivp(rate, (0.0, time[-1]), [0.0, 0.0], "Radau", t_eval=time, rtol=1e-8, atol=1e-10, max_step=0.04)
    y = run.y[0] + 0.01 * np.random.default_rng([seed, 8]).standard_normal(time.size)
    return MatchedLog(f"slide{seed}", time, force[np.newaxis], y[np.newaxis])
