"""Numbers in the text of laws: no more digits than their intervals support."""

from __future__ import annotations

import math
import re

import sympy
from hypothesis import assume, given
from hypothesis import strategies as st
from sympy import Float, Symbol, tanh

from bondgraph.correct.shapes.law_text import python_text, rounded, with_numbers
from bondgraph.declare.expressions import parse

NUMBERS = st.floats(1e-12, 1e12) | st.floats(-1e12, -1e-12)


@given(NUMBERS, st.floats(1e-6, 10.0))
def test_a_number_is_rounded_by_less_than_a_tenth_of_its_uncertainty(value: float, share: float) -> None:
    half = share * abs(value)
    shown = rounded(value, (value - half, value + half))
    assert abs(float(shown) - value) <= max(0.051 * half, 0.5 * 10.0 ** math.floor(math.log10(abs(value))))
    digits = re.sub(r"e.*|[-.]", "", shown).strip("0")
    assert len(digits) <= math.floor(math.log10(abs(value))) - math.floor(math.log10(half)) + 2 or len(digits) == 1


@given(NUMBERS)
def test_without_an_interval_it_has_three_digits(value: float) -> None:
    assert abs(float(rounded(value)) - value) <= 0.005 * abs(value)


@given(NUMBERS, NUMBERS, st.floats(-3.0, 3.0))
def test_the_text_of_a_law_is_the_law_to_three_digits(c: float, reach: float, x: float) -> None:
    assume(abs(x / reach) < 1e3)
    at, law = Symbol("x"), Symbol("c_law") * tanh(Symbol("x") / Symbol("reach_law"))
    text = with_numbers(law, {"c_law": c, "reach_law": reach})
    told = float(parse(text, {"x": at}, "law").subs(at, x))
    assert math.isclose(told, c * math.tanh(x / reach), rel_tol=0.02, abs_tol=1e-300)


def test_constants_of_a_law_are_rounded_too() -> None:
    x = Symbol("x")
    assert with_numbers(Symbol("c") * tanh(x / Float(18.0 / 1.01)), {"c": -2.0}) == "-2*tanh(x/17.8)"
    assert with_numbers(tanh((x + Symbol("at")) / Float(4.0)), {"at": 6.23456}) == "tanh((x + 6.23)/4)"
    wave = sympy.sin(Float(6.2832) * x / Symbol("p"))
    assert with_numbers(wave, {"p": 2.0}) == "sin(6.28*x/2)"
    assert with_numbers(x - Symbol("at"), {"at": 6.23456}) == "x - 6.23"
    assert with_numbers(sympy.Abs(x) * Symbol("c"), {"c": 0.05555555555555555}) == "0.0556*|x|"


def test_a_coefficient_comes_first_and_is_one_number() -> None:
    w, c = Symbol("w"), Symbol("Zc")
    law = sympy.sign(w) * sympy.Abs(w / Float(25.0)) ** 1.5 * c
    assert with_numbers(law, {"Zc": 2.0}) == "0.016*|w|^1.5*sign(w)"
    assert with_numbers(law, {"Zc": -2.0}, {"Zc": (-2.002, -1.998)}) == "-0.016*|w|^1.5*sign(w)"
    assert with_numbers(law, {"Zc": 2.0123}, {"Zc": (2.0121, 2.0125)}) == "0.0160984*|w|^1.5*sign(w)"  # as c = 2.01230
    assert with_numbers(sympy.Abs(w) * c, {"Zc": 0.00587}) == "0.00587*|w|"
    assert python_text(sympy.Abs(w) * Float(1.0 / 3.0), 6) == "0.333333*Abs(w)"  # lines to paste stay Python
