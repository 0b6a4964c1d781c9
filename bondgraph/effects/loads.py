"""Loads from outside: constant, drifting, wind, by position, with every turn.

References: Hucho (1998), Aerodynamics of Road Vehicles, for wind; Hanselman (2003), Brushless Permanent-Magnet Motor
Design, for cogging.
"""

from __future__ import annotations

from math import pi

from sympy import Abs, Expr, Function, cos, sin

from bondgraph.declare.domains import ROTATION
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_law
from bondgraph.effects.places import (
    Words,
    effort_unit,
    elements_at,
    flow_unit,
    has_effort,
    has_flow,
    is_motion,
    is_speed,
    over,
    position_at,
)
from bondgraph.effects.storages import spring_at

_BOND_GRAPHS = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 3"
_COGGING = "Hanselman (2003), Brushless Permanent-Magnet Motor Design"
#: Names of laws in each domain.
_CONSTANT = Words("constant_effort", "offset_voltage", "static_pressure")
_CONSTANT_FLOW = Words("", "offset_current", "constant_inflow", "constant_heat", "constant_supply")
#: The most periods in a turn at which a load that repeats is tried. Cogging repeats with the least common multiple of
#: slots and poles in a turn (Hanselman), of twelve slots and fourteen poles, as direct drives have them, 84 times.
_MOST_PERIODS = 84
#: The most periods of a detent: four for each tooth of a hybrid stepping motor's rotor, which has fifty as a rule.
#: Kenjo, Sugawara (1994), Stepping Motors and Their Microprocessor Controls, chapter 2.
_DETENT, _MOST_DETENT = 4, 200
#: Time in which a drifting load may become as large as the efforts at its place [s].
LONGEST_DRIFT = 100.0


def constant_effort(g: BondGraph, at: Place) -> Effect | None:
    """A constant effort of unknown sign: a grade, a bias of a torque map, the zero of an amplifier, a height."""
    word = _CONSTANT.at(at)
    if not has_flow(at) or not word:
        return None
    name = f"{word}_{at.name}"
    limit = 2.0 * at.scale.effort
    load = g.parameter(f"load_{name}", 0.0, effort_unit(at), f"constant load on {at.label}", (-limit, limit))
    g.effort_source(name, -load, at=at.junction)
    return Effect(
        word, name, "effort = -load", (f"load_{name}",), reference=_BOND_GRAPHS,
        manoeuvre="rest, or runs in both directions",
    )  # fmt: skip


def constant_flow(g: BondGraph, at: Place) -> Effect | None:
    """A constant flow of unknown sign: the offset of a pump, a current that leaks in, heat from a neighbour."""
    word = _CONSTANT_FLOW.at(at)
    if not has_effort(at) or not word:
        return None
    name = f"{word}_{at.name}"
    limit = 2.0 * at.scale.flow
    flow = g.parameter(f"flow_{name}", 0.0, flow_unit(at), f"constant flow out of {at.label}", (-limit, limit))
    g.flow_source(name, -flow, at=at.junction)
    return Effect(
        word, name, "flow = -constant", (flow.name,), reference=_BOND_GRAPHS, manoeuvre="rest with nothing driven"
    )  # fmt: skip


def headwind(g: BondGraph, at: Place) -> Effect | None:
    """Wind against the motion: a drag that is declared with the square of the speed acts at speed and wind."""
    open_air = is_motion(at) and at.domain != ROTATION
    drags = [node for node in elements_at(g, at, "R") if _is_square(node)] if open_air else []
    if len(drags) != 1:
        return None
    name = f"headwind_{at.name}"
    wind = g.parameter(f"w_{name}", 0.0, flow_unit(at), f"wind against {at.label}", (-at.scale.flow, at.scale.flow))
    own = symbol("flow")
    revise_law(g, drags[0].name, "effort", lambda old: old.xreplace({own: own + wind}))
    return Effect(
        "headwind", drags[0].name, "drag at flow + w", (wind.name,),
        reference="Hucho (1998), Aerodynamics of Road Vehicles",
        manoeuvre="fast runs in both directions",
    )  # fmt: skip


def _is_square(node: Node) -> bool:
    """Whether an element's effort is c*flow*|flow|: twice the flow gives four times the effort, with the sign of it."""
    law, own = node.law("effort"), symbol("flow")
    if law is None or own not in law.free_symbols:
        return False
    if any(not isinstance(part, Abs) for part in law.atoms(Function)):
        return False
    others = dict.fromkeys(law.free_symbols - {own}, 1.0)
    once, twice, back = (float(law.subs(others | {own: point})) for point in (1.0, 2.0, -1.0))
    return once != 0.0 and abs(twice - 4.0 * once) < 1e-9 * abs(once) and abs(back + once) < 1e-9 * abs(once)


def position_stiffness(g: BondGraph, at: Place) -> Effect | None:
    """A load proportional to the position that a graph integrates from the flow here: a cable, an inclined bed."""
    position = position_at(g, at)
    if position is None:
        return None
    name = f"position_stiffness_{at.name}"
    travel, unit = position
    limit = 10.0 * at.scale.effort
    rate = g.parameter(f"c_{name}", 0.0, over(effort_unit(at), unit), "load per position", (-limit, limit))
    g.effort_source(name, -rate * travel, at=at.junction)
    return Effect(
        "position_stiffness", name, "effort = c*position", (f"c_{name}",), reference=_BOND_GRAPHS,
        manoeuvre="rest at several positions",
    )  # fmt: skip


def drifting_load(g: BondGraph, at: Place) -> Effect | None:
    """A load that grows with time: the zero of an amplifier that warms up, a leak, a slowly tightening bearing."""
    if not is_speed(at):
        return None
    name = f"drifting_load_{at.name}"
    limit = at.scale.effort / LONGEST_DRIFT
    unit = over(effort_unit(at), "s")
    rate = g.parameter(f"c_{name}", 0.0, unit, f"load gained per time at {at.label}", (-limit, limit))
    g.effort_source(name, -rate * symbol("t"), at=at.junction)
    return Effect(
        "drifting_load", name, "effort = c*t", (f"c_{name}",), reference=_BOND_GRAPHS,
        manoeuvre="the same short run at the start and at the end of a long log",
    )  # fmt: skip


def ripple(g: BondGraph, at: Place) -> Effect | None:
    """A torque that repeats with an angle: cogging of magnets, teeth, a universal joint, a bent shaft.

    The angle is that of a spring, the one that the graph declares, or one that is added and starts at zero. Whole
    periods in a turn are tried, beyond those of direct drives the detents of stepping motors, up to those of which
    samples show two parts at half the largest speed.
    """
    turns = has_flow(at) and at.domain == ROTATION
    most = min(_MOST_DETENT, int(2 * pi / (at.scale.flow * at.times[0]))) if turns else 0
    angle = _angle_at(g, at) if most else None
    if angle is None:
        return None
    name = f"ripple_{at.name}"
    limit = at.scale.effort
    unit, bounds = effort_unit(at), (-limit, limit)
    sine = g.parameter(f"sine_{name}", 0.0, unit, "amplitude of the sine", bounds)
    cosine = g.parameter(f"cosine_{name}", 0.0, unit, "amplitude of the cosine", bounds)
    order = g.parameter(f"order_{name}", 1.0, "1", "periods in a turn", (0.5, most + 0.5))
    g.effort_source(name, -sine * sin(order * angle) - cosine * cos(order * angle), at=at.junction)
    detents = range(_MOST_PERIODS + _DETENT, most + 1, _DETENT)
    tried = tuple(float(whole) for whole in (*range(1, min(most, _MOST_PERIODS) + 1), *detents))
    return Effect(
        "ripple", name, "effort = a*sin(n*angle) + b*cos(n*angle)", (sine.name, cosine.name), shapes=(order.name,),
        grids=((order.name, tried),), reference=_COGGING, manoeuvre="slow turning without load, over several turns",
    )  # fmt: skip


def _angle_at(g: BondGraph, at: Place) -> Expr | None:
    if (spring := spring_at(g, at, straight=False)) is not None:
        return signal("displacement", spring.name)
    if (declared := position_at(g, at)) is not None:
        return declared[0]
    if elements_at(g, at, "I"):
        return g.integral(f"angle_ripple_{at.name}", at.junction.flow, "rad", f"angle of {at.label}")
    return None


def ripple_sine(g: BondGraph, at: Place) -> Effect | None:
    """The sine part of a load that repeats with every turn of a screw, whose parameter ``screw_lead`` the graph has."""
    return _ripple(g, at, "ripple_sine", sin)


def ripple_cosine(g: BondGraph, at: Place) -> Effect | None:
    """The cosine part of a load that repeats with every turn of a screw."""
    return _ripple(g, at, "ripple_cosine", cos)


def _ripple(g: BondGraph, at: Place, effect: str, wave: type[sin] | type[cos]) -> Effect | None:
    position = position_at(g, at)
    lead = next((p for p in g.parameters if p.name == "screw_lead"), None)
    if position is None or lead is None:
        return None
    name = f"{effect}_{at.name}"
    limit = at.scale.effort
    size = g.parameter(f"c_{name}", 0.0, effort_unit(at), "amplitude of the load per turn", (-limit, limit))
    g.effort_source(name, -size * wave(6.283185307179586 * position[0] / lead.symbol), at=at.junction)
    law = f"effort = c*{wave.__name__}(2 pi position/lead)"
    manoeuvre = "slow travel over several turns of the screw"
    return Effect(effect, name, law, (f"c_{name}",), reference=_COGGING, manoeuvre=manoeuvre)
