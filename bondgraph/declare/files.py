"""Graph files: networkx node-link JSON in, and out again without loss; graphs by ``module:function``."""

from __future__ import annotations

import importlib
import json
import os
import sys
from pathlib import Path
from typing import Any

from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import FORMAT, graph_from_json
from bondgraph.declare.json_writer import graph_to_json, to_networkx
from bondgraph.errors import DeclarationError, suggest
from bondgraph.files import write_text

__all__ = ["FORMAT", "graph_from_json", "graph_to_json", "load_graph", "read_graph", "to_networkx", "write_graph"]


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
    except (TypeError, ValueError):  # importlib's way to refuse ".x" and ""
        raise DeclarationError(
            f"{reference}: {module_name!r} is no module - write its full name, such as vehicle_graphs.baja:launch",
            where=(reference,),
        ) from None
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
    except OSError as error:
        raise DeclarationError(f"{path}: cannot be read ({error.strerror})", where=(str(path),)) from None
    except (ValueError, RecursionError) as error:  # also of a number with thousands of digits
        raise DeclarationError(f"{path}: not JSON ({error}) - see the graph file format", where=(str(path),)) from None
    graph = graph_from_json(data, path.name)
    graph.source = path.name
    return graph


def write_graph(graph: BondGraph, path: Path | str) -> None:
    """Write a graph file; :func:`read_graph` gives an equal graph."""
    write_text(Path(path), json.dumps(graph_to_json(graph), indent=1) + "\n")
