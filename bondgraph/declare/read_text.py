"""Text of expressions as a person reads it: bars around an absolute value, a caret before a power, min and max.

It is no Python and is not parsed back; :func:`bondgraph.declare.expression_text.to_text` gives what is. Laws of the
dictionary are written in the same marks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sympy import Abs, Expr, Float, Max, Min, Piecewise, Pow, Rational, S, sign
from sympy.printing.precedence import PRECEDENCE, precedence
from sympy.printing.str import StrPrinter

#: Significant digits of a number.
DIGITS = 6


@dataclass(frozen=True)
class Marks:
    """Signs of a notation: between factors, and of powers that have one of their own."""

    times: str = "*"
    powers: Mapping[str, str] = field(default_factory=dict)


#: Notation of terminals and files, and that of drawings.
PLAIN = Marks()
TYPESET = Marks("·", {"2": "²", "3": "³", "4": "⁴"})


class ReadPrinter(StrPrinter):  # type: ignore[misc]
    """Expressions as an engineer writes them; ``marks`` says with which signs, ``digits`` how numbers are rounded."""

    def __init__(self, marks: Marks = PLAIN, digits: int = DIGITS) -> None:
        super().__init__()
        self.marks, self.digits = marks, digits

    def ordered(self, factors: Sequence[Expr]) -> list[Expr]:
        """Factors of a product in the order in which they are read: a sign comes last."""
        return sorted(factors, key=lambda one: isinstance(one, sign))

    def _print_Mul(self, expression: Expr) -> str:
        minus = expression.as_coeff_Mul()[0].is_negative
        whole = -expression if minus else expression
        above, below = _fraction(whole)
        factors = [self._factor(one) for one in self.ordered(above)] or ["1"]
        text = self.marks.times.join(factors)
        if below:
            divisors = [self._factor(one, divides=len(below) == 1) for one in self.ordered(below)]
            divisor = self.marks.times.join(divisors)
            text += f"/({divisor})" if len(below) > 1 else f"/{divisor}"
        return f"-{text}" if minus else text

    def _factor(self, factor: Expr, divides: bool = False) -> str:
        own = precedence(factor)
        text = str(self._print(factor))
        bound = PRECEDENCE["Mul"] if divides else PRECEDENCE["Add"]
        return f"({text})" if own <= bound or text.startswith("-") else text

    def _print_Pow(self, expression: Pow, rational: bool = False) -> str:
        base, exponent = expression.as_base_exp()
        if exponent == S.Half:
            return f"sqrt({self._print(base)})"
        if exponent.is_number and exponent.is_negative:
            return f"1/{self._factor(Pow(base, -exponent), divides=True)}"
        inner = self.parenthesize(base, PRECEDENCE["Pow"])
        power = self.parenthesize(exponent, PRECEDENCE["Atom"], strict=True)
        return f"{inner}{self.marks.powers.get(power, f'^{power}')}"

    def _print_Abs(self, expression: Abs) -> str:
        return f"|{self._print(expression.args[0])}|"

    def _print_Float(self, expression: Float) -> str:
        return f"{float(expression):.{self.digits}g}"

    def _listed(self, name: str, parts: Sequence[Any]) -> str:
        return f"{name}({', '.join(str(self._print(one)) for one in parts)})"

    def _print_minimum(self, expression: Expr) -> str:
        return self._listed("min", expression.args)

    def _print_maximum(self, expression: Expr) -> str:
        return self._listed("max", expression.args)

    def _print_Min(self, expression: Min) -> str:
        return self._listed("min", expression.args)

    def _print_Max(self, expression: Max) -> str:
        return self._listed("max", expression.args)

    def _print_Piecewise(self, expression: Piecewise) -> str:
        *cases, (last, otherwise) = expression.args
        parts = [f"{self._print(value)} if {self._print(condition)}" for value, condition in cases]
        final = self._print(last) if otherwise == True else f"{self._print(last)} if {self._print(otherwise)}"  # noqa: E712
        return f"({' else '.join([*parts, final])})"


def _fraction(product: Expr) -> tuple[list[Expr], list[Expr]]:
    """Factors above and below the line of a product, in sympy's order."""
    above: list[Expr] = []
    below: list[Expr] = []
    for factor in product.as_ordered_factors():
        base, exponent = factor.as_base_exp()
        if isinstance(factor, Rational):
            above += [S(factor.p)] if factor.p != 1 else []
            below += [S(factor.q)] if factor.q != 1 else []
        elif isinstance(factor, Pow) and exponent.is_number and exponent.is_negative:
            below.append(Pow(base, -exponent))
        else:
            above.append(factor)
    return above, below


def read_text(expression: Expr, marks: Marks = PLAIN, digits: int = DIGITS) -> str:
    """Text of an expression as a person reads it.

    Parameters
    ----------
    expression
        Any expression of a law.
    marks
        Signs of the notation: :data:`PLAIN` for terminals and files, :data:`TYPESET` for drawings.
    digits
        Significant digits of its numbers.

    Examples
    --------
    >>> from sympy import sign, symbols
    >>> c, w = symbols("c w")
    >>> read_text(sign(w) * Abs(w) ** 1.5 * c), read_text(c * w * Abs(w) / 3), read_text(c * w**2, TYPESET)
    ('c*|w|^1.5*sign(w)', 'c*w*|w|/3', 'c·w²')
    """
    return str(ReadPrinter(marks, digits).doprint(expression))
