"""Engine of the Ranger: a torque at the crankshaft, by a formula or by a dynamometer's map.

Both fill the same part: port ``crank``, input ``throttle``. Wide-open torque is a parabola over speed, part load
follows the filling of the cylinders (a plausible exponential), an idle governor opens the throttle below idle speed, a
limiter cuts the torque above the highest speed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from sympy import Expr, exp, lambdify

from bondgraph.declare.domains import ROTATION
from bondgraph.declare.expressions import signal
from bondgraph.declare.functions import clip, maximum, number
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import symbol

#: Crankshaft speed at which governor and friction balance, belt released [rad/s].
IDLE_SPEED = 125.650494711


def engine() -> BondGraph:
    """The engine by its formula.

    Examples
    --------
    >>> [signal.name for signal in engine().signals]
    ['idle_opening', 'opening', 'T_f', 'T_w', 'filling', 'T_e']
    """
    g = BondGraph("engine", doc=__doc__)
    crank = _crank(g)
    opening = _opening(g, crank.flow)
    friction = _friction(g, crank.flow)
    g.effort_source("combustion", _torque(g, crank.flow, opening, friction), at=crank)
    return g


def mapped_engine(
    speed: Sequence[float] | None = None,
    opening: Sequence[float] | None = None,
    torque: Sequence[Sequence[float]] | None = None,
) -> BondGraph:
    """The engine by a dynamometer's map: shaft torque [N m] over crankshaft speed [rad/s] and throttle opening.

    Parameters
    ----------
    speed, opening
        Where the torque was measured, increasing.
    torque
        One row per speed, one column per opening. Left out, the map is that of the formula with its default values.

    Examples
    --------
    >>> [table.name for table in mapped_engine().tables]
    ['torque_map']
    """
    if speed is None or opening is None or torque is None:
        speed, opening, torque = sampled_map()
    g = BondGraph("mapped_engine", doc=__doc__)
    crank = _crank(g)
    position = _opening(g, crank.flow)
    torque_map = g.table(
        "torque_map", speed, torque, "N m", ("rad/s", "1"), y=opening, meaning="shaft torque from the dynamometer"
    )
    shaft = g.signal("T_e", torque_map(crank.flow, position), "N m", "engine torque")
    g.effort_source("combustion", shaft, at=crank)
    return g


def sampled_map() -> tuple[list[float], list[float], list[list[float]]]:
    """The formula with its default values on the grid of a dynamometer: speeds, openings, torques.

    Examples
    --------
    >>> speed, opening, torque = sampled_map()
    >>> len(speed), len(opening), round(torque[speed.index(520.0)][-1], 1)
    (54, 27, 75.0)
    """
    speed = np.concatenate([np.arange(60.0, 701.0, 20.0), np.arange(702.0, 741.0, 2.0), [760.0]])
    opening = np.concatenate([np.linspace(0.0, 0.09, 10), np.linspace(0.1, 0.37, 10), np.linspace(0.4, 1.0, 7)])
    g = engine()
    position = symbol("opening")
    named = {symbol(one.name): one.expression for one in g.signals if one.name != position.name}
    torque = named[symbol("T_e")]
    while not named.keys().isdisjoint(torque.free_symbols):
        torque = torque.xreplace(named)
    torque = torque.xreplace({parameter.symbol: number(parameter.value) for parameter in g.parameters})
    own = {"minimum": np.minimum, "maximum": np.maximum}
    compute = lambdify((signal("flow", "crank"), position), torque, [own, "numpy"])
    values = compute(speed[:, np.newaxis], np.maximum(opening, 1e-6))
    return speed.tolist(), opening.tolist(), np.round(values, 9).tolist()


def _crank(g: BondGraph) -> Handle:
    """Crankshaft with everything that turns with it, and its drag."""
    crank = g.one_junction("crank", ROTATION)
    J_e = g.parameter("J_e", 0.06, "kg m^2", "engine with primary clutch")
    g.require(J_e, "an engine without positive inertia does not obey a torque")
    b_d = g.parameter("b_d", 0.004, "N m s", "drag of auxiliaries")
    g.inertance("inertia", J_e, at=crank, initial=IDLE_SPEED, state="engine_speed")
    g.resistance("drag", b_d, at=crank)
    return crank


def _opening(g: BondGraph, speed: Expr) -> Expr:
    """Throttle opening of driver or idle governor, whichever is larger."""
    throttle = g.input("throttle", "1", "throttle pedal, 0 to 1")
    w_idle = g.parameter("w_idle", 125.7, "rad/s", "idle speed of the governor (1200 rpm)")
    idle = g.signal(
        "idle_opening", clip(0.016 + 0.6 * (w_idle - speed) / w_idle, 0, 0.35), "1", "opening by the idle governor"
    )
    return g.signal("opening", maximum(maximum(throttle, idle), 1e-6), "1", "throttle opening")


def _friction(g: BondGraph, speed: Expr) -> Expr:
    T_f0 = g.parameter("T_f0", 4.0, "N m", "friction of the engine at standstill", (2.0, 7.0))
    T_f1 = g.parameter("T_f1", 0.02, "N m s", "friction of the engine per speed")
    return g.signal("T_f", T_f0 + T_f1 * speed, "N m", "friction torque")


def _torque(g: BondGraph, speed: Expr, opening: Expr, friction: Expr) -> Expr:
    """Shaft torque: the share of the wide-open indicated torque that the filling allows, less friction."""
    T_pk = g.parameter("T_pk", 75.0, "N m", "largest shaft torque", (50.0, 100.0))
    w_pk = g.parameter("w_pk", 523.6, "rad/s", "speed of the largest torque (5000 rpm)")
    a_t = g.parameter("a_t", 1.0, "1", "curvature of the torque over speed")
    w_max = g.parameter("w_max", 712.0, "rad/s", "speed at which the limiter begins")
    w_cut = g.parameter("w_cut", 20.0, "rad/s", "range over which the limiter closes")
    k_u = g.parameter("k_u", 5.0, "1", "filling per opening at the reference speed", (2.5, 8.0))
    w_ref = g.parameter("w_ref", 314.16, "rad/s", "reference speed of the filling")
    w_fill = g.parameter("w_fill", 80.0, "rad/s", "speed below which the filling grows no further")
    limiter = clip((w_max + w_cut - speed) / w_cut, 0, 1)
    wide_open = g.signal("T_w", T_pk * (1 - a_t * ((speed - w_pk) / w_pk) ** 2) * limiter, "N m", "wide-open torque")
    filling = g.signal("filling", k_u * opening * w_ref / maximum(speed, w_fill), "1", "filling of the cylinders")
    share = (1 - exp(-filling)) / (1 - exp(-filling / opening))
    return g.signal("T_e", share * (wide_open + friction) - friction, "N m", "engine torque")
