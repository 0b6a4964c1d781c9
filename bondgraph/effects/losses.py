"""Losses of power that is passed on: in proportion to the load, by direction, by slip, by the belt's own weight.

References: Niemann, Winter (2003), Maschinenelemente II, chapter 21, for gear mesh; Gerbert (1999), Traction Belt
Mechanics, for creep, slip and centrifugal tension.
"""

from __future__ import annotations

from sympy import Abs, Expr, tanh

from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.expressions import signal
from bondgraph.declare.functions import maximum
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.revision import revise_law
from bondgraph.effects.places import (
    direction,
    effort_unit,
    elements_at,
    flow_unit,
    is_force,
    over,
    transmitted,
)

_MESH = "Niemann, Winter (2003), Maschinenelemente II, chapter 21"
_BELT = "Gerbert (1999), Traction Belt Mechanics"


def torque_proportional_loss(g: BondGraph, at: Place) -> Effect | None:
    """A share of the transmitted effort that is lost: gear mesh, belt, chain; it acts against the motion."""
    effort = transmitted(g, at)
    if effort is None:
        return None
    name = f"torque_proportional_loss_{at.name}"
    share = g.parameter(f"share_{name}", 0.0, "1", f"share of the effort lost at {at.label}", (0.0, 0.95))
    w = direction(g, at, name)
    g.resistance(name, lambda flow: share * Abs(effort) * tanh(flow / w), at=at.junction)
    law = "effort = c*|transmitted effort|*tanh(flow/w)"
    return Effect(
        "torque_proportional_loss", name, law, (share.name,), reference=_MESH, dissipative=True, widths=(w.name,)
    )


def directional_loss(g: BondGraph, at: Place) -> Effect | None:
    """Efficiency that differs between drive and overrun: worm and hypoid gears, belts with a torque sensor."""
    effort = transmitted(g, at)
    if effort is None:
        return None
    name = f"directional_loss_{at.name}"
    drive = g.parameter(f"drive_{name}", 0.0, "1", f"share of a driving effort lost at {at.label}", (0.0, 0.95))
    overrun = g.parameter(f"overrun_{name}", 0.0, "1", f"share of a braking effort lost at {at.label}", (0.0, 0.95))
    w = direction(g, at, name)
    g.resistance(
        name,
        lambda flow: (drive * maximum(effort, 0) + overrun * maximum(-effort, 0)) * tanh(flow / w),
        at=at.junction,
    )
    law = "effort = (a*max(e, 0) + b*max(-e, 0))*tanh(flow/w), e transmitted"
    coefficients = (overrun.name, drive.name)
    return Effect("directional_loss", name, law, coefficients, reference=_MESH, dissipative=True, widths=(w.name,))


def creep(g: BondGraph, at: Place) -> Effect | None:
    """A flow lost in proportion to the effort: elastic creep of a belt, slip of a tyre, leakage, a shunt."""
    if not is_force(at):
        return None
    name = f"creep_{at.name}"
    limit = 0.5 * at.scale.flow / at.scale.effort
    c = g.parameter(f"c_{name}", 0.0, over(flow_unit(at), effort_unit(at)), f"creep at {at.label}", (0.0, limit))
    g.resistance(name, flow=lambda effort: c * effort, at=at.junction)
    return Effect("creep", name, "flow = c*effort", (c.name,), reference=_BELT, dissipative=True)


def slip(g: BondGraph, at: Place) -> Effect | None:
    """A flow lost that grows with the square of the effort: a belt or tyre near its grip, an orifice."""
    if not is_force(at):
        return None
    name = f"slip_{at.name}"
    limit = 0.5 * at.scale.flow / at.scale.effort**2
    c = g.parameter(f"c_{name}", 0.0, over(flow_unit(at), effort_unit(at), 2), f"slip at {at.label}", (0.0, limit))
    g.resistance(name, flow=lambda effort: c * effort * Abs(effort), at=at.junction)
    return Effect("slip", name, "flow = c*effort*|effort|", (c.name,), reference=_BELT, dissipative=True)


def centrifugal_tension(g: BondGraph, at: Place) -> Effect | None:
    """Grip that a belt loses to its own weight at speed: the friction declared there falls with the square of it."""
    speed = _speed_beside(g, at) if is_force(at) else None
    grips = [node for node in elements_at(g, at, "R") if [given for given, _ in node.laws] == ["effort"]]
    if not is_force(at) or at.domain not in (ROTATION, TRANSLATION) or speed is None or len(grips) != 1:
        return None
    name = f"centrifugal_tension_{at.name}"
    limit = 0.8 / at.scale.flow**2
    unit = over("1", flow_unit(at), 2)
    c = g.parameter(f"c_{name}", 0.0, unit, f"share of grip lost over speed squared at {at.label}", (0.0, limit))
    revise_law(g, grips[0].name, "effort", lambda old: old * (1 - c * speed**2))
    return Effect(
        "centrifugal_tension", grips[0].name, "grip = declared grip*(1 - c*speed^2)", (c.name,), reference=_BELT
    )


def _speed_beside(g: BondGraph, at: Place) -> Expr | None:
    """The speed that feeds a 0-junction, as a signal: of a 1-junction, or behind a pulley."""
    flat = g.flatten()
    for index, inward in flat.incidence().get(at.junction.name, []):
        source = flat.nodes[flat.bonds[index].source]
        if inward and source.kind == "1":
            return Handle(source.name, "1", at.domain).flow
        if inward and source.kind == "TF":
            port = 1 + [i for i, _ in flat.incidence()[source.name]].index(index)
            return signal("flow", source.name, port)
    return None
