"""Angular speeds: a bare number per time is refused where one is computed, since turns and radians look alike there.

The SI writes both as 1/s, so dimensions cannot tell 3000 1/min of a shaft from 3000 rad/min. An expression counts as an
angular speed where it is the flow of a rotation, or a quantity declared in rad/s, rpm or deg/s, times whole numbers or
their ratios. A factor of pi, a decimal number, or a parameter without dimension (the pulses of a counter per radian)
may be the conversion itself, and nothing is said of such a product.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import sympy
from sympy import Add, Expr, Mul, Piecewise, Pow, Symbol
from sympy.core.relational import Relational

from bondgraph.coherent import Displayed
from bondgraph.declare.domains import Domain
from bondgraph.declare.elements import TWO_PORTS, Node
from bondgraph.declare.expressions import signal_name, to_text
from bondgraph.declare.functions import TableFunction, delay, maximum, minimum, switch
from bondgraph.declare.quantities import Input, Integral, NamedSignal, Parameter, symbol
from bondgraph.declare.store import GraphStore
from bondgraph.errors import DimensionError
from bondgraph.units import ANGULAR_UNITS, DIMENSIONLESS, dimension, is_angular_rate, is_bare_rate

_ANGULAR, _BARE, _PURE = "angular", "bare", "pure"

#: Laws that give a flow, or are compared with one.
_FLOWS = ("flow", "width")


def check_angular_speeds(graph: GraphStore, domains: Mapping[str, Domain | None]) -> None:
    """Raise DimensionError where a bare number per time stands for an angular speed, or beside one.

    Parameters
    ----------
    graph
        A flat, valid graph.
    domains
        The domain of every node.
    """
    _AngularSpeeds(graph, domains).run()


class _AngularSpeeds:
    def __init__(self, graph: GraphStore, domains: Mapping[str, Domain | None]) -> None:
        self.graph, self.domains = graph, domains
        self.incidence = graph.incidence()
        self.tables = {table.name: table for table in graph.tables}
        listed: list[Input | Parameter | Integral | NamedSignal] = [
            *graph.inputs, *graph.parameters, *graph.integrals, *graph.signals
        ]  # fmt: skip
        self.quantities = {symbol(one.name): one for one in listed}
        self.any_bare = any(is_bare_rate(one.unit) for one in (*self.quantities.values(), *graph.outputs)) or any(
            is_bare_rate(unit) for table in graph.tables for unit in (table.unit, *table.argument_units)
        )

    def run(self) -> None:
        if not self.any_bare:
            return
        for node in self.graph.nodes.values():
            own = self._own(node)
            for given, law in node.laws:
                kind = own.get(symbol(given.rpartition(".")[2])) if given != "width" else own.get(symbol("flow"))
                self._check(node.name, kind if given.rstrip("0123456789").endswith(_FLOWS) else "", law, own)
        for output in self.graph.outputs:
            self._declared(output.name, output, output.expression)
        for named in self.graph.signals:
            self._declared(named.name, named, named.expression)
        for integral in self.graph.integrals:
            angle = dimension(integral.unit) == DIMENSIONLESS and is_angular_rate(f"({integral.unit or '1'})/s")
            self._check(integral.name, _ANGULAR if angle else "", integral.of, {})

    def _declared(self, name: str, quantity: Displayed, expression: Expr) -> None:
        """An output or signal: its unit and its expression are of one kind."""
        self._check(name, _kind_of_unit(quantity.unit), expression, {})
        if is_bare_rate(quantity.unit) and self._kind(expression, {}) == _ANGULAR:
            raise self._refusal(name, quantity.display_unit, f"{name} is an angular speed, {to_text(expression)},")

    def _check(self, where: str, needed: str | None, law: Expr, own: Mapping[Symbol, str]) -> None:
        if needed == _ANGULAR and self._kind(law, own) == _BARE:
            raise self._beside(where, law, own, "it gives an angular speed")
        for part in sympy.preorder_traversal(law):
            for compared in self._compared(part, own):
                kinds = {self._kind(one, own): one for one in compared}
                if _ANGULAR in kinds and _BARE in kinds:
                    beside = f"it stands beside the angular speed {to_text(kinds[_ANGULAR])}"
                    raise self._beside(where, kinds[_BARE], own, beside)
            if isinstance(part, TableFunction):
                self._table(where, part, own)

    def _compared(self, part: Any, own: Mapping[Symbol, str]) -> Iterator[Sequence[Any]]:
        """Groups of expressions that have to be of one kind: terms, sides of a comparison, the parts of a ratio."""
        if isinstance(part, Add | minimum | maximum | sympy.Min | sympy.Max | Relational | switch | sympy.atan2):
            yield part.args
        elif isinstance(part, Piecewise):
            yield [branch for branch, _ in part.args]
        elif isinstance(part, Mul):
            below = [factor.base for factor in part.args if isinstance(factor, Pow) and factor.exp == -1]
            above = [factor for factor in part.args if not (isinstance(factor, Pow) and factor.exp == -1)]
            sides = [[one for one in side if self._kind(one, own) != _PURE] for side in (above, below)]
            if [len(side) for side in sides] == [1, 1]:  # a ratio of two rates, and nothing that may convert one
                yield [sides[0][0], sides[1][0]]

    def _table(self, where: str, call: TableFunction, own: Mapping[Symbol, str]) -> None:
        table = self.tables[call.table_name]
        shown = table.shown_argument_units or table.argument_units
        for argument, unit in zip(call.args, shown, strict=False):
            if is_bare_rate(unit) and self._kind(argument, own) == _ANGULAR:
                about = f"table {table.name} takes {unit!r} but is given the angular speed {to_text(argument)}:"
                raise self._refusal(where, unit, about)

    def _kind(self, value: Any, own: Mapping[Symbol, str]) -> str:
        """``angular``, ``bare``, ``pure`` (a number that converts nothing), or nothing where neither can be said."""
        if isinstance(value, Symbol):
            return own.get(value) or self._of_symbol(value)
        if isinstance(value, TableFunction):
            return _kind_of_unit(self.tables[value.table_name].unit) if not any(value.derivative or ()) else ""
        if value.is_number:
            return "" if _may_convert(value) else _PURE
        if isinstance(value, sympy.Abs | delay):
            return self._kind(value.args[0], own)
        if isinstance(value, Mul):
            return _product([self._kind(factor, own) for factor in value.args])
        if isinstance(value, Pow):
            return _PURE if self._kind(value.base, own) == _PURE else ""
        if isinstance(value, Add | minimum | maximum | sympy.Min | sympy.Max):
            return _sum(self._kind(part, own) for part in value.args)
        if isinstance(value, Piecewise):
            return _sum(self._kind(branch, own) for branch, _ in value.args)
        return _PURE if isinstance(value, sympy.tanh | sympy.sin | sympy.cos | sympy.exp | sympy.sign) else ""

    def _of_symbol(self, used: Symbol) -> str:
        read = signal_name(used)
        if read is None:
            return _kind_of_unit(self.quantities[used].unit) if used in self.quantities else ""
        if read.variable != "flow":
            return ""
        return _kind_of_flow(self._port_domains(self.graph.nodes[read.node]), max(read.port, 1))

    def _own(self, node: Node) -> dict[Symbol, str]:
        """The kinds of an element's own flows."""
        domains = self._port_domains(node)
        several = node.is_field or node.kind in TWO_PORTS
        return {
            symbol(f"flow{port if several else ''}"): kind
            for port in range(1, len(domains) + 1)
            if (kind := _kind_of_flow(domains, port))
        }

    def _port_domains(self, node: Node) -> list[Domain | None]:
        if node.is_junction:
            return [self.domains[node.name]]
        ends = [self.graph.bonds[bond] for bond, _ in self.incidence[node.name]]
        others = [end.target if end.source == node.name else end.source for end in ends]
        return [self.domains[node.name] or self.domains[other] for other in others]

    def _beside(self, where: str, bare: Expr, own: Mapping[Symbol, str], why: str) -> DimensionError:
        """The refusal of the quantity that makes an expression a bare number per time."""
        used = next(
            one
            for one in (*sorted(bare.free_symbols, key=str), *sorted(bare.atoms(TableFunction), key=str))
            if self._kind(one, own) == _BARE
        )
        declared = self.tables[used.table_name] if isinstance(used, TableFunction) else self.quantities[used]
        unit = declared.display_unit
        return self._refusal(where, unit, f"{used} is declared in {unit!r}, but {why}:")

    def _refusal(self, where: str, unit: str, about: str) -> DimensionError:
        return DimensionError(
            f"{self.graph.name}: {where}: {about} unit {unit!r} does not say whether it counts turns or radians - "
            f"write {ANGULAR_UNITS}",
            where=(where,),
        )


@functools.cache
def _kind_of_unit(unit: str) -> str:
    if not unit:
        return ""
    if is_angular_rate(unit):
        return _ANGULAR
    return _BARE if is_bare_rate(unit) else ""


def _kind_of_flow(domains: Sequence[Domain | None], port: int) -> str:
    domain = domains[port - 1] if port <= len(domains) else None
    return _ANGULAR if domain is not None and is_angular_rate(domain.flow_unit) else ""


def _may_convert(factor: Any) -> bool:
    """Whether a number may turn turns into radians or back: pi, 6.28, 60/9.55, but not 2 or 1/3."""
    return bool(factor.is_number and not factor.is_Rational)


def _product(kinds: Sequence[str]) -> str:
    rates = [kind for kind in kinds if kind != _PURE]
    return rates[0] if len(rates) == 1 else "" if rates else _PURE


def _sum(kinds: Iterable[str]) -> str:
    found = [kind for kind in kinds if kind]
    return next((kind for kind in found if kind != _PURE), found[0] if found else "")
