"""Effects that measured machines showed beyond the usual losses, each a function that extends a graph.

They follow the rules of ``vehicle_graphs.effects``: one element at a junction, one coefficient that is zero when the
effect is absent. References: Janot, Gautier, Brunot (2019), *Data Set and Reference Models of EMPS*, for friction that
differs by direction; Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7), for friction that falls with
speed and for friction that depends on position.
"""

from __future__ import annotations

from sympy import Abs, Expr, cos, exp, sin, tanh

from bondgraph.declare.domains import CHEMICAL, THERMAL
from bondgraph.declare.effect import Effect, Place, sensor_fault
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_output

#: The flow, as a share of its scale, at which smoothed dry friction reaches 76 % of its level, and at which the rise of
#: friction towards standstill has fallen to 37 %.
SMOOTHING, RISE = 0.02, 0.1
#: Time constants between which a lagging drive is looked for [s].
SHORTEST_LAG, LONGEST_LAG = 1e-4, 0.2
#: Time in which a drifting load may become as large as the efforts at its place [s].
LONGEST_DRIFT = 100.0


def direction_dependent_drag(g: BondGraph, at: Place) -> Effect | None:
    """Viscous drag that differs by direction: what a screw or belt loses more in one direction than in the other."""
    if not _is_speed(at):
        return None
    name, coefficient = _coefficient(g, at, "direction_dependent_drag", "half the difference of drags", 1, signed=True)
    g.resistance(name, lambda flow: coefficient * Abs(flow), at=at.junction)
    return Effect("direction_dependent_drag", name, "effort = c*|flow|", (coefficient.name,))


def cubic_loss(g: BondGraph, at: Place) -> Effect | None:
    """Drag that grows with the cube of the flow: a damping that stiffens with amplitude."""
    if not _is_speed(at):
        return None
    name, coefficient = _coefficient(g, at, "cubic_loss", "cubic coefficient", 3)
    g.resistance(name, lambda flow: coefficient * flow**3, at=at.junction)
    return Effect("cubic_loss", name, "effort = c*flow^3", (coefficient.name,))


def rise_of_friction(g: BondGraph, at: Place) -> Effect | None:
    """Friction that rises towards standstill (Stribeck), on top of a constant level."""
    if not _is_speed(at):
        return None
    name, level = _coefficient(g, at, "rise_of_friction", "friction gained at standstill", 0)
    unit = "" if at.domain is None else at.domain.flow_unit
    around = g.parameter(f"w_{name}", SMOOTHING * at.scale.flow, unit, "flow at which the friction reaches 76 %")
    falls = g.parameter(f"v_{name}", RISE * at.scale.flow, unit, "flow at which the rise has fallen to 37 %")
    g.resistance(name, lambda flow: level * tanh(flow / around) * exp(-((flow / falls) ** 2)), at=at.junction)
    return Effect("rise_of_friction", name, "effort = c*tanh(flow/w)*exp(-(flow/v)^2)", (level.name,))


def position_stiffness(g: BondGraph, at: Place) -> Effect | None:
    """A load proportional to the position that a graph integrates from the flow here: a cable, an inclined bed."""
    position = _position(g, at)
    if position is None or at.domain is None:
        return None
    name = f"position_stiffness_{at.name}"
    travel, unit = position
    limit = 10.0 * at.scale.effort
    rate = g.parameter(f"c_{name}", 0.0, f"{at.domain.effort_unit}/({unit})", "load per position", (-limit, limit))
    g.effort_source(name, -rate * travel, at=at.junction)
    return Effect("position_stiffness", name, "effort = c*position", (f"c_{name}",))


def ripple_sine(g: BondGraph, at: Place) -> Effect | None:
    """The sine part of a load that repeats with every turn of a screw, whose parameter ``screw_lead`` the graph has."""
    return _ripple(g, at, "ripple_sine", sin)


def ripple_cosine(g: BondGraph, at: Place) -> Effect | None:
    """The cosine part of a load that repeats with every turn of a screw."""
    return _ripple(g, at, "ripple_cosine", cos)


def drifting_load(g: BondGraph, at: Place) -> Effect | None:
    """A load that grows with time: the zero of an amplifier that warms up, a leak, a slowly tightening bearing."""
    if not _is_speed(at):
        return None
    name = f"drifting_load_{at.name}"
    limit = at.scale.effort / LONGEST_DRIFT
    unit = "" if at.domain is None else f"{at.domain.effort_unit}/s"
    rate = g.parameter(f"c_{name}", 0.0, unit, f"load gained per time at {at.label}", (-limit, limit))
    g.effort_source(name, -rate * symbol("t"), at=at.junction)
    return Effect("drifting_load", name, "effort = c*t", (f"c_{name}",))


def overrun_loss(g: BondGraph, at: Place) -> Effect | None:
    """A share of the transmitted effort that is lost, or gained, only when the machine drives the motor."""
    transmitted = _transmitted(g, at)
    if transmitted is None:
        return None
    name = f"overrun_loss_{at.name}"
    share = g.parameter(f"share_{name}", 0.0, "1", f"share of a negative effort at {at.label}", (-0.5, 0.5))
    g.effort_source(name, -share * (Abs(transmitted) - transmitted) / 2, at=at.junction)
    return Effect("overrun_loss", name, "effort = c*max(-transmitted effort, 0)", (f"share_{name}",))


def lagging_source(g: BondGraph, at: Place) -> Effect | None:
    """A drive that follows its command with a lag: current control, a valve, the manifold of an engine."""
    drive = _driven_source(g, at)
    if drive is None or at.domain is None:
        return None
    name = f"lagging_source_{at.name}"
    middle = (SHORTEST_LAG * LONGEST_LAG) ** 0.5
    lag = g.parameter(f"time_{name}", middle, "s", f"time constant of {drive.name}", (SHORTEST_LAG, LONGEST_LAG))
    law = g.nodes[drive.name].law("effort")
    follows = g.integral(f"effort_{name}", lambda x: (law - x) / lag, at.domain.effort_unit, "effort that arrives")
    g.effort_source(name, follows - law, at=at.junction)
    return Effect("lagging_source", name, "effort = lagged - commanded", (f"time_{name}",), adds_state=True)


@sensor_fault
def sensor_magnitude(g: BondGraph, at: Place) -> Effect | None:
    """A sensor that does not see the direction: a pulse counter, a tachometer behind a rectifier."""
    name = f"magnitude_{at.name}"
    share = g.parameter(name, 0.0, "1", f"share of {at.output} shown without its sign", (0.0, 1.5))
    revise_output(g, at.output, lambda shown: (1 - share) * shown + share * Abs(shown))
    return Effect(
        "sensor_magnitude", at.output, "shown = (1 - s)*true + s*|true|", (name,), amplitudes=(0.3, 0.67),
        channel=at.output, kind="magnitude",
    )  # fmt: skip


@sensor_fault
def sensor_square(g: BondGraph, at: Place) -> Effect | None:
    """A sensor that shows the square of what it senses: an orifice, a rectified and smoothed oscillation, a power."""
    name = f"square_{at.name}"
    unit = next((output.unit for output in g.outputs if output.name == at.output), "")
    share = g.parameter(name, 0.0, "1", f"share of {at.output} shown as its square", (0.0, 1.5))
    size = g.parameter(f"true_at_{at.name}", at.scale.effort, unit, f"where the square of {at.output} is right")
    revise_output(g, at.output, lambda shown: (1 - share) * shown + share * shown**2 / size)
    return Effect(
        "sensor_square", at.output, "shown = (1 - s)*true + s*true^2/size", (name,), amplitudes=(0.3, 0.67),
        channel=at.output, kind="square",
    )  # fmt: skip


def _is_speed(at: Place) -> bool:
    return at.bond is None and at.junction.kind == "1" and at.domain not in (THERMAL, CHEMICAL)


def _coefficient(
    g: BondGraph, at: Place, effect: str, meaning: str, power: int, signed: bool = False
) -> tuple[str, Expr]:
    """A coefficient whose largest value makes the effort twice as large as those at this place."""
    name = f"{effect}_{at.name}"
    limit = 2.0 * at.scale.effort / at.scale.flow**power
    bounds = (-limit if signed else 0.0, limit)
    return name, g.parameter(f"c_{name}", 0.0, _unit(at, power), f"{meaning} at {at.label}", bounds)


def _unit(at: Place, power: int) -> str:
    if at.domain is None:
        return ""
    if power == 0:
        return at.domain.effort_unit
    return f"{at.domain.effort_unit}/({at.domain.flow_unit})" + (f"^{power}" if power > 1 else "")


def _position(g: BondGraph, at: Place) -> tuple[Expr, str] | None:
    """The declared integral of the flow of a junction, and its unit."""
    if not _is_speed(at):
        return None
    found = next((i for i in g.integrals if i.of == signal("flow", at.junction.name)), None)
    return None if found is None else (symbol(found.name), found.unit)


def _ripple(g: BondGraph, at: Place, effect: str, wave: type[sin] | type[cos]) -> Effect | None:
    position = _position(g, at)
    lead = next((p for p in g.parameters if p.name == "screw_lead"), None)
    if position is None or lead is None:
        return None
    name = f"{effect}_{at.name}"
    limit = at.scale.effort
    size = g.parameter(f"c_{name}", 0.0, _unit(at, 0), "amplitude of the load per turn", (-limit, limit))
    g.effort_source(name, -size * wave(6.283185307179586 * position[0] / lead.symbol), at=at.junction)
    return Effect(effect, name, f"effort = c*{wave.__name__}(2 pi position/lead)", (f"c_{name}",))


def _transmitted(g: BondGraph, at: Place) -> Expr | None:
    """The effort that arrives at a junction through a transformer or gyrator."""
    if not _is_speed(at):
        return None
    flat = g.flatten()
    for index, inward in flat.incidence()[at.junction.name]:
        source = flat.bonds[index].source
        if inward and flat.nodes[source].kind in ("TF", "GY"):
            port = 1 + [i for i, _ in flat.incidence()[source]].index(index)
            return signal("effort", source, port)
    return None


def _driven_source(g: BondGraph, at: Place) -> Handle | None:
    """The one effort source at a junction whose law contains an input."""
    if not _is_speed(at):
        return None
    inputs = {declared.symbol for declared in g.inputs}
    ends = (bond.source for bond in g.bonds if bond.target == at.junction.name)
    driven = [end for end in ends if end in g.nodes and _reads(g, end, inputs)]
    return Handle(driven[0], "Se", at.domain) if len(driven) == 1 else None


def _reads(g: BondGraph, node: str, inputs: set[Expr]) -> bool:
    law = g.nodes[node].law("effort") if g.nodes[node].kind == "Se" else None
    return law is not None and bool(law.free_symbols & inputs)
