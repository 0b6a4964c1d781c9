"""What the effects share: where they make sense, how large their coefficients may be, and in which units."""

from __future__ import annotations

from sympy import Expr

from bondgraph.declare.domains import CHEMICAL, THERMAL
from bondgraph.declare.effect import Place
from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph, Handle

#: The flow, as a share of its scale, at which smoothed dry friction reaches 76 % of its level.
SMOOTHING = 0.02


def is_speed(at: Place) -> bool:
    """Losses and loads act on a 1-junction of a domain in which flow is a motion or current."""
    return at.bond is None and at.junction.kind == "1" and at.domain not in (THERMAL, CHEMICAL)


def is_force(at: Place) -> bool:
    """Slip and leakage act on a 0-junction of such a domain."""
    return at.bond is None and at.junction.kind == "0" and at.domain not in (THERMAL, CHEMICAL)


def effort_unit(at: Place) -> str:
    """Unit of the effort there, empty where the domain is not declared."""
    return "" if at.domain is None else at.domain.effort_unit


def flow_unit(at: Place) -> str:
    """Unit of the flow there, empty where the domain is not declared."""
    return "" if at.domain is None else at.domain.flow_unit


def over(unit: str, other: str, power: int = 1) -> str:
    """A unit over a power of another; empty where one is not known."""
    if not unit or not other:
        return ""
    return f"{unit}/({other})" + (f"^{power}" if power > 1 else "")


def coefficient(g: BondGraph, at: Place, effect: str, meaning: str, unit: str, power: int) -> tuple[str, Expr]:
    """A coefficient whose largest value makes the loss as large as twice the efforts at this place."""
    name = f"{effect}_{at.name}"
    limit = 2.0 * at.scale.effort / at.scale.flow**power
    return name, g.parameter(f"c_{name}", 0.0, unit, f"{meaning} at {at.label}", (0.0, limit))


def direction(g: BondGraph, at: Place, name: str) -> Expr:
    """The flow over which smoothed dry friction changes sign."""
    meaning = "flow at which the friction reaches 76 %"
    return g.parameter(f"w_{name}", SMOOTHING * at.scale.flow, flow_unit(at), meaning)


def elements_at(g: BondGraph, at: Place, kind: str) -> list[Node]:
    """The one-ports of a kind at a junction."""
    flat = g.flatten()
    found = []
    for index, inward in flat.incidence()[at.junction.name]:
        bond = flat.bonds[index]
        node = flat.nodes[bond.source if inward else bond.target]
        if node.kind == kind and node.ports == 1:
            found.append(node)
    return found


def transmitted(g: BondGraph, at: Place) -> Expr | None:
    """The effort that arrives at a junction through a two-port or from a 0-junction, as a signal."""
    if not is_speed(at):
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
