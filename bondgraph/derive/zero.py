"""Exact decisions: whether an expression vanishes identically, whether a matrix of expressions is regular.

Nothing is decided by comparing a float with zero. A rational expression is evaluated at random points in a field of
prime order, where a non-zero one vanishes with a probability below degree/2**61 (Schwartz 1980, J. ACM 27(4)). Where
there are other functions they are first taken for unknowns of their own: if the expression vanishes even so, it is
zero; if not, interval arithmetic at a point proves that it is not zero (the interval excludes zero), or sympy
simplifies it.
"""

from __future__ import annotations

import functools
import operator
import random
import sys
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import mpmath
import sympy
from sympy import Add, Expr, Mul, Pow, Rational

from bondgraph.declare.functions import maximum, minimum

_PRIME = (1 << 61) - 1
_TRIALS = 3
_POINTS = 8
_PRECISION = 60
#: The largest float.
_LARGEST = sys.float_info.max


def is_zero(expression: Expr) -> bool:
    """Whether an expression vanishes identically.

    Examples
    --------
    >>> a, b = sympy.symbols("a b", real=True)
    >>> is_zero((a + b) ** 2 - a**2 - 2 * a * b - b**2), is_zero(a - b)
    (True, False)
    >>> is_zero(sympy.sin(a) ** 2 + sympy.cos(a) ** 2 - 1), is_zero(1 - sympy.tanh(a) ** 2)
    (True, False)
    """
    return ZeroTest().is_zero(expression)


class ZeroTest:
    """Decides about expressions in symbols some of which stand for other expressions.

    Examples
    --------
    >>> a, b, gain = sympy.symbols("a b gain", real=True)
    >>> test = ZeroTest()
    >>> test.define(gain, a * b / (a * b + a) * (1 + 1 / b))
    >>> test.is_zero(1 - gain)
    True
    """

    def __init__(self) -> None:
        self._definitions: list[tuple[Expr, Expr]] = []
        self._fields = [_Field(trial) for trial in range(_TRIALS)]
        self._intervals: dict[int, _Interval] = {}

    def define(self, symbol: Expr, value: Expr) -> None:
        """Let a symbol stand for an expression in symbols defined before it."""
        self._definitions.append((symbol, value))

    def is_zero(self, expression: Expr) -> bool:
        """Whether the expression vanishes identically."""
        if expression.is_Number:
            return bool(expression == 0)
        for field in self._fields:
            field.functions = False
            field.learn(self._definitions)
        try:
            values = [field.value(expression) for field in self._fields]
        except ZeroDivisionError:
            return self._simplifies_to_zero(expression)
        if not any(values):
            return True
        if not any(field.functions or field.learned_functions for field in self._fields):
            return False
        return not self._proven_not_zero(expression) and self._simplifies_to_zero(expression)

    def _simplifies_to_zero(self, expression: Expr) -> bool:
        known: dict[Expr, Expr] = {}
        for symbol, value in self._definitions:
            known[symbol] = value.xreplace(known)
        return bool(sympy.simplify(expression.xreplace(known)) == 0)

    def _proven_not_zero(self, expression: Expr) -> bool:
        """Whether the interval of values at some point excludes zero."""
        previous, mpmath.iv.dps = mpmath.iv.dps, _PRECISION
        try:
            return any(self._excludes_zero(expression, trial) for trial in range(_POINTS))
        finally:
            mpmath.iv.dps = previous

    def _excludes_zero(self, expression: Expr, trial: int) -> bool:
        interval = self._intervals.setdefault(trial, _Interval(trial))
        try:
            interval.learn(self._definitions, expression)
            value = interval.value(expression)
        except (_UnboundedError, ZeroDivisionError, ValueError, OverflowError, mpmath.libmp.ComplexResult):
            return False
        return isinstance(value, mpmath.ctx_iv.ivmpf) and bool(value > 0 or value < 0)


def is_regular(matrix: list[list[Expr]]) -> bool:
    """Whether a square matrix of expressions has an inverse (functions other than rational ones count as independent).

    Examples
    --------
    >>> a, b = sympy.symbols("a b", real=True)
    >>> is_regular([[a, b], [b, a]]), is_regular([[a, b], [2 * a, 2 * b]])
    (True, False)
    """
    for trial in range(_TRIALS):
        field = _Field(trial)
        try:
            rows = [[field.value(entry) for entry in row] for row in matrix]
        except ZeroDivisionError:
            continue
        if _has_full_rank(rows):
            return True
    return False


def _has_full_rank(rows: list[list[int]]) -> bool:
    for column in range(len(rows)):
        pivot = next((row for row in rows[column:] if row[column]), None)
        if pivot is None:
            return False
        rows.remove(pivot)
        rows.insert(column, pivot)
        reciprocal = _reciprocal(pivot[column])
        for row in rows[column + 1 :]:
            ratio = row[column] * reciprocal % _PRIME
            row[:] = [(a - ratio * b) % _PRIME for a, b in zip(row, pivot, strict=True)]
    return True


class _Field:
    """Values in the integers modulo a prime; equal symbols and functions get equal random ones."""

    def __init__(self, trial: int) -> None:
        self.random = random.Random(trial)
        self.known: dict[Expr, int] = {}
        self.functions = self.learned_functions = False
        self.learned = 0

    def learn(self, definitions: list[tuple[Expr, Expr]]) -> None:
        """Take over what symbols stand for."""
        for symbol, value in definitions[self.learned :]:
            try:
                self.known[symbol] = self.value(value)
            except ZeroDivisionError:
                self.known[symbol] = self.random.randrange(1, _PRIME)
        self.learned = len(definitions)
        self.learned_functions |= self.functions
        self.functions = False

    def value(self, expression: Expr) -> int:
        """The expression's value; raises ZeroDivisionError where it has none at this point."""
        if expression not in self.known:
            self.known[expression] = self._compute(expression) % _PRIME
        return self.known[expression]

    def _compute(self, expression: Expr) -> int:
        if expression.is_Float or isinstance(expression, Rational):
            exact = Fraction(float(expression)) if expression.is_Float else Fraction(expression.p, expression.q)
            return exact.numerator * _reciprocal(exact.denominator)
        if isinstance(expression, Add):
            return sum(map(self.value, expression.args))
        if isinstance(expression, Mul):
            value = 1
            for factor in expression.args:
                value = value * self.value(factor) % _PRIME
            return value
        if isinstance(expression, Pow) and expression.exp.is_Integer:
            base, exponent = self.value(expression.base), int(expression.exp)
            return pow(base if exponent > 0 else _reciprocal(base), abs(exponent), _PRIME)
        self.functions |= not expression.is_Symbol
        return self.random.randrange(1, _PRIME)


def _reciprocal(value: int) -> int:
    if value % _PRIME == 0:
        raise ZeroDivisionError
    return pow(value, -1, _PRIME)


# ---------------------------------------------------------------------- intervals


class _UnboundedError(Exception):
    """A value that an interval cannot enclose, or a comparison that it cannot decide."""


class _Interval:
    """Values enclosed in intervals, at a point drawn for each trial."""

    def __init__(self, trial: int) -> None:
        self.draw, self.signed = random.Random(trial), trial % 2
        self.point: dict[Expr, Any] = {}

    def learn(self, definitions: list[tuple[Expr, Expr]], wanted: Expr) -> None:
        """Take over what symbols stand for on which an expression depends; one without a value here has none."""
        needed = set(wanted.free_symbols)
        for symbol, value in reversed(definitions):
            if symbol in needed:
                needed |= value.free_symbols
        for symbol, value in definitions:
            if symbol not in needed or symbol in self.point:
                continue
            try:
                self.point[symbol] = self.value(value)
            except (_UnboundedError, ZeroDivisionError, ValueError, OverflowError, mpmath.libmp.ComplexResult):
                self.point[symbol] = mpmath.iv.mpf([-mpmath.inf, mpmath.inf])

    def value(self, expression: Expr) -> Any:
        if expression not in self.point:
            self.point[expression] = self._compute(expression)
        return self.point[expression]

    def _drawn(self) -> Any:
        return mpmath.iv.mpf(self.draw.randrange(1, 64)) / 32 * (-1) ** (self.signed * self.draw.randrange(2))

    def _compute(self, expression: Expr) -> Any:
        if expression.is_Symbol:
            return self._drawn()
        if isinstance(expression, Rational):
            return mpmath.iv.mpf(expression.p) / expression.q
        if expression.is_Float:
            return mpmath.iv.mpf(float(expression))
        if expression is sympy.pi:
            return +mpmath.iv.pi
        if isinstance(expression, sympy.Piecewise):
            return self.value(next(value for value, condition in expression.args if self._holds(condition)))
        values = [self.value(argument) for argument in expression.args]
        if isinstance(expression, Add):
            return sum(values[1:], values[0])
        if isinstance(expression, Mul):
            return functools.reduce(operator.mul, values)
        if isinstance(expression, Pow):
            return values[0] ** (int(expression.exp) if expression.exp.is_Integer else values[1])
        rule = _ENCLOSED.get(type(expression))
        return self._drawn() if rule is None else rule(*values)

    def _holds(self, condition: Any) -> bool:
        if condition in (sympy.true, sympy.false):
            return bool(condition)
        if isinstance(condition, sympy.And | sympy.Or | sympy.Not):
            return bool(condition.func(*(sympy.sympify(self._holds(part)) for part in condition.args)))
        compare = _COMPARED.get(type(condition))
        found = None if compare is None else compare(self.value(condition.lhs), self.value(condition.rhs))
        if found is None:
            raise _UnboundedError
        return bool(found)


def _chosen(take_first: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    def choose(a: Any, b: Any) -> Any:
        first = take_first(a, b)
        if first is None:
            raise _UnboundedError
        return a if first else b

    return choose


def _sign(value: Any) -> Any:
    if value > 0 or value < 0:
        return mpmath.iv.mpf(1 if value > 0 else -1)
    raise _UnboundedError


def _periodic(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A function that is asked for no larger argument than a float: its period must be known to all digits of that."""

    def enclosed(value: Any) -> Any:
        if not abs(value) < _LARGEST:
            raise _UnboundedError
        return function(value)

    return enclosed


def _tanh(value: Any) -> Any:
    grown = mpmath.iv.exp(2 * value)
    return (grown - 1) / (grown + 1)


_ENCLOSED: dict[type, Callable[..., Any]] = {
    sympy.sin: _periodic(mpmath.iv.sin), sympy.cos: _periodic(mpmath.iv.cos), sympy.tan: _periodic(mpmath.iv.tan),
    sympy.exp: mpmath.iv.exp, sympy.log: mpmath.iv.log, sympy.tanh: _tanh,
    sympy.cosh: lambda x: (mpmath.iv.exp(x) + mpmath.iv.exp(-x)) / 2,
    sympy.sinh: lambda x: (mpmath.iv.exp(x) - mpmath.iv.exp(-x)) / 2,
    sympy.sign: _sign, sympy.Abs: lambda x: _sign(x) * x,
    minimum: _chosen(lambda a, b: a < b), maximum: _chosen(lambda a, b: a > b),
}  # fmt: skip
_COMPARED: dict[type, Callable[[Any, Any], Any]] = {
    sympy.StrictLessThan: lambda a, b: a < b, sympy.LessThan: lambda a, b: a <= b,
    sympy.StrictGreaterThan: lambda a, b: a > b, sympy.GreaterThan: lambda a, b: a >= b,
}  # fmt: skip
