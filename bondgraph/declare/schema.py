"""The JSON schema of graph files, made from the keys that their reader knows.

What needs more than the shape of a file (names that exist, causality, units) is found by the reader alone.
"""

from __future__ import annotations

import dataclasses
from typing import Any, get_args

from bondgraph.declare import json_reader as reader
from bondgraph.declare.domains import DOMAINS, Domain
from bondgraph.declare.elements import KINDS, MULTIPORTS, allowed_laws
from bondgraph.declare.limits import MOST_PORTS
from bondgraph.declare.quantities import Interpolation

Schema = dict[str, Any]

_TEXT: Schema = {"type": "string"}
_NUMBER: Schema = {"type": "number"}
_NUMBERS: Schema = {"type": "array", "items": _NUMBER}
_BOOLEAN: Schema = {"type": "boolean"}
#: A law: text such as ``b*flow``, or a number.
_LAW: Schema = {"type": ["string", "number"]}
_START: Schema = {
    "anyOf": [_LAW, {"type": "array", "prefixItems": [_TEXT, _NUMBER], "minItems": 2, "maxItems": 2, "items": False}]
}

#: Schema of each key, wherever it is read.
_KEYS: dict[str, Schema] = {
    **dict.fromkeys(("id", "name", "unit", "meaning", "doc", "state", "at", "source", "target", "reason"), _TEXT),
    **dict.fromkeys(("of", "is", "residual", "guess", "positive"), _LAW),
    "format": {"const": reader.FORMAT},
    "value": _NUMBER,
    "default": {"type": ["number", "null"]},
    "bounds": {"type": ["array", "null"], "items": _NUMBER, "minItems": 2, "maxItems": 2},
    "tolerance": {"type": ["number", "null"], "minimum": 0, "exclusiveMaximum": 1},
    "interpolation": {"enum": list(get_args(Interpolation))},
    "letters": {"type": "object", "additionalProperties": _NUMBER},
    "x": _NUMBERS,
    "y": _NUMBERS,
    "values": {"type": "array", "items": {"anyOf": [_NUMBER, _NUMBERS]}},
    "argument_units": {"type": "array", "items": _TEXT},
    "variable": {"type": "string", "pattern": "^(effort|flow|displacement|momentum)[0-9]*$"},
    "initial": {"anyOf": [_START, {"type": "array", "items": _START}, {"type": "null"}]},
    "domain": {"anyOf": [{"enum": sorted(DOMAINS)}, {"$ref": "#/$defs/domain"}]},
    "ports": {"type": "integer", "minimum": 1, "maximum": MOST_PORTS},
    "laws": {"type": "array", "items": _LAW},
    "residuals": {"type": "array", "items": _LAW},
    "form": {"enum": ["effort", "flow"]},
    "forms": {"type": "array", "items": {"type": "object", "additionalProperties": _LAW}},
    "bind": {"type": "object", "additionalProperties": _LAW},
    "shared": _BOOLEAN,
    "graph": {"$ref": "#"},
    "key": {"type": ["integer", "string"]},
}


def graph_schema() -> Schema:
    """The schema of ``bondgraph/1``, JSON Schema draft 2020-12.

    Examples
    --------
    >>> graph_schema()["properties"]["graph"]["properties"]["format"]
    {'const': 'bondgraph/1'}
    """
    groups = {group: {"type": "array", "items": _record(keys, *_needed(group))} for group, keys in _groups().items()}
    tables = {"type": "object", "additionalProperties": _record(reader._TABLE_KEYS, "x", "values")}
    head = _record(("format", "name", "doc"))
    head["properties"] |= groups | {"tables": tables}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"bond graph, {reader.FORMAT}",
        "type": "object",
        "properties": {
            "directed": {"const": True},
            "multigraph": {"const": True},
            "graph": head,
            "nodes": {"type": "array", "items": {"$ref": "#/$defs/node"}},
            "bonds": {"type": "array", "items": _record(reader._BOND_KEYS, "source", "target")},
        },
        "additionalProperties": False,
        "$defs": {"node": _node(), "domain": _domain()},
    }


def _groups() -> dict[str, tuple[str, ...]]:
    return {**reader._QUANTITY_KEYS, "requirements": ("positive", "reason")}


def _needed(group: str) -> tuple[str, ...]:
    return ("positive", "reason") if group == "requirements" else reader._REQUIRED.get(group, ("name",))


def _record(keys: tuple[str, ...], *required: str) -> Schema:
    """An object with these keys and no others."""
    found: Schema = {"type": "object", "properties": {key: _KEYS[key] for key in keys}, "additionalProperties": False}
    return found | ({"required": list(required)} if required else {})


def _node() -> Schema:
    """A node: what it may declare depends on its kind."""
    kinds = {kind: _element(kind) for kind in KINDS} | {"graph": _part()}
    return {
        "type": "object",
        "properties": {"id": _TEXT, "kind": {"enum": list(kinds)}},
        "required": ["id", "kind"],
        "allOf": [
            {"if": {"properties": {"kind": {"const": kind}}}, "then": described} for kind, described in kinds.items()
        ],
    }


def _part() -> Schema:
    """A graph as a part of another."""
    keys = tuple(key for key in reader._PART_KEYS if key not in ("kind", "ports"))
    found = _record(keys, "graph")
    found["properties"] |= {"kind": {}, "ports": {"type": "object", "additionalProperties": _TEXT}}
    return found


def _element(kind: str) -> Schema:
    """A junction or element."""
    extra = ("ports", "laws", "residuals", "form", "forms") if kind in MULTIPORTS else ()
    found = _record((*(key for key in reader._NODE_KEYS if key != "kind"), *extra))
    found["properties"] |= {"kind": {}, **dict.fromkeys(allowed_laws(kind, 1) if kind != "X" else (), _LAW)}
    if kind in MULTIPORTS:  # laws of numbered ports
        found["patternProperties"] = {"^(effort|flow|residual)[0-9]+$": _LAW}
    return found


def _domain() -> Schema:
    """A domain that is none of the known ones, described in full."""
    fields = {one.name: one for one in dataclasses.fields(Domain)}
    return {
        "type": "object",
        "properties": {name: _BOOLEAN if name == "pseudo" else _TEXT for name in fields},
        "required": [name for name, one in fields.items() if one.default is dataclasses.MISSING],
        "additionalProperties": False,
    }
