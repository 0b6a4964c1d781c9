"""Derivatives of expressions of real quantities, ready to be printed.

sympy's own differentiation allows for complex arguments and so leaves conjugates, Dirac pulses and unevaluated
derivatives behind ``Abs`` and ``sign``; here a kink has the slope of one of its sides and a step has slope zero.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping

import sympy
from sympy import Expr, Symbol

_STEPS = (sympy.sign, sympy.floor, sympy.ceiling)


def derivative(expression: Expr, seeds: Mapping[Symbol, Expr]) -> Expr:
    """Derivative of an expression along a direction.

    Parameters
    ----------
    expression
        In real symbols.
    seeds
        Derivative of each symbol that varies; the others are constant.

    Examples
    --------
    >>> v, k = sympy.symbols("v k", real=True)
    >>> derivative(k * v * sympy.Abs(v), {v: sympy.S.One})
    k*v*sign(v) + k*Abs(v)
    """
    memo: dict[Expr, Expr] = {}

    def walk(node: Expr) -> Expr:
        if node not in memo:
            memo[node] = _rule(node)
        return memo[node]

    def _rule(node: Expr) -> Expr:
        if isinstance(node, Symbol):
            return seeds.get(node, sympy.S.Zero)
        if not node.args or isinstance(node, _STEPS):
            return sympy.S.Zero
        if isinstance(node, sympy.Add):
            return sympy.Add(*map(walk, node.args))
        if isinstance(node, sympy.Mul):
            return _product(node.args, tuple(map(walk, node.args)))
        if isinstance(node, sympy.Pow):
            return _power(node, walk(node.base), walk(node.exp))
        if isinstance(node, sympy.Piecewise):
            return sympy.Piecewise(*((walk(value), condition) for value, condition in node.args))
        if isinstance(node, sympy.Min | sympy.Max):
            return walk(_nested(node))
        slopes = [(index, walk(argument)) for index, argument in enumerate(node.args, start=1)]
        return sympy.Add(*(node.fdiff(index) * slope for index, slope in slopes if slope != 0))

    return walk(expression)


def _product(factors: tuple[Expr, ...], slopes: tuple[Expr, ...]) -> Expr:
    terms = []
    for index, slope in enumerate(slopes):
        if slope != 0:
            terms.append(sympy.Mul(*factors[:index], slope, *factors[index + 1 :]))
    return sympy.Add(*terms)


def _power(node: Expr, base_slope: Expr, exponent_slope: Expr) -> Expr:
    result = sympy.S.Zero
    if base_slope != 0:
        result += node.exp * node.base ** (node.exp - 1) * base_slope
    if exponent_slope != 0:
        result += node * sympy.log(node.base) * exponent_slope
    return result


def _nested(node: Expr) -> Expr:
    """An extremum of many values as nested choices between two."""
    ordered = sorted(node.args, key=sympy.default_sort_key)
    if isinstance(node, sympy.Min):
        return functools.reduce(lambda a, b: sympy.Piecewise((a, a <= b), (b, True)), ordered)
    return functools.reduce(lambda a, b: sympy.Piecewise((a, a >= b), (b, True)), ordered)
