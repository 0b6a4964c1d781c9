"""Axles: two wheels on one shaft, with brake and rolling resistance, both smoothed around standstill.

Rolling resistance on gravel, 0.012 packed to 0.06 wet: Wong, *Theory of Ground Vehicles* (2008), chapter 1.
"""

from __future__ import annotations

from typing import Literal

from sympy import Expr, tanh

from bondgraph.declare.domains import ROTATION
from bondgraph.declare.graph import BondGraph

End = Literal["front", "rear"]

_INERTIA = {"front": ("J_f", "front_axle_speed"), "rear": ("J_r", "rear_axle_speed")}
_BRAKE = {"front": ("T_bf_max", 1800.0), "rear": ("T_br_max", 1200.0)}


def tyre_radius(g: BondGraph, end: End) -> Expr:
    """Dynamic radius of the tyres of an axle: what all axles share times a gain of its own, below one where air leaks.

    Examples
    --------
    >>> tyre_radius(BondGraph("wheels"), "front")
    r_d*radius_gain_f
    """
    r_d = g.parameter("r_d", 0.315, "m", "dynamic tyre radius", (0.27, 0.36))
    gain = g.parameter(f"radius_gain_{end[0]}", 1.0, "1", f"dynamic radius of the {end} tyres relative to r_d")
    return r_d * gain


def axle(end: End) -> BondGraph:
    """One axle: port ``hub``, inputs ``brake`` and ``load`` (force on the ground).

    Examples
    --------
    >>> [element.name for element in axle("front").nodes.values()]
    ['hub', 'inertia', 'brake_discs', 'rolling']
    """
    g = BondGraph(f"{end}_axle", doc=__doc__)
    brake = g.input("brake", "1", "brake pedal, 0 to 1", default=0.0)
    load = g.input("load", "N", "force of the tyres on the ground")
    inertia, state = _INERTIA[end]
    largest, torque = _BRAKE[end]
    hub = g.one_junction("hub", ROTATION)
    J = g.parameter(inertia, 2.0, "kg m^2", f"{end} axle with wheels")
    g.require(J, "an axle without positive inertia does not obey a torque")
    g.inertance("inertia", J, at=hub, state=state)
    gain = g.parameter("brake_gain", 1.0, "1", "brake torque relative to its nominal value, both axles", (0.5, 1.5))
    T_b = g.parameter(largest, torque, "N m", f"largest brake torque of the {end} axle")
    w_b = g.parameter("w_brake", 0.5, "rad/s", "axle speed at which the brake reaches 76 % (smoothing)")
    g.resistance("brake_discs", lambda w: brake * gain * T_b * tanh(w / w_b), at=hub)
    f_r = g.parameter("f_r", 0.035, "1", "rolling resistance coefficient", (0.01, 0.08))
    w_r = g.parameter("w_roll", 0.3, "rad/s", "axle speed at which rolling resistance reaches 76 % (smoothing)")
    radius = tyre_radius(g, end)
    g.resistance("rolling", lambda w: f_r * load * radius * tanh(w / w_r), at=hub)
    return g
