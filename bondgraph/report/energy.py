"""Energy variables of storages, whatever variables the states of a model are."""

from __future__ import annotations

from collections.abc import Mapping

from sympy import Expr

from bondgraph.declare.elements import ENERGY_VARIABLE, STORAGES, Node
from bondgraph.declare.quantities import symbol
from bondgraph.derive.variables import BondVariables


def energy_name(node: Node, port: int) -> str:
    """``displacement(C)``, ``momentum2(coils)``: the energy variable of a storage's port.

    Examples
    --------
    >>> energy_name(Node("rotor", "I"), 1)
    'momentum(rotor)'
    """
    return f"{ENERGY_VARIABLE[node.kind]}{port if node.ports > 1 else ''}({node.name})"


def energy_states(variables: BondVariables) -> dict[str, tuple[str, Expr | None]]:
    """Energy variable of each independent storage -> its state, and the inertia by which a flow state is multiplied."""
    found: dict[str, tuple[str, Expr | None]] = {}
    for node in variables.graph.nodes.values():
        for port in range(1, node.ports + 1) if node.kind in STORAGES else ():
            state = variables.state_of(node.name, port)
            if state is not None:
                inertia = variables.constant_inertia(node) if state.variable == "flow" else None
                found[energy_name(node, port)] = (state.symbol.name, inertia)
    return found


def inertia_value(inertia: Expr | None, parameters: Mapping[str, float]) -> float:
    """The inertia at values of the parameters, one where the state is the energy variable itself."""
    if inertia is None:
        return 1.0
    return float(inertia.subs({symbol(name): value for name, value in parameters.items()}))
