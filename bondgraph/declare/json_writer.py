"""A graph as a networkx multigraph, and as the node-link JSON object of a graph file."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import networkx as nx

from bondgraph.coherent import displayed
from bondgraph.declare.domains import DOMAINS
from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import signal_name, to_text
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import FORMAT
from bondgraph.declare.quantities import Input, NamedSignal, Output, Parameter, ParameterStart, Start, Table


def to_networkx(graph: BondGraph) -> nx.MultiDiGraph[str]:
    """The graph as a networkx multigraph whose node attributes are those of the graph file."""
    network: nx.MultiDiGraph[str] = nx.MultiDiGraph(**_head(graph))
    for part in graph.subgraphs:
        record: dict[str, Any] = {"kind": "graph", "graph": graph_to_json(part.graph), "ports": dict(part.ports)}
        if part.bind:
            record["bind"] = {key: to_text(value) for key, value in part.bind}
        if part.shared:
            record["shared"] = True
        network.add_node(part.name, **record)
    for node in graph.nodes.values():
        network.add_node(node.name, **_node_record(node))
    for bond in graph.bonds:
        network.add_edge(bond.source, bond.target)
    for name in network:
        if "." in name and name not in graph.nodes:
            network.nodes[name]["port"] = True
    return network


def graph_to_json(graph: BondGraph) -> dict[str, Any]:
    """The node-link JSON object of a graph, keys in a fixed order.

    Examples
    --------
    >>> from bondgraph.declare.json_reader import graph_from_json
    >>> g = BondGraph("rc")
    >>> z = g.zero_junction("z")
    >>> _ = g.compliance("c", 1e6, at=z)
    >>> graph_from_json(graph_to_json(g)) == g
    True
    """
    network = to_networkx(graph)
    data = nx.node_link_data(network, edges="bonds")
    nodes = [record for record in data["nodes"] if not record.pop("port", False)]
    bonds = [{"source": bond.source, "target": bond.target} for bond in graph.bonds]
    nodes = [{"id": record.pop("id"), **record} for record in nodes]
    return {"directed": True, "multigraph": True, "graph": data["graph"], "nodes": nodes, "bonds": bonds}


def _without_empty(record: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in record.items() if value not in ("", None, (), [], {})}


def _head(graph: BondGraph) -> dict[str, Any]:
    head: dict[str, Any] = {"format": FORMAT, "name": graph.name, "doc": graph.doc}
    head["inputs"] = [_input_record(quantity) for quantity in graph.inputs]
    head["parameters"] = [_parameter_record(quantity) for quantity in graph.parameters]
    head["tables"] = {table.name: _table_record(table) for table in graph.tables}
    head["signals"] = [_signal_record(signal) for signal in graph.signals]
    head["integrals"] = [
        _without_empty({"name": i.name, "of": to_text(i.of), "unit": i.display_unit, "meaning": i.meaning})
        | _initial_record([i.shown(i.initial)], (i.start,), many=False)
        for i in graph.integrals
    ]
    head["requirements"] = [{"positive": to_text(r.positive), "reason": r.reason} for r in graph.requirements]
    head["outputs"] = [_output_record(output) for output in graph.outputs]
    return {"format": FORMAT, "name": graph.name} | _without_empty(head)


def _input_record(quantity: Input) -> dict[str, Any]:
    record = _without_empty({"name": quantity.name, "unit": quantity.display_unit, "meaning": quantity.meaning})
    if quantity.has_default:
        record["default"] = quantity.shown(quantity.default)
    if quantity.letters:
        record["letters"] = {letter: quantity.shown(value) for letter, value in quantity.letters}
    elif quantity.interpolation != "linear":
        record["interpolation"] = quantity.interpolation
    return record


def _parameter_record(quantity: Parameter) -> dict[str, Any]:
    record: dict[str, Any] = {"name": quantity.name, "value": quantity.shown(quantity.value)}
    record |= _without_empty({"unit": quantity.display_unit, "meaning": quantity.meaning})
    record |= {"bounds": [quantity.shown(bound) for bound in quantity.bounds]} if quantity.bounds else {}
    return record | ({} if quantity.tolerance is None else {"tolerance": quantity.tolerance})


def _signal_record(named: NamedSignal) -> dict[str, Any]:
    law = {"is": to_text(named.expression)}
    if named.guess is not None:
        law = {"residual": to_text(named.expression), "guess": to_text(named.guess)}
    return {"name": named.name} | law | _without_empty({"unit": named.display_unit, "meaning": named.meaning})


def _table_record(table: Table) -> dict[str, Any]:
    own = table.shown
    values: list[Any] = [list(map(own, row)) for row in table.values] if table.y else list(map(own, table.values))  # type: ignore[arg-type]
    x, y = (
        [displayed(one, unit) for one in points]
        for points, unit in zip((table.x, table.y), _arguments(table), strict=True)
    )
    record = {"x": x, "y": y, "values": values, "unit": table.display_unit, "meaning": table.meaning}
    return _without_empty(record | {"argument_units": list(table.shown_argument_units or table.argument_units)})


def _arguments(table: Table) -> tuple[str, str]:
    """Units in which the arguments of a table are written, empty where those are its own."""
    first, second, *_ = (*table.shown_argument_units, "", "")
    return first, second


def _output_record(output: Output) -> dict[str, Any]:
    read = signal_name(output.expression) if output.expression.is_Symbol else None
    if read is not None:
        described: dict[str, Any] = {"variable": f"{read.variable}{read.port or ''}", "at": read.node}
    else:
        described = {"is": to_text(output.expression)}
    return (
        {"name": output.name} | described | {"unit": output.display_unit} | _without_empty({"meaning": output.meaning})
    )


def _node_record(node: Node) -> dict[str, Any]:
    record: dict[str, Any] = {"kind": node.kind}
    if node.domain is not None:
        known = DOMAINS.get(node.domain.name) == node.domain
        record["domain"] = node.domain.name if known else dataclasses.asdict(node.domain)
    if node.is_field:
        record |= {"ports": node.ports} | _field_record(node)
    else:
        record |= {given: to_text(law) for given, law in node.laws}
    record |= _initial_record(node.initial, node.starts or (None,) * len(node.initial), node.is_field)
    return record | _without_empty({"state": node.state, "doc": node.doc})


def _initial_record(
    values: Sequence[float], starts: Sequence[Start | ParameterStart | None], many: bool
) -> dict[str, Any]:
    """Start values: a number, an expression of parameters, or a signal with its number unless that is zero."""
    texts = [
        value if start is None else [str(start), value] if value and isinstance(start, Start) else str(start)
        for value, start in zip(values, starts, strict=True)
    ]
    return {"initial": texts if many else texts[0]} if any(texts) else {}


def _field_record(node: Node) -> dict[str, Any]:
    if node.kind == "X":
        forms: dict[str, dict[str, str]] = {}
        for given, law in node.laws:
            number, _, variable = given.partition(".")
            forms.setdefault(number, {})[variable] = to_text(law)
        return {"forms": list(forms.values())}
    laws = [to_text(law) for _, law in node.laws]
    given = node.laws[0][0]
    if given == "energy":
        return {"energy": laws[0]}
    if given.startswith("residual"):
        return {"residuals": laws}
    return {"laws": laws} | ({"form": "flow"} if node.kind == "R" and given.startswith("flow") else {})
