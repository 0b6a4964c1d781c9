"""Text of sympy expressions as numpy source: readable, and the same on every machine under every hash seed.

sympy orders the arguments of sums and products by an internal key that is slow to compute and may change between
versions. Here factors and terms are ordered by the rank of the quantities in them (declared first, computed later), so
a sum reads in the order in which the machine was declared:

    (1/2)*cd_area*rho_air*v_body*np.abs(v_body)
    tau_engine - tau_drag - tau_belt/ratio_cvt
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import sympy
from sympy import Expr, Symbol
from sympy.core.relational import Relational
from sympy.logic.boolalg import BooleanFunction

from bondgraph.declare.functions import TableFunction, maximum, minimum
from bondgraph.errors import GenerationError, suggest
from bondgraph.generate.names import unused

_CONDITION, _SUM, _PRODUCT, _POWER, _ATOM = range(5)
_EXACT = 2**53

_FUNCTIONS: dict[type, str] = {
    sympy.sin: "sin", sympy.cos: "cos", sympy.tan: "tan",
    sympy.asin: "arcsin", sympy.acos: "arccos", sympy.atan: "arctan", sympy.atan2: "arctan2",
    sympy.sinh: "sinh", sympy.cosh: "cosh", sympy.tanh: "tanh",
    sympy.asinh: "arcsinh", sympy.acosh: "arccosh", sympy.atanh: "arctanh",
    sympy.exp: "exp", sympy.log: "log", sympy.Abs: "abs", sympy.sign: "sign", sympy.floor: "floor",
    minimum: "minimum", maximum: "maximum",
}  # fmt: skip
_CONSTANTS = {
    sympy.pi: "np.pi", sympy.E: "np.e", sympy.oo: "np.inf", -sympy.oo: "-np.inf", sympy.nan: "np.nan",
    sympy.true: "True", sympy.false: "False",
}  # fmt: skip


class _Text(NamedTuple):
    """Printed text with what its surroundings need to know of it.

    ``kind`` orders factors (number, name, power, function, sum) and ``rank`` is that of the last quantity in the text.
    """

    text: str
    precedence: int
    kind: int
    rank: int

    def within(self, precedence: int) -> str:
        """The text, in parentheses unless it binds at least as strongly."""
        return self.text if self.precedence >= precedence else f"({self.text})"


_NUMBER, _NAME, _RAISED, _CALL, _GROUP = range(5)


class ExpressionPrinter:
    """Prints expressions in a given vocabulary and notes what they use.

    Parameters
    ----------
    identifiers
        Identifier of every symbol by its name.
    known
        Names that may be used from the start, in the order in which factors and terms are to stand; all where omitted.
    table_stems
        Function name of every table by its declared name.
    where
        Name of the model, for messages.

    Examples
    --------
    >>> printer = ExpressionPrinter({"k": "k", "x": "x_", "v": "v"})
    >>> k, x, v = sympy.symbols("k x v", real=True)
    >>> printer.text(v**2 / 2 - k * x / (v + 1))
    '(1/2)*v**2 - k*x_/(v + 1)'
    """

    def __init__(
        self,
        identifiers: Mapping[str, str],
        known: Iterable[str] | None = None,
        table_stems: Mapping[str, str] | None = None,
        where: str = "expression",
    ) -> None:
        self._identifiers = dict(identifiers)
        self._ranks = {name: rank for rank, name in enumerate(self._identifiers if known is None else known)}
        self._table_stems = dict(table_stems or {})
        self._where = where
        #: Names of the symbols printed since the last :meth:`forget`, in order of appearance.
        self.used: dict[str, None] = {}
        #: Tables and derivatives of tables ever printed: ``(name, orders)``.
        self.used_tables: dict[tuple[str, tuple[int, ...]], None] = {}
        self._printers: dict[type, Callable[[Any], _Text]] = {
            sympy.Add: self._sum,
            sympy.Mul: lambda e: _signed_text(*self._product(e)),
            sympy.Pow: self._reciprocal_or_power,
            sympy.Symbol: self._symbol,
            sympy.Piecewise: self._piecewise,
            sympy.Min: lambda e: self._fold("np.minimum", e),
            sympy.Max: lambda e: self._fold("np.maximum", e),
            sympy.And: lambda e: self._logic(" & ", e),
            sympy.Or: lambda e: self._logic(" | ", e),
            sympy.ceiling: lambda e: self._print(-sympy.floor(-e.args[0], evaluate=False)),
        }
        for function, name in _FUNCTIONS.items():
            self._printers[function] = functools.partial(self._function, f"np.{name}")

    def declare(self, name: str) -> None:
        """Let expressions printed from now on use a name; it ranks after all that are known."""
        if name in self._ranks:
            raise GenerationError(
                f"{self._where}: {name!r} is declared or computed twice - give one of them another name",
                where=(self._where, name),
            )
        self._ranks[name] = len(self._ranks)

    def temporary(self, suggestion: str) -> Symbol:
        """A new symbol of the generator's own, known from now on."""
        identifier = unused(f"_{suggestion}", set(self._identifiers.values()))
        name = f" {identifier}"  # no declared name begins with a blank
        self._identifiers[name] = identifier
        self.declare(name)
        return Symbol(name, real=True)

    def known(self) -> frozenset[str]:
        """Names that may be used now."""
        return frozenset(self._ranks)

    def rank(self, name: str) -> int:
        """Position of a known name in the order of declaration and computation."""
        return self._ranks[name]

    def identifier(self, name: str) -> str:
        """Identifier under which a symbol is printed."""
        return self._identifiers[name]

    def table_stem(self, name: str) -> str:
        """Name of the function of a declared table."""
        return self._table_stems[name]

    def forget(self) -> None:
        """Begin a new record of the symbols used."""
        self.used = {}

    def text(self, expression: Expr) -> str:
        """The expression as numpy source; a whole number by itself is printed as a float.

        Raises
        ------
        GenerationError
            If the expression holds a symbol or function that cannot be printed.
        """
        return self._print_float(expression).text

    def _print_float(self, expression: Any) -> _Text:
        printed = self._print(expression)
        whole = printed.kind == _NUMBER and printed.text.lstrip("-").isdigit()
        return printed._replace(text=f"{printed.text}.0") if whole else printed

    def _print(self, expression: Any) -> _Text:
        printer = self._printers.get(type(expression))
        if printer is not None:
            return printer(expression)
        if getattr(expression, "is_Number", False) and expression.is_finite:
            return _signed_text(*_number(expression))
        if isinstance(expression, TableFunction):
            return self._table(expression)
        if isinstance(expression, Relational):
            sides = self._print(expression.lhs), self._print(expression.rhs)
            return _joined(f" {expression.rel_op} ", sides, _CONDITION, _CALL)
        if expression in _CONSTANTS:
            return _Text(_CONSTANTS[expression], _ATOM, _NUMBER, -1)
        if isinstance(expression, BooleanFunction) and (normal := expression.to_nnf(simplify=False)) != expression:
            return self._print(normal)
        raise GenerationError(
            f"{self._where}: {expression} cannot be printed ({type(expression).__name__} has no numpy form)"
            f" - write the law with arithmetic, comparisons, tables and {', '.join(sorted(_FUNCTIONS.values()))}",
            where=(self._where,),
        )

    def _symbol(self, expression: Expr) -> _Text:
        name = expression.name
        if name not in self._ranks:
            raise GenerationError(
                f"{self._where}: {name!r} is used but neither declared nor computed before{suggest(name, self._ranks)}"
                " - declare it as a state, input or parameter, or assign it earlier",
                where=(self._where, name),
            )
        self.used[name] = None
        return _Text(self._identifiers[name], _ATOM, _NAME, self._ranks[name])

    def _sum(self, expression: Expr) -> _Text:
        """Terms with a plus before terms with a minus, each in order of rank and length, numbers last."""
        terms = []
        for negative, term in map(self._signed, expression.args):
            terms.append((negative, term.kind == _NUMBER, term.rank, len(term.text), term.within(_PRODUCT)))
        terms.sort()
        text = "".join((" - " if negative else " + ") + term for negative, _, _, _, term in terms)
        text = "-" + text[3:] if terms[0][0] else text[3:]
        return _Text(text, _SUM, _GROUP, max(rank for _, _, rank, _, _ in terms))

    def _signed(self, expression: Expr) -> tuple[bool, _Text]:
        """Sign and text of a term."""
        if type(expression) is sympy.Mul:
            return self._product(expression)
        if expression.is_Number and expression.is_finite:
            return _number(expression)
        return False, self._print(expression)

    def _product(self, expression: Expr) -> tuple[bool, _Text]:
        """Sign and text of a product: number, factors in order of rank, divisors behind one slash."""
        number, above, below = sympy.S.One, [], []
        for factor in expression.args:
            if factor.is_Number and factor.is_finite and number is sympy.S.One:
                number = factor
            elif type(factor) is sympy.Pow and _is_negative_number(factor.args[1]):
                below.append(self._power(factor.args[0], -factor.args[1]))
            else:
                above.append(self._print(factor))
        above.sort(key=_factor_key)
        below.sort(key=_factor_key)
        if number.is_Rational and not above:
            negative, front = _number(sympy.Integer(number.p))
            below = [_number(sympy.Integer(number.q))[1]][: number.q != 1] + below
        else:
            negative, front = _number(number)
        return negative, _quotient([front, *above] if front.text != "1" or not above else above, below)

    def _reciprocal_or_power(self, expression: Expr) -> _Text:
        base, exponent = expression.args
        if _is_negative_number(exponent):
            return _quotient([_number(sympy.S.One)[1]], [self._power(base, -exponent)])
        return self._power(base, exponent)

    def _power(self, base: Expr, exponent: Expr) -> _Text:
        if exponent.is_Float and (float(exponent) == 0.5 or float(exponent).is_integer()):
            exponent = sympy.Rational(float(exponent))
        if exponent == 1:
            return self._print(base)
        if exponent is sympy.S.Half:
            return self._call("np.sqrt", [base])
        below, above = self._print(base), self._print(exponent)
        return _Text(f"{below.within(_ATOM)}**{above.within(_ATOM)}", _POWER, _RAISED, max(below.rank, above.rank))

    def _function(self, name: str, expression: Expr) -> _Text:
        return self._call(name, expression.args)

    def _call(self, function: str, arguments: Iterable[Expr]) -> _Text:
        printed = [self._print_float(argument) for argument in arguments]
        return _Text(f"{function}({', '.join(p.text for p in printed)})", _ATOM, _CALL, max(p.rank for p in printed))

    def _table(self, expression: TableFunction) -> _Text:
        name = expression.table_name
        if name not in self._table_stems:
            raise GenerationError(
                f"{self._where}: table {name!r} is used but not declared{suggest(name, self._table_stems)}",
                where=(self._where, name),
            )
        orders = expression.derivative or (0,) * len(expression.args)
        self.used_tables[name, orders] = None
        return self._call(self._table_stems[name] + derivative_ending(orders), expression.args)

    def _fold(self, function: str, expression: Expr) -> _Text:
        printed = sorted(map(self._print_float, expression.args), key=lambda p: (p.kind == _NUMBER, *_factor_key(p)))
        return functools.reduce(
            lambda a, b: _Text(f"{function}({a.text}, {b.text})", _ATOM, _CALL, max(a.rank, b.rank)), printed
        )

    def _logic(self, operator: str, expression: Any) -> _Text:
        conditions = sorted(map(self._print, expression.args), key=_factor_key)
        return _joined(operator, conditions, _CONDITION, _CALL, each=_ATOM)

    def _piecewise(self, expression: Expr) -> _Text:
        """Nested choices; what no condition covers is nan."""
        result = _Text("np.nan", _ATOM, _NUMBER, -1)
        for value, condition in reversed(expression.args):
            chosen = self._print_float(value)
            if condition is sympy.true:
                result = chosen
                continue
            tested = self._print(condition)
            text = f"np.where({tested.text}, {chosen.text}, {result.text})"
            result = _Text(text, _ATOM, _CALL, max(tested.rank, chosen.rank, result.rank))
        return result


def derivative_ending(orders: tuple[int, ...]) -> str:
    """Ending of the name of a table's derivative, as in ``_table_torque_d1``.

    Examples
    --------
    >>> derivative_ending((0,)), derivative_ending((1,)), derivative_ending((1, 1))
    ('', '_d1', '_d12')
    """
    digits = "".join(str(i + 1) * order for i, order in enumerate(orders))
    return f"_d{digits}" if digits else ""


def _factor_key(printed: _Text) -> tuple[int, int, str]:
    return printed.kind, printed.rank, printed.text


def _is_negative_number(expression: Expr) -> bool:
    return bool(expression.is_Number and expression.is_negative)


def _number(value: Expr) -> tuple[bool, _Text]:
    """Sign and text of a number: exact where it is exact and small, else the shortest float that reads back."""
    negative = bool(value.is_negative)
    if negative:
        value = -value
    if not value.is_Rational or max(value.p, value.q) >= _EXACT:
        text = repr(float(value))
    else:
        text = str(value.p) if value.q == 1 else f"{value.p}/{value.q}"
    return negative, _Text(text, _PRODUCT if "/" in text else _ATOM, _NUMBER, -1)


def _signed_text(negative: bool, printed: _Text) -> _Text:
    return printed._replace(text=f"-{printed.text}", precedence=_PRODUCT) if negative else printed


def _joined(operator: str, parts: Iterable[_Text], precedence: int, kind: int, each: int = _SUM) -> _Text:
    listed = list(parts)
    text = operator.join(part.within(each) for part in listed)
    return _Text(text, precedence, kind, max(part.rank for part in listed))


def _quotient(above: list[_Text], below: list[_Text]) -> _Text:
    text = "*".join(factor.within(_POWER) for factor in above)
    if len(below) == 1:
        text += f"/{below[0].within(_POWER)}"
    elif below:
        text += f"/({'*'.join(factor.within(_POWER) for factor in below)})"
    return _Text(text, _PRODUCT, _GROUP, max(factor.rank for factor in [*above, *below]))
