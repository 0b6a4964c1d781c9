"""Values of laws at a point, in the floats in which a model computes: as quick as the law is long.

Computer algebra at many digits is not: the sine of a power of 1e9 keeps it busy for hours.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import sympy
from sympy import Expr, Symbol

from bondgraph.declare.functions import TableFunction, delay, maximum, minimum, smooth_step, switch

#: The value of a table (and with orders of differentiation, of its slopes) at its arguments.
TableValue = Callable[[Sequence[float], Sequence[int]], float]

_UFUNCS: dict[Any, Callable[..., Any]] = {
    sympy.sin: np.sin, sympy.cos: np.cos, sympy.tan: np.tan, sympy.asin: np.arcsin, sympy.acos: np.arccos,
    sympy.atan: np.arctan, sympy.atan2: np.arctan2, sympy.sinh: np.sinh, sympy.cosh: np.cosh, sympy.tanh: np.tanh,
    sympy.asinh: np.arcsinh, sympy.acosh: np.arccosh, sympy.atanh: np.arctanh, sympy.exp: np.exp, sympy.log: np.log,
    sympy.Abs: np.abs, sympy.sign: np.sign, sympy.floor: np.floor, sympy.ceiling: np.ceil,
    minimum: np.minimum, maximum: np.maximum,
    sympy.Min: lambda *values: functools.reduce(np.minimum, values),
    sympy.Max: lambda *values: functools.reduce(np.maximum, values), sympy.Pow: np.power,
    sympy.Gt: np.greater, sympy.Ge: np.greater_equal, sympy.Lt: np.less, sympy.Le: np.less_equal,
    sympy.Eq: np.equal, sympy.Ne: np.not_equal, sympy.Not: np.logical_not,
}  # fmt: skip


class NoFloatError(LookupError):
    """A part of an expression whose value is not known: a table that is not given, a function that no law may use."""


def float_value(expression: Expr, values: Mapping[Symbol, Any], tables: Mapping[str, TableValue] | None = None) -> Any:
    """The value of an expression in floats, or of a condition.

    Overflow and undefined operations give inf and nan, as in a generated module; a switch is a smooth step.

    Parameters
    ----------
    expression
        In the vocabulary of laws.
    values
        Of all symbols in it.
    tables
        By name.

    Raises
    ------
    NoFloatError
        With the part that has no value.

    Examples
    --------
    >>> x = sympy.Symbol("x", real=True)
    >>> float(float_value(sympy.sqrt(x) + 1, {x: 4.0})), float(float_value(sympy.sin(x**1e9), {x: 4.0}))
    (3.0, nan)
    """
    with np.errstate(all="ignore"):
        return _value(expression, values, tables or {})


def _value(node: Any, values: Mapping[Symbol, Any], tables: Mapping[str, TableValue]) -> Any:
    if isinstance(node, Symbol):
        if node not in values:
            raise NoFloatError(node)
        return np.float64(values[node])
    if isinstance(node, sympy.Add):
        return sum(_value(term, values, tables) for term in node.args)
    if isinstance(node, sympy.Mul):
        return np.prod([_value(factor, values, tables) for factor in node.args])
    if isinstance(node, sympy.Number | sympy.NumberSymbol):
        return np.float64(node)
    if isinstance(node, sympy.Piecewise):
        chosen = (branch for branch, condition in node.args if _value(condition, values, tables))
        return _value(next(chosen, sympy.nan), values, tables)
    if isinstance(node, switch):
        return _value(smooth_step(*node.args), values, tables)
    if isinstance(node, delay):  # at rest
        return _value(node.args[0], values, tables)
    if isinstance(node, sympy.And | sympy.Or):
        return (all if isinstance(node, sympy.And) else any)(_value(part, values, tables) for part in node.args)
    if node in (sympy.true, sympy.false):
        return bool(node)
    arguments = [_value(argument, values, tables) for argument in node.args]
    if isinstance(node, TableFunction) and node.table_name in tables:
        return tables[node.table_name](arguments, node.derivative or (0,) * len(arguments))
    function = _UFUNCS.get(node.func)
    if function is None:
        raise NoFloatError(node)
    return function(*arguments)
