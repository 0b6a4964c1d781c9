"""Dimensions of expressions: what each has, and whether its parts fit together.

What has no unit fits everything. A number beside declared quantities is a pure number (``2*b*flow``), but one that
multiplies variables alone may be a coefficient with a unit of its own (``10*flow`` in a graph file without units), so
it fits everything too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Any

import sympy
from sympy import Add, Expr, Mul, Piecewise, Pow, Symbol
from sympy.core.relational import Relational

from bondgraph.declare.expressions import to_text
from bondgraph.declare.functions import TableFunction, delay, maximum, minimum, switch
from bondgraph.declare.quantities import Table
from bondgraph.units import DIMENSIONLESS, Dimension, dimension, dimension_text

#: A dimension, or None where it is not known and fits everything.
Known = Dimension | None

SECOND = dimension("s")
_PURE = (
    sympy.sin, sympy.cos, sympy.tan, sympy.sinh, sympy.cosh, sympy.tanh, sympy.exp, sympy.log,
    sympy.asin, sympy.acos, sympy.atan, sympy.floor,
)  # fmt: skip


class MismatchError(Exception):
    """Two parts of one expression do not fit."""


class DimensionReader:
    """Dimensions of expressions, given those of symbols.

    Parameters
    ----------
    known
        Dimension of every symbol that has one; it may grow as symbols are assigned.
    declared
        Symbols of parameters and inputs, beside which a number is a pure number, unless it has digits as 9.81 has.
    tables
        Tables by name.

    Examples
    --------
    >>> b, v = sympy.symbols("b v", real=True)
    >>> reader = DimensionReader({b: dimension("N s/m"), v: dimension("m/s")}, {b}, {})
    >>> dimension_text(reader.of(2 * b * v))
    'kg m s^-2'
    >>> reader.of(2 * v) is None
    True
    """

    def __init__(self, known: dict[Symbol, Known], declared: set[Symbol], tables: Mapping[str, Table]) -> None:
        self.known, self.declared, self.tables = known, declared, tables
        self._memo: dict[Expr, Known] = {}

    def of(self, value: Any) -> Known:
        """The dimension of an expression; raises MismatchError where its parts do not fit."""
        if isinstance(value, Symbol):
            return self.known.get(value)
        if value not in self._memo:
            self._memo[value] = self._compute(value)
        return self._memo[value]

    def _compute(self, value: Any) -> Known:
        if value.is_number:
            return None if value.is_zero or _may_have_a_unit(value) else DIMENSIONLESS
        if isinstance(value, Mul):
            return self._product(value)
        if isinstance(value, Add):
            return self._same(value, value.args, "adds")
        if isinstance(value, Pow):
            return self._power(value)
        return self._function(value)

    def _is_declared(self, value: Any) -> bool:
        return not self.declared.isdisjoint(value.free_symbols)

    def _product(self, value: Mul) -> Known:
        total: Known = DIMENSIONLESS
        number = value.args[0]
        unsure = number.is_number and abs(number) != 1 and (not self._is_declared(value) or _may_have_a_unit(number))
        for factor in value.args:
            part = self.of(factor)
            total = None if part is None or total is None else _add(total, part)
        return None if unsure else total

    def _power(self, value: Pow) -> Known:
        base = self.of(value.base)
        if value.exp.is_Rational:
            power = Fraction(value.exp.p, value.exp.q)
            return None if base is None else tuple(exponent * power for exponent in base)
        if value.exp.is_Float:
            power = Fraction(float(value.exp)).limit_denominator(1000)
            return None if base is None else tuple(exponent * power for exponent in base)
        self._pure(value, value.exp)
        self._pure(value, value.base)
        return DIMENSIONLESS

    def _function(self, value: Any) -> Known:
        if isinstance(value, TableFunction):
            return self._table(value)
        if isinstance(value, minimum | maximum | sympy.Min | sympy.Max):
            return self._same(value, value.args, "compares")
        if isinstance(value, Piecewise):
            for _, condition in value.args:
                for relation in sorted(condition.atoms(Relational), key=str):
                    self._same(relation, relation.args, "compares")
            return self._same(value, [branch for branch, _ in value.args], "chooses between")
        if isinstance(value, sympy.Abs | delay):
            return self.of(value.args[0])
        if isinstance(value, sympy.sign):
            self.of(value.args[0])
            return DIMENSIONLESS
        if isinstance(value, sympy.atan2):
            self._same(value, value.args, "compares")
            return DIMENSIONLESS
        if isinstance(value, switch):
            self._same(value, value.args, "compares")
            return DIMENSIONLESS
        if isinstance(value, _PURE):
            self._pure(value, value.args[0])
            return DIMENSIONLESS
        for argument in value.args:
            self.of(argument)
        return None

    def _table(self, value: TableFunction) -> Known:
        table = self.tables[value.table_name]
        units = [*table.argument_units, "", ""][: len(value.args)]
        result = of_unit(table.unit)
        for argument, unit, order in zip(value.args, units, value.derivative or (0, 0), strict=False):
            needed, found = of_unit(unit), self.of(argument)
            if needed is not None and found is not None and needed != found:
                raise MismatchError(
                    f"table {table.name} takes {dimension_text(needed)} but {to_text(argument)} is "
                    f"{dimension_text(found)}"
                )
            for _ in range(order):
                result = None if result is None or needed is None else subtract(result, needed)
        return result

    def _pure(self, value: Expr, argument: Expr) -> None:
        found = self.of(argument)
        if found is not None and found != DIMENSIONLESS:
            raise MismatchError(
                f"{to_text(value)} needs a pure number but {to_text(argument)} is {dimension_text(found)}"
            )

    def _same(self, value: Any, parts: Iterable[Any], verb: str) -> Known:
        parts = list(parts)
        strict = any(self._is_declared(part) for part in parts)
        first: Expr | None = None
        common: Known = None
        for part in parts:
            found = None if part.is_number and not strict else self.of(part)
            if found is None:
                continue
            if common is None:
                first, common = part, found
            elif found != common:
                assert first is not None
                raise MismatchError(
                    f"{to_text(value)} {verb} {to_text(first)}, which is {dimension_text(common)}, and "
                    f"{to_text(part)}, which is {dimension_text(found)}"
                )
        return common


def _may_have_a_unit(number: Expr) -> bool:
    """Whether a bare number may be a constant of nature: 9.81, but not 2, 1/3 or 0.5.

    Examples
    --------
    >>> _may_have_a_unit(sympy.Float(9.81)), _may_have_a_unit(sympy.Float(0.5)), _may_have_a_unit(sympy.Rational(1, 3))
    (True, False, False)
    """
    return bool(number.is_Float) and not (8 * float(number)).is_integer()


def of_unit(unit: str) -> Known:
    """The dimension of a unit, None where there is no unit."""
    return dimension(unit) if unit else None


def subtract(a: Dimension, b: Dimension) -> Dimension:
    """The dimension of a quotient."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _add(a: Dimension, b: Dimension) -> Dimension:
    return tuple(x + y for x, y in zip(a, b, strict=True))
