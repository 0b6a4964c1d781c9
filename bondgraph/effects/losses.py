"""Losses of power that is passed on, and of flow at a 0-junction: by load, direction, slip, leaks, thresholds.

References: Niemann, Winter (2003), Maschinenelemente II, for gear mesh; Gerbert (1999), Traction Belt Mechanics, for
creep, slip and centrifugal tension; Pacejka (2012), Tire and Vehicle Dynamics, chapter 7, for relaxation lengths;
White (2011), Fluid Mechanics, section 10.7, for weirs.
"""

from __future__ import annotations

from sympy import Abs, Expr, Rational, tanh

from bondgraph.declare.domains import HYDRAULIC, ROTATION, TRANSLATION
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.expressions import signal
from bondgraph.declare.functions import maximum
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_law
from bondgraph.effects.places import (
    ROOT_LAW,
    Words,
    conductance,
    direction,
    effort_unit,
    elements_at,
    flow_unit,
    has_effort,
    over,
    root_flow,
    transmitted,
)

_MESH = "Niemann, Winter (2003), Maschinenelemente II"
_BELT = "Gerbert (1999), Traction Belt Mechanics"
_ORIFICE = "Merritt (1967), Hydraulic Control Systems, chapters 3 and 5"
_WEIR = "White (2011), Fluid Mechanics, section 10.7"
_PACEJKA = "Pacejka (2012), Tire and Vehicle Dynamics, chapter 7"
#: Relaxation lengths, as times of rolling at the largest speed [s]: the shortest, as declared, the longest.
_RELAXATION = (2e-3, 0.03, 0.5)
_BOND_GRAPHS = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 3"
#: Names of laws in each domain; heat that a body gives away has a law of its own, which knows what is around.
_PROPORTIONAL = Words("creep", "shunt_leakage", "leakage", chemical="side_reaction")
_SQUARE = Words("slip", chemical="second_order_reaction")
_THRESHOLD = Words(electrical="breakdown", hydraulic="relief_valve")


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
        "torque_proportional_loss", name, law, (share.name,), reference=_MESH, dissipative=True, widths=(w.name,),
        manoeuvre="light and heavy loads at one speed",
    )  # fmt: skip


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
    return Effect(
        "directional_loss", name, law, coefficients, reference=_MESH, dissipative=True, widths=(w.name,),
        manoeuvre="driving and overrun at equal loads",
    )  # fmt: skip


def creep(g: BondGraph, at: Place) -> Effect | None:
    """Flow lost in proportion to the effort: creep of a belt, a shunt, a leak, heat that a body gives away."""
    word = _PROPORTIONAL.at(at)
    if not has_effort(at) or not word:
        return None
    unit = over(flow_unit(at), effort_unit(at))
    name, c = conductance(g, at, word, f"coefficient of {word.replace('_', ' ')}", unit, 1)
    g.resistance(name, flow=lambda effort: c * effort, at=at.junction)
    return Effect(
        word, name, "flow = c*effort", (c.name,), reference=_BELT if word == "creep" else _BOND_GRAPHS,
        dissipative=True, manoeuvre="steady runs at several efforts, or a decay with nothing drawn",
    )  # fmt: skip


def slip(g: BondGraph, at: Place) -> Effect | None:
    """Flow lost with the square of the effort: a belt or tyre near its grip, a reaction of second order."""
    word = _SQUARE.at(at)
    if not has_effort(at) or not word:
        return None
    unit = over(flow_unit(at), effort_unit(at), 2)
    name, c = conductance(g, at, word, word.replace("_", " "), unit, 2)
    g.resistance(name, flow=lambda effort: c * effort * Abs(effort), at=at.junction)
    return Effect(
        word, name, "flow = c*effort*|effort|", (c.name,), reference=_BELT if word == "slip" else _BOND_GRAPHS,
        dissipative=True, manoeuvre="small and large efforts in one log",
    )  # fmt: skip


def orifice_leak(g: BondGraph, at: Place) -> Effect | None:
    """Flow lost through an opening, with the root of the pressure or a little more: a hole, a worn seat, a crack."""
    if not has_effort(at) or at.domain != HYDRAULIC:
        return None
    name = f"orifice_leak_{at.name}"
    leak = root_flow(g, at, name)
    g.resistance(name, flow=leak.law, at=at.junction)
    return Effect(
        "orifice_leak", name, ROOT_LAW, (leak.coefficient,), reference=_ORIFICE, dissipative=True,
        widths=(leak.power,), manoeuvre="low and high pressure held with no flow drawn",
    )  # fmt: skip


def relief(g: BondGraph, at: Place) -> Effect | None:
    """Flow that begins at a threshold of the effort: a relief valve, an overflow, a breakdown of an insulation."""
    word = _THRESHOLD.at(at)
    if not has_effort(at) or not word:
        return None
    unit = over(flow_unit(at), effort_unit(at))
    name, c = conductance(g, at, word, "flow per effort above the threshold", unit, 1)
    size = at.scale.effort
    opens = g.parameter(f"e_{name}", 0.5 * size, effort_unit(at), "effort at which it opens", (0.05 * size, size))
    g.resistance(name, flow=lambda effort: c * maximum(effort - opens, 0), at=at.junction)
    return Effect(
        word, name, "flow = c*max(effort - e, 0)", (c.name,), shapes=(opens.name,), reference=_ORIFICE,
        dissipative=True, manoeuvre="a slow rise of the effort to its largest value",
    )  # fmt: skip


def overflow(g: BondGraph, at: Place) -> Effect | None:
    """Flow by the power 3/2 of what stands above an edge: a tank that runs over, a weir, a valve that opens wider."""
    if not has_effort(at) or at.domain != HYDRAULIC:
        return None
    name, size = f"overflow_{at.name}", at.scale.effort
    largest = (0.0, 0.5 * at.scale.flow)
    c = g.parameter(f"c_{name}", 0.0, flow_unit(at), f"flow at {size:.3g} {effort_unit(at)} above the edge", largest)
    edge = g.parameter(f"e_{name}", 0.5 * size, effort_unit(at), "effort at the edge", (0.05 * size, size))
    unit = g.parameter(f"p_{name}", size, effort_unit(at), "effort of that flow")
    g.resistance(name, flow=lambda e: c * maximum((e - edge) / unit, 0) ** Rational(3, 2), at=at.junction)
    return Effect(
        "overflow", name, "flow = c*(max(effort - e, 0)/p)^1.5", (c.name,), shapes=(edge.name,), reference=_WEIR,
        dissipative=True, manoeuvre="a slow rise of the effort to its largest value",
    )  # fmt: skip


def tyre_relaxation(g: BondGraph, at: Place) -> Effect | None:
    """A slip force that builds up over a length of rolling: tyres, belts; a lag that is the longer the slower."""
    speed = _speed_beside(g, at) if has_effort(at) else None
    grips = [node for node in elements_at(g, at, "R") if [given for given, _ in node.laws] == ["effort"]]
    if at.domain not in (ROTATION, TRANSLATION) or speed is None or len(grips) != 1 or "." in grips[0].name:
        return None
    name, node = f"tyre_relaxation_{at.name}", grips[0]
    shortest, usual, longest = (time * at.scale.flow for time in _RELAXATION)
    length = g.parameter(
        f"length_{name}", usual, at.domain.displacement_unit, f"rolling over which {node.name} follows its slip",
        (shortest, longest),
    )  # fmt: skip
    own = node.laws[0][1].xreplace({symbol("flow"): signal("flow", node.name)})
    built = g.integral(
        f"built_{name}", lambda x: Abs(speed) / length * (own - x), effort_unit(at), f"force of {node.name}"
    )
    revise_law(g, node.name, "effort", built)
    return Effect(
        "tyre_relaxation", node.name, "d(effort)/dt = |speed|/s*(declared - effort)", (length.name,), adds_state=True,
        amplitudes=(0.35, 0.65), reference=_PACEJKA, manoeuvre="quick changes of slip at low and high speed",
    )  # fmt: skip


def centrifugal_tension(g: BondGraph, at: Place) -> Effect | None:
    """Grip that a belt loses to its own weight at speed: the friction declared there falls with the square of it."""
    speed = _speed_beside(g, at) if has_effort(at) else None
    grips = [node for node in elements_at(g, at, "R") if [given for given, _ in node.laws] == ["effort"]]
    if not has_effort(at) or at.domain not in (ROTATION, TRANSLATION) or speed is None or len(grips) != 1:
        return None
    name = f"centrifugal_tension_{at.name}"
    limit = 0.8 / at.scale.flow**2
    unit = over("1", flow_unit(at), 2)
    c = g.parameter(f"c_{name}", 0.0, unit, f"share of grip lost over speed squared at {at.label}", (0.0, limit))
    revise_law(g, grips[0].name, "effort", lambda old: old * (1 - c * speed**2))
    return Effect(
        "centrifugal_tension", grips[0].name, "grip = declared grip*(1 - c*speed^2)", (c.name,), reference=_BELT,
        manoeuvre="the same load at low and high speed",
    )  # fmt: skip


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
