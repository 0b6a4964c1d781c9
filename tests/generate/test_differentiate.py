"""Derivatives against finite differences of high precision."""

from __future__ import annotations

import pytest
import sympy
from sympy import Float, Integer, Rational

from bondgraph.declare.functions import maximum, minimum, table_function
from bondgraph.declare.quantities import symbol
from bondgraph.generate.differentiate import derivative

a, b = symbol("a"), symbol("b")
POINTS = ((0.7, -1.3), (-0.4, 0.9), (1.6, 2.1))
FUNCTIONS = ("sin", "cos", "tan", "sinh", "cosh", "tanh", "asinh", "atan", "exp", "Abs")


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_of_one_argument(name: str) -> None:
    _compare(getattr(sympy, name)(a * b + a / 3))


@pytest.mark.parametrize(
    "expression",
    [
        a**3 * b / (1 + a**2) - b,
        (1 + a**2) ** b,
        sympy.sqrt(2 + a) * sympy.log(3 + a * b / 4),
        (3 + a) ** Rational(-3, 2) + (3 + b) ** Float(0.7) * a,
        sympy.asin(sympy.tanh(a)) + sympy.acos(sympy.tanh(a * b)) + sympy.atanh(sympy.sin(a) / 2) + sympy.acosh(4 + a),
        sympy.atan2(a, b) * sympy.atan2(b, 1 + a**2),
        minimum(a, b) * maximum(a * b, b) + sympy.Min(a, b, 1) * sympy.Max(a, b, -1, b**2),
        sympy.Piecewise((a**2, a > b), (sympy.sin(a * b), sympy.And(a < 0, b > 0)), (b, True)),
        sympy.sign(a) * a * b + sympy.floor(a) * b + sympy.ceiling(b) * a**2,
        sympy.Abs(sympy.sqrt(2 + a) - b),
        Integer(7),
    ],
)
def test_laws(expression: sympy.Expr) -> None:
    _compare(expression)


def test_a_direction_seeds_several_symbols() -> None:
    assert derivative(a * b, {a: Integer(2), b: symbol("db")}) == 2 * b + a * symbol("db")
    assert derivative(a * b, {}) == 0


def test_tables_give_their_slope() -> None:
    table = table_function("map", 2)
    assert str(derivative(table(a, 2 * b), {b: Integer(1)})) == "2*map_d2(a, 2*b)"


def _compare(expression: sympy.Expr) -> None:
    step = Float("1e-20", 60)
    for variable in (a, b):
        slope = derivative(expression, {variable: Integer(1)})
        for point in POINTS:
            values = {a: Float(point[0], 60), b: Float(point[1], 60)}
            ahead, behind = ({**values, variable: values[variable] + s} for s in (step, -step))
            difference = (expression.subs(ahead) - expression.subs(behind)).evalf(60) / (2 * step)
            assert float(slope.subs(values)) == pytest.approx(float(difference), rel=1e-9, abs=1e-12)
