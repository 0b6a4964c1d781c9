"""Text of expressions that parses back to the same expression."""

from __future__ import annotations

from typing import Any

import sympy
from sympy import Expr, Float
from sympy.core.relational import Relational
from sympy.logic.boolalg import BooleanFunction
from sympy.printing.str import StrPrinter


class TextPrinter(StrPrinter):  # type: ignore[misc]
    """Text of an expression that :func:`parse` reads back to the same value."""

    def _print_Float(self, expression: Float) -> str:
        return repr(float(expression))

    def _print_Exp1(self, expression: Expr) -> str:
        return "exp(1)"

    def _print_Relational(self, expression: Any) -> str:
        sign = {"Equality": "==", "Unequality": "!="}.get(type(expression).__name__) or expression.rel_op
        return f"{self._operand(expression.lhs)} {sign} {self._operand(expression.rhs)}"

    def _operand(self, expression: Any) -> str:
        text = str(self._print(expression))
        return f"({text})" if isinstance(expression, Relational | BooleanFunction) else text

    def _print_And(self, expression: Any) -> str:
        return " and ".join(map(self._operand, sorted(expression.args, key=sympy.default_sort_key)))

    def _print_Or(self, expression: Any) -> str:
        return " or ".join(map(self._operand, sorted(expression.args, key=sympy.default_sort_key)))

    def _print_Not(self, expression: Any) -> str:
        return f"not {self._operand(expression.args[0])}"


_PRINTER = TextPrinter()


def to_text(expression: Expr) -> str:
    """Text of an expression; parsing it gives the expression back.

    Examples
    --------
    >>> to_text(sympy.Symbol("a") / 2 + 0.1)
    'a/2 + 0.1'
    """
    return str(_PRINTER.doprint(expression))
