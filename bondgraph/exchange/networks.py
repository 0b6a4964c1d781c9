"""Graphs from and to networkx and GraphML: node and bond attributes are those of the graph file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import networkx as nx

from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.json_writer import graph_to_json
from bondgraph.errors import DeclarationError, require_kind
from bondgraph.files import write_bytes

#: GraphML knows texts and numbers; lists and objects stand in it as JSON behind this sign.
_JSON = "json:"
#: Attributes that networkx gives to every graph that it reads from GraphML.
_DEFAULTS = ("node_default", "edge_default")


def from_networkx(network: Any, where: str = "graph") -> BondGraph:
    """The graph of a networkx multigraph whose attributes are called as in graph files.

    Parameters
    ----------
    network
        Directed; each node has a ``kind`` and its law, an edge is a bond that points the way of positive power, and
        the attributes of the graph hold name, parameters, inputs and outputs. What networkx reads from a file of
        :func:`write_graphml` is such a network, too.
    where
        Name in messages.

    Raises
    ------
    DeclarationError
        If it is not directed, or declares something impossible.

    Examples
    --------
    >>> import networkx as nx
    >>> network = nx.MultiDiGraph(name="rc")
    >>> network.add_node("z", kind="0")
    >>> network.add_node("c", kind="C", effort="1e6*displacement")
    >>> network.add_node("r", kind="R", flow="effort/50")
    >>> network.add_edges_from([("z", "c"), ("z", "r")])
    [0, 0]
    >>> len(from_networkx(network).bonds)
    2
    """
    if not network.is_directed():
        raise DeclarationError(
            f"{where}: the edges have no direction, and a bond points the way of positive power - give a MultiDiGraph",
            where=(where,),
        )
    return _declared(network, str(network.graph.get("name") or where), where)


def _declared(network: Any, name: str, where: str) -> BondGraph:
    """The graph of a network, whose lists may be packed as texts, as GraphML needs them."""
    head = {key: _unpacked(value) for key, value in network.graph.items() if key not in _DEFAULTS}
    nodes = [
        {"id": str(node), **{key: _unpacked(value) for key, value in attributes.items()}}
        for node, attributes in network.nodes(data=True)
        if attributes or "." not in str(node)  # ends within sub-graphs are named by bonds alone
    ]
    edges = sorted(network.edges(data=True), key=lambda edge: int(edge[2].get("order", 0)))
    bonds = [{"source": str(source), "target": str(target)} for source, target, _ in edges]
    return graph_from_json({"graph": {"name": name, **head}, "nodes": nodes, "bonds": bonds}, where)


def write_graphml(graph: BondGraph, path: Path | str) -> None:
    """Write a graph as GraphML, which yEd, Gephi and networkx read.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    require_kind("write_graphml", graph, BondGraph, "graph")
    data = graph_to_json(graph)
    network: nx.MultiDiGraph[str] = nx.MultiDiGraph(**{key: _packed(value) for key, value in data["graph"].items()})
    for record in data["nodes"]:
        network.add_node(record["id"], **{key: _packed(value) for key, value in record.items() if key != "id"})
    for place, bond in enumerate(data["bonds"]):  # ports of a field are told apart by the order of their bonds
        network.add_edge(bond["source"], bond["target"], order=place)
    write_bytes(Path(path), ("\n".join(nx.generate_graphml(network)) + "\n").encode())


def read_graphml(path: Path | str) -> BondGraph:
    """The graph of a GraphML file as :func:`write_graphml` writes it, or drawn with the same attributes.

    Raises
    ------
    DeclarationError
        If the file is not GraphML, or declares something impossible.
    """
    path = Path(path)
    try:
        network = nx.read_graphml(path, force_multigraph=True)
    except (OSError, SyntaxError, nx.NetworkXException, ValueError) as error:
        raise DeclarationError(f"{path.name}: cannot be read as GraphML ({error})", where=(path.name,)) from None
    return _declared(network, path.stem, path.name)


def _packed(value: Any) -> Any:
    return f"{_JSON}{json.dumps(value)}" if isinstance(value, list | dict | tuple | bool) else value


def _unpacked(value: Any) -> Any:
    return json.loads(value.removeprefix(_JSON)) if isinstance(value, str) and value.startswith(_JSON) else value
