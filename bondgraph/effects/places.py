"""What effects share: where they make sense, how large their coefficients may be, and in which units."""

from __future__ import annotations

from sympy import Expr, Symbol

from bondgraph.declare.domains import CHEMICAL, THERMAL
from bondgraph.declare.effect import Place
from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import Input, symbol
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.laws import linear_coefficient


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


def coefficient(
    g: BondGraph, at: Place, effect: str, meaning: str, unit: str, power: int, signed: bool = False
) -> tuple[str, Expr]:
    """A coefficient whose largest value makes the loss as large as twice the efforts at this place."""
    name = f"{effect}_{at.name}"
    limit = 2.0 * at.scale.effort / at.scale.flow**power
    lower = -limit if signed else 0.0
    return name, g.parameter(f"c_{name}", 0.0, unit, f"{meaning} at {at.label}", (lower, limit))


def direction(g: BondGraph, at: Place, name: str) -> Expr:
    """The flow over which smoothed dry friction changes sign; its parameter is ``w_`` and the name."""
    meaning = "flow at which the friction reaches 76 %"
    return g.parameter(f"w_{name}", at.smoothing * at.scale.flow, flow_unit(at), meaning)


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
    """The effort that a junction passes on through a two-port or a 0-junction, as a signal.

    That is the effort that arrives; at the head of a chain, where only a source drives, the one that leaves.
    """
    if not is_speed(at):
        return None
    flat = g.flatten()
    for index, _ in sorted(flat.incidence()[at.junction.name], key=lambda end: not end[1]):
        bond = flat.bonds[index]
        other = bond.target if bond.source == at.junction.name else bond.source
        if flat.nodes[other].kind == "0":
            return Handle(other, "0", at.domain).effort
        if flat.nodes[other].kind in ("TF", "GY"):
            port = 1 + [i for i, _ in flat.incidence()[other]].index(index)
            return signal("effort", other, port)
    return None


def commands(g: BondGraph, node: Node) -> list[Input]:
    """The inputs, other than levers and switches, on which the laws of an element depend, through signals too."""
    flat = g.flatten()
    named = {symbol(one.name): one.expression for one in flat.signals}
    reached: set[Symbol] = set()
    waiting = [used for _, law in node.laws for used in law.free_symbols]
    while waiting:
        used = waiting.pop()
        if used not in reached:
            reached.add(used)
            waiting += named[used].free_symbols if used in named else ()
    return [one for one in flat.inputs if one.symbol in reached and not one.is_held]


def commanded(g: BondGraph, at: Place) -> list[tuple[Node, Input]]:
    """Sources and resistances at a junction that follow an input, each with the first such input."""
    if not is_speed(at):
        return []
    nodes = [*elements_at(g, at, "Se"), *elements_at(g, at, "R")]
    return [(node, found[0]) for node in nodes if node.law("effort") is not None and (found := commands(g, node))]


def yielding(g: BondGraph, at: Place) -> tuple[Node, Expr] | None:
    """The viscous resistance that sets the flow of a junction without inertia, and its coefficient.

    There the forces decide how fast something gives way; friction must hold them before it moves at all.
    """
    if not is_speed(at) or elements_at(g, at, "I"):
        return None
    found = elements_at(g, at, "R")
    law = found[0].law("effort") if len(found) == 1 else None
    coefficient = None if law is None else linear_coefficient(law, symbol("flow"))
    if coefficient is None or not _gives_flow(g, found[0].name):
        return None
    return found[0], coefficient


def _gives_flow(g: BondGraph, resistance: str) -> bool:
    """Whether causality lets a resistance give a flow to its junction."""
    causal = assign_causality(g)
    own = next(k for k, bond in enumerate(causal.bonds) if resistance in (bond.source, bond.target))
    return causal.receives_effort(own, resistance)


def position_at(g: BondGraph, at: Place) -> tuple[Expr, str] | None:
    """The declared integral of the flow of a junction, and its unit."""
    if not is_speed(at):
        return None
    found = next((i for i in g.integrals if i.of == signal("flow", at.junction.name)), None)
    return None if found is None else (symbol(found.name), found.unit)
