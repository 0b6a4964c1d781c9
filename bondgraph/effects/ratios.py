"""Ratios that move with the way of a machine: cranks, universal joints, linkages; no power is lost in them.

A transformer whose ratio is declared as a constant may have one that depends on an angle or a stroke. References:
Norton (2012), Design of Machinery, chapters 4 and 6, for cranks and linkages; Seherr-Thoss, Schmelz, Aucktor (2006),
Universal Joints and Driveshafts, chapter 1, for the ratio of a universal joint.
"""

from __future__ import annotations

from sympy import Expr, cos, sin

from bondgraph.declare.domains import ROTATION
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.revision import revise_law
from bondgraph.effects.places import has_flow, is_motion, over, position_at, two_ports_at
from bondgraph.effects.storages import spring_at

_LINKAGE = "Norton (2012), Design of Machinery, chapters 4 and 6"
_JOINT = "Seherr-Thoss, Schmelz, Aucktor (2006), Universal Joints and Driveshafts, chapter 1"
#: Periods in a turn that are tried: a crank has one, a universal joint two.
_ORDERS = (1.0, 2.0)
#: The largest share of a ratio that an angle or a stroke takes or adds: with more it would change its sign.
_MOST = 1.0


def ratio_by_angle(g: BondGraph, at: Place) -> Effect | None:
    """A ratio that goes up and down about its mean: a universal joint, a wheel or sprocket that is not centred."""
    return _turning(g, at, "ratio_by_angle", 0, _JOINT)


def crank_ratio(g: BondGraph, at: Place) -> Effect | None:
    """A ratio that is the declared one at an angle of zero: a crank, a lever that swings far."""
    return _turning(g, at, "crank_ratio", 1, _LINKAGE)


def _turning(g: BondGraph, at: Place, effect: str, at_zero: int, reference: str) -> Effect | None:
    """A ratio with a wave of the angle, which is a declared one, or added to the graph and starts at zero."""
    node = _constant(g, at) if has_flow(at) and at.domain == ROTATION else None
    if node is None:
        return None
    name = f"{effect}_{at.name}"
    known = position_at(g, at)
    angle = known[0] if known else g.integral(f"angle_{name}", at.junction.flow, "rad", f"angle of {at.label}")
    wave, shift = (
        g.parameter(f"{of}_{name}", 0.0, "1", f"share of the {of} in the ratio", (-_MOST, _MOST))
        for of in ("sine", "cosine")
    )
    order = g.parameter(f"order_{name}", 1.0, "1", "periods in a turn", (0.5, 2.0 * _ORDERS[-1]))
    moved = 1 + wave * sin(order * angle) + shift * (cos(order * angle) - at_zero)
    revise_law(g, node.name, "modulus", lambda old: old * moved)
    cosine = "(cos(n*angle) - 1)" if at_zero else "cos(n*angle)"
    return Effect(
        effect, node.name, f"modulus = declared*(1 + a*sin(n*angle) + b*{cosine})", (wave.name, shift.name),
        shapes=(order.name,), grids=((order.name, _ORDERS),), reference=reference,
        manoeuvre="slow turning, or wide swings, with a load",
    )  # fmt: skip


def ratio_by_stroke(g: BondGraph, at: Place) -> Effect | None:
    """A ratio that changes over the stroke of a spring: the linkage of a suspension, a lever, a coil in its gap."""
    node = (_constant(g, at, "TF") or _constant(g, at, "GY")) if is_motion(at) else None
    spring = spring_at(g, at, straight=False)
    if node is None or spring is None:
        return None
    name = f"ratio_by_stroke_{at.name}"
    stroke = signal("displacement", spring.name)
    parts: list[Expr] = []
    for power, meaning in ((1, "slope"), (2, "bend")):
        limit = _MOST / spring.way**power
        unit = over("1", spring.unit, power)
        parts.append(
            g.parameter(f"c{power}_{name}", 0.0, unit, f"{meaning} of the ratio over the stroke", (-limit, limit))
        )
    moved = 1 + parts[0] * stroke + parts[1] * stroke**2
    revise_law(g, node.name, "modulus", lambda old: old * moved)
    return Effect(
        "ratio_by_stroke", node.name, "modulus = declared*(1 + c1*q + c2*q^2), q = displacement",
        tuple(one.name for one in parts), reference=_LINKAGE, manoeuvre="small and large strokes in one log",
    )  # fmt: skip


def _constant(g: BondGraph, at: Place, kind: str = "TF") -> Node | None:
    """The only transformer (or gyrator) at a junction, if its ratio is a constant."""
    found = two_ports_at(g, at, kind)
    law = found[0].law("modulus") if len(found) == 1 else None
    constants = {parameter.symbol for parameter in g.flatten().parameters}
    return found[0] if law is not None and law.free_symbols <= constants else None
