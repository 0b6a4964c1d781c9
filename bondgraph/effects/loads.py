"""Loads from outside, and the actuators that drive: constant forces, wind, wrong maps, lags.

References: Hucho (1998), Aerodynamics of Road Vehicles, chapter 4, for wind; Guzzella, Onder (2010), Introduction to
Modeling and Control of Internal Combustion Engine Systems, chapter 2, for the lag of an engine's torque.
"""

from __future__ import annotations

from sympy import Abs, Function, cos, sin

from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.elements import Node
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Input, symbol
from bondgraph.declare.revision import replace_input, revise_law
from bondgraph.effects.places import (
    commanded,
    commands,
    effort_unit,
    elements_at,
    flow_unit,
    is_speed,
    over,
    position_at,
)

_ENGINE = "Guzzella, Onder (2010), Modeling and Control of Internal Combustion Engine Systems, chapter 2"
#: Time in which a drifting load may become as large as the efforts at its place [s].
LONGEST_DRIFT = 100.0


def constant_effort(g: BondGraph, at: Place) -> Effect | None:
    """A constant load of unknown sign: a grade, an inclined mounting, a bias of a torque map."""
    if not is_speed(at):
        return None
    name = f"constant_effort_{at.name}"
    limit = 2.0 * at.scale.effort
    load = g.parameter(f"load_{name}", 0.0, effort_unit(at), f"constant load on {at.label}", (-limit, limit))
    g.effort_source(name, -load, at=at.junction)
    return Effect("constant_effort", name, "effort = -load", (f"load_{name}",))


def headwind(g: BondGraph, at: Place) -> Effect | None:
    """Wind against the motion: a drag that is declared with the square of the speed acts at speed and wind."""
    drags = [node for node in elements_at(g, at, "R") if _is_square(node)] if is_speed(at) else []
    if len(drags) != 1:
        return None
    name = f"headwind_{at.name}"
    wind = g.parameter(f"w_{name}", 0.0, flow_unit(at), f"wind against {at.label}", (-at.scale.flow, at.scale.flow))
    own = symbol("flow")
    revise_law(g, drags[0].name, "effort", lambda old: old.xreplace({own: own + wind}))
    return Effect(
        "headwind", drags[0].name, "drag at flow + w", (wind.name,),
        reference="Hucho (1998), Aerodynamics of Road Vehicles, chapter 4",
    )  # fmt: skip


def actuator_scale(g: BondGraph, at: Place) -> Effect | None:
    """A source or brake whose map is wrong by a factor: a torque model, a calibration."""
    found = commanded(g, at)
    if not found:
        return None
    node = found[0][0]
    name = f"actuator_scale_{at.name}"
    share = g.parameter(f"s_{name}", 0.0, "1", f"share by which {node.name} is stronger", (-0.6, 0.6))
    revise_law(g, node.name, "effort", lambda old: (1 + share) * old)
    return Effect("actuator_scale", node.name, "effort = (1 + s)*declared", (share.name,), reference=_ENGINE)


def actuator_lag(g: BondGraph, at: Place) -> Effect | None:
    """A command that acts late, by a first-order lag: manifold filling, brake pressure, a current controller."""
    found = commanded(g, at)
    if not found or found[0][0].name != _first_follower(g, found[0][1]):
        return None
    node, command = found[0]
    name = f"actuator_lag_{at.name}"
    lag = g.parameter(f"T_{name}", 0.1, "s", f"time in which {node.name} follows its command", (5e-3, 2.0))
    own = command.symbol
    given = g.integral(
        f"given_{name}", lambda x: (own - x) / lag, command.unit, f"{command.name} as {node.name} gives it"
    )
    replace_input(g, command.name, given)
    return Effect(
        "actuator_lag", node.name, "command follows by dx/dt = (u - x)/T", (lag.name,), adds_state=True,
        amplitudes=(0.35, 0.65), reference=_ENGINE,
    )  # fmt: skip


def _first_follower(g: BondGraph, command: Input) -> str:
    """The first element that follows a command: it stands for all of them."""
    nodes = g.flatten().nodes.values()
    followers = (node.name for node in nodes if node.kind in ("Se", "R") and command in commands(g, node))
    return next(followers, "")


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
    return Effect("position_stiffness", name, "effort = c*position", (f"c_{name}",))


def drifting_load(g: BondGraph, at: Place) -> Effect | None:
    """A load that grows with time: the zero of an amplifier that warms up, a leak, a slowly tightening bearing."""
    if not is_speed(at):
        return None
    name = f"drifting_load_{at.name}"
    limit = at.scale.effort / LONGEST_DRIFT
    unit = over(effort_unit(at), "s")
    rate = g.parameter(f"c_{name}", 0.0, unit, f"load gained per time at {at.label}", (-limit, limit))
    g.effort_source(name, -rate * symbol("t"), at=at.junction)
    return Effect("drifting_load", name, "effort = c*t", (f"c_{name}",))


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
    return Effect(effect, name, f"effort = c*{wave.__name__}(2 pi position/lead)", (f"c_{name}",))
