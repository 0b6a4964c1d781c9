"""Graphs by reference; graph files: networkx node-link JSON in, and out again without loss."""

from __future__ import annotations

import json
from pathlib import Path

from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import FORMAT, graph_from_json
from bondgraph.declare.json_writer import graph_to_json, to_networkx
from bondgraph.declare.loading import is_code_reference, python_graph
from bondgraph.errors import DeclarationError, require_kind
from bondgraph.files import write_text

__all__ = ["FORMAT", "graph_from_json", "graph_to_json", "load_graph", "read_graph", "to_networkx", "write_graph"]


def load_graph(reference: str) -> BondGraph:
    """The graph of a file (``motor.json``, ``sled.py``, ``sled.py:sled``) or module (``vehicle_graphs.baja:launch``).

    Raises
    ------
    DeclarationError
        If the file or name does not exist or does not give a graph, or the code fails.
    """
    path = Path(reference)
    if is_code_reference(reference):
        return python_graph(reference)
    if path.suffix == ".fmu":
        raise DeclarationError(
            f"{reference}: an FMU holds compiled code and no equations, so it is no graph - bondgraph simulate and "
            "compare run it along a log; what it gives may feed a source of a model",
            where=(reference,),
        )
    if path.suffix != ".json" and not path.is_file():
        raise DeclarationError(
            f"{reference}: no such file - give a graph file (motor.json, sled.py, sled.py:name), or module:name such "
            "as vehicle_graphs.baja:launch",
            where=(reference,),
        )
    return read_graph(path)


def read_graph(path: Path | str) -> BondGraph:
    """Read a graph file.

    Raises
    ------
    DeclarationError
        If the file is missing, is not JSON, or declares something impossible; unknown keys are named.

    Examples
    --------
    >>> import tempfile
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("rotor")
    >>> _ = g.inertance("J", 0.02, at=g.one_junction("shaft", bg.ROTATION))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     bg.write_graph(g, f"{folder}/rotor.json")
    ...     bg.read_graph(f"{folder}/rotor.json") == g
    True
    """
    path = Path(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DeclarationError(f"{path}: no such file", where=(str(path),)) from None
    except OSError as error:
        raise DeclarationError(f"{path}: cannot be read ({error.strerror})", where=(str(path),)) from None
    except (ValueError, RecursionError) as error:  # also of a number with thousands of digits
        raise DeclarationError(f"{path}: not JSON ({error}) - see the graph file format", where=(str(path),)) from None
    graph = graph_from_json(data, path.name)
    graph.source = path.name
    return graph


def write_graph(graph: BondGraph, path: Path | str) -> None:
    """Write a graph file; :func:`read_graph` gives an equal graph.

    Examples
    --------
    >>> import tempfile
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("rotor")
    >>> _ = g.inertance("J", 0.02, at=g.one_junction("shaft", bg.ROTATION))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     bg.write_graph(g, f"{folder}/rotor.json")
    ...     bg.build(f"{folder}/rotor.json")
    <BuiltModel rotor: 1 state, 0 inputs, 0 parameters, 0 outputs>
    """
    require_kind("write_graph", graph, BondGraph, "graph")
    require_kind("write_graph", path, (str, Path), "file")
    write_text(Path(path), json.dumps(graph_to_json(graph), indent=1) + "\n")
