"""Expressions: safe parsing, and text that parses back to the same expression."""

from __future__ import annotations

import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.declare.expressions import (
    FUNCTIONS,
    normalise,
    parse,
    signal,
    signal_name,
    signals_in,
    to_text,
)
from bondgraph.declare.functions import clip, maximum, minimum, number, switch, table_function
from bondgraph.declare.quantities import symbol
from bondgraph.declare.sympy_text import to_sympy_text
from bondgraph.errors import DeclarationError

A, B, C, FLOW = (symbol(name) for name in ("a", "b", "c", "flow"))
NAMES = {"a": A, "b": B, "c": C, "flow": FLOW, "T": table_function("T"), "M": table_function("M", 2)}


def read(text: str) -> sympy.Expr:
    return parse(text, NAMES, "r")


leaves = st.sampled_from([A, B, C, FLOW, signal("flow", "shaft"), signal("displacement", "axle.k", 2)]) | st.one_of(
    st.integers(-3, 5).map(sympy.Integer),
    st.fractions(-2, 2, max_denominator=7).map(lambda f: sympy.Rational(f.numerator, f.denominator)),
    st.floats(-1e9, 1e9, allow_nan=False, allow_subnormal=False).map(lambda x: normalise(float(x))),
)


def combined(inner: st.SearchStrategy) -> st.SearchStrategy:
    one = st.sampled_from([sympy.sin, sympy.tanh, sympy.exp, sympy.Abs, sympy.sign, sympy.floor, table_function("T")])
    two = st.sampled_from([minimum, maximum, sympy.atan2, table_function("M", 2), switch])
    return st.one_of(
        st.builds(lambda x, y: x + y, inner, inner),
        st.builds(lambda x, y: x - y, inner, inner),
        st.builds(lambda x, y: x * y, inner, inner),
        st.builds(lambda x, y, z: sympy.Mul(x, y, z), inner, inner, inner),
        st.builds(lambda x, y: x / (y + A), inner, inner),
        st.builds(lambda x, n: x**n, inner, st.sampled_from([2, 3, -1, -2, sympy.Rational(1, 2), sympy.Float(0.7)])),
        st.builds(lambda f, x: f(x), one, inner),
        st.builds(lambda f, x, y: f(x, y), two, inner, inner),
        st.builds(lambda x, y: sympy.Piecewise((x, (A > B) & (C <= 1) | sympy.Ne(FLOW, 0)), (y, True)), inner, inner),
    )


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.recursive(leaves, combined, max_leaves=7))
def test_text_parses_back_to_the_same_expression(expression):
    if expression.has(sympy.nan, sympy.zoo, sympy.oo, sympy.I):
        return
    expression = normalise(expression)
    assert read(to_text(expression)) == expression


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a*flow + b*flow**2", A * FLOW + B * FLOW**2),
        ("max(flow, 0) - min(a, b, c)", maximum(FLOW, 0) - minimum(minimum(A, B), C)),
        ("clip(flow, -a, a)", clip(FLOW, -A, A)),
        ("a if flow > 0 else b", sympy.Piecewise((A, FLOW > 0), (B, True))),
        ("Piecewise((a, flow > 0), (b, True))", sympy.Piecewise((A, FLOW > 0), (B, True))),
        ("(a if 0 < flow <= 1 and not b > 0 or c == 0 else b)*2", None),
        ("pow(flow, 2) + ln(a) + abs(b)", FLOW**2 + sympy.log(A) + sympy.Abs(B)),
        ("+flow - -a", FLOW + A),
        ("T(flow)*M(a, b)", table_function("T")(FLOW) * table_function("M", 2)(A, B)),
        ("flow(shaft) + momentum2( axle.rotor )", signal("flow", "shaft") + signal("momentum", "axle.rotor", 2)),
        ("2*pi*a", 2 * sympy.pi * A),
        ("Heaviside(flow)", sympy.Piecewise((1, FLOW >= 0), (0, True))),
        ("Heaviside(flow, 0.5)", sympy.Piecewise((1, FLOW > 0), (0.5, sympy.Eq(FLOW, 0)), (0, True))),
        ("a*flow^3 + b^2", A * FLOW**3 + B**2),
        (
            "Piecewise((a, (flow > 0) & ~(b < 0) | Eq(a, 1)), (Mod(flow, a), Or(Gt(a, b), Not(a <= 0))), (1, True))",
            None,
        ),
        ("2*(a + b)*flow", sympy.Mul(2, A + B, FLOW)),
        ("1e-7*a + 1E7", sympy.Float(1e-7) * A + sympy.Float(1e7)),
    ],
)
def test_what_may_be_written(text, expected):
    found = read(text)
    assert expected is None or found == expected
    assert read(to_text(found)) == found


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("flow +", "cannot be read (invalid syntax)"),
        ("", "cannot be read"),
        ("flow; a", "cannot be read"),
        ("x*flow", "name 'x' is not declared"),
        ("flwo", "did you mean 'flow'?"),
        ("tanhh(flow)", "did you mean 'tanh'?"),
        ("__import__('os').system('ls')", "only names may have dots"),
        ("a.__class__", "'a.__class__' is not declared"),
        ("(lambda: 1)()", "cannot be read"),
        ("[a, b]", "List is not arithmetic"),
        ("'text'", "'text' is not a number"),
        ("a[0]", "Subscript is not arithmetic"),
        ("f'{a}'", "JoinedStr is not arithmetic"),
        ("~a", "~ is not arithmetic"),
        ("flow & a", "& and | join conditions"),
        ("a % b", "BinOp is not arithmetic"),
        ("a // b", "BinOp is not arithmetic"),
        ("a in b", "cannot be read"),
        ("sin(a, b)", "sin does not take 2 argument(s)"),
        ("T(a, b)", "T does not take 2"),
        ("sin(x=a)", "no keyword arguments"),
        ("T*flow", "T is a table"),
        ("Piecewise(a, b)", "Piecewise takes pairs"),
        ("1j*a", "1j is not a number"),
        ("9**9**9", "too large"),
        ("a*2**(10**9)", "too large"),
        ("(" * 500 + "a" + ")" * 500, "cannot be read"),
        ("-(" * 80 + "*".join(["a"] * 3_000) + ")" * 80, "nested too deeply"),
        ("a" * 3000, "name 'aaa"),
        ("lambda", "'lambda' is not declared"),
    ],
)
def test_what_may_not_be_written(text, problem):
    with pytest.raises(DeclarationError) as caught:
        read(text)
    assert problem in caught.value.message and caught.value.message.startswith("r: ")
    assert caught.value.where == ("r",) and len(caught.value.message) < 4000


def test_keywords_are_names():
    names = {word: symbol(word) for word in ("lambda", "class", "import")}
    assert parse("lambda*class + import", names, "r") == symbol("lambda") * symbol("class") + symbol("import")


@pytest.mark.parametrize("value", [None, True, [1], {"a": 1}])
def test_only_texts_and_numbers_are_expressions(value):
    with pytest.raises(DeclarationError, match="expected an expression or a number"):
        parse(value, {}, "r")


def test_signals_are_recognised():
    assert signal_name(signal("effort", "a.b", 2)) == ("effort", 2, "a.b")
    assert signal_name(symbol("effort")) is None and signal_name(A) is None
    assert signals_in(A * signal("flow", "z") + signal("effort", "b")) == (signal("effort", "b"), signal("flow", "z"))


def test_numbers_stay_exact():
    assert normalise(2.0) == sympy.Integer(2) and normalise(0.1) == sympy.Float(0.1) and number(1e20).is_Float
    assert normalise(sympy.Max(A, B, 0)).func is maximum and normalise(sympy.Min(A, B)) == minimum(A, B)


OF_MORE = {"Heaviside", "Mod", "pow", "atan2", "clip", "switch", "delay"}


@pytest.mark.parametrize("name", sorted(set(FUNCTIONS) - OF_MORE))
def test_every_function_is_understood_by_text_and_number(name):
    arguments = "flow, a" if name.lower() in ("min", "max", "minimum", "maximum") else "flow"
    found = read(f"{name}({arguments})")
    assert read(to_text(found)) == found


def test_two_argument_extrema_have_one_sided_slopes():
    assert minimum(1, 2) == 1 and maximum(A, A) == A
    at = {A: 1, B: 2}
    assert minimum(A, B).diff(A).subs(at) == 1 and minimum(A, B).diff(B).subs(at) == 0
    assert maximum(A, B).diff(A).subs(at) == 0 and maximum(A, B).diff(B).subs(at) == 1


def test_a_very_long_sum_is_read():
    text = " + ".join(f"{i}*a - b" for i in range(600))
    assert read(text) == sum(range(600)) * A - 600 * B


@pytest.mark.parametrize("text", ["min(flow, max(a, b))", "a if flow > 0 and not a == b or b != 2 else Abs(b)"])
def test_text_for_other_programs_is_read_by_sympy(text):
    found = read(text)
    names = {used.name: used for used in found.free_symbols}
    assert read(to_sympy_text(found)) == found
    assert normalise(sympy.sympify(to_sympy_text(found), locals=names)) == found
