"""Expressions of laws: safe parsing, and signals.

Nothing is evaluated as Python: the text is parsed to a syntax tree and only arithmetic, comparisons, the functions in
:data:`FUNCTIONS`, declared names, declared tables and signals are accepted.
"""

from __future__ import annotations

import ast
import functools
import keyword
import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import sympy
from sympy import Expr, Float, Integer, Symbol

from bondgraph.coherent import in_si, is_quantity
from bondgraph.declare.expression_text import to_text as to_text
from bondgraph.declare.functions import TableFunction, clip, delay, maximum, minimum, number, switch
from bondgraph.declare.limits import NoValueError, bounded, check_law_text, power
from bondgraph.declare.quantities import symbol
from bondgraph.errors import DeclarationError, suggest
from bondgraph.syntax import parsed

_SIGNAL = re.compile(r"\b(effort|flow|displacement|momentum)(\d*)\(\s*([A-Za-z0-9_.]+)\s*\)")
_SIGNAL_NAME = re.compile(r"(effort|flow|displacement|momentum)(\d*)\(([A-Za-z0-9_.]+)\)\Z")
_LOCAL_NAME = re.compile(r"(effort|flow|displacement|momentum)\d*\Z")
_KEPT_WORDS = {"True", "False", "and", "or", "not", "if", "else"}
_ESCAPED = "__word_"
#: Longer expressions are cut in messages.
_SHOWN = 200


def _step(value: Expr, at_zero: Any = 1) -> Expr:
    """Heaviside's step; one at zero unless a second argument gives the value there."""
    at = sympy.sympify(at_zero)
    if at == 1:
        return sympy.Piecewise((Integer(1), value >= 0), (Integer(0), True))
    return sympy.Piecewise((Integer(1), value > 0), (at, sympy.Eq(value, 0)), (Integer(0), True))


def _nested(function: Any) -> Callable[..., Expr]:
    def fold(*arguments: Expr) -> Expr:
        return functools.reduce(function, arguments)

    return fold


def _modulo(a: Expr, b: Expr) -> Expr:
    if b == 0:
        raise NoValueError(f"Mod({a}, 0) is not a finite real number")
    return a - b * sympy.floor(a / b)


#: Functions that laws may use, by the names accepted in text.
FUNCTIONS: dict[str, Callable[..., Expr]] = {
    "sin": sympy.sin, "cos": sympy.cos, "tan": sympy.tan,
    "asin": sympy.asin, "acos": sympy.acos, "atan": sympy.atan, "atan2": sympy.atan2,
    "sinh": sympy.sinh, "cosh": sympy.cosh, "tanh": sympy.tanh,
    "asinh": sympy.asinh, "acosh": sympy.acosh, "atanh": sympy.atanh,
    "sec": lambda x: 1 / sympy.cos(x), "csc": lambda x: 1 / sympy.sin(x), "cot": lambda x: 1 / sympy.tan(x),
    "exp": sympy.exp, "log": sympy.log, "ln": sympy.log, "sqrt": sympy.sqrt, "cbrt": sympy.cbrt,
    "abs": sympy.Abs, "Abs": sympy.Abs, "sign": sympy.sign, "floor": sympy.floor, "ceiling": lambda x: -sympy.floor(-x),
    "Mod": _modulo,
    "min": _nested(minimum), "Min": _nested(minimum), "minimum": _nested(minimum),
    "max": _nested(maximum), "Max": _nested(maximum), "maximum": _nested(maximum),
    "clip": clip, "pow": power, "switch": switch, "delay": delay,
    "Heaviside": _step,
}  # fmt: skip

#: Conditions written as functions, as sympy prints some of them.
_CONDITIONS: dict[str, Callable[..., Any]] = {
    "And": sympy.And, "Or": sympy.Or, "Not": sympy.Not,
    "Eq": sympy.Eq, "Ne": sympy.Ne, "Lt": sympy.Lt, "Le": sympy.Le, "Gt": sympy.Gt, "Ge": sympy.Ge,
}  # fmt: skip
_IN_PARENTHESES = ("& and | join conditions", "put the conditions into parentheses")
#: Those whose arguments are conditions themselves.
_JOINS = ("And", "Or", "Not")
_JOINED: dict[type[ast.operator], Callable[..., Any]] = {ast.BitAnd: sympy.And, ast.BitOr: sympy.Or}

_BINARY: dict[type[ast.operator], Callable[[Expr, Expr], Expr]] = {
    ast.Pow: power,
}
_COMPARE: dict[type[ast.cmpop], Callable[[Expr, Expr], Any]] = {
    ast.Lt: sympy.Lt, ast.LtE: sympy.Le, ast.Gt: sympy.Gt, ast.GtE: sympy.Ge, ast.Eq: sympy.Eq, ast.NotEq: sympy.Ne,
}  # fmt: skip


class SignalName(NamedTuple):
    """What a signal reads: the variable (``flow``), the port (0 where there is one) and the node."""

    variable: str
    port: int
    node: str


def signal(variable: str, node: str, port: int = 0) -> Symbol:
    """The symbol of a signal such as ``flow(shaft)`` or ``displacement2(field)``.

    Examples
    --------
    >>> signal("flow", "shaft")
    flow(shaft)
    """
    return symbol(f"{variable}{port or ''}({node})")


def signal_name(candidate: Symbol) -> SignalName | None:
    """What a symbol reads if it is a signal, else None.

    Examples
    --------
    >>> signal_name(signal("momentum", "rotor", 2))
    SignalName(variable='momentum', port=2, node='rotor')
    """
    found = _SIGNAL_NAME.match(candidate.name)
    return SignalName(found[1], int(found[2] or 0), found[3]) if found else None


def is_local(candidate: Symbol) -> bool:
    """Whether a symbol is an element's own variable (``flow``, ``displacement2``) and not a signal or quantity."""
    return _LOCAL_NAME.match(candidate.name) is not None


@functools.lru_cache(maxsize=16384)
def symbols_in(expression: Expr) -> tuple[Symbol, ...]:
    """Symbols used by an expression, sorted by name."""
    return tuple(sorted(expression.free_symbols, key=lambda s: s.name))


@functools.lru_cache(maxsize=16384)
def signals_in(expression: Expr) -> tuple[Symbol, ...]:
    """Signals used by an expression, sorted by name."""
    return tuple(s for s in symbols_in(expression) if signal_name(s))


@functools.lru_cache(maxsize=16384)
def tables_in(expression: Expr) -> tuple[str, ...]:
    """Names of the tables used by an expression, sorted."""
    return tuple(sorted({used.table_name for used in expression.atoms(TableFunction)}))


def normalise(expression: Any) -> Expr:
    """A sympy expression in the vocabulary of the toolkit: numbers exact or floats, Min/Max as nested pairs.

    A pint quantity counts as its number in coherent SI.

    Examples
    --------
    >>> normalise(sympy.Max(sympy.Symbol("x", real=True), 0))
    maximum(0, x)
    """
    if is_quantity(expression):
        expression = in_si(expression)
    result = number(expression) if isinstance(expression, int | float) else sympy.sympify(expression)
    if result.has(sympy.Min, sympy.Max, sympy.Heaviside):
        order = sympy.default_sort_key
        result = result.replace(sympy.Min, lambda *a: functools.reduce(minimum, sorted(a, key=order)))
        result = result.replace(sympy.Max, lambda *a: functools.reduce(maximum, sorted(a, key=order)))
        result = result.replace(sympy.Heaviside, lambda x, *_: _step(x))
    return result


def parse(text: str, names: Mapping[str, Any], where: str) -> Expr:
    """Parse the text of an expression safely.

    Parameters
    ----------
    text
        Arithmetic in declared names, local variables, signals, tables and :data:`FUNCTIONS`.
    names
        What each declared name stands for: a symbol, or a callable for a table.
    where
        Name of the element or output, for messages.

    Raises
    ------
    DeclarationError
        If the text does not parse, uses an unknown name or anything but arithmetic.

    Examples
    --------
    >>> parse("b*flow + max(flow, 0)", {"b": symbol("b"), "flow": symbol("flow")}, "bearing")
    b*flow + maximum(flow, 0)
    """
    if not isinstance(text, str):
        return normalise(_checked_number(text, where))
    signals: dict[str, Symbol] = {}

    def hide(found: re.Match[str]) -> str:
        placeholder = f"__signal_{len(signals)}"
        signals[placeholder] = signal(found[1], found[3], int(found[2] or 0))
        return placeholder

    source = _SIGNAL.sub(hide, text.strip()).replace("^", "**")
    source = re.sub(r"\b[A-Za-z_]\w*\b", _escape_word, source)
    try:
        check_law_text(source)
        tree = parsed(source, mode="eval").body
        return normalise(_Reader(names, signals, where, text).read(tree))
    except NoValueError as error:
        raise DeclarationError(
            f"{where}: the law has no finite real value ({_cut(str(error))}) in {_cut(text)!r} - check divisions by "
            "zero, roots and logarithms of negative numbers",
            where=(where,),
        ) from None
    except (SyntaxError, ValueError) as error:
        problem, todo = str(error.args[0]), "write it as in Python, with * and **"
    except OverflowError as error:
        problem, todo = str(error), "numbers stay below 1.8e308, tables hold what is long"
    except (RecursionError, MemoryError):
        problem, todo = "it is nested too deeply", "name parts of it as signals"
    except (ArithmeticError, AttributeError, LookupError, TypeError) as error:  # sympy's, of parts that are not real
        problem, todo = f"no value: {error}", "check roots and logarithms of negative numbers, or name parts as signals"
    raise DeclarationError(f"{where}: expression {_cut(text)!r} cannot be read ({problem}) - {todo}", where=(where,))


def _cut(text: str) -> str:
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "..."


def _checked_number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DeclarationError(f"{where}: expected an expression or a number but got {value!r}", where=(where,))
    return value


def _escape_word(found: re.Match[str]) -> str:
    word = found[0]
    return _ESCAPED + word if keyword.iskeyword(word) and word not in _KEPT_WORDS else word


class _Reader:
    """Turns the accepted part of a Python syntax tree into a sympy expression."""

    def __init__(self, names: Mapping[str, Any], signals: Mapping[str, Symbol], where: str, text: str) -> None:
        self.names, self.signals, self.where, self.text = names, signals, where, text

    def read(self, node: ast.expr) -> Any:
        """A value or a condition; numbers in it are bounded as soon as they are known."""
        return bounded(self._read(node))

    def value(self, node: ast.expr) -> Expr:
        """A value, where a condition makes no sense."""
        value = self.read(node)
        if not isinstance(value, Expr):
            raise self._refusal(f"{value} is a condition, not a value", todo="write Piecewise((value, condition), ...)")
        return value

    def condition(self, node: ast.expr, joined: tuple[str, str] | None = None) -> Any:
        """A condition, where a value makes no sense."""
        value = self.read(node)
        if isinstance(value, Expr):
            raise self._refusal(*joined or (f"{value} is a value, not a condition", "compare it, such as flow > 0"))
        return value

    def _read(self, node: ast.expr) -> Any:
        if isinstance(node, ast.Constant):
            return self._constant(node.value)
        if isinstance(node, ast.Name | ast.Attribute):
            return self._name(self._dotted(node))
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
            return sympy.Mul(*self._factors(node))
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            return sympy.Add(*self._terms(node))
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            return _BINARY[type(node.op)](self.value(node.left), self.value(node.right))
        if isinstance(node, ast.BinOp) and type(node.op) in _JOINED:
            return _JOINED[type(node.op)](*(self.condition(side, _IN_PARENTHESES) for side in (node.left, node.right)))
        if isinstance(node, ast.UnaryOp):
            return self._unary(node)
        if isinstance(node, ast.Compare):
            return self._comparison(node)
        if isinstance(node, ast.BoolOp):
            join = sympy.And if isinstance(node.op, ast.And) else sympy.Or
            return join(*(self.condition(value) for value in node.values))
        if isinstance(node, ast.IfExp):
            test, body, orelse = self.condition(node.test), self.value(node.body), self.value(node.orelse)
            return sympy.Piecewise((body, test), (orelse, True))
        if isinstance(node, ast.Call):
            return self._call(node)
        raise self._refusal(f"{type(node).__name__} is not arithmetic")

    def _terms(self, node: ast.expr) -> list[Any]:
        """Terms of a sum; a long one nests to the left, which must not use up the stack."""
        terms: list[Any] = []
        while isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            right = self.value(node.right)
            terms.append(right if isinstance(node.op, ast.Add) else -right)
            node = node.left
        return [self.value(node), *reversed(terms)]

    def _factors(self, node: ast.expr) -> list[Any]:
        """Factors of a product, multiplied all at once: one by one, a number would be multiplied into a sum first."""
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
            return [*self._factors(node.left), *self._factors(node.right)]
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
            return [*self._factors(node.left), *(sympy.Pow(factor, -1) for factor in self._factors(node.right))]
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return [Integer(-1), *self._factors(node.operand)]
        return [self.value(node)]

    def _constant(self, value: Any) -> Any:
        if isinstance(value, bool):
            return sympy.true if value else sympy.false
        if isinstance(value, int):
            return Integer(value)
        if isinstance(value, float):
            return Float(value)
        raise self._refusal(f"{value!r} is not a number")

    def _dotted(self, node: ast.expr) -> str:
        if isinstance(node, ast.Name):
            return node.id.removeprefix(_ESCAPED)
        if isinstance(node, ast.Attribute):
            return f"{self._dotted(node.value)}.{node.attr.removeprefix(_ESCAPED)}"
        raise self._refusal("only names may have dots")

    def _name(self, name: str) -> Any:
        if name in self.signals:
            return self.signals[name]
        if name in self.names and not callable(self.names[name]):
            return self.names[name]
        if name == "pi":
            return sympy.pi
        if name in self.names:
            raise self._refusal(f"{name} is a table", todo=f"write {name}(argument)")
        known = [*self.names, *FUNCTIONS, "pi", "t"]
        raise self._refusal(
            f"name {name!r} is not declared{suggest(name, known)}", todo="declare it as a parameter, input or signal"
        )

    def _unary(self, node: ast.UnaryOp) -> Any:
        if isinstance(node.op, ast.USub):
            return -self.value(node.operand)
        if isinstance(node.op, ast.UAdd):
            return self.value(node.operand)
        if isinstance(node.op, ast.Invert) and isinstance(self.read(node.operand), Expr):
            raise self._refusal("~ is not arithmetic")
        return sympy.Not(self.condition(node.operand))

    def _comparison(self, node: ast.Compare) -> Any:
        values = [self.value(node.left), *(self.value(value) for value in node.comparators)]
        parts = []
        for operator, left, right in zip(node.ops, values[:-1], values[1:], strict=True):
            if type(operator) not in _COMPARE:
                raise self._refusal("only < <= > >= == != compare")
            parts.append(_COMPARE[type(operator)](left, right))
        return sympy.And(*parts) if len(parts) > 1 else parts[0]

    def _call(self, node: ast.Call) -> Any:
        name = self._dotted(node.func)
        if node.keywords:
            raise self._refusal(f"{name} takes no keyword arguments")
        if name == "Piecewise" and node.args:
            return sympy.Piecewise(*(self._branch(argument) for argument in node.args))
        if name == "Piecewise":
            raise self._refusal("Piecewise takes pairs (value, condition)")
        function = self.names[name] if callable(self.names.get(name)) else {**FUNCTIONS, **_CONDITIONS}.get(name)
        if function is None:
            known = [*FUNCTIONS, *_CONDITIONS, *(known for known, value in self.names.items() if callable(value))]
            raise self._refusal(f"function {name!r} is not known{suggest(name, known)}", todo="declare it as a table")
        read = self.condition if name in _JOINS else self.value
        try:
            return function(*(read(argument) for argument in node.args))
        except TypeError:
            raise self._refusal(f"{name} does not take {len(node.args)} argument(s)") from None

    def _branch(self, node: ast.expr) -> tuple[Any, Any]:
        if not isinstance(node, ast.Tuple) or len(node.elts) != 2:
            raise self._refusal("Piecewise takes pairs (value, condition)")
        return self.value(node.elts[0]), self.condition(node.elts[1])

    def _refusal(self, what: str, todo: str = "use arithmetic, declared names and known functions") -> DeclarationError:
        return DeclarationError(f"{self.where}: {_cut(what)} in {_cut(self.text)!r} - {todo}", where=(self.where,))
