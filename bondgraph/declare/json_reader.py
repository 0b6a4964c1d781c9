"""A graph from the node-link JSON object of a graph file."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

from bondgraph.declare.domains import Domain, domain_named
from bondgraph.declare.elements import KINDS, LAW_GIVES, Node, allowed_laws, numbered
from bondgraph.declare.expressions import parse, signal, signal_name
from bondgraph.declare.functions import table_function
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.limits import MOST_PORTS, check_nesting
from bondgraph.declare.quantities import Interpolation, symbol
from bondgraph.declare.quantity_checks import is_free_name
from bondgraph.declare.records import check_keys, count, items, mapping, number, numbers, shown, text
from bondgraph.declare.starts import Initial, starts_of
from bondgraph.errors import DeclarationError, suggest

FORMAT = "bondgraph/1"

_TOP_KEYS = ("directed", "multigraph", "graph", "nodes", "bonds")
_HEAD_KEYS = (
    "format",
    "name",
    "doc",
    "inputs",
    "parameters",
    "tables",
    "integrals",
    "signals",
    "outputs",
    "requirements",
)
_QUANTITY_KEYS = {
    "inputs": ("name", "unit", "meaning", "default", "interpolation", "letters"),
    "parameters": ("name", "value", "unit", "meaning", "bounds", "tolerance"),
    "integrals": ("name", "of", "unit", "meaning", "initial"),
    "signals": ("name", "is", "residual", "guess", "unit", "meaning"),
    "outputs": ("name", "variable", "at", "is", "unit", "meaning"),
}
_REQUIRED = {"parameters": ("name", "value"), "integrals": ("name", "of")}
_TABLE_KEYS = ("x", "y", "values", "unit", "argument_units", "meaning")
_NODE_KEYS = ("id", "kind", "domain", "initial", "state", "doc")
_PART_KEYS = ("id", "kind", "graph", "ports", "bind", "shared")
_BOND_KEYS = ("source", "target", "key")


def graph_from_json(data: Mapping[str, Any], where: str = "graph") -> BondGraph:
    """The graph of a node-link JSON object.

    Raises
    ------
    DeclarationError
        If a key is unknown or missing, a value has the wrong type, or the graph declares something impossible.
    """
    check_nesting(data, where)
    check_keys(data, _TOP_KEYS, where)
    head = check_keys(data.get("graph", {}), _HEAD_KEYS, f"{where}: graph")
    if head.get("format", FORMAT) != FORMAT:
        raise DeclarationError(f"{where}: format {shown(head['format'])} is not {FORMAT!r}", where=("format",))
    if data.get("directed", True) is not True or data.get("multigraph", True) is not True:
        raise DeclarationError(f"{where}: must be a directed multigraph", where=("directed", "multigraph"))
    return _Reader(head, items(data, "nodes", where), items(data, "bonds", where), where).graph


class _Reader:
    """Declares everything a file holds, in the order in which one thing may use another."""

    def __init__(self, head: Mapping[str, Any], nodes: list[Any], bonds: list[Any], where: str) -> None:
        self.head, self.where = head, where
        self.graph = BondGraph(text(head, "name", where) or Path(where).stem, text(head, "doc", where))
        for index, record in enumerate(nodes):
            if not isinstance(record, Mapping) or not isinstance(record.get("id"), str):
                raise DeclarationError(
                    f"{where}: node {index} {shown(record)} must be an object with an id", where=("nodes",)
                )
        self.parts = [record for record in nodes if record.get("kind") == "graph"]
        for record in self.parts:
            self._part(record)
        self.names = self._declared_names()
        self._quantities()
        for record in self.parts:
            self._bind(record)
        for record in nodes:
            if record.get("kind") != "graph":
                self.graph.add_node(self._node(record))
        for record in bonds:
            check_keys(record, _BOND_KEYS, f"{where}: bond", required=("source", "target"))
            self.graph.bond(text(record, "source", f"{where}: bond"), text(record, "target", f"{where}: bond"))
        for record in self._records("outputs"):
            self._output(record)
        for record in items(head, "requirements", where):
            check_keys(record, ("positive", "reason"), f"{where}: requirements", required=("positive", "reason"))
            reason = text(record, "reason", f"{where}: requirements")
            self.graph.require(parse(record["positive"], self.names, "requirement"), reason)

    # ------------------------------------------------------------------ quantities

    def _records(self, group: str) -> list[Mapping[str, Any]]:
        where = f"{self.where}: {group}"
        required = _REQUIRED.get(group, ("name",))
        records = [check_keys(r, _QUANTITY_KEYS[group], where, required) for r in items(self.head, group, self.where)]
        for record in records:
            for key in ("name", "unit", "meaning"):
                text(record, key, where)
        return records

    def _declared_names(self) -> dict[str, Any]:
        """What each name stands for in expressions."""
        names: dict[str, Any] = {"t": symbol("t")}
        for group in ("inputs", "parameters", "integrals", "signals"):
            names |= {record["name"]: symbol(record["name"]) for record in self._records(group)}
        for name, record in mapping(self.head, "tables", self.where).items():
            check_keys(record, _TABLE_KEYS, f"{self.where}: table {name}", required=("x", "values"))
            if not is_free_name(name):
                raise DeclarationError(
                    f"{self.where}: table {name!r}: use letters, digits and underscores, and no reserved name",
                    where=(name,),
                )
            names[name] = table_function(name, 2 if record.get("y") else 1)
        shared = {record["id"] for record in self.parts if record.get("shared")}
        for part in self.graph.subgraphs:
            inner = part.graph.flatten().quantities
            names |= {f"{part.name}.{name}": symbol(f"{part.name}.{name}") for name in inner}
            names |= {name: symbol(name) for name in inner} if part.name in shared else {}
        return names

    def _quantities(self) -> None:
        for record in self._records("inputs"):
            self._input(record)
        for record in self._records("parameters"):
            self._parameter(record)
        for name, record in mapping(self.head, "tables", self.where).items():
            self._table(name, record)
        for record in self._records("signals"):
            self._signal(record)
        for record in self._records("integrals"):
            expression = parse(record["of"], self.names, record["name"])
            begun = _initial(record.get("initial", 0.0), record["name"])
            self.graph._declare_integral(record["name"], expression, *_unit_and_meaning(record), begun)

    def _signal(self, record: Mapping[str, Any]) -> None:
        name = record["name"]
        law = "residual" if "residual" in record else "is"
        allowed = (law, "name", "unit", "meaning", *(("guess",) if law == "residual" else ()))
        check_keys(record, allowed, f"{self.where}: signal {name}", required=(law,))
        expression = parse(record[law], self.names, name)
        guess = parse(record.get("guess", "0"), self.names, f"{name}: guess") if law == "residual" else None
        self.graph._declare_signal(name, expression, *_unit_and_meaning(record), guess)

    def _input(self, record: Mapping[str, Any]) -> None:
        name, between = record["name"], record.get("interpolation")
        if between is not None and between not in get_args(Interpolation):
            problem = f"interpolation {shown(between)} - use {', '.join(get_args(Interpolation))}"
            raise DeclarationError(f"{self.where}: {name}: {problem}", where=(name,))
        letters = mapping(record, "letters", f"{self.where}: {name}")
        self.graph.input(
            name,
            *_unit_and_meaning(record),
            default=None if record.get("default") is None else number(record["default"], name),
            between=None if between == "linear" else between,
            letters={letter: number(value, f"{name}: letter {letter}") for letter, value in letters.items()},
        )

    def _parameter(self, record: Mapping[str, Any]) -> None:
        name, bounds, tolerance = record["name"], record.get("bounds"), record.get("tolerance")
        limits = None
        if bounds is not None:
            pair = numbers(bounds, f"{name}: bounds")
            if len(pair) != 2:
                raise DeclarationError(f"{self.where}: {name}: bounds {bounds} must be two numbers", where=(name,))
            limits = (pair[0], pair[1])
        share = None if tolerance is None else number(tolerance, f"{name}: tolerance")
        self.graph.parameter(name, number(record["value"], name), *_unit_and_meaning(record), limits, share)

    def _table(self, name: str, record: Mapping[str, Any]) -> None:
        where = f"table {name}"
        rows = items(record, "values", where)
        values = [numbers(row, where) for row in rows] if record.get("y") else numbers(rows, where)
        units = tuple(str(unit) for unit in items(record, "argument_units", where))
        x, y = numbers(record["x"], where), numbers(record.get("y", []), where)
        unit, meaning = text(record, "unit", where), text(record, "meaning", where)
        self.graph.table(name, x, values, unit, units, y=y, meaning=meaning)

    # ------------------------------------------------------------------ nodes, parts, outputs

    def _node(self, record: Mapping[str, Any]) -> Node:
        name, kind = record["id"], record.get("kind")
        here = f"{self.where}: {name}"
        if kind not in KINDS:
            raise DeclarationError(
                f"{here}: kind {shown(kind)} is not known{suggest(str(kind), KINDS)} - use one of {' '.join(KINDS)}",
                where=(name,),
            )
        ports = count(record, "ports", here, MOST_PORTS)
        known = allowed_laws(kind, ports) if kind != "X" else {}
        extra = ("ports", "laws", "residuals", "form", "forms") if kind in ("C", "I", "R", "X") else ()
        check_keys(record, (*known, *_NODE_KEYS, *extra), here)
        scope = {**self.names, **_locals(kind, ports)}
        laws = tuple((key, parse(record[key], scope, name)) for key in known if key in record)
        laws += tuple((given, parse(law, scope, name)) for given, law in _listed_laws(record, kind, ports, here))
        begun = [self.graph._initial(name, one) for one in _initials(record, ports, here)]
        if not begun and kind in LAW_GIVES and ports == 1:
            begun = [Initial(0.0)]
        domain = _domain(record["domain"], here) if "domain" in record else None
        return Node(
            name, kind, domain, laws, ports, tuple(one.value for one in begun), text(record, "state", here),
            text(record, "doc", here), starts_of(begun),
        )  # fmt: skip

    def _part(self, record: Mapping[str, Any]) -> None:
        here = f"{self.where}: {record['id']}"
        check_keys(record, _PART_KEYS, here, required=("graph",))
        ports = {port: str(inner) for port, inner in mapping(record, "ports", here).items()}
        if not isinstance(record.get("shared", False), bool):
            raise DeclarationError(f"{here}: shared must be true or false", where=(record["id"],))
        self.graph.include(record["id"], graph_from_json(record["graph"], here), ports)

    def _bind(self, record: Mapping[str, Any]) -> None:
        bound, shared = mapping(record, "bind", f"{self.where}: {record['id']}"), record.get("shared", False)
        if bound or shared:
            order = list(self.graph._subgraphs)
            part = self.graph._subgraphs.pop(record["id"])
            expressions = {key: parse(law, self.names, f"{part.name}.{key}") for key, law in bound.items()}
            self.graph.include(part.name, part.graph, dict(part.ports), expressions, shared=shared)
            self.graph._subgraphs = {name: self.graph._subgraphs[name] for name in order}

    def _output(self, record: Mapping[str, Any]) -> None:
        name = record["name"]
        if "is" in record:
            self.graph.measure(name, parse(record["is"], self.names, name), *_unit_and_meaning(record))
            return
        where = f"{self.where}: output {name}"
        check_keys(record, _QUANTITY_KEYS["outputs"], where, required=("variable", "at"))
        variable, at = text(record, "variable", where), text(record, "at", where)
        stem = variable.rstrip("0123456789")
        if signal_name(signal(stem, "node")) is None:
            raise DeclarationError(
                f"{where}: variable {variable!r} - use effort, flow, displacement or momentum", where=(name,)
            )
        port = int(variable[len(stem) :] or 0)
        self.graph._measure_variable(name, stem, at, text(record, "meaning", where), record.get("unit"), port)


def _initials(record: Mapping[str, Any], ports: int, where: str) -> list[Any]:
    """The start values of a node: one, or a list with one per port of a multiport."""
    given = record.get("initial")
    if given is None:
        return []
    listed = given if isinstance(given, list) and not _is_start(given, ports) else [given]
    return [_initial(one, where) for one in listed]


def _is_start(given: list[Any], ports: int) -> bool:
    """Whether a list is one start, a signal and a number, not one start per port."""
    return ports == 1 and len(given) == 2 and isinstance(given[0], str)


def _initial(given: Any, where: str) -> Any:
    """A start value: a number, the name of a signal or a multiple of it, or both as a pair."""
    if isinstance(given, str):
        return given
    if isinstance(given, list) and _is_start(given, 1):
        return (given[0], number(given[1], where))
    return number(given, where)


def _domain(value: Any, where: str) -> Domain:
    """A domain by its name, or described in full where it is none of the known ones."""
    if isinstance(value, str):
        return domain_named(value)
    fields = {field.name: field.default for field in dataclasses.fields(Domain)}
    check_keys(value, tuple(fields), f"{where}: domain", [n for n, d in fields.items() if d is dataclasses.MISSING])
    texts = {name: text(value, name, f"{where}: domain") for name in fields if name != "pseudo"}
    pseudo = value.get("pseudo", False)
    if not isinstance(pseudo, bool):
        raise DeclarationError(f"{where}: domain: pseudo must be true or false but is {pseudo!r}", where=(where,))
    return Domain(**texts, pseudo=pseudo)


def _unit_and_meaning(record: Mapping[str, Any]) -> tuple[str, str]:
    return record.get("unit", ""), record.get("meaning", "")


@functools.cache
def _locals(kind: str, ports: int) -> dict[str, Any]:
    """An element's own variables."""
    if kind == "X":
        own = {*numbered("effort", ports), *numbered("flow", ports)}
    else:
        own = {name for given in allowed_laws(kind, ports).values() for name in given}
    return {name: symbol(name) for name in sorted(own)}


def _listed_laws(record: Mapping[str, Any], kind: str, ports: int, where: str) -> list[tuple[str, Any]]:
    """Laws given as lists, one for each port, or as the forms of an X."""
    pairs: list[tuple[str, Any]] = []
    for index, form in enumerate(items(record, "forms", where), start=1):
        if not isinstance(form, Mapping):
            raise DeclarationError(f"{where}: a form must be an object but is {shown(form)}", where=(where,))
        pairs += [(f"{index}.{given}", law) for given, law in form.items()]
    stem = LAW_GIVES.get(kind) or record.get("form", "effort")
    if stem not in ("effort", "flow"):
        raise DeclarationError(f"{where}: form {stem!r} - use effort or flow", where=(where,))
    for key, given in (("laws", stem), ("residuals", "residual")):
        laws = items(record, key, where)
        pairs += zip(numbered(given, len(laws)) if ports > 1 else [given] * len(laws), laws, strict=True)
    return pairs
