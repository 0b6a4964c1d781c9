"""Text of expressions for people: what it says is what the expression is, in marks that are no Python."""

from __future__ import annotations

import itertools
import re

import pytest
import sympy
from sympy import Abs, Float, Max, Min, Piecewise, Rational, exp, sign, sqrt, symbols, tanh

from bondgraph.declare.functions import maximum, minimum
from bondgraph.declare.read_text import PLAIN, TYPESET, read_text

C, R, W, X, Y = symbols("c r w x y")
PARTS = (
    C, -X, X * Y, X / Y, X + Y, C - X, X**2, X**-2, sqrt(X), 1 / sqrt(X), Abs(X), Abs(X - Y) ** 1.5, sign(X),
    tanh(X / W), exp(-((X / W) ** 2)), Rational(3, 4) * X, Float(0.25), (X + Y) ** Y,
)  # fmt: skip


def read_back(text: str) -> sympy.Expr:
    """The expression that a text says; bars are not nested in it."""
    python = re.sub(r"\|([^|]*)\|", r"Abs(\1)", text).replace("^", "**")
    return sympy.sympify(python, {one.name: one for one in (C, R, W, X, Y)})


@pytest.mark.parametrize("first", PARTS, ids=str)
def test_what_is_read_is_what_is_meant(first: sympy.Expr) -> None:
    at = {C: 1.3, R: 0.7, W: 0.9, X: 1.7, Y: 2.3}
    for second, make in itertools.product(PARTS, (sympy.Add, sympy.Mul, lambda a, b: a / b, lambda a, b: a - b)):
        law = make(first, second)
        said = read_back(read_text(law, digits=17))
        assert float(said.subs(at)) == pytest.approx(float(law.subs(at)), rel=1e-12), read_text(law)


@pytest.mark.parametrize(("law", "plain", "typeset"), [
    (Abs(X) * C, "c*|x|", "c·|x|"),
    (sign(W) * Abs(W) ** 1.5 * C, "c*|w|^1.5*sign(w)", "c·|w|^1.5·sign(w)"),
    (-C * X**2 / Y, "-c*x^2/y", "-c·x²/y"),
    (C * X / (W * Y), "c*x/(w*y)", "c·x/(w·y)"),
    (X ** Rational(1, 4), "x^(1/4)", "x^(1/4)"),
    (1 / sqrt(X), "1/sqrt(x)", "1/sqrt(x)"),
    (exp(-((X / W) ** 2)), "exp(-x^2/w^2)", "exp(-x²/w²)"),
    (maximum(X, 0) - minimum(X, Y), "max(x, 0) - min(x, y)", "max(x, 0) - min(x, y)"),
    (Max(X, Y) + Min(X, Y), "max(x, y) + min(x, y)", "max(x, y) + min(x, y)"),
    (Piecewise((X, X > 0), (0, True)), "(x if x > 0 else 0)", "(x if x > 0 else 0)"),
    (Float(0.0123456789) * X, "0.0123457*x", "0.0123457·x"),
], ids=str)  # fmt: skip
def test_laws_are_read_in_both_notations(law: sympy.Expr, plain: str, typeset: str) -> None:
    assert (read_text(law, PLAIN), read_text(law, TYPESET)) == (plain, typeset)
    assert "**" not in read_text(law) and "Abs" not in read_text(law) and read_text(law).isascii()
