"""Checks of complete graphs."""

from __future__ import annotations

from typing import Any

import networkx as nx

from bondgraph.declare.angular import check_angular_speeds
from bondgraph.declare.both_forms import check_both_forms
from bondgraph.declare.domains import Domain
from bondgraph.declare.elements import SOURCES, STORAGES, TWO_PORTS, Node, a_kind
from bondgraph.declare.expressions import signal_name, signals_in
from bondgraph.declare.law_units import check_law_units
from bondgraph.declare.quantity_checks import is_free_name
from bondgraph.declare.requirements import check_requirements
from bondgraph.declare.starts import check_starts
from bondgraph.declare.store import GraphStore
from bondgraph.errors import DeclarationError, suggest


def validate(graph: GraphStore) -> None:
    """Raise DeclarationError for what can only be known when the (flat) graph is complete."""
    if not graph.nodes:
        raise DeclarationError(f"{graph.name}: the graph has no nodes - declare junctions and elements", (graph.name,))
    incidence = graph.incidence()
    parameters = graph.parameters
    for node in graph.nodes.values():
        _check_degree(graph, node, incidence[node.name])
        check_both_forms(node, parameters, graph.name)
    domains = node_domains(graph)
    _check_signals(graph)
    _check_state_names(graph)
    check_starts(graph)
    check_law_units(graph, domains)
    check_angular_speeds(graph, domains)
    check_requirements(graph.requirements, graph.parameters, graph.name)


def _check_state_names(graph: GraphStore) -> None:
    seen: dict[str, str] = {}
    for node in graph.nodes.values():
        for port in range(1, node.ports + 1) if node.state else ():
            name = node.state_name(port)
            taken = seen.get(name) or (name if name in graph.quantities else "")
            if taken or not is_free_name(name):
                problem = f"is taken by {taken}" if taken else "is no name, or one that is reserved"
                raise DeclarationError(
                    f"{graph.name}: {node.name}: state {name!r} {problem} - use another name", where=(node.name,)
                )
            seen[name] = node.name


def _check_degree(graph: GraphStore, node: Node, bonds: list[tuple[int, bool]]) -> None:
    degree = len(bonds)
    incoming = sum(inward for _, inward in bonds)
    where = f"{graph.name}: {node.name}"
    if node.is_junction:
        if degree == 0:
            raise DeclarationError(f"{where}: {node.kind}-junction without bonds - bond it or remove it", (node.name,))
    elif node.kind in TWO_PORTS:
        if degree != 2 or incoming != 1:
            raise DeclarationError(
                f"{where}: a {node.kind} has one incoming and one outgoing bond, this one has {incoming} in and "
                f"{degree - incoming} out",
                where=(node.name,),
            )
    elif degree != node.ports:
        kind = "source" if node.kind in SOURCES else "storage" if node.kind in STORAGES else "element"
        raise DeclarationError(
            f"{where}: the {node.kind} {kind} has {node.ports} port(s) but {degree} bond(s) - "
            "each port takes exactly one bond; use a junction to share it",
            where=(node.name,),
        )


def node_domains(graph: GraphStore) -> dict[str, Domain | None]:
    """The domain of every junction and one-port, spread along bonds; two-ports and fields take None.

    Raises
    ------
    DeclarationError
        If a bond joins two domains without a transformer, gyrator or field between them.
    """
    network: nx.Graph[str] = nx.Graph()
    network.add_nodes_from(graph.nodes)
    couplers = {n.name for n in graph.nodes.values() if n.kind in TWO_PORTS or n.ports > 1}
    network.add_edges_from((b.source, b.target) for b in graph.bonds if not {b.source, b.target} & couplers)
    domains: dict[str, Domain | None] = dict.fromkeys(graph.nodes)
    component_of = {name: i for i, component in enumerate(nx.connected_components(network)) for name in component}
    declared: dict[int, list[str]] = {}
    for node in graph.nodes.values():
        if node.domain is not None:
            declared.setdefault(component_of[node.name], []).append(node.name)
    for names in declared.values():
        if any(graph.nodes[name].domain != graph.nodes[names[0]].domain for name in names):
            _refuse_mixed(graph, network, names)
    for name, component in component_of.items():
        if component in declared and name not in couplers:
            domains[name] = graph.nodes[declared[component][0]].domain
    return domains


def _refuse_mixed(graph: GraphStore, network: nx.Graph[str], declared: list[str]) -> None:
    first = declared[0]
    other = next(n for n in declared if graph.nodes[n].domain != graph.nodes[first].domain)
    path = nx.shortest_path(network, first, other)
    raise DeclarationError(
        f"{graph.name}: bond {path[-2]} -> {path[-1]} joins {graph.nodes[first].domain.name} and "  # type: ignore[union-attr]
        f"{graph.nodes[other].domain.name}; put a transformer or gyrator between them",  # type: ignore[union-attr]
        where=(f"bond {path[-2]} -> {path[-1]}",),
    )


def _check_signals(graph: GraphStore) -> None:
    users: list[tuple[str, Any]] = [(n.name, law) for n in graph.nodes.values() for _, law in n.laws]
    users += [(i.name, i.of) for i in graph.integrals]
    users += [(s.name, law) for s in graph.signals for law in (s.expression, s.guess) if law is not None]
    users += [(o.name, o.expression) for o in graph.outputs]
    for user, expression in users:
        for used in signals_in(expression):
            _check_signal(graph, user, used)


def _check_signal(graph: GraphStore, user: str, used: Any) -> None:
    read = signal_name(used)
    assert read is not None
    node = graph.nodes.get(read.node)
    where = f"{graph.name}: {user}"
    if node is None:
        raise DeclarationError(
            f"{where}: signal {used.name}: no node {read.node!r}{suggest(read.node, graph.nodes)}", where=(user,)
        )
    storage = {"displacement": "C", "momentum": "I"}.get(read.variable)
    if storage is not None and node.kind != storage:
        raise DeclarationError(
            f"{where}: signal {used.name}: {read.node} is {a_kind(node.kind)}, only {a_kind(storage)} has a "
            f"{read.variable}",
            where=(user,),
        )
    common = {"0": "effort", "1": "flow"}.get(node.kind)
    if common is not None and read.variable != common:
        raise DeclarationError(
            f"{where}: signal {used.name}: the bonds of a {node.kind}-junction differ in {read.variable} - read the "
            f"{read.variable} of one element instead",
            where=(user,),
        )
    ports = 2 if node.kind in TWO_PORTS else node.ports
    if ports > 1 and not 1 <= read.port <= ports:
        raise DeclarationError(
            f"{where}: signal {used.name}: {read.node} has {ports} ports - write {read.variable}1({read.node})", (user,)
        )
    if ports == 1 and read.port > 1:
        raise DeclarationError(
            f"{where}: signal {used.name}: {read.node} has one port - write {read.variable}({read.node})", (user,)
        )
