"""Files of BondGraphTools (version 0.1 of its format): components of its base library, linear and in plain numbers.

Reference: P. Cudmore, M. Pan, P. Gawthrop, E. Crampin (2021), Analysing and simulating energy-based models in biology
using BondGraphTools, The European Physical Journal E 44, and its module ``fileio``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.errors import DeclarationError
from bondgraph.exchange.libraries import library

#: Parameter of a component of the base library, the field of a graph file that its law gives, and the law.
_LAWS = {
    "R": ("r", "effort", "{name}*flow"),
    "C": ("C", "effort", "displacement/{name}"),
    "I": ("L", "flow", "momentum/{name}"),
    "Se": ("e", "effort", "{name}"),
    "Sf": ("f", "flow", "{name}"),
    "TF": ("r", "modulus", "{name}"),
    "GY": ("R", "modulus", "{name}"),
}
#: Laws where power enters a two-port at its port 0: there ``e_1 = r e_0``, and ``e_0 = R f_1`` with flows inward.
_FIRST = {"TF": "1/{name}", "GY": "-{name}"}
#: Ports of a 1-junction by whether a bond leaves it, by which BondGraphTools directs flows.
_LEAVES = {"inverting": True, "non_inverting": False}
_JUNCTIONS = ("0", "1")


@dataclass
class _Parts:
    """What a model holds, with names that are unique in the whole file."""

    nodes: list[dict[str, Any]] = field(default_factory=list)
    parameters: list[dict[str, Any]] = field(default_factory=list)
    inputs: list[dict[str, Any]] = field(default_factory=list)
    bonds: list[dict[str, str]] = field(default_factory=list)


def read_bondgraphtools(path: Path | str) -> BondGraph:
    """The graph of a file that BondGraphTools saved.

    Numbers become parameters ``component_parameter`` without unit, since its files have none; a parameter without a
    number becomes an input of a source and is refused elsewhere, and so are sub-models.

    Raises
    ------
    DeclarationError
        If the file cannot be read, or holds a component that is none of R, C, I, Se, Sf, TF, GY, 0, 1.
    GenerationError
        If the library that reads YAML is not installed.
    """
    path = Path(path)
    yaml = library("yaml", "bondgraphtools")
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        version, models = str(content["version"]), content["models"]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, TypeError, KeyError) as error:
        said = f"{path.name}: cannot be read as a file of BondGraphTools ({error})"
        raise DeclarationError(said, where=(path.name,)) from None
    if version != "0.1":
        raise DeclarationError(f"{path.name}: format version {version} is not 0.1", where=(path.name, "version"))
    parts = _Parts()
    _take(parts, models, "/", "", path.name)
    head = {"name": str(content.get("root") or path.stem), "parameters": parts.parameters, "inputs": parts.inputs}
    return graph_from_json({"graph": head, "nodes": parts.nodes, "bonds": parts.bonds}, path.name)


def _take(parts: _Parts, models: Mapping[str, Any], uri: str, prefix: str, where: str) -> None:
    model = models.get(uri)
    if not isinstance(model, Mapping):
        raise DeclarationError(f"{where}: there is no model {uri!r}", where=(where, uri))
    for text in model.get("components", ()):
        name, template, *values = str(text).split()
        base, slash, kind = template.partition("/")
        if base == "base" and slash:
            _component(parts, f"{prefix}{name}", kind, dict(one.split("=", 1) for one in values), where)
        elif template in models:
            raise DeclarationError(
                f"{where}: component {name!r} is a sub-model, whose ports are not taken over - flatten it first, or "
                "read its models one by one",
                where=(where, name),
            )
        else:
            raise DeclarationError(
                f"{where}: component {name!r} is a {template!r} - of BondGraphTools' libraries only base is read",
                where=(where, name),
            )
    for text in model.get("netlist", ()):
        ends = [str(end).partition(".") for end in str(text).split()]
        for (name, _, port), is_tail in zip(ends, (True, False), strict=True):
            _check_port(parts, f"{prefix}{name}", port, is_tail, where)
        source, target = (f"{prefix}{name}" for name, _, _ in ends)
        parts.bonds.append({"source": source, "target": target})


def _check_port(parts: _Parts, name: str, port: str, is_tail: bool, where: str) -> None:
    """Give a two-port, or a source that takes a bond in, the law of that direction."""
    node = next((one for one in parts.nodes if one["id"] == name), None)
    if node is None:
        raise DeclarationError(f"{where}: a bond ends at {name!r}, which is no component", where=(where, name))
    kind = node["kind"]
    if kind in _FIRST and port == "0" and not is_tail:
        node["modulus"] = _FIRST[kind].format(name=node["modulus"])
    elif kind == "Sf" and not is_tail:  # its flow is out of the source, that of the bond into it
        node["flow"] = f"-{node['flow']}"
    elif kind == "1" and _LEAVES.get(port, is_tail) is not is_tail:
        raise DeclarationError(
            f"{where}: a bond of junction {name!r} is turned against its port {port!r} - connect it by its other port",
            where=(where, name),
        )


def _component(parts: _Parts, name: str, kind: str, values: Mapping[str, str], where: str) -> None:
    if kind in _JUNCTIONS:
        parts.nodes.append({"id": name, "kind": kind})
        return
    if kind not in _LAWS:
        raise DeclarationError(
            f"{where}: component {name!r} is of kind {kind!r} - read are {', '.join((*_LAWS, *_JUNCTIONS))}",
            where=(where, name),
        )
    parameter, gives, law = _LAWS[kind]
    quantity = f"{name}_{parameter}"
    if parameter in values:
        parts.parameters.append({"name": quantity, "value": float(values[parameter])})
    elif kind in ("Se", "Sf"):
        parts.inputs.append({"name": quantity})
    else:
        raise DeclarationError(
            f"{where}: component {name!r} has no number for {parameter!r} - give it one before saving",
            where=(where, name),
        )
    parts.nodes.append({"id": name, "kind": kind, gives: law.format(name=quantity)})
