"""A number that notes what is done to it, so that a Python function of numbers becomes the text of a generated module.

The function is called once with such numbers in place of states, inputs and parameters. Arithmetic, numpy's functions,
``numpy.where`` and comparisons are noted; loops over fixed ranges and functions that it calls run as they are. What
depends on a value that only a simulation knows (``if x > 0``, ``while``, ``math.sin``) cannot be noted, and says so.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from bondgraph.compile.ir.tape import FUNCTIONS
from bondgraph.errors import ModelError

#: Functions of numpy that are noted, by the names that they have there; all others are refused.
CALLED = (*FUNCTIONS, "minimum", "maximum", "arctan2", "where", "clip")

_ALIASES = {"absolute": "abs", "fabs": "abs"}
_OPERATORS: Mapping[str, type[ast.operator]] = {
    "add": ast.Add, "subtract": ast.Sub, "multiply": ast.Mult, "divide": ast.Div, "power": ast.Pow,
    "float_power": ast.Pow,
}  # fmt: skip
_COMPARISONS: Mapping[str, type[ast.cmpop]] = {
    "less": ast.Lt, "less_equal": ast.LtE, "greater": ast.Gt, "greater_equal": ast.GtE,
}  # fmt: skip
_LOGIC: Mapping[str, type[ast.operator]] = {
    "logical_and": ast.BitAnd, "logical_or": ast.BitOr, "bitwise_and": ast.BitAnd, "bitwise_or": ast.BitOr,
}  # fmt: skip


class TraceError(ModelError):
    """What a function does with a number cannot be noted."""


class Traced:
    """A number, or where ``truth`` a condition, by the expression that gives it."""

    __hash__ = None  # type: ignore[assignment]
    __slots__ = ("node", "truth")

    def __init__(self, node: ast.expr, truth: bool = False) -> None:
        self.node, self.truth = node, truth

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *given: Any, **named: Any) -> Any:
        if method != "__call__" or named:
            raise TraceError(f"numpy.{ufunc.__name__}.{method} of a quantity cannot be followed")
        return noted(ufunc.__name__, *given)

    def __array_function__(self, function: Callable[..., Any], types: Any, given: Any, named: Any) -> Any:
        if named:
            raise TraceError(f"numpy.{function.__name__} with {', '.join(named)} cannot be followed")
        return noted(function.__name__, *given)

    def _refused(self, *_: object) -> Any:
        raise TraceError(
            "a branch or loop depends on a quantity, whose value is only known in a simulation - use numpy.where,"
            " numpy.minimum or numpy.maximum"
        )

    def _no_number(self) -> Any:
        raise TraceError("a quantity is taken for a number that is known - use numpy's functions, not those of math")

    __bool__ = __iter__ = __len__ = __contains__ = _refused
    __float__ = __int__ = __index__ = __complex__ = __round__ = _no_number
    __trunc__ = __floor__ = __ceil__ = _no_number

    def __add__(self, other: Any) -> Any:
        return noted("add", self, other)

    def __radd__(self, other: Any) -> Any:
        return noted("add", other, self)

    def __sub__(self, other: Any) -> Any:
        return noted("subtract", self, other)

    def __rsub__(self, other: Any) -> Any:
        return noted("subtract", other, self)

    def __mul__(self, other: Any) -> Any:
        return noted("multiply", self, other)

    def __rmul__(self, other: Any) -> Any:
        return noted("multiply", other, self)

    def __truediv__(self, other: Any) -> Any:
        return noted("divide", self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return noted("divide", other, self)

    def __pow__(self, other: Any) -> Any:
        return noted("power", self, other)

    def __rpow__(self, other: Any) -> Any:
        return noted("power", other, self)

    def __mod__(self, other: Any) -> Any:
        return noted("mod", self, other)

    def __floordiv__(self, other: Any) -> Any:
        return noted("floor", noted("divide", self, other))

    def __lt__(self, other: Any) -> Any:
        return noted("less", self, other)

    def __le__(self, other: Any) -> Any:
        return noted("less_equal", self, other)

    def __gt__(self, other: Any) -> Any:
        return noted("greater", self, other)

    def __ge__(self, other: Any) -> Any:
        return noted("greater_equal", self, other)

    def __eq__(self, other: object) -> Any:
        self._refused()

    def __ne__(self, other: object) -> Any:
        self._refused()

    def __and__(self, other: Any) -> Any:
        return noted("logical_and", self, other)

    def __or__(self, other: Any) -> Any:
        return noted("logical_or", self, other)

    def __invert__(self) -> Any:
        return noted("logical_not", self)

    def __neg__(self) -> Any:
        return noted("negative", self)

    def __pos__(self) -> Any:
        return self

    def __abs__(self) -> Any:
        return noted("abs", self)


def _method(name: str) -> Callable[[Traced], Any]:
    return lambda self: noted(name, self)


# numpy asks the elements of an array of objects for their own functions
for _name in FUNCTIONS:
    setattr(Traced, _name, _method(_name))


def noted(name: str, *given: Any) -> Any:
    """What a function or an operator of numpy gives, by its name there; element by element where arrays are given.

    Raises
    ------
    TraceError
        If it is not one of those that a model can hold.
    """
    if any(isinstance(one, np.ndarray | list | tuple) for one in given):
        arrays = np.broadcast_arrays(*(np.asarray(one, dtype=object) for one in given))
        found = np.empty(arrays[0].shape, dtype=object)
        for place in np.ndindex(found.shape):
            found[place] = noted(name, *(array[place] for array in arrays))
        return found
    name = _ALIASES.get(name, name)
    if name in ("square", "mod", "remainder", "reciprocal"):
        return _composed(name, *given)
    if name in _LOGIC:
        return Traced(ast.BinOp(_condition(given[0]), _LOGIC[name](), _condition(given[1])), True)
    if name in ("logical_not", "invert"):
        return Traced(ast.UnaryOp(ast.Invert(), _condition(given[0])), True)
    if name == "where" and len(given) == 3:
        return Traced(_call("where", [_condition(given[0]), *map(_number, given[1:])]))
    nodes = [_number(one) for one in given]
    if name in _OPERATORS:
        return Traced(ast.BinOp(nodes[0], _OPERATORS[name](), nodes[1]))
    if name in _COMPARISONS:
        return Traced(ast.Compare(nodes[0], [_COMPARISONS[name]()], [nodes[1]]), True)
    if name == "negative":
        return Traced(ast.UnaryOp(ast.USub(), nodes[0]))
    needed = {"minimum": 2, "maximum": 2, "arctan2": 2, "where": 3, "clip": 3}.get(name, 1)
    if name in CALLED and len(nodes) != needed:
        raise TraceError(f"{name} takes {needed}, not {len(nodes)} numbers")
    if name not in CALLED:
        raise TraceError(f"numpy.{name} cannot be followed - there are {', '.join(sorted(CALLED))}")
    return Traced(_call(name, nodes))


def _composed(name: str, first: Any, second: Any = None) -> Any:
    if name == "square":
        return noted("power", first, 2)
    if name == "reciprocal":
        return noted("divide", 1.0, first)
    return noted("subtract", first, noted("multiply", second, noted("floor", noted("divide", first, second))))


def _call(name: str, nodes: Sequence[ast.expr]) -> ast.expr:
    return ast.Call(ast.Attribute(ast.Name("np", ast.Load()), name, ast.Load()), list(nodes), [])


def _condition(given: Any) -> ast.expr:
    if isinstance(given, Traced) and given.truth:
        return given.node
    if isinstance(given, bool | np.bool_):
        return ast.Compare(ast.Constant(int(given)), [ast.Gt()], [ast.Constant(0)])
    raise TraceError("a number stands where a condition is needed - compare it, as in x > 0")


def _number(given: Any) -> ast.expr:
    if isinstance(given, Traced):
        ones = [ast.Constant(1.0), ast.Constant(0.0)]
        return _call("where", [given.node, *ones]) if given.truth else given.node
    if isinstance(given, bool | int | float | np.number | np.bool_):
        value = int(given) if isinstance(given, bool | int | np.integer | np.bool_) else float(given)
        if not math.isfinite(value):
            raise TraceError(f"{value} is no number to compute with")
        size = ast.Constant(abs(value))
        return ast.UnaryOp(ast.USub(), size) if value < 0 else size
    raise TraceError(f"{given!r} is neither a number nor a quantity")


def constant(value: float) -> Traced:
    """A number that is known."""
    return Traced(_number(value))


def lines_of(roots: Iterable[Traced], prefix: str) -> tuple[list[str], list[str]]:
    """Assignments of what is used more than once, and the expressions of roots in these terms.

    Examples
    --------
    >>> x = Traced(ast.Name("x", ast.Load()))
    >>> force = 3 * x
    >>> lines_of([force + 1, force - 1], "part")
    (['part0 = 3 * x'], ['part0 + 1', 'part0 - 1'])
    """
    nodes = [_number(root) for root in roots]
    uses: dict[int, int] = {}
    order: list[ast.expr] = []
    for node in nodes:
        _count(node, uses, order)
    lines: list[str] = []
    names: dict[int, ast.expr] = {}
    for node in order:
        _replace(node, names)
        if uses[id(node)] > 1 and not isinstance(node, ast.Name | ast.Constant | ast.UnaryOp | ast.Compare):
            lines.append(f"{prefix}{len(lines)} = {ast.unparse(node)}")
            names[id(node)] = ast.Name(f"{prefix}{len(lines) - 1}", ast.Load())
    return lines, [ast.unparse(names.get(id(node), node)) for node in nodes]


def _parts(node: ast.expr) -> list[tuple[str, int | None, ast.expr]]:
    """Operands of an expression, each with the field, and the place in it, where it stands."""
    if isinstance(node, ast.BinOp):
        return [("left", None, node.left), ("right", None, node.right)]
    if isinstance(node, ast.UnaryOp):
        return [("operand", None, node.operand)]
    if isinstance(node, ast.Compare):
        return [("left", None, node.left), ("comparators", 0, node.comparators[0])]
    if isinstance(node, ast.Call):
        return [("args", k, one) for k, one in enumerate(node.args)]
    return []


def _count(root: ast.expr, uses: dict[int, int], order: list[ast.expr]) -> None:
    """How often every part is used, and all of them, operands first; without recursion, since loops make long sums."""
    waiting = [(root, False)]
    while waiting:
        node, done = waiting.pop()
        if done:
            order.append(node)
            continue
        uses[id(node)] = uses.get(id(node), 0) + 1
        if uses[id(node)] == 1:
            waiting.append((node, True))
            waiting += [(part, False) for _, _, part in reversed(_parts(node))]


def _replace(node: ast.expr, names: Mapping[int, ast.expr]) -> None:
    """Put names in the place of operands that have one."""
    for field, place, part in _parts(node):
        if id(part) in names:
            if place is None:
                setattr(node, field, names[id(part)])
            else:
                getattr(node, field)[place] = names[id(part)]
