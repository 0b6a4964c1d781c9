"""Text of laws with numbers in them: as many digits as a person can use, or as their intervals support."""

from __future__ import annotations

import math
from collections.abc import Mapping

import sympy
from sympy import Expr, Float, Symbol

from bondgraph.declare.expression_text import TextPrinter

#: Ends of intervals by name of parameter.
Intervals = Mapping[str, tuple[float, float]]
#: Significant digits of a number without an interval.
DIGITS = 3
#: Letters of the signals of a law, in order.
LETTERS = ("x", "y", "z", "w")


def rounded(value: float, ends: tuple[float, float] | None = None, digits: int = DIGITS) -> str:
    """A number with two digits of its uncertainty, or with so many significant ones where no interval is known.

    Examples
    --------
    >>> rounded(0.05555555555555555), rounded(1234.5678, (1230.0, 1239.0)), rounded(82297405062.8, (8.1e10, 8.35e10))
    ('0.0556', '1234.6', '8.23e+10')
    >>> rounded(0.0, (-0.1, 0.1)), rounded(0.3, (-7.0, 8.0)), rounded(2.5, (2.5, 2.5))
    ('0', '0.3', '2.5')
    """
    half = math.nan if ends is None else 0.5 * abs(ends[1] - ends[0])
    if value != 0.0 and math.isfinite(half) and half > 0.0:
        digits = max(math.floor(math.log10(abs(value))) - math.floor(math.log10(half)) + 2, 1)
    return f"{value:.{digits}g}"


def with_numbers(law: Expr, values: Mapping[str, float], ends: Intervals | None = None, digits: int = DIGITS) -> str:
    """Text of a law in symbols with the values of its parameters; numbers that stand in it are rounded, too.

    Examples
    --------
    >>> c, d, x = sympy.symbols("c_law d_law x")
    >>> with_numbers(c * sympy.tanh(x / d) + x / Float(18.0), {"c_law": -2.0, "d_law": 0.1234567})
    '-2*tanh(x/0.123) + 0.0556*x'
    >>> with_numbers(c * sympy.tanh(x / d) + x, {"c_law": 0.0, "d_law": 2.0})  # a part that is nothing is left out
    'x'
    """
    gone = law.xreplace({one: sympy.Integer(0) for one in law.free_symbols if values.get(one.name) == 0.0})
    law = law if gone.has(sympy.nan, sympy.zoo, sympy.oo) else gone
    negative = {one: -one for one in law.free_symbols if values.get(one.name, 0.0) < 0.0}
    shown = {name: rounded(abs(value), _turned(name, value, ends), digits) for name, value in values.items()}
    return str(_Numbers(shown, digits).doprint(sympy.factor_terms(law.xreplace(negative))))


def _turned(name: str, value: float, ends: Intervals | None) -> tuple[float, float] | None:
    own = None if ends is None else ends.get(name)
    return own if own is None or value >= 0.0 else (-own[1], -own[0])


class _Numbers(TextPrinter):
    """Text of an expression in which parameters are numbers."""

    def __init__(self, shown: Mapping[str, str], digits: int) -> None:
        super().__init__()
        self._shown, self._digits = shown, digits

    def _print_Symbol(self, expression: Symbol) -> str:
        return self._shown.get(expression.name, expression.name)

    def _print_Float(self, expression: Float) -> str:
        return rounded(float(expression), digits=self._digits)

    def _as_ordered_terms(self, expression: Expr, order: str | None = None) -> list[Expr]:
        """Terms that move before those that do not: x - 6.2."""
        terms = super()._as_ordered_terms(expression, order)
        return sorted(terms, key=lambda term: {one.name for one in term.free_symbols} <= self._shown.keys())
