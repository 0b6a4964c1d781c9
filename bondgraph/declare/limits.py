"""Limits of what a declaration may hold, so that no file keeps a reader busy for ever or gives equations no value.

Files come from anywhere. What they say is bounded before it is worked on: the size and nesting of files and laws, and
numbers in laws, each of which must be a finite real one, as every number of a model is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from sympy import Expr, Float, Function, I, Piecewise, Pow, Rational, Symbol, nan, oo, zoo

from bondgraph.declare.floats import NoFloatError, float_value
from bondgraph.errors import DeclarationError

#: Letters of one law; the longest of the corrected vehicle models has some thousands.
LONGEST_LAW = 50_000
#: Calls and parentheses inside each other: assumptions are asked of every level by those around it.
DEEPEST_LAW = 40
#: Objects and lists inside each other in a graph file; a part inside a part takes three.
DEEPEST_FILE = 100
#: Parts inside each other.
DEEPEST_PART = 30
#: Ports of one element.
MOST_PORTS = 200
#: Binary digits of the largest float, and of the reciprocal of the smallest.
_MOST_BITS = 1075


class NoValueError(ValueError):
    """A part of a law is no finite real number."""


def check_law_text(text: str) -> None:
    """Refuse a law that is too long or nested too deeply.

    Raises
    ------
    OverflowError, RecursionError
        With what is too large.

    Examples
    --------
    >>> check_law_text("(" * 50 + "flow" + ")" * 50)
    Traceback (most recent call last):
        ...
    RecursionError: it is nested more than 40 deep
    """
    if len(text) > LONGEST_LAW:
        raise OverflowError(f"it has {len(text)} letters, at most {LONGEST_LAW} are read")
    depth = 0
    for letter in text:
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if depth > DEEPEST_LAW:
            raise RecursionError(f"it is nested more than {DEEPEST_LAW} deep")


def check_nesting(data: Any, where: str) -> None:
    """Refuse a file whose objects and lists stand too deeply inside each other.

    Examples
    --------
    >>> nested = []
    >>> for _ in range(200):
    ...     nested = [nested]
    >>> check_nesting(nested, "motor.json")
    Traceback (most recent call last):
        ...
    bondgraph.errors.DeclarationError: motor.json: is nested more than 100 deep - put fewer parts into parts
    """
    level, depth = [data], 0
    while level := [inner for value in level for inner in _inside(value)]:
        depth += 1
        if depth > DEEPEST_FILE:
            raise DeclarationError(
                f"{where}: is nested more than {DEEPEST_FILE} deep - put fewer parts into parts", where=(where,)
            )


def _inside(value: Any) -> Iterable[Any]:
    if isinstance(value, Mapping):
        return value.values()
    return value if isinstance(value, list) else ()


def power(base: Expr, exponent: Expr) -> Expr:
    """A power; of two numbers only where a float can hold it."""
    if isinstance(base, Rational) and exponent.is_Number and base not in (0, 1, -1):
        size = max(abs(math.log2(abs(base.p))), math.log2(base.q))
        if abs(float(exponent)) * max(size, 1.0) > _MOST_BITS:
            raise OverflowError("a number in it is too large for any float")
    elif base.is_number and exponent.is_number and abs(exponent) > _MOST_BITS:
        raise OverflowError("a number in it is too large for any float")
    return base**exponent


def bounded(value: Any) -> Any:
    """The same value, if it is no number, or one that is finite, real and no larger than a float.

    Raises
    ------
    OverflowError
        If it is too large.
    NoValueError
        If it is infinite, undefined or complex.

    Examples
    --------
    >>> from sympy import asin, pi
    >>> bounded(pi / 4)
    pi/4
    >>> bounded(asin(3))
    Traceback (most recent call last):
        ...
    bondgraph.declare.limits.NoValueError: asin(3) is not a finite real number
    """
    if isinstance(value, Rational):
        if max(value.p.bit_length(), value.q.bit_length()) > _MOST_BITS:
            raise OverflowError("a number in it is too large for any float")
    elif isinstance(value, Expr) and value.is_number:
        number = value if isinstance(value, Float) else value.evalf(15)
        if number.has(nan, oo, -oo, zoo, I):  # tables and switches of numbers stay as they are
            raise NoValueError(f"{value} is not a finite real number")
        if isinstance(number, Float) and not math.isfinite(float(number)):
            raise OverflowError("a number in it is too large for any float")
    return value


def check_numbers(law: Expr) -> None:
    """Refuse a law with a number that is not finite and real; errors are those of :func:`bounded`."""
    stack: list[Any] = [law]
    while stack:
        part = stack.pop()
        if getattr(part, "is_number", False):
            bounded(part)
        else:
            stack += part.args


def unreal_part(law: Expr, values: Mapping[Symbol, float]) -> Expr | None:
    """A root, logarithm or other function of parameters alone that is not real at their declared values, else None.

    Branches of a law may not be taken there, and are not looked at.

    Examples
    --------
    >>> from sympy import sqrt
    >>> m, v = Symbol("m", real=True), Symbol("v", real=True)
    >>> unreal_part(v * sqrt(-m), {m: 2.0}), unreal_part(v * sqrt(m), {m: 2.0})
    (sqrt(-m), None)
    """
    for part in _outside_branches(law):
        used = part.free_symbols
        if not used or not used <= values.keys():
            continue
        if isinstance(part, Function) or (isinstance(part, Pow) and not part.exp.is_integer):
            try:
                given = [float_value(argument, values) for argument in part.args]
                value = float_value(part, values)
            except NoFloatError:
                continue
            if math.isnan(value) and all(map(math.isfinite, given)):
                return part
    return None


def _outside_branches(law: Any) -> Iterator[Any]:
    stack = [law]
    while stack:
        part = stack.pop()
        yield part
        if not isinstance(part, Piecewise):
            stack += part.args
