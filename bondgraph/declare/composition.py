"""Flattening: a graph with parts becomes one graph whose inner names carry the part's name and a dot."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, TypeVar

from sympy import Expr, Symbol

from bondgraph.declare.elements import Bond, Node
from bondgraph.declare.expressions import is_local, normalise, signal, signal_name, symbols_in
from bondgraph.declare.functions import TableFunction, table_function
from bondgraph.declare.handles import SubGraph
from bondgraph.declare.quantities import Integral, NamedSignal, Output, ParameterStart, Requirement, Start, symbol
from bondgraph.declare.starts import Initial, renamed_start, restarted, starts_of
from bondgraph.declare.store import GraphStore
from bondgraph.errors import DeclarationError

_Graph = TypeVar("_Graph", bound=GraphStore)


def flatten(graph: _Graph) -> _Graph:
    """The same machine without parts; a graph without parts is returned as it is.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> wheel = BondGraph("wheel")
    >>> hub = wheel.one_junction("hub")
    >>> _ = wheel.inertance("disc", wheel.parameter("J", 2.0, "kg m^2"), at=hub)
    >>> car = BondGraph("car")
    >>> _ = car.include("front", wheel, {"hub": "hub"})
    >>> flat = flatten(car)
    >>> list(flat.nodes), [p.name for p in flat.parameters]
    (['front.hub', 'front.disc'], ['front.J'])
    """
    if not graph.subgraphs:
        return graph
    flat = type(graph)(graph.name, graph.doc, graph.source)
    parts = {part.name: (part, flatten(part.graph)) for part in graph.subgraphs}

    def resolve(name: str) -> str:
        part_name, _, inner = name.partition(".")
        if not inner or part_name not in parts:
            return name
        part, inside = parts[part_name]
        inner = dict(part.ports).get(inner, inner)
        return f"{part_name}.{inner if inner in inside.nodes else _resolve_inside(part.graph, inner)}"

    outer = _Renaming(_outer_names(graph), resolve, {})
    for quantity in graph.quantities.values():
        flat._quantities[quantity.name] = outer.quantity(quantity)
    for part, inside in parts.values():
        _copy_part(flat, part, inside, outer)
    for node in graph.nodes.values():
        flat._nodes[node.name] = outer.node(node, node.name)
    flat._bonds += [Bond(resolve(bond.source), resolve(bond.target)) for bond in graph.bonds]
    own = [Requirement(outer.expression(r.positive), r.reason) for r in graph.requirements]
    flat._requirements += [requirement for requirement in own if requirement not in flat._requirements]
    for output in graph.outputs:
        flat._outputs[output.name] = dataclasses.replace(output, expression=outer.expression(output.expression))
    restarted(flat)
    return flat


def depth_of(graph: GraphStore) -> int:
    """How deep graphs stand inside each other: one where there are no parts."""
    return 1 + max((depth_of(part.graph) for part in graph.subgraphs), default=0)


def _resolve_inside(graph: GraphStore, name: str) -> str:
    part_name, _, inner = name.partition(".")
    for part in graph.subgraphs:
        if part.name == part_name:
            inner = dict(part.ports).get(inner, inner)
            return f"{part_name}.{_resolve_inside(part.graph, inner)}"
    return name


def _outer_names(graph: GraphStore) -> Callable[[str], str]:
    """What the outer graph's name of a quantity becomes: a shared one loses the name of its part."""
    shared = {part.name for part in graph.subgraphs if part.shared}

    def rename(name: str) -> str:
        part, dot, inner = name.partition(".")
        return inner if dot and part in shared else name

    return rename


def share(graph: GraphStore, quantities: dict[str, Any], quantity: Any, part: str) -> None:
    """Add a quantity of a part under its own name, where equal ones may meet.

    Raises
    ------
    DeclarationError
        If another quantity of the same name differs.
    """
    known = quantities.setdefault(quantity.name, quantity)
    if known != quantity:
        raise DeclarationError(
            f"{graph.name}: {part}: its {quantity.name} and another of the same name differ ({known} and {quantity}) - "
            "declare both alike, rename one, or bind it",
            where=(f"{part}.{quantity.name}",),
        )


def _copy_part(flat: _Graph, part: SubGraph[_Graph], inside: _Graph, outer: _Renaming) -> None:
    bound = {name: outer.expression(expression) for name, expression in part.bind}
    renaming = _inside(part.name, part.shared, tuple(bound.items()))
    for quantity in inside.quantities.values():
        if quantity.name not in bound:
            renamed = renaming.quantity(quantity)
            if part.shared:
                share(flat, flat._quantities, renamed, part.name)
            else:
                flat._quantities[renamed.name] = renamed
    for node in inside.nodes.values():
        name = f"{part.name}.{node.name}"
        flat._nodes[name] = renaming.node(node, name)
    flat._bonds += [Bond(f"{part.name}.{b.source}", f"{part.name}.{b.target}") for b in inside.bonds]
    for requirement in inside.requirements:
        renamed = Requirement(renaming.expression(requirement.positive), requirement.reason)
        if renamed not in flat._requirements:
            flat._requirements.append(renamed)
    for output in inside.outputs:
        name = renaming.quantity_name(output.name)
        flat._outputs[name] = dataclasses.replace(output, name=name, expression=renaming.expression(output.expression))


@functools.lru_cache(maxsize=256)
def _inside(part: str, shared: bool, bound: tuple[tuple[str, Expr], ...]) -> _Renaming:
    """The names of a part's inside; it is kept, for a machine is flattened again with every effect that is tried."""
    quantity_name = (lambda name: name) if shared else (lambda name: f"{part}.{name}")
    return _Renaming(quantity_name, lambda name: f"{part}.{name}", dict(bound))


class _Renaming:
    """New names for the quantities, nodes and tables that expressions mention."""

    def __init__(
        self, quantity_name: Callable[[str], str], node_name: Callable[[str], str], bound: dict[str, Expr]
    ) -> None:
        self.quantity_name, self.node_name, self.bound = quantity_name, node_name, bound
        self.expression = functools.lru_cache(maxsize=4096)(self._expression)

    def _symbol(self, used: Symbol) -> Expr:
        read = signal_name(used)
        if read is not None:
            return signal(read.variable, self.node_name(read.node), read.port)
        if used.name == "t" or is_local(used):
            return used
        return self.bound.get(used.name, symbol(self.quantity_name(used.name)))

    def _expression(self, expression: Expr) -> Expr:
        replaced = expression.xreplace({used: self._symbol(used) for used in symbols_in(expression)})
        tables = {
            used: table_function(self.quantity_name(used.table_name), len(used.args), used.derivative)
            for used in sorted(replaced.atoms(TableFunction), key=str)
        }
        for used, function in tables.items():
            replaced = replaced.replace(used.func, function)
        return normalise(replaced)

    def node(self, node: Node, name: str) -> Node:
        laws = tuple((given, self.expression(law)) for given, law in node.laws)
        if not node.starts:
            return dataclasses.replace(node, name=name, laws=laws)
        begun = [self._begun(name, value, start) for value, start in zip(node.initial, node.starts, strict=True)]
        values = tuple(one.value for one in begun)
        return dataclasses.replace(node, name=name, laws=laws, initial=values, starts=starts_of(begun))

    def _begun(self, name: str, value: float, start: Start | ParameterStart | None) -> Initial:
        return renamed_start(Initial(value, start), self.quantity_name, self.bound, self.expression, name)

    def quantity(self, quantity: Any) -> Any:
        name = self.quantity_name(quantity.name)
        if isinstance(quantity, Integral):
            begun = self._begun(name, quantity.initial, quantity.start)
            of = self.expression(quantity.of)
            return dataclasses.replace(quantity, name=name, of=of, initial=begun.value, start=begun.start)
        if isinstance(quantity, NamedSignal):
            guess = None if quantity.guess is None else self.expression(quantity.guess)
            return dataclasses.replace(
                quantity, name=name, expression=self.expression(quantity.expression), guess=guess
            )
        if isinstance(quantity, Output):
            return dataclasses.replace(quantity, name=name, expression=self.expression(quantity.expression))
        return dataclasses.replace(quantity, name=name)
