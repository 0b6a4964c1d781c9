"""Text of laws with numbers in them: as many digits as a person can use, or as their intervals support."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import sympy
from sympy import Expr, Float, Symbol
from sympy.printing.precedence import PRECEDENCE

from bondgraph.declare.expression_text import TextPrinter
from bondgraph.declare.read_text import ReadPrinter

#: Ends of intervals by name of parameter.
Intervals = Mapping[str, tuple[float, float]]
#: Significant digits of a number without an interval.
DIGITS = 3
#: Letters of the signals of a law, in order.
LETTERS = ("x", "y", "z", "w")


def letters_beside(names: Iterable[str]) -> list[Symbol]:
    """Letters of the signals of a law, in order, without those that are a signal's own name.

    Examples
    --------
    >>> letters_beside(["effort of oil", "y"])
    [x, z, w]
    """
    taken = set(names)
    return [Symbol(one) for one in LETTERS if one not in taken]


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


def with_numbers(law: Expr, values: Mapping[str, float], ends: Intervals | None = None) -> str:
    """Text of a law in symbols as a person reads it, with the values of its parameters.

    Numbers that stand in it are rounded, too. Numbers before a term are one, in which those without an interval count
    as exact.

    Examples
    --------
    >>> c, d, x = sympy.symbols("c_law d_law x")
    >>> with_numbers(c * sympy.tanh(x / d) + x / Float(18.0), {"c_law": -2.0, "d_law": 0.1234567})
    '-2*tanh(x/0.123) + 0.0556*x'
    >>> with_numbers(c * sympy.tanh(x / d) + x, {"c_law": 0.0, "d_law": 2.0})  # a part that is nothing is left out
    'x'
    >>> with_numbers(sympy.sign(x) * sympy.Abs(x / Float(25.0)) ** 1.5 * c, {"c_law": 2.0}, {"c_law": (1.9, 2.1)})
    '0.016*|x|^1.5*sign(x)'
    >>> with_numbers(c * (sympy.Abs(x) / Float(31.0)) ** d, {"c_law": 2.0, "d_law": 1.81})
    '2*(|x|/31)^1.81'
    >>> with_numbers(c * (1 - sympy.tanh((d - x) / Float(0.04))) / 2, {"c_law": 3.0, "d_law": 1.6})
    '3*(tanh((x - 1.6)/0.04) + 1)/2'
    """
    gone = law.xreplace({one: sympy.Integer(0) for one in law.free_symbols if values.get(one.name) == 0.0})
    law = law if gone.has(sympy.nan, sympy.zoo, sympy.oo) else gone
    negative = {one: -one for one in law.free_symbols if values.get(one.name, 0.0) < 0.0}
    sizes = {name: abs(value) for name, value in values.items()}
    turned = {name: _turned(name, value, ends) for name, value in values.items()}
    return str(_Numbers(sizes, turned).doprint(sympy.factor_terms(_rising(law.xreplace(negative), sizes))))


def _rising(law: Expr, sizes: Mapping[str, float]) -> Expr:
    """The law with steps that rise with what moves in them: tanh is odd, and a person reads x - 1.6, not -x + 1.6."""
    turned = {}
    for step in law.atoms(sympy.tanh):
        argument = sympy.expand(step.args[0])
        moving = [
            term
            for term in sympy.Add.make_args(argument)
            if not {one.name for one in term.free_symbols} <= sizes.keys()
        ]
        if moving and all(term.could_extract_minus_sign() for term in moving):
            turned[step] = -sympy.tanh(sympy.factor_terms(-step.args[0]))
    return law.xreplace(turned)


def python_text(law: Expr, digits: int) -> str:
    """Text of a law as Python, its numbers with so many significant digits.

    Examples
    --------
    >>> python_text(sympy.Abs(sympy.Symbol("x")) / Float(18.0), 6)
    '0.0555556*Abs(x)'
    """
    return str(_Digits(digits).doprint(sympy.factor_terms(law)))


def _turned(name: str, value: float, ends: Intervals | None) -> tuple[float, float] | None:
    own = None if ends is None else ends.get(name)
    return own if own is None or value >= 0.0 else (-own[1], -own[0])


class _Digits(TextPrinter):
    """Python text with rounded numbers."""

    def __init__(self, digits: int) -> None:
        super().__init__()
        self._rounding = digits

    def _print_Float(self, expression: Float) -> str:
        return rounded(float(expression), digits=self._rounding)


class _Numbers(ReadPrinter):
    """Text of an expression in which parameters are numbers, by their sizes and the ends of their intervals."""

    def __init__(self, sizes: Mapping[str, float], ends: Mapping[str, tuple[float, float] | None]) -> None:
        super().__init__(digits=DIGITS)
        self._sizes, self._ends = sizes, ends

    def ordered(self, factors: Sequence[Expr]) -> list[Expr]:
        """Factors in the order in which they are read: one number, what it multiplies, a sign."""
        numbers = [one for one in factors if one.is_Float or (one.is_Symbol and one.name in self._sizes)]
        others = super().ordered([one for one in factors if one not in numbers])
        return [*([self._product(numbers)] if numbers else []), *others]

    def _product(self, numbers: Sequence[Expr]) -> Expr:
        """The product of numbers as a symbol, whose name is their text."""
        if len(numbers) == 1:
            return Symbol(str(self._print(numbers[0])))
        sizes = [self._sizes[one.name] if one.is_Symbol else float(one) for one in numbers]
        whole, scaled = math.prod(sizes), []
        for one, size in zip(numbers, sizes, strict=True):
            ends = self._ends.get(one.name) if one.is_Symbol else None
            scaled += [] if ends is None else [(ends[0] * whole / size, ends[1] * whole / size)]
        return Symbol(rounded(whole, max(scaled, key=lambda own: abs(own[1] - own[0]), default=None)))

    def _print_Symbol(self, expression: Symbol) -> str:
        name = expression.name
        return rounded(self._sizes[name], self._ends.get(name)) if name in self._sizes else name

    def _print_Float(self, expression: Float) -> str:
        return rounded(float(expression))

    def _print_Function(self, expression: Expr) -> str:
        return f"{expression.func.__name__}({', '.join(map(self._over_its_size, expression.args))})"

    def _print_Pow(self, expression: Expr, rational: bool = False) -> str:
        base, exponent = expression.as_base_exp()
        if exponent.is_number or self._over_its_size(base) == str(self._print(base)):
            return str(super()._print_Pow(expression, rational))
        return f"({self._over_its_size(base)})^{self.parenthesize(exponent, PRECEDENCE['Atom'], strict=True)}"

    def _over_its_size(self, argument: Expr) -> str:
        """Argument of a function, a signal over its size where a number scales it: x/23.6, not 0.0424*x."""
        number, rest = argument.as_coeff_Mul()
        if not (number.is_Float and number > 0.0 and (rest.is_Symbol or rest.is_Add or isinstance(rest, sympy.Abs))):
            return str(self._print(argument))
        return f"{self._factor(rest)}/{rounded(1.0 / float(number))}"

    def _as_ordered_terms(self, expression: Expr, order: str | None = None) -> list[Expr]:
        """Terms that move before those that do not: x - 6.2."""
        terms = super()._as_ordered_terms(expression, order)
        return sorted(terms, key=lambda term: {one.name for one in term.free_symbols} <= self._sizes.keys())
