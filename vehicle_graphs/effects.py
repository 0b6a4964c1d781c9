"""Effects that a declared machine may lack: losses, loads and storages, each a function that extends a graph.

Every function adds one element at a junction or on a bond, with coefficients that are zero when the effect is absent.
The signs are those of a loss: a positive coefficient takes energy out of the machine. References: Armstrong-Helouvry,
Dupont, Canudas de Wit (1994), Automatica 30(7), for friction; Karnopp, Margolis, Rosenberg (2012), *System Dynamics*,
for the elements.
"""

from __future__ import annotations

from sympy import Abs, Expr, tanh

from bondgraph.declare.domains import CHEMICAL, THERMAL
from bondgraph.declare.editing import split_bond
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import symbol
from bondgraph.derive.laws import linear_coefficient

#: The flow, as a share of its scale, at which smoothed dry friction reaches 76 % of its level.
SMOOTHING = 0.02


def constant_effort(g: BondGraph, at: Place) -> Effect | None:
    """A constant load of unknown sign: a grade, a headwind, a bias of a torque map."""
    if not _is_speed(at):
        return None
    name = f"constant_effort_{at.name}"
    limit = 2.0 * at.scale.effort
    load = g.parameter(f"load_{name}", 0.0, _effort_unit(at), f"constant load on {at.label}", (-limit, limit))
    g.effort_source(name, -load, at=at.junction)
    return Effect("constant_effort", name, "effort = -load", (f"load_{name}",))


def viscous_loss(g: BondGraph, at: Place) -> Effect | None:
    """Drag proportional to the flow: bearing oil, a fluid coupling, eddy currents."""
    if not _is_speed(at):
        return None
    name, coefficient = _coefficient(g, at, "viscous_loss", "viscous coefficient", _over_flow(at, 1), power=1)
    g.resistance(name, lambda flow: coefficient * flow, at=at.junction)
    return Effect("viscous_loss", name, "effort = c*flow", (coefficient.name,))


def coulomb_loss(g: BondGraph, at: Place) -> Effect | None:
    """Dry friction of constant size against the motion, smoothed around standstill."""
    if not _is_speed(at):
        return None
    name, level = _coefficient(g, at, "coulomb_loss", "dry friction", _effort_unit(at), power=0)
    direction = _direction(g, at, name)
    g.resistance(name, lambda flow: level * tanh(flow / direction), at=at.junction)
    return Effect("coulomb_loss", name, "effort = c*tanh(flow/w)", (level.name,))


def quadratic_loss(g: BondGraph, at: Place) -> Effect | None:
    """Drag that grows with the square of the flow: air, churned oil, an orifice."""
    if not _is_speed(at):
        return None
    name, coefficient = _coefficient(g, at, "quadratic_loss", "quadratic coefficient", _over_flow(at, 2), power=2)
    g.resistance(name, lambda flow: coefficient * flow * Abs(flow), at=at.junction)
    return Effect("quadratic_loss", name, "effort = c*flow*|flow|", (coefficient.name,))


def torque_proportional_loss(g: BondGraph, at: Place) -> Effect | None:
    """A share of the transmitted effort that is lost: gear mesh, belt, chain; it acts against the motion."""
    transmitted = _transmitted(g, at)
    if transmitted is None:
        return None
    name = f"torque_proportional_loss_{at.name}"
    share = g.parameter(f"share_{name}", 0.0, "1", f"share of the effort lost at {at.label}", (0.0, 0.6))
    direction = _direction(g, at, name)
    g.resistance(name, lambda flow: share * Abs(transmitted) * tanh(flow / direction), at=at.junction)
    return Effect("torque_proportional_loss", name, "effort = c*|transmitted effort|*tanh(flow/w)", (share.name,))


def added_inertia(g: BondGraph, at: Place) -> Effect | None:
    """Inertia that was not counted: payload, a flywheel, adhering oil; a storage that follows the flow."""
    declared = _inertance_beside(g, at.junction) if _is_speed(at) else None
    if declared is None:
        return None
    name = f"added_inertia_{at.name}"
    size, unit = declared
    inertia = g.parameter(f"inertia_{name}", 0.0, unit, f"inertia added to {at.label}", (0.0, size))
    g.inertance(name, inertia, at=at.junction)
    return Effect("added_inertia", name, "effort = c*d(flow)/dt", (f"inertia_{name}",))


def added_compliance(g: BondGraph, at: Place) -> Effect | None:
    """An elastic part in a connection declared as rigid: a spring with some damping on a bond between two speeds."""
    if at.bond is None or not _joins_speeds(g, at):
        return None
    name = f"added_compliance_{at.name}"
    domain = at.domain
    unit = "" if domain is None else f"{domain.displacement_unit}/({domain.effort_unit})"
    softest = 0.5 * at.scale.flow / at.scale.effort
    bounds = (1e-4 * softest, softest)
    compliance = g.parameter(f"compliance_{name}", 1e-2 * softest, unit, f"compliance of {at.label}", bounds)
    drag = 0.05 * at.scale.effort / at.scale.flow
    damping = g.parameter(f"damping_{name}", drag, _over_flow(at, 1), "damping beside that compliance")
    junction = split_bond(g, at.bond, Node(f"z_{name}", "0", domain))
    stretch = g.one_junction(f"stretch_{name}", domain)
    g.bond(junction, stretch)
    g.compliance(name, 1 / compliance, at=stretch)
    g.resistance(f"damper_{name}", damping, at=stretch)
    return Effect("added_compliance", name, "effort = displacement/c", (f"compliance_{name}",), adds_state=True)


def _is_speed(at: Place) -> bool:
    """Losses and loads act on a 1-junction of a domain in which flow is a motion or current."""
    return at.bond is None and at.junction.kind == "1" and at.domain not in (THERMAL, CHEMICAL)


def _joins_speeds(g: BondGraph, at: Place) -> bool:
    """Whether a bond rigidly joins two speeds, directly or through a transformer (then only its first bond counts)."""
    if at.bond is None or at.domain in (THERMAL, CHEMICAL):
        return False
    flat = g.flatten()
    first, second = (flat.nodes[end] for end in (at.bond.source, at.bond.target))
    if first.kind == "TF":
        before = next(bond.source for bond in flat.bonds if bond.target == first.name)
        return second.kind == "1" and flat.nodes[before].kind != "1"
    return first.kind == "1" and second.kind in ("1", "TF")


def _effort_unit(at: Place) -> str:
    return "" if at.domain is None else at.domain.effort_unit


def _over_flow(at: Place, power: int) -> str:
    if at.domain is None:
        return ""
    return f"{at.domain.effort_unit}/({at.domain.flow_unit})" + (f"^{power}" if power > 1 else "")


def _coefficient(g: BondGraph, at: Place, effect: str, meaning: str, unit: str, power: int) -> tuple[str, Expr]:
    """A coefficient whose largest value makes the loss as large as twice the efforts at this place."""
    name = f"{effect}_{at.name}"
    limit = 2.0 * at.scale.effort / at.scale.flow**power
    return name, g.parameter(f"c_{name}", 0.0, unit, f"{meaning} at {at.label}", (0.0, limit))


def _direction(g: BondGraph, at: Place, name: str) -> Expr:
    unit = "" if at.domain is None else at.domain.flow_unit
    return g.parameter(f"w_{name}", SMOOTHING * at.scale.flow, unit, "flow at which the friction reaches 76 %")


def _transmitted(g: BondGraph, at: Place) -> Expr | None:
    """The effort that arrives at a junction through a two-port or from a 0-junction, as a signal."""
    if not _is_speed(at):
        return None
    flat = g.flatten()
    for index, inward in flat.incidence()[at.junction.name]:
        bond = flat.bonds[index]
        other = bond.source if inward else bond.target
        if not inward:
            continue
        if flat.nodes[other].kind == "0":
            return Handle(other, "0", at.domain).effort
        if flat.nodes[other].kind in ("TF", "GY"):
            port = 1 + [i for i, _ in flat.incidence()[other]].index(index)
            return signal("effort", other, port)
    return None


def _inertance_beside(g: BondGraph, junction: Handle) -> tuple[float, str] | None:
    """Size and unit of the linear inertance declared at a junction: the natural size of one that was forgotten."""
    flat = g.flatten()
    declared = {parameter.symbol: parameter for parameter in flat.parameters}
    values = {symbol: parameter.value for symbol, parameter in declared.items()}
    for index, _ in flat.incidence()[junction.name]:
        bond = flat.bonds[index]
        other = flat.nodes[bond.target if bond.source == junction.name else bond.source]
        law = other.law("flow") if other.kind == "I" and other.ports == 1 else None
        reciprocal = None if law is None else linear_coefficient(law, symbol("momentum"))
        if reciprocal is not None and reciprocal.free_symbols <= set(values):
            used = [declared[name] for name in reciprocal.free_symbols]
            domain = junction.domain
            unit = "" if domain is None else f"{domain.momentum_unit}/({domain.flow_unit})"
            return 1.0 / float(reciprocal.subs(values)), used[0].unit if len(used) == 1 else unit
    return None
