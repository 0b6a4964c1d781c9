"""Units of declared laws: each must be homogeneous as declared, so that a wrong unit is found with its element."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence

from sympy import Expr, Symbol

from bondgraph.declare.dimensions import SECOND, DimensionReader, Known, MismatchError, of_unit, subtract
from bondgraph.declare.domains import Domain
from bondgraph.declare.elements import ENERGY_VARIABLE, TWO_PORTS, Node
from bondgraph.declare.expressions import signal_name, symbols_in, tables_in, to_text
from bondgraph.declare.modal_laws import MODAL_LAWS, modal_dimension
from bondgraph.declare.quantities import Input, Integral, NamedSignal, Parameter, Table, symbol
from bondgraph.declare.store import GraphStore
from bondgraph.errors import DimensionError
from bondgraph.units import Dimension, dimension_text

_VARIABLES = ("effort", "flow", "displacement", "momentum")


def check_law_units(graph: GraphStore, domains: dict[str, Domain | None]) -> None:
    """Raise DimensionError unless every law, signal, integral and output of a flat graph is homogeneous.

    Parameters
    ----------
    graph
        A flat, valid graph.
    domains
        The domain of every node, as :func:`bondgraph.declare.validation.node_domains` finds it.
    """
    _LawUnits(graph, domains).run()


class _LawUnits:
    def __init__(self, graph: GraphStore, domains: dict[str, Domain | None]) -> None:
        self.graph, self.domains = graph, domains
        self.incidence = graph.incidence()
        self.tables = {table.name: table for table in graph.tables}
        self.known: dict[Symbol, Known] = {symbol("t"): SECOND}
        quantities: list[Input | Parameter | Integral | NamedSignal] = [
            *graph.inputs, *graph.parameters, *graph.integrals, *graph.signals
        ]  # fmt: skip
        self.known |= {symbol(quantity.name): of_unit(quantity.unit) for quantity in quantities}
        constants: list[Input | Parameter] = [*graph.inputs, *graph.parameters]
        self.declared = {quantity.symbol for quantity in constants if quantity.unit}

    def run(self) -> None:
        for node in self.graph.nodes.values():
            if node.laws:
                self._node(node)
        for named in self.graph.signals:
            if named.guess is None:
                self._require(named.name, named.name, of_unit(named.unit), named.expression, {})
            else:
                self._require(named.name, f"the residual of {named.name}", None, named.expression, {})
                self._require(named.name, f"the guess of {named.name}", of_unit(named.unit), named.guess, {})
        for integral in self.graph.integrals:
            unit = of_unit(integral.unit)
            rate = None if unit is None else subtract(unit, SECOND)
            self._require(integral.name, f"the rate of {integral.name}", rate, integral.of, {})
        for output in self.graph.outputs:
            self._require(output.name, f"output {output.name}", of_unit(output.unit), output.expression, {})

    def _node(self, node: Node) -> None:
        domains = self._port_domains(node)
        own: dict[Symbol, Known] = {}
        for port, domain in enumerate(domains, start=1):
            for variable in _VARIABLES:
                name = f"{variable}{port if node.is_field or node.kind in TWO_PORTS else ''}"
                own[symbol(name)] = _variable_dimension(domain, variable)
        for given, law in node.laws:
            needed = self._needed(node, given, own, domains)
            self._require(node.name, given.rpartition(".")[2], needed, law, own)

    def _needed(self, node: Node, given: str, own: dict[Symbol, Known], domains: Sequence[Domain | None]) -> Known:
        if given == "modulus":
            return self._modulus(node)
        if given == "energy":
            return _energy(node, domains)
        if given in MODAL_LAWS:
            effort, flow, displacement = (own[symbol(name)] for name in _VARIABLES[:3])
            return modal_dimension(given, node.law("gap") is not None, effort, flow, displacement)
        return own.get(symbol(given.rpartition(".")[2]))

    def _port_domains(self, node: Node) -> list[Domain | None]:
        found = []
        for bond, inward in self.incidence[node.name]:
            ends = self.graph.bonds[bond]
            found.append(self.domains[node.name] or self.domains[ends.source if inward else ends.target])
        return found

    def _modulus(self, node: Node) -> Known:
        """effort_in/effort_out of a TF, effort_in/flow_out of a GY."""
        ends = zip(self.incidence[node.name], self._port_domains(node), strict=True)
        into, out = (domain for _, domain in sorted(ends, key=lambda end: not end[0][1]))
        above = _variable_dimension(into, "effort")
        below = _variable_dimension(out, "effort" if node.kind == "TF" else "flow")
        return None if above is None or below is None else subtract(above, below)

    def _require(self, where: str, name: str, needed: Known, law: Expr, own: dict[Symbol, Known]) -> None:
        used = symbols_in(law)
        declared = frozenset(one for one in used if one in self.declared)
        if not declared:
            return  # bare numbers beside variables may carry units of their own
        known = tuple((one, self._known(one, own)) for one in used)
        tables = tuple(self.tables[name] for name in tables_in(law))
        try:
            found = _dimension(law, known, declared, tables)
        except MismatchError as mismatch:
            raise DimensionError(
                f"{self.graph.name}: {where}: {mismatch} - correct the law or its units", where=(where,)
            ) from None
        if needed is not None and found is not None and found != needed:
            raise DimensionError(
                f"{self.graph.name}: {where}: {name} must be {dimension_text(needed)} but {to_text(law)} is "
                f"{dimension_text(found)} - correct the law or its units{_reciprocal(needed, found, law, own)}",
                where=(where,),
            )

    def _known(self, used: Symbol, own: Mapping[Symbol, Known]) -> Known:
        read = signal_name(used)
        if read is None:
            return own[used] if used in own else self.known.get(used)
        node = self.graph.nodes[read.node]
        domains = self._port_domains(node) if not node.is_junction else [self.domains[node.name]]
        number = max(read.port, 1)
        return _variable_dimension(domains[number - 1], read.variable) if number <= len(domains) else None


@functools.lru_cache(maxsize=4096)
def _dimension(
    law: Expr, known: tuple[tuple[Symbol, Known], ...], declared: frozenset[Symbol], tables: tuple[Table, ...]
) -> Known:
    """The dimension of a law; kept, for most laws of a machine are those of before when an effect is added to it."""
    return DimensionReader(dict(known), set(declared), {table.name: table for table in tables}).of(law)


def _reciprocal(needed: Dimension, found: Dimension, law: Expr, own: Mapping[Symbol, Known]) -> str:
    """A hint where the reciprocal of a coefficient fits: a capacity for a stiffness, a conductance, an area."""
    variables = [one for one in symbols_in(law) if one in own]
    one = variables[0] if len(variables) == 1 else None
    by = of_unit("1") if not variables else one and own[one]
    coefficient = law if one is None else law.coeff(one)
    if by is None or (one is not None and law != coefficient * one) or coefficient.is_zero:
        return ""
    fits = subtract(found, by) == subtract(by, needed)
    return f"; the reciprocal would fit: {to_text(1 / coefficient)}" if fits else ""


def _variable_dimension(domain: Domain | None, variable: str) -> Known:
    return None if domain is None else of_unit(getattr(domain, f"{variable}_unit"))


def _energy(node: Node, domains: Sequence[Domain | None]) -> Known:
    for domain in domains:
        if domain is not None:
            power = _variable_dimension(domain, "effort" if node.kind == "C" else "flow")
            stored = _variable_dimension(domain, ENERGY_VARIABLE[node.kind])
            if power is not None and stored is not None:
                return tuple(a + b for a, b in zip(power, stored, strict=True))
    return None
