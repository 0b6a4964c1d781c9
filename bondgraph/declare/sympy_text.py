"""Expressions as text for other programs, in the spelling of sympy."""

from __future__ import annotations

from typing import Any

import sympy
from sympy import Expr

from bondgraph.declare.expression_text import TextPrinter


class _SympyPrinter(TextPrinter):
    """Text of an expression that sympy's own parser reads too."""

    def _print_minimum(self, expression: Expr) -> str:
        return f"Min({', '.join(map(self._print, expression.args))})"

    def _print_maximum(self, expression: Expr) -> str:
        return f"Max({', '.join(map(self._print, expression.args))})"

    def _print_Relational(self, expression: Any) -> str:
        name = {"Equality": "Eq", "Unequality": "Ne"}.get(type(expression).__name__)
        if name is None:
            return super()._print_Relational(expression)
        return f"{name}({self._print(expression.lhs)}, {self._print(expression.rhs)})"

    def _joined(self, expression: Any) -> str:
        parts = sorted(expression.args, key=sympy.default_sort_key)
        return f"{type(expression).__name__}({', '.join(map(self._print, parts))})"

    _print_And = _print_Or = _print_Not = _joined


_SYMPY_PRINTER = _SympyPrinter()


def to_sympy_text(expression: Expr) -> str:
    """Text of an expression that both :func:`~bondgraph.declare.expressions.parse` and sympy's own parser read back.

    Examples
    --------
    >>> from bondgraph.declare.functions import maximum
    >>> from bondgraph.declare.quantities import symbol
    >>> to_sympy_text(maximum(symbol("a"), 0))
    'Max(a, 0)'
    """
    return str(_SYMPY_PRINTER.doprint(expression))
