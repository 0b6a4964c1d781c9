"""Rubber belt of the Ranger's CVT: radii of a belt of fixed length, and its traction between the pulleys.

The length fixes the secondary radius to the primary's, by an equation without closed form that the model solves to
rounding. The belt slips as a dissipator between two speeds, its force limited by the weaker clamp; the clamp of the
secondary grows with that force, a loop which the derivation finds and solves. Geometry of an open belt: Budynas,
Nisbett, *Shigley's Mechanical Engineering Design*, chapter 17. Virtual work gives the ratio in which sheaves balance.
"""

from __future__ import annotations

from sympy import Expr, asin, cos, pi, sqrt, tan, tanh

from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.functions import clip, minimum
from bondgraph.declare.graph import BondGraph
from vehicle_graphs.clutches import sheave_travel


def rubber_belt() -> BondGraph:
    """The belt: port ``belt`` (its force; the surface speeds of both pulleys), inputs ``travel`` and both clamp forces.

    Signals: ``r_p`` and ``r_s`` radii, ``wrap_ratio`` arc of contact of the primary over that of the secondary, which
    is also -d r_s/d r_p, ``ratio`` of the CVT.

    Examples
    --------
    >>> [signal.name for signal in rubber_belt().signals]
    ['r_p', 'L_b', 'r_s', 'lean', 'wrap_ratio', 'ratio', 'F_b', 'slip']
    """
    g = BondGraph("belt", doc=__doc__)
    primary_clamp = g.input("primary_clamp", "N", "clamp force of the primary")
    secondary_clamp = g.input("secondary_clamp", "N", "clamp force of the secondary")
    al = g.parameter("al", 0.22689280275926285, "rad", "half of the groove angle (13 deg)")
    _radii(g, al)
    mu_b = g.parameter("mu_b", 0.5, "1", "friction of belt on sheave", (0.3, 0.7))
    v_s = g.parameter("v_s", 0.15, "m/s", "slip at which the belt carries 76 % of what it can")
    belt = g.zero_junction("belt", TRANSLATION)

    def traction(slip: Expr) -> Expr:
        return 2 * mu_b / cos(al) * minimum(primary_clamp, secondary_clamp) * tanh(slip / v_s)

    slipping = g.resistance("traction", traction, at=belt)
    g.signal("F_b", belt.effort, "N", "belt force")
    g.signal("slip", slipping.flow, "m/s", "slip of the belt")
    return g


def _radii(g: BondGraph, al: Expr) -> None:
    """Radii and wrap of a belt of fixed length around two pulleys, against the travel of the primary sheave."""
    travel = g.input("travel", "m", "travel of the primary sheave")
    x_max = sheave_travel(g)
    C = g.parameter("C", 0.265, "m", "distance of the pulleys' axes")
    r_p_min = g.parameter("r_p_min", 0.038, "m", "belt radius on the primary, sheave open")
    r_s0 = g.parameter("r_s0", 0.132, "m", "belt radius on the secondary then; fixes the length of the belt")
    r_p = g.signal("r_p", r_p_min + clip(travel, 0, x_max) / (2 * tan(al)), "m", "belt radius on the primary")

    def length(primary: Expr, secondary: Expr) -> Expr:
        step = secondary - primary
        return 2 * sqrt(C**2 - step**2) + pi * (primary + secondary) + 2 * step * asin(step / C)

    g.require(r_p_min, "the belt cannot run around an axis without radius")
    g.require(C - r_p_min - r_s0, "the belt is longer than the geometry allows: its pulleys would overlap")
    largest = r_p_min + x_max / (2 * tan(al))
    g.require(C - largest, "the sheave closes beyond its pulley: the belt would run over the other axis")
    too_short = "the belt is too short: the whole travel of the sheave would pull it off the secondary"
    g.require(length(r_p_min, r_s0) - length(largest, 0), too_short)
    L_b = g.signal("L_b", length(r_p_min, r_s0), "m", "length of the belt")
    near = r_s0 - (r_p - r_p_min)  # what one pulley gains the other yields, but for the lean of the strands
    r_s = g.implicit_signal("r_s", lambda r: length(r_p, r) - L_b, "m", "belt radius on the secondary", guess=near)
    lean = g.signal("lean", asin((r_s - r_p) / C), "rad", "angle of the free strands to the line of centres")
    g.signal("wrap_ratio", (pi - 2 * lean) / (pi + 2 * lean), "1", "wrap angle of the primary over the secondary's")
    g.signal("ratio", r_s / r_p, "1", "ratio of the CVT, primary over secondary speed without slip")
