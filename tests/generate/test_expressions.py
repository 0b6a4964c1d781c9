"""Printed text: what it looks like, that it means what the expression means, and that it never changes."""

from __future__ import annotations

import operator
import os
import subprocess
import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sympy import Float, Integer, Rational

from bondgraph.declare.functions import clip, maximum, minimum, table_function
from bondgraph.declare.quantities import symbol
from bondgraph.errors import GenerationError
from bondgraph.generate.expressions import ExpressionPrinter

NAMES = ("c_d", "rho", "k", "b", "x_1", "v", "w", "F")
c_d, rho, k, b, x_1, v, w, F = map(symbol, NAMES)


def printed(expression: sympy.Expr) -> str:
    return ExpressionPrinter({name: name for name in NAMES}).text(expression)


@pytest.mark.parametrize(
    ("expression", "text"),
    [
        (c_d * rho * v * sympy.Abs(v) / 2, "(1/2)*c_d*rho*v*np.abs(v)"),
        (F - k * x_1 - b * v, "F - k*x_1 - b*v"),
        (-k * x_1 - b * v, "-k*x_1 - b*v"),
        (1 - sympy.exp(-v), "1 - np.exp(-v)"),
        (v - 1, "v - 1"),
        (k / b, "k/b"),
        (k / (b * v), "k/(b*v)"),
        (1 / k, "1/k"),
        (1 / (2 * k), "1/(2*k)"),
        (-2 * v / (3 * k), "-(2/3)*v/k"),
        (k / v**2, "k/v**2"),
        (k / sympy.sqrt(v), "k/np.sqrt(v)"),
        (v ** Rational(3, 2), "v**(3/2)"),
        (v ** Float(2.0), "v**2"),
        (v ** Float(-1.5), "1/v**1.5"),
        (v ** Float(0.5), "np.sqrt(v)"),
        (v ** (-k), "v**(-k)"),
        ((v + w) ** 2, "(v + w)**2"),
        (k * (x_1 - v) / (w - v), "k*(x_1 - v)/(w - v)"),
        (sympy.Mul(k, sympy.Mul(b, v), evaluate=False), "k*(b*v)"),
        (sympy.Add(k, sympy.Add(v, w, evaluate=False), evaluate=False), "k + (v + w)"),
        (sympy.pi * v, "np.pi*v"),
        (Float(1e-20) * v, "1e-20*v"),
        (Integer(10) ** 20 * v, "1e+20*v"),
        (Integer(3), "3.0"),
        (Rational(-1, 3), "-1/3"),
        (-sympy.oo, "-np.inf"),
        (sympy.atan2(v, 2 * w), "np.arctan2(v, 2*w)"),
        (clip(v, 0, k), "np.minimum(np.maximum(v, 0.0), k)"),
        (sympy.Min(v, 3, w), "np.minimum(np.minimum(v, w), 3.0)"),
        (sympy.ceiling(v), "-np.floor(-v)"),
        (sympy.Piecewise((1, v > 0), (w**2, v < -1), (0, True)), "np.where(v > 0, 1.0, np.where(v < -1, w**2, 0.0))"),
        (sympy.Piecewise((v, v > 0)), "np.where(v > 0, v, np.nan)"),
        (
            sympy.Piecewise((v, sympy.Not(sympy.And(v > 0, sympy.Or(w > 1, k < 2)))), (0, True)),
            "np.where((v <= 0) | ((k >= 2) & (w <= 1)), v, 0.0)",
        ),
        (sympy.Piecewise((v, sympy.Xor(v > 0, w > 0)), (0, True)), None),
    ],
)
def test_text_reads_like_the_law(expression: sympy.Expr, text: str | None) -> None:
    if text is None:
        assert eval(printed(expression), {"np": np, "v": 2.0, "w": -1.0}) == 2.0
        assert eval(printed(expression), {"np": np, "v": 2.0, "w": 1.0}) == 0.0
    else:
        assert printed(expression) == text


def test_terms_stand_in_order_of_declaration_not_of_the_alphabet() -> None:
    zeta, alpha = symbol("zeta"), symbol("alpha")
    printer = ExpressionPrinter({"zeta": "zeta", "alpha": "alpha"})
    assert printer.text(alpha + zeta) == "zeta + alpha"
    assert printer.text(alpha * zeta) == "zeta*alpha"


def test_tables_and_their_slopes_have_their_stem() -> None:
    printer = ExpressionPrinter({"v": "v", "w": "w"}, table_stems={"map": "_table_map"})
    surface = table_function("map", 2)(v, w)
    assert printer.text(surface) == "_table_map(v, w)"
    assert printer.text(surface.diff(w)) == "_table_map_d2(v, w)"
    assert printer.text(surface.diff(v).diff(w)) == "_table_map_d12(v, w)"
    assert list(printer.used_tables) == [("map", (0, 0)), ("map", (0, 1)), ("map", (1, 1))]


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        (symbol("F_drge"), r"'F_drge' is used but neither declared nor computed before; did you mean 'F_drag'\?"),
        (sympy.gamma(v), "gamma.* cannot be printed"),
        (sympy.zoo, "zoo cannot be printed"),
        (sympy.Integral(v, w), "Integral has no numpy form"),
        (table_function("torqe")(v), r"table 'torqe' is used but not declared; did you mean 'torque'\?"),
        (sympy.Piecewise((v, sympy.Not(sympy.Symbol("on"))), (w, True)), "Not has no numpy form"),
    ],
)
def test_what_cannot_be_printed_is_refused(expression: sympy.Expr, message: str) -> None:
    printer = ExpressionPrinter({"F_drag": "F_drag", "v": "v", "w": "w"}, table_stems={"torque": "_t"}, where="car")
    with pytest.raises(GenerationError, match=message) as caught:
        printer.text(expression)
    assert str(caught.value).startswith("car: ")


# -- any expression of the vocabulary means the same in sympy and in numpy --------------------------------------------
#
# Every expression is built twice by the same function: from sympy's functions as an expression, and from mpmath's with
# thirty digits as its value at some points. sympy's own evaluation is not used.

SYMBOLS = tuple(symbol(name) for name in ("p", "q", "r"))
POINTS = np.random.default_rng(12).uniform(-3, 3, (4, 3))


class Node(NamedTuple):
    """An expression, its values at the points, the largest value of any part of it, and how deep it is nested."""

    expression: sympy.Expr
    values: tuple[mpmath.mpf, ...]
    scale: float
    depth: int = 0


def _choice_of_sympy(*branches: Any) -> sympy.Expr:
    *chosen, last = branches
    return sympy.Piecewise(*chosen, (last, True), evaluate=False)  # its simplification may take minutes


def _choice_of_numbers(*branches: Any) -> Any:
    *chosen, last = branches
    return next((value for value, condition in chosen if condition), last)


def _clear(distance: mpmath.mpf) -> mpmath.mpf:
    """The distance from a jump, refused where rounding could decide on which side it is."""
    if abs(distance) < 1e-9:
        raise ValueError("too close to a jump")
    return distance


_SAME_NAMES = ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "exp")
SYMPY = SimpleNamespace(
    **{name: getattr(sympy, name) for name in (*_SAME_NAMES, "log", "sqrt", "atan2", "sign", "floor", "ceiling")},
    **{name: getattr(sympy, name) for name in ("Abs", "Min", "Max", "And", "Or", "Not", "Rational", "Float")},
    **{"Gt": sympy.Gt, "Ge": sympy.Ge, "Lt": sympy.Lt, "Ne": sympy.Ne, "minimum": minimum, "maximum": maximum},
    choice=_choice_of_sympy,
)
MPMATH = SimpleNamespace(
    **{name: getattr(mpmath, name) for name in (*_SAME_NAMES, "log", "sqrt", "atan2")},
    **{"Abs": abs, "Min": min, "Max": max, "minimum": min, "maximum": max},
    **{"And": lambda *c: all(c), "Or": lambda *c: any(c), "Not": operator.not_, "Float": mpmath.mpf},
    **{"Gt": lambda a, b: _clear(a - b) > 0, "Ge": lambda a, b: _clear(a - b) > 0},
    **{"Lt": lambda a, b: _clear(a - b) < 0, "Ne": lambda a, b: _clear(a - b) != 0},
    sign=lambda e: mpmath.sign(_clear(e)),
    floor=lambda e: mpmath.floor(e) + 0 * _clear(e - mpmath.nint(e)),
    ceiling=lambda e: mpmath.ceil(e) + 0 * _clear(e - mpmath.nint(e)),
    Rational=lambda p, q: mpmath.mpf(p) / q,
    choice=_choice_of_numbers,
)

Law = Callable[..., Any]
ONE_ARGUMENT: tuple[Law, ...] = (
    lambda m, e: m.sin(e),
    lambda m, e: m.cos(e),
    lambda m, e: m.atan(e),
    lambda m, e: m.tanh(e),
    lambda m, e: m.asinh(e),
    lambda m, e: m.Abs(e),
    lambda m, e: m.sign(e),
    lambda m, e: m.floor(e),
    lambda m, e: m.ceiling(e),
    lambda m, e: -e,
    lambda m, e: e**2,
    lambda m, e: e**3,
    lambda m, e: 1 / e,
    lambda m, e: e**-2,
    lambda m, e: m.tan(m.tanh(e)),
    lambda m, e: m.exp(m.tanh(e)),
    lambda m, e: m.sinh(m.sin(e)),
    lambda m, e: m.cosh(m.sin(e)),
    lambda m, e: m.log(1 + m.Abs(e)),
    lambda m, e: m.sqrt(m.Abs(e)),
    lambda m, e: 1 / m.sqrt(1 + e**2),
    lambda m, e: m.asin(m.tanh(e)),
    lambda m, e: m.acos(m.tanh(e)),
    lambda m, e: m.acosh(2 + m.Abs(e)),
    lambda m, e: m.atanh(m.sin(e) / 2),
    lambda m, e: (1 + m.Abs(e)) ** m.Rational(-3, 2),
    lambda m, e: (1 + m.Abs(e)) ** m.Float(0.7),
)
TWO_ARGUMENTS: tuple[Law, ...] = (
    lambda m, a, b: a + b,
    lambda m, a, b: a - b,
    lambda m, a, b: a * b,
    lambda m, a, b: a / b,
    lambda m, a, b: (1 + m.Abs(a)) ** m.tanh(b),
    lambda m, a, b: m.atan2(a, 2 + m.sin(b)),
    lambda m, a, b: m.minimum(a, b),
    lambda m, a, b: m.maximum(a, b),
    lambda m, a, b: m.Min(a, b, 1),
    lambda m, a, b: m.Max(a, b, -1),
    lambda m, a, b: m.choice((a, m.Gt(a, b)), b),
    lambda m, a, b: m.choice((a, m.And(m.Ge(a, 0), m.Lt(b, 1))), (b, m.Or(m.Lt(a, -1), m.Gt(b, 2))), a * b),
    lambda m, a, b: m.choice((a + 1, m.Ne(a, b)), b),
    lambda m, a, b: m.choice((a, m.Not(m.And(m.Gt(a, 0), m.Gt(b, 0)))), b),
)


def _number(expression: sympy.Expr, value: mpmath.mpf) -> Node:
    return Node(expression, (value,) * len(POINTS), float(abs(value)))


numbers = st.one_of(
    st.integers(-5, 5).map(lambda i: _number(Integer(i), mpmath.mpf(i))),
    st.builds(lambda p, q: _number(Rational(p, q), mpmath.mpf(p) / q), st.integers(-7, 7), st.integers(1, 9)),
    st.floats(-4, 4).map(lambda f: _number(Float(f), mpmath.mpf(f))),
    st.just(_number(sympy.pi, mpmath.mp.pi)),
)
variables = st.sampled_from(
    [Node(s, tuple(map(mpmath.mpf, POINTS[:, i])), float(abs(POINTS[:, i]).max())) for i, s in enumerate(SYMBOLS)]
)


def _apply(law: Law, *arguments: Node) -> Node:
    """The law of the arguments, or the first argument where the law has no moderate real value or is nested deeply."""
    depth = 1 + max(node.depth for node in arguments)
    if depth > 4:
        return arguments[0]
    with mpmath.workdps(30):
        try:
            expression = law(SYMPY, *(node.expression for node in arguments))
            values = tuple(law(MPMATH, *at) for at in zip(*(node.values for node in arguments), strict=True))
        except Exception:  # division by zero; sympy refuses what is not real, or trips over its own simplification
            return arguments[0]
    if not (expression.free_symbols or expression.is_Number):  # sympy spends minutes on signs of nested constants
        return arguments[0]
    scale = max(float(abs(value)) for value in values)
    largest = max(scale, *(node.scale for node in arguments), 1.0)
    return Node(expression, values, largest, depth) if scale < 1e3 else arguments[0]


def _grown(children: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    return st.one_of(
        st.builds(_apply, st.sampled_from(ONE_ARGUMENT), children),
        st.builds(_apply, st.sampled_from(TWO_ARGUMENTS), children, children),
    )


expressions = st.recursive(st.one_of(variables, variables, numbers), _grown, max_leaves=8)


@settings(max_examples=120, deadline=None, derandomize=True)
@given(expressions)
def test_printed_text_equals_the_expression_at_random_points(node: Node) -> None:
    _compare(node)


@pytest.mark.slow
@settings(max_examples=600, deadline=None, derandomize=True)
@given(expressions)
def test_printed_text_equals_many_expressions(node: Node) -> None:
    _compare(node)


def _compare(node: Node) -> None:
    assume(not node.expression.has(sympy.zoo, sympy.oo, -sympy.oo, sympy.nan))  # no law divides by a constant zero
    text = ExpressionPrinter({s.name: s.name for s in SYMBOLS}).text(node.expression)
    for point, value in zip(POINTS, node.values, strict=True):
        with np.errstate(all="ignore"):
            found = eval(text, {"np": np}, dict(zip((s.name for s in SYMBOLS), point, strict=True)))
        assert float(found) == pytest.approx(float(value), rel=1e-9, abs=1e-11 * node.scale**3)


# -- the same text under every hash seed ------------------------------------------------------------------------------

_SCRIPT = """
import sympy
from bondgraph.declare.quantities import symbol
from bondgraph.generate.expressions import ExpressionPrinter
names = [f"s{i}" for i in range(12)]
s = [symbol(name) for name in names]
total = sum((-1)**i * s[i] * sympy.tanh(s[i - 1] / s[i - 2]) for i in range(12))
product = sympy.prod([s[i] + s[i - 3] ** 2 for i in range(12)]) / (s[0] * s[5] * s[7])
choice = sympy.Piecewise((total, sympy.And(*(a > 0 for a in s))), (product, sympy.Or(*(a < -1 for a in s))), (0, True))
printer = ExpressionPrinter({name: name for name in names})
print(printer.text(total), printer.text(product), printer.text(choice), printer.text(sympy.Min(*s)), sep="\\n")
"""


@pytest.mark.slow
def test_text_is_the_same_under_every_hash_seed() -> None:
    texts = {
        subprocess.run(
            [sys.executable, "-c", _SCRIPT],
            env={**os.environ, "PYTHONHASHSEED": str(seed)},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for seed in range(4)
    }
    assert len(texts) == 1
    assert texts.pop().startswith("s2*np.tanh(s1/s0) + s4*np.tanh(s3/s2) + ")
