"""Graph files: networkx node-link JSON in, and out again without loss; graphs by ``module:function``."""

from __future__ import annotations

import importlib
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import networkx as nx
from sympy import Expr

from bondgraph.declare.domains import Domain, domain_named
from bondgraph.declare.elements import KINDS, LAW_GIVES, Node, allowed_laws
from bondgraph.declare.expressions import parse, signal, signal_name, to_text
from bondgraph.declare.functions import table_function
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Input, Integral, NamedSignal, Output, Parameter, Table, symbol
from bondgraph.errors import DeclarationError, suggest

FORMAT = "bondgraph/1"

_TOP_KEYS = ("directed", "multigraph", "graph", "nodes", "bonds")
_GRAPH_KEYS = (
    "format", "name", "doc", "inputs", "parameters", "tables", "integrals", "signals", "outputs",
)  # fmt: skip
_QUANTITY_KEYS = {
    "inputs": ("name", "unit", "meaning", "default", "interpolation", "letters"),
    "parameters": ("name", "value", "unit", "meaning", "bounds"),
    "integrals": ("name", "of", "unit", "meaning", "initial"),
    "signals": ("name", "is", "unit", "meaning"),
    "outputs": ("name", "variable", "at", "is", "unit", "meaning"),
}
_TABLE_KEYS = ("x", "y", "values", "unit", "argument_units", "meaning")
_NODE_KEYS = ("id", "kind", "domain", "ports", "laws", "residuals", "form", "initial", "state", "doc")
_PART_KEYS = ("id", "kind", "graph", "ports", "bind")
_BOND_KEYS = ("source", "target", "key")


def load_graph(reference: str) -> BondGraph:
    """The graph of a file (``motor.json``) or of a function (``vehicle_graphs.baja:launch``).

    Raises
    ------
    DeclarationError
        If the file or function does not exist or does not give a graph.
    """
    path = Path(reference)
    if path.suffix == ".json" or path.is_file():
        return read_graph(path)
    module_name, colon, function_name = reference.partition(":")
    if not colon:
        raise DeclarationError(
            f"{reference}: no such file - give a graph file, or module:function such as vehicle_graphs.baja:launch",
            where=(reference,),
        )
    function = _graph_function(module_name, function_name, reference)
    graph = function()
    if not isinstance(graph, BondGraph):
        raise DeclarationError(f"{reference}: gives a {type(graph).__name__}, not a BondGraph", where=(reference,))
    graph.source = graph.source or module_name.replace(".", "/") + ".py"
    return graph


def _graph_function(module_name: str, function_name: str, reference: str) -> Any:
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name and (module_name == error.name or module_name.startswith(error.name + ".")):
            raise DeclarationError(f"{reference}: there is no module {error.name!r}", where=(reference,)) from None
        raise
    function = getattr(module, function_name, None)
    if not callable(function):
        public = [name for name, value in vars(module).items() if callable(value) and not name.startswith("_")]
        raise DeclarationError(
            f"{reference}: {module_name} has no function {function_name!r}{suggest(function_name, public)}",
            where=(reference,),
        )
    return function


def read_graph(path: Path | str) -> BondGraph:
    """Read a graph file.

    Raises
    ------
    DeclarationError
        If the file is missing, is not JSON, or declares something impossible; unknown keys are named.
    """
    path = Path(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DeclarationError(f"{path}: no such file", where=(str(path),)) from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise DeclarationError(f"{path}: not JSON ({error}) - see the graph file format", where=(str(path),)) from None
    graph = graph_from_json(data, path.name)
    graph.source = path.name
    return graph


def write_graph(graph: BondGraph, path: Path | str) -> None:
    """Write a graph file; :func:`read_graph` gives an equal graph."""
    Path(path).write_text(json.dumps(graph_to_json(graph), indent=1) + "\n", encoding="utf-8")


# ---------------------------------------------------------------------- reading


def graph_from_json(data: Mapping[str, Any], where: str = "graph") -> BondGraph:
    """The graph of a node-link JSON object."""
    _check_keys(data, _TOP_KEYS, where)
    head = data.get("graph", {})
    _check_keys(head, _GRAPH_KEYS, f"{where}: graph")
    if head.get("format", FORMAT) != FORMAT:
        raise DeclarationError(f"{where}: format {head['format']!r} is not {FORMAT!r}", where=("format",))
    if data.get("directed") is False or data.get("multigraph") is False:
        raise DeclarationError(f"{where}: must be a directed multigraph", where=("directed", "multigraph"))
    graph = BondGraph(str(head.get("name", Path(where).stem)), str(head.get("doc", "")))
    for record in data.get("nodes", ()):
        if record.get("kind") == "graph":
            _read_part(graph, record, where)
    names = _read_quantities(graph, head, where)
    for record in data.get("nodes", ()):
        if record.get("kind") == "graph":
            _bind_part(graph, record, names)
        else:
            graph.add_node(_node(record, names, where))
    for record in data.get("bonds", ()):
        _check_keys(record, _BOND_KEYS, f"{where}: bond", required=("source", "target"))
        graph.bond(str(record["source"]), str(record["target"]))
    for record in head.get("outputs", ()):
        _read_output(graph, record, names, where)
    return graph


def _check_keys(record: Any, known: Sequence[str], where: str, required: Sequence[str] = ()) -> None:
    if not isinstance(record, Mapping):
        raise DeclarationError(f"{where}: expected an object but got {record!r}", where=(where,))
    for key in record:
        if key not in known:
            raise DeclarationError(f"{where}: unknown key {key!r}{suggest(key, known)}", where=(key,))
    for key in required:
        if key not in record:
            raise DeclarationError(f"{where}: key {key!r} is missing", where=(key,))


def _read_quantities(graph: BondGraph, head: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Declare the quantities of the file's head; returns what each name stands for in expressions."""
    for group in _QUANTITY_KEYS:
        for record in head.get(group, ()):
            _check_keys(record, _QUANTITY_KEYS[group], f"{where}: {group}", required=("name",))
    names = _declared_names(graph, head)
    for record in head.get("inputs", ()):
        graph.input(
            record["name"],
            record.get("unit", ""),
            record.get("meaning", ""),
            default=_number(record.get("default", 0.0), record["name"]),
            hold=record.get("interpolation") == "hold",
            letters=record.get("letters"),
        )
    for record in head.get("parameters", ()):
        _check_keys(record, _QUANTITY_KEYS["parameters"], f"{where}: parameters", required=("name", "value"))
        value, bounds = _number(record["value"], record["name"]), record.get("bounds")
        graph.parameter(record["name"], value, record.get("unit", ""), record.get("meaning", ""), bounds)
    for name, record in head.get("tables", {}).items():
        _check_keys(record, _TABLE_KEYS, f"{where}: table {name}", required=("x", "values"))
        units = tuple(record.get("argument_units", ()))
        graph.table(
            name,
            record["x"],
            record["values"],
            record.get("unit", ""),
            units or "",
            y=record.get("y", ()),
            meaning=record.get("meaning", ""),
        )
    for group, key in (("signals", "is"), ("integrals", "of")):
        for record in head.get(group, ()):
            _check_keys(record, _QUANTITY_KEYS[group], f"{where}: {group}", required=("name", key))
            expression = parse(record[key], names, record["name"])
            unit, meaning = record.get("unit", ""), record.get("meaning", "")
            if group == "signals":
                graph._declare(NamedSignal(record["name"], expression, unit, meaning))
            else:
                start = _number(record.get("initial", 0.0), record["name"])
                graph._declare(Integral(record["name"], expression, unit, meaning, start))
    return names


def _declared_names(graph: BondGraph, head: Mapping[str, Any]) -> dict[str, Any]:
    names: dict[str, Any] = {"t": symbol("t")}
    for group in ("inputs", "parameters", "integrals", "signals"):
        names |= {record["name"]: symbol(record["name"]) for record in head.get(group, ())}
    for name, record in head.get("tables", {}).items():
        names[name] = table_function(name, 2 if "y" in record else 1)
    for part in graph.subgraphs:
        names |= {f"{part.name}.{name}": symbol(f"{part.name}.{name}") for name in part.graph.flatten().quantities}
    return names


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DeclarationError(f"{where}: expected a number but got {value!r}", where=(where,))
    return float(value)


def _node(record: Mapping[str, Any], names: Mapping[str, Any], where: str) -> Node:
    name = str(record.get("id", ""))
    kind = str(record.get("kind", ""))
    here = f"{where}: {name or record}"
    if "id" not in record or kind not in KINDS:
        raise DeclarationError(
            f"{here}: kind {kind!r} is not known{suggest(kind, KINDS)} - a node has an id and one of the kinds "
            f"{' '.join(KINDS)}",
            where=(name,),
        )
    ports = int(record.get("ports", 1))
    known = allowed_laws(kind, ports)
    _check_keys(record, (*_NODE_KEYS, *known), here)
    local = {own for given in known.values() for own in given}
    scope = {**names, **{own: symbol(own) for own in sorted(local)}}
    laws = tuple((key, parse(record[key], scope, name)) for key in known if key in record)
    laws += tuple(_field_laws(record, kind, scope, name))
    initial = record.get("initial", ())
    return Node(
        name,
        kind,
        domain_named(record["domain"]) if "domain" in record else None,
        laws,
        ports,
        tuple(map(float, initial if isinstance(initial, list) else (initial,))) if initial != () else _zeros(kind, ports),
        str(record.get("state", "")),
        str(record.get("doc", "")),
    )


def _zeros(kind: str, ports: int) -> tuple[float, ...]:
    return (0.0,) if kind in LAW_GIVES and ports == 1 else ()


def _field_laws(record: Mapping[str, Any], kind: str, names: Mapping[str, Any], name: str) -> list[tuple[str, Expr]]:
    form = record.get("form", LAW_GIVES.get(kind, "effort"))
    if form not in ("effort", "flow"):
        raise DeclarationError(f"{name}: form {form!r} - use effort or flow", where=(name,))
    pairs = [(f"{form}{i + 1}", text) for i, text in enumerate(record.get("laws", ()))]
    pairs += [(f"residual{i + 1}", text) for i, text in enumerate(record.get("residuals", ()))]
    return [(given, parse(text, names, name)) for given, text in pairs]


def _read_part(graph: BondGraph, record: Mapping[str, Any], where: str) -> None:
    _check_keys(record, _PART_KEYS, f"{where}: {record.get('id')}", required=("id", "graph"))
    inner = graph_from_json(record["graph"], f"{where}: {record['id']}")
    graph.include(str(record["id"]), inner, record.get("ports"))


def _bind_part(graph: BondGraph, record: Mapping[str, Any], names: Mapping[str, Any]) -> None:
    if record.get("bind"):
        part = graph._subgraphs.pop(str(record["id"]))
        bound = {key: parse(text, names, f"{part.name}.{key}") for key, text in record["bind"].items()}
        graph.include(part.name, part.graph, dict(part.ports), bound)


def _read_output(graph: BondGraph, record: Mapping[str, Any], names: Mapping[str, Any], where: str) -> None:
    name = record["name"]
    if "is" in record:
        expression = parse(record["is"], names, name)
    else:
        _check_keys(record, _QUANTITY_KEYS["outputs"], f"{where}: output {name}", required=("variable", "at"))
        variable = str(record["variable"])
        expression = signal(variable.rstrip("0123456789"), str(record["at"]))
        if signal_name(expression) is None:
            raise DeclarationError(
                f"{where}: output {name}: variable {variable!r} - use effort, flow, displacement or momentum", (name,)
            )
        graph._measure_variable(name, variable, record["at"], record.get("meaning", ""), record.get("unit"))
        return
    graph.measure(name, expression, record.get("unit", ""), record.get("meaning", ""))


# ---------------------------------------------------------------------- writing


def to_networkx(graph: BondGraph) -> nx.MultiDiGraph[str]:
    """The graph as a networkx multigraph whose node attributes are those of the graph file."""
    network: nx.MultiDiGraph[str] = nx.MultiDiGraph(**_head(graph))
    for part in graph.subgraphs:
        record: dict[str, Any] = {"kind": "graph", "graph": graph_to_json(part.graph), "ports": dict(part.ports)}
        if part.bind:
            record["bind"] = {key: to_text(value) for key, value in part.bind}
        network.add_node(part.name, **record)
    for node in graph.nodes.values():
        network.add_node(node.name, **_node_record(node))
    for bond in graph.bonds:
        network.add_edge(bond.source, bond.target)
    _drop_port_nodes(network, graph)
    return network


def _drop_port_nodes(network: nx.MultiDiGraph[str], graph: BondGraph) -> None:
    for name in [name for name in network if "." in name and name not in graph.nodes]:
        network.nodes[name]["port"] = True


def graph_to_json(graph: BondGraph) -> dict[str, Any]:
    """The node-link JSON object of a graph, keys in a fixed order.

    Examples
    --------
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
    head["signals"] = [
        _without_empty({"name": s.name, "is": to_text(s.expression), "unit": s.unit, "meaning": s.meaning})
        for s in graph.signals
    ]
    head["integrals"] = [
        _without_empty({"name": i.name, "of": to_text(i.of), "unit": i.unit, "meaning": i.meaning})
        | ({"initial": i.initial} if i.initial else {})
        for i in graph.integrals
    ]
    head["outputs"] = [_output_record(output) for output in graph.outputs]
    return {"format": FORMAT, "name": graph.name} | _without_empty(head)


def _input_record(quantity: Input) -> dict[str, Any]:
    record = _without_empty({"name": quantity.name, "unit": quantity.unit, "meaning": quantity.meaning})
    if quantity.default:
        record["default"] = quantity.default
    if quantity.letters:
        record["letters"] = dict(quantity.letters)
    elif quantity.interpolation == "hold":
        record["interpolation"] = "hold"
    return record


def _parameter_record(quantity: Parameter) -> dict[str, Any]:
    record: dict[str, Any] = {"name": quantity.name, "value": quantity.value}
    record |= _without_empty({"unit": quantity.unit, "meaning": quantity.meaning})
    return record | ({"bounds": list(quantity.bounds)} if quantity.bounds else {})


def _table_record(table: Table) -> dict[str, Any]:
    values = [list(row) for row in table.values] if table.y else list(table.values)  # type: ignore[arg-type]
    record = {"x": list(table.x), "y": list(table.y), "values": values, "unit": table.unit, "meaning": table.meaning}
    return _without_empty(record | {"argument_units": [unit for unit in table.argument_units if unit]})


def _output_record(output: Output) -> dict[str, Any]:
    read = signal_name(output.expression) if output.expression.is_Symbol else None
    if read is not None:
        described: dict[str, Any] = {"variable": f"{read.variable}{read.port or ''}", "at": read.node}
    else:
        described = {"is": to_text(output.expression)}
    return {"name": output.name} | described | _without_empty({"unit": output.unit, "meaning": output.meaning})


def _node_record(node: Node) -> dict[str, Any]:
    record: dict[str, Any] = {"kind": node.kind}
    if isinstance(node.domain, Domain):
        record["domain"] = node.domain.name
    if node.is_field:
        record |= {"ports": node.ports} | _field_record(node)
    else:
        record |= {given: to_text(law) for given, law in node.laws}
    if any(node.initial):
        record["initial"] = list(node.initial) if node.is_field else node.initial[0]
    return record | _without_empty({"state": node.state, "doc": node.doc})


def _field_record(node: Node) -> dict[str, Any]:
    laws = [to_text(law) for _, law in node.laws]
    given = node.laws[0][0]
    if given == "energy":
        return {"energy": laws[0]}
    if given.startswith("residual"):
        return {"residuals": laws}
    return {"laws": laws} | ({"form": "flow"} if node.kind == "R" and given.startswith("flow") else {})
