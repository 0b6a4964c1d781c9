"""Graphs in a few lines: nodes as ``"name kind law=..."``, bonds as ``"a->b b->c"``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import sympy
from sympy import Expr, Symbol

from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.quantities import symbol
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import check_closed, derive
from bondgraph.derive.equations import Assignment
from bondgraph.derive.explicit import explicit


def graph(
    nodes: Mapping[str, Any],
    bonds: str,
    parameters: Mapping[str, float] | None = None,
    inputs: str = "",
    **head: Any,
) -> BondGraph:
    """A graph from ``{"mass": ("I", {"flow": "momentum/m"}), "v": "1"}``, bonds and parameter values."""
    records = []
    for name, given in nodes.items():
        kind, laws = (given, {}) if isinstance(given, str) else given
        records.append({"id": name, "kind": kind, **laws})
    ends = [dict(zip(("source", "target"), bond.split("->"), strict=True)) for bond in bonds.split()]
    head["parameters"] = [{"name": name, "value": value} for name, value in (parameters or {}).items()]
    head["inputs"] = [{"name": name} for name in inputs.split()]
    return graph_from_json({"graph": {"name": "g", **head}, "nodes": records, "bonds": ends})


def mass(m: str = "m") -> tuple[str, dict[str, Any]]:
    return "I", {"flow": f"momentum/{m}"}


def spring(k: str = "k") -> tuple[str, dict[str, Any]]:
    return "C", {"effort": f"{k}*displacement"}


def damper(b: str = "b") -> tuple[str, dict[str, Any]]:
    return "R", {"effort": f"{b}*flow"}


def force(u: str = "u") -> tuple[str, dict[str, Any]]:
    return "Se", {"effort": u}


def speed(u: str = "u") -> tuple[str, dict[str, Any]]:
    return "Sf", {"flow": u}


def derivatives(g: BondGraph, independent: Sequence[str] = ()) -> dict[str, Expr]:
    """State derivatives in states, inputs and parameters alone."""
    equations = derive(assign_causality(g, independent))
    check_closed(equations)
    return {state.name: value for state, value in explicit(equations).derivatives}


def outputs(g: BondGraph) -> dict[str, Expr]:
    return {output.name: value for output, value in explicit(derive(assign_causality(g))).outputs}


def same(found: Mapping[str, Expr], **expected: str) -> bool:
    """Whether expressions are the expected ones, and no others."""
    names = {used.name for value in found.values() for used in value.free_symbols}
    scope: dict[str, Symbol] = {name: symbol(name) for name in names}
    assert list(found) == list(expected), list(found)
    for name, text in expected.items():
        value = sympy.sympify(text, locals=scope)
        value = value.xreplace({used: symbol(used.name) for used in value.free_symbols})
        assert sympy.simplify(found[name] - value) == 0, f"{name}: {found[name]} is not {value}"
    return True


def assigned(g: BondGraph) -> list[str]:
    """Names of the intermediate results."""
    return [step.symbol.name for step in derive(assign_causality(g)).assignments if isinstance(step, Assignment)]
