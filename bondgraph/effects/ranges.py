"""Ranges that end: ceilings of what is given or shown, floors of what is shown, and how sharply they end."""

from __future__ import annotations

from sympy import Expr

from bondgraph.declare.effect import SMOOTHING
from bondgraph.declare.graph import BondGraph

#: Bounds of the number that says how sharply a ceiling or floor ends: a hyperbolic tangent is about 2.7, 20 a corner.
SHARPNESS = (2.0, 20.0)
#: Square of a share of a ceiling below which the slope of its sharpness does not matter: a logarithm needs a number.
_AT_REST = SMOOTHING**8


def ceiling(value: Expr, c: Expr, n: Expr) -> Expr:
    """A value that nears 1/c and never exceeds it, the more sharply the larger n is; itself where c is zero.

    Examples
    --------
    >>> from sympy import Float, Integer, Rational
    >>> round(float(ceiling(Float(1), Integer(0), Integer(2))), 9)
    1.0
    >>> round(float(ceiling(Float(100), Rational(1, 2), Integer(4))), 6)
    2.0
    """
    return value / (1 + ((c * value) ** 2 + _AT_REST) ** (n / 2)) ** (1 / n)


def floor(value: Expr, c: Expr, n: Expr) -> Expr:
    """A value, plus what a floor c adds to its size, which is then never less than c; itself where c is zero.

    Both are shares of one size. With n = 2 sizes add like noises, with n = 4 like radiations; a large n is a corner.

    Examples
    --------
    >>> from sympy import Float, Integer
    >>> round(float(floor(Float(0.3), Float(0.4), Integer(2))), 9)
    0.5
    >>> round(float(floor(Float(-0.3), Integer(0), Integer(4))), 9)
    -0.3
    """
    size = (value**2 + _AT_REST) ** (n / 2)
    return value + (size + (c**2 + _AT_REST) ** (n / 2)) ** (1 / n) - (size + _AT_REST ** (n / 2)) ** (1 / n)


def sharpness(g: BondGraph, name: str) -> Expr:
    """The number that says how sharply a range ends, from a root of squares to a corner."""
    return g.parameter(name, 3.0, "1", "how sharply it ends", SHARPNESS)
