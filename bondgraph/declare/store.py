"""What a graph under construction holds, and the checks of every line that adds to it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Self

from sympy import Expr, Symbol

from bondgraph.declare.elements import STORAGES, Bond, Node, check_node, foreign_locals, own_variables
from bondgraph.declare.expressions import is_local, signal_name, symbols_in, tables_in
from bondgraph.declare.handles import At, Handle, SubGraph
from bondgraph.declare.laws import as_expression
from bondgraph.declare.limits import NoValueError, check_numbers, unreal_part
from bondgraph.declare.other_names import node_hint
from bondgraph.declare.quantities import Input, Integral, NamedSignal, Output, Parameter, Requirement, Table, symbol
from bondgraph.declare.quantity_checks import check_quantity
from bondgraph.errors import DeclarationError, suggest
from bondgraph.files import check_name

Quantity = Input | Parameter | Table | Integral | NamedSignal


class GraphStore:
    """Nodes, bonds, quantities, outputs and parts in order of declaration."""

    def __init__(self, name: str, doc: str | None = "", source: str = "") -> None:
        check_name(name, lambda problem: DeclarationError(f"graph: {problem}", where=(name,)))
        self.name = name
        self.doc = (doc or "").strip()
        self.source = source
        self._nodes: dict[str, Node] = {}
        self._bonds: list[Bond] = []
        self._quantities: dict[str, Quantity] = {}
        self._outputs: dict[str, Output] = {}
        self._requirements: list[Requirement] = []
        self._subgraphs: dict[str, SubGraph[Self]] = {}

    # ------------------------------------------------------------------ what has been declared

    @property
    def nodes(self) -> Mapping[str, Node]:
        """Junctions and elements by name, in order of declaration."""
        return self._nodes

    @property
    def bonds(self) -> tuple[Bond, ...]:
        """Bonds in order of declaration."""
        return tuple(self._bonds)

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """Inputs, parameters, tables, integrals and named signals by name, in order of declaration."""
        return self._quantities

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Declared inputs."""
        return tuple(q for q in self._quantities.values() if isinstance(q, Input))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Declared parameters."""
        return tuple(q for q in self._quantities.values() if isinstance(q, Parameter))

    @property
    def tables(self) -> tuple[Table, ...]:
        """Declared tables."""
        return tuple(q for q in self._quantities.values() if isinstance(q, Table))

    @property
    def integrals(self) -> tuple[Integral, ...]:
        """Extra states that integrate an expression."""
        return tuple(q for q in self._quantities.values() if isinstance(q, Integral))

    @property
    def signals(self) -> tuple[NamedSignal, ...]:
        """Named expressions."""
        return tuple(q for q in self._quantities.values() if isinstance(q, NamedSignal))

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Measured quantities in order of declaration."""
        return tuple(self._outputs.values())

    @property
    def requirements(self) -> tuple[Requirement, ...]:
        """What must be positive for the machine to be possible."""
        return tuple(self._requirements)

    @property
    def subgraphs(self) -> tuple[SubGraph[Self], ...]:
        """Parts that are graphs themselves."""
        return tuple(self._subgraphs.values())

    def incidence(self) -> dict[str, list[tuple[int, bool]]]:
        """The bonds of every node: index of the bond, and whether it points to the node."""
        bonds: dict[str, list[tuple[int, bool]]] = {name: [] for name in self._nodes}
        for index, bond in enumerate(self._bonds):
            for end, inward in ((bond.source, False), (bond.target, True)):
                if end in bonds:
                    bonds[end].append((index, inward))
        return bonds

    def __eq__(self, other: object) -> bool:
        """Whether both declare the same graph (where it was declared does not matter)."""
        return isinstance(other, GraphStore) and self._value() == other._value()

    __hash__ = None  # type: ignore[assignment]  # it grows

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}: {len(self._nodes)} nodes, {len(self._bonds)} bonds)"

    def _value(self) -> tuple[Any, ...]:
        quantities = (self.inputs, self.parameters, self.tables, self.integrals, self.signals)
        rest = (quantities, self.outputs, self.subgraphs, self.requirements)
        return (self.name, self.doc, tuple(self._nodes.values()), self.bonds, *rest)

    # ------------------------------------------------------------------ adding

    def add_node(self, node: Node) -> Handle:
        """Add a node given as a value (what the methods that declare elements end in)."""
        check_node(node, self.name)
        if node.name in self._nodes or node.name in self._subgraphs:
            raise DeclarationError(f"{self.name}: node {node.name} is declared twice - use another name", (node.name,))
        if not all(math.isfinite(value) for value in node.initial):
            raise DeclarationError(f"{self.name}: {node.name}: initial {node.initial} must be finite", (node.name,))
        if any(node.starts) and node.kind not in STORAGES:
            raise DeclarationError(
                f"{self.name}: {node.name}: initial {node.starts[0]}: only a storage starts at a signal or at "
                "parameters - give a number",
                where=(node.name,),
            )
        for given, law in node.laws:
            checked = self._checked(law, own_variables(node, given) or (), node.name)
            self._check_real(checked, node.name)
            if given == "modulus" and checked.is_zero:
                raise DeclarationError(
                    f"{self.name}: {node.name}: a modulus of zero passes no power - remove the {node.kind}",
                    (node.name,),
                )
        self._nodes[node.name] = node
        return Handle(node.name, node.kind, node.domain)

    def bond(self, source: At, target: At | None = None) -> Bond:
        """Bond two nodes; positive power flows from ``source`` to ``target``."""
        if target is None:
            raise DeclarationError(
                f"{self.name}: bond {source}: give both nodes, such as bond('air', 'room')", where=(f"bond {source}",)
            )
        ends = [end.name if isinstance(end, Handle) else end for end in (source, target)]
        for end in ends:
            if end not in self._nodes and not self._is_port(end):
                known = [*self._nodes, *(f"{part.name}.{port}" for part in self.subgraphs for port, _ in part.ports)]
                raise DeclarationError(
                    f"{self.name}: bond {ends[0]} -> {ends[1]}: node {end!r} is not declared{node_hint(end, known)}",
                    where=(f"bond {ends[0]} -> {ends[1]}",),
                )
        if ends[0] == ends[1]:
            raise DeclarationError(
                f"{self.name}: bond {ends[0]} -> {ends[1]} joins a node with itself - bond two different nodes",
                where=(f"bond {ends[0]} -> {ends[1]}",),
            )
        bond = Bond(ends[0], ends[1])
        self._bonds.append(bond)
        return bond

    def has_node(self, name: str) -> bool:
        """Whether a node of that (possibly dotted) name exists here or in a part."""
        return name in self._nodes or self._is_port(name)

    def _is_port(self, end: str) -> bool:
        part, _, port = end.partition(".")
        if part not in self._subgraphs:
            return False
        subgraph = self._subgraphs[part]
        return port in dict(subgraph.ports) or subgraph.graph.has_node(port)

    def _declare(self, quantity: Quantity) -> Symbol:
        check_quantity(quantity, self.name)
        if quantity.name in self._quantities:
            raise DeclarationError(
                f"{self.name}: {quantity.name} is declared twice - use another name", where=(quantity.name,)
            )
        for law in (getattr(quantity, "of", None), getattr(quantity, "expression", None)):
            if law is not None:
                self._check_numbers(law, quantity.name)
                self._check_real(law, quantity.name)
        self._quantities[quantity.name] = quantity
        return symbol(quantity.name)

    # ------------------------------------------------------------------ checks of expressions

    def _checked(self, expression: Any, own: tuple[str, ...], where: str, also: Symbol | None = None) -> Expr:
        """The normalised expression, if it uses only declared names, signals and the element's own variables."""
        result = as_expression(expression, f"{self.name}: {where}")
        self._check_value(result, where)
        symbols = sorted(result.free_symbols, key=lambda s: str(s.name))
        foreign = foreign_locals([s for s in symbols if is_local(s)], own)
        if foreign:
            allowed = ", ".join(own) or "none of its own variables"
            raise DeclarationError(
                f"{self.name}: {where}: the law uses {foreign[0]!r} but may use {allowed}", where=(where,)
            )
        for used in symbols:
            if used.name in self._quantities or used in (also, symbol("t")) or is_local(used) or signal_name(used):
                continue
            if self._is_inner_quantity(used.name):
                continue
            raise DeclarationError(
                f"{self.name}: {where}: {used.name!r} is not declared{suggest(used.name, self._quantities)} - "
                "declare it as a parameter, input or signal first",
                where=(where,),
            )
        for name in tables_in(result):
            if not isinstance(self._quantities.get(name), Table):
                raise DeclarationError(
                    f"{self.name}: {where}: table {name!r} is not declared in this graph", where=(where,)
                )
        return result

    def _check_value(self, result: Any, where: str) -> None:
        if not isinstance(result, Expr):
            raise DeclarationError(
                f"{self.name}: {where}: {result} is a condition, not a value - "
                "write Piecewise((value, condition), ...)",
                where=(where,),
            )
        self._check_numbers(result, where)
        for used in symbols_in(result):
            if isinstance(self._quantities.get(used.name), Table):
                raise DeclarationError(
                    f"{self.name}: {where}: {used.name} is a table - write {used.name}(argument)", where=(where,)
                )

    def _check_numbers(self, law: Expr, where: str) -> None:
        try:
            check_numbers(law)
        except (NoValueError, OverflowError) as error:
            raise DeclarationError(
                f"{self.name}: {where}: the law has no finite real value ({error} in {law}) - check divisions by "
                "zero and roots of negative numbers",
                where=(where,),
            ) from None

    def _check_real(self, law: Expr, where: str) -> None:
        """Refuse a root or logarithm that is not real at the declared parameters."""
        unreal = unreal_part(law, {quantity.symbol: quantity.value for quantity in self.parameters})
        if unreal is not None:
            raise DeclarationError(
                f"{self.name}: {where}: {unreal} has no real value at the declared parameters - correct its sign or "
                "their values",
                where=(where,),
            )

    def _is_inner_quantity(self, name: str) -> bool:
        if any(part.shared and part.graph._has_quantity(name) for part in self.subgraphs):
            return True
        part, _, inner = name.partition(".")
        return part in self._subgraphs and self._subgraphs[part].graph._has_quantity(inner)

    def _has_quantity(self, name: str) -> bool:
        return name in self._quantities or self._is_inner_quantity(name)
