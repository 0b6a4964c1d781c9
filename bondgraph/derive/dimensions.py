"""Dimensions: every derived equation must be homogeneous; a wrong unit is found with the element's name.

What has no unit (a graph file may leave units out) is not checked; where an unnamed intermediate has none, the
dimension of its expression is taken.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

import sympy
from sympy import Add, Expr, Mul, Piecewise, Pow, Symbol
from sympy.core.relational import Relational

from bondgraph.declare.expressions import to_text
from bondgraph.declare.functions import TableFunction, maximum, minimum
from bondgraph.declare.quantities import Table
from bondgraph.derive.equations import Assignment, ImplicitLoop, StateEquations
from bondgraph.errors import DimensionError
from bondgraph.units import DIMENSIONLESS, Dimension, dimension, dimension_text

#: A dimension, or None where it is not known and fits everything.
Known = Dimension | None

_SECOND = dimension("s")
_PURE = (
    sympy.sin, sympy.cos, sympy.tan, sympy.sinh, sympy.cosh, sympy.tanh, sympy.exp, sympy.log,
    sympy.asin, sympy.acos, sympy.atan, sympy.floor,
)  # fmt: skip


def check_dimensions(equations: StateEquations) -> None:
    """Raise DimensionError unless every equation with known units is homogeneous.

    Examples
    --------
    >>> from bondgraph.declare.domains import TRANSLATION
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> g = BondGraph("car")
    >>> c, m = g.parameter("c", 0.4, "kg/m"), g.parameter("m", 900.0, "kg")
    >>> body = g.one_junction("body", TRANSLATION)
    >>> _ = g.inertance("mass", m, at=body)
    >>> _ = g.resistance("aero", lambda v: c * v, at=body)
    >>> check_dimensions(derive(assign_causality(g)))
    Traceback (most recent call last):
    ...
    bondgraph.errors.DimensionError: car: F_aero must be kg m s^-2 but c*v_mass is kg s^-1 - correct the law or its
    units
    """
    _Checker(equations).run()


class _MismatchError(Exception):
    """Two parts of one expression do not fit."""


class _Checker:
    def __init__(self, equations: StateEquations) -> None:
        self.equations = equations
        self.tables: dict[str, Table] = {table.name: table for table in equations.tables}
        self.known: dict[Symbol, Known] = {Symbol("t", real=True): _SECOND}
        self.memo: dict[Expr, Known] = {}
        self.known |= {given.symbol: _of_unit(given.unit) for given in equations.inputs}
        self.known |= {given.symbol: _of_unit(given.unit) for given in equations.parameters}
        for state in equations.states:
            self.known[state.symbol] = _of_unit(state.unit)

    def run(self) -> None:
        for step in self.equations.assignments:
            if isinstance(step, ImplicitLoop):
                self._loop(step)
            else:
                self._assignment(step)
        for state, value in zip(self.equations.states, self.equations.derivatives, strict=True):
            own = self.known[state.symbol]
            self._require(f"d({state.symbol.name})/dt", None if own is None else _subtract(own, _SECOND), value)
        for output in self.equations.outputs:
            self._require(output.symbol.name, _of_unit(output.unit), output.expression)

    def _assignment(self, step: Assignment) -> None:
        found = self._require(step.symbol.name, _of_unit(step.unit), step.expression)
        self.known[step.symbol] = _of_unit(step.unit) or found

    def _loop(self, step: ImplicitLoop) -> None:
        for unknown, unit in zip(step.unknowns, step.units, strict=True):
            self.known[unknown] = _of_unit(unit)
        for local in step.body:
            self._assignment(local)
        for residual in step.residuals:
            self._require(step.name, None, residual)

    def _require(self, name: str, needed: Known, value: Expr) -> Known:
        try:
            found = self._dimension(value)
        except _MismatchError as mismatch:
            raise DimensionError(
                f"{self.equations.name}: {name}: {mismatch} - correct the law or its units", where=(name,)
            ) from None
        if needed is not None and found is not None and found != needed and value != 0:
            raise DimensionError(
                f"{self.equations.name}: {name} must be {dimension_text(needed)} but {to_text(value)} is "
                f"{dimension_text(found)} - correct the law or its units",
                where=(name,),
            )
        return found if found is not None else needed

    def _dimension(self, value: Expr) -> Known:
        if value not in self.memo:
            self.memo[value] = self._compute(value)
        return self.memo[value]

    def _compute(self, value: Any) -> Known:
        if isinstance(value, Symbol):
            return self.known.get(value)
        if value.is_number:
            return None if value == 0 else DIMENSIONLESS
        if isinstance(value, Mul):
            return self._product(value)
        if isinstance(value, Add):
            return self._same(value, value.args, "adds")
        if isinstance(value, Pow):
            return self._power(value)
        return self._function(value)

    def _product(self, value: Mul) -> Known:
        total: Known = DIMENSIONLESS
        for factor in value.args:
            part = self._dimension(factor)
            if part is None or total is None:
                return None
            total = tuple(a + b for a, b in zip(total, part, strict=True))
        return total

    def _power(self, value: Pow) -> Known:
        base = self._dimension(value.base)
        if value.exp.is_Rational or value.exp.is_Float:
            power = (
                Fraction(str(value.exp))
                if value.exp.is_Rational
                else Fraction(float(value.exp)).limit_denominator(1000)
            )
            return None if base is None else tuple(exponent * power for exponent in base)
        self._pure(value, value.exp)
        self._pure(value, value.base)
        return DIMENSIONLESS

    def _function(self, value: Expr) -> Known:
        if isinstance(value, TableFunction):
            return self._table(value)
        if isinstance(value, minimum | maximum):
            return self._same(value, value.args, "compares")
        if isinstance(value, Piecewise):
            for _, condition in value.args:
                for relation in condition.atoms(Relational):
                    self._same(relation, relation.args, "compares")
            return self._same(value, [branch for branch, _ in value.args], "chooses between")
        if isinstance(value, sympy.Abs):
            return self._dimension(value.args[0])
        if isinstance(value, sympy.sign):
            self._dimension(value.args[0])
            return DIMENSIONLESS
        if isinstance(value, sympy.atan2):
            self._same(value, value.args, "compares")
            return DIMENSIONLESS
        if isinstance(value, _PURE):
            self._pure(value, value.args[0])
            return DIMENSIONLESS
        for argument in value.args:
            self._dimension(argument)
        return None

    def _table(self, value: TableFunction) -> Known:
        table = self.tables[value.table_name]
        units = [*table.argument_units, "", ""][: len(value.args)]
        result = _of_unit(table.unit)
        for argument, unit, order in zip(value.args, units, value.derivative or (0, 0), strict=False):
            needed, found = _of_unit(unit), self._dimension(argument)
            if needed is not None and found is not None and needed != found:
                raise _MismatchError(
                    f"table {table.name} takes {dimension_text(needed)} but {to_text(argument)} is "
                    f"{dimension_text(found)}"
                )
            for _ in range(order):
                result = None if result is None or needed is None else _subtract(result, needed)
        return result

    def _pure(self, value: Expr, argument: Expr) -> None:
        found = self._dimension(argument)
        if found is not None and found != DIMENSIONLESS:
            raise _MismatchError(
                f"{to_text(value)} needs a pure number but {to_text(argument)} is {dimension_text(found)}"
            )

    def _same(self, value: Expr, parts: Iterable[Expr], verb: str) -> Known:
        first: Expr | None = None
        common: Known = None
        for part in parts:
            found = self._dimension(part)
            if found is None:
                continue
            if common is None:
                first, common = part, found
            elif found != common:
                assert first is not None
                raise _MismatchError(
                    f"{to_text(value)} {verb} {to_text(first)}, which is {dimension_text(common)}, and "
                    f"{to_text(part)}, which is {dimension_text(found)}"
                )
        return common


def _of_unit(unit: str) -> Known:
    return dimension(unit) if unit else None


def _subtract(a: Dimension, b: Dimension) -> Dimension:
    return tuple(x - y for x, y in zip(a, b, strict=True))
