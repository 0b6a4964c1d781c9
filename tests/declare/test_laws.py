"""Laws that want numbers where symbols come, or give no expression: one error with element, line and remedy."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

import bondgraph
from bondgraph.declare.domains import HYDRAULIC, TRANSLATION
from bondgraph.declare.functions import maximum
from bondgraph.declare.graph import BondGraph, ElementType, Handle
from bondgraph.declare.laws import apply_law
from bondgraph.declare.modal import friction
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_law
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.errors import DeclarationError, LawError

V = symbol("flow")
CHOOSE = "choose by switch(value, width) (from bondgraph.declare.functions import switch)"


def _helper(v: Any) -> Any:
    return math.exp(v)


def _branches(v: Any) -> Any:
    if v > 0:
        return v
    return -v


def _several_lines(v: Any) -> Any:
    drag = 3 * v
    return np.tanh(
        drag,
    )


def _nothing(v: Any) -> None:
    v * 2


@pytest.mark.parametrize(
    ("law", "problem", "remedy"),
    [
        # numpy: TypeError: loop of ufunc does not support argument 0 of type Symbol which has no callable tanh method
        (lambda v: np.tanh(v / 0.1), "`np.tanh(v / 0.1)`", "use sympy's tanh (from sympy import tanh)"),
        (lambda v: 2 * np.arctan(v), "numpy's arctan", "use sympy's atan (from sympy import atan)"),
        (lambda v: np.sqrt(v), "numpy's sqrt", "use sympy's sqrt"),
        (lambda v: np.heaviside(v, 0.5), "numpy's heaviside", "use sympy's Heaviside"),
        (_several_lines, "`return np.tanh(`", "use sympy's tanh"),
        # math: TypeError: Cannot convert expression to float
        (lambda v: math.tanh(v), "applies tanh of numbers to a symbol", "use sympy's tanh (from sympy import tanh)"),
        (lambda v: math.atan2(v, 1.0), "applies atan2 of numbers", "use sympy's atan2"),
        (lambda v: math.floor(v), "applies floor of numbers", "use sympy's floor"),
        (lambda v: _helper(v) + 1, "`return math.exp(v)`", "use sympy's exp"),
        (lambda v: float(v), "applies float of numbers", "leave it out"),
        (lambda v: round(v), "applies round of numbers", "leave it out"),
        (lambda v: np.interp(v, [0, 1], [0, 1]), "applies interp of numbers", "use g.table(...)"),
        (math.tanh, "`tanh` applies tanh of numbers", "use sympy's tanh"),
        (np.tanh, "`tanh` applies numpy's tanh", "use sympy's tanh"),
        # TypeError: cannot determine truth value of Relational
        (_branches, "`if v > 0:`", CHOOSE),
        (lambda v: 1.0 if v > 0 else -1.0, "asks which of two symbols is larger", CHOOSE),
        (lambda v: v > 0 and v < 3, "asks which of two symbols is larger", CHOOSE),
        (lambda v: v * (0 < v < 3), "asks which of two symbols is larger", CHOOSE),
        (lambda v: max(v, 0.0), "compares symbols by max", "use maximum (from bondgraph.declare.functions"),
        (lambda v: min(v, 0.0), "compares symbols by min", "use minimum (from bondgraph.declare.functions"),
        (lambda v: np.maximum(v, 0.0), "compares symbols by maximum", "use maximum (from bondgraph.declare.functions"),
        (lambda v: np.where(v > 0, v, 0), "compares symbols by where", "use sympy's Piecewise"),
        # names, arguments, other failures
        (lambda v: viscosity * v, "uses 'viscosity', which is not defined", "declare or import it first"),  # noqa: F821
        (lambda v: tanh(v), "uses 'tanh', which is not defined", "use sympy's tanh (from sympy import tanh)"),  # noqa: F821
        (lambda v, w: v * w, "takes (v, w)", "write it as a function of 1: (flow)"),
        (lambda: 3.0, "takes (nothing)", "write it as a function of 1: (flow)"),
        (lambda v: v / 0, "gives", "finite"),
        (lambda v: 1 / 0, "fails (ZeroDivisionError: division by zero)", "correct the function"),
        (lambda v: v[0], "fails (TypeError: 'Symbol' object is not subscriptable)", "correct the function"),
        # what is no expression
        (_nothing, "returns nothing", "write `return` before its value"),
        (lambda v: [v, v], "returns a list of 2 values", "give one expression"),
        (lambda v: np.array([1.0, 2.0]) * v, "returns a ndarray of 2 values", "give one expression"),
        (lambda v: "b*v", "returns the text 'b*v'", "without quotes"),
        (lambda v: v > 0, "returns a condition, not a value (flow > 0)", CHOOSE),
        (lambda v: True, "returns a condition, not a value (True)", CHOOSE),
        (lambda v: _helper, "returns a function", "give an expression"),
        (lambda v: Handle("shaft", "1", None), "returns the node shaft", "shaft.flow"),
        (lambda v: {"a": 1}, "returns a dict", "give one expression or number"),
    ],
)  # fmt: skip
def test_a_law_that_is_no_expression_is_told_with_its_remedy(
    law: Callable[..., Any], problem: str, remedy: str
) -> None:
    g = BondGraph("sled")
    body = g.one_junction("body", TRANSLATION)
    with pytest.raises(DeclarationError) as caught:
        g.resistance("runners", law, at=body)
    said = caught.value.message
    assert said.startswith("sled: runners: ") and caught.value.where == ("runners",)
    if problem != "gives":
        assert problem in said and isinstance(caught.value, LawError)
    assert remedy in said
    assert list(g.nodes) == ["body"]


def test_the_line_of_the_law_is_told() -> None:
    with pytest.raises(LawError) as caught:
        apply_law(_several_lines, V, where="sled: runners")
    first = _several_lines.__code__.co_firstlineno
    assert f"`return np.tanh(` (line {first + 2} of test_laws.py)" in caught.value.message


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (lambda v: abs(v) * v, sympy.Abs(V) * V),
        (lambda v: np.abs(v), sympy.Abs(V)),
        (lambda v: np.float64(3.0) * v, 3.0 * V),
        (lambda v: np.float64(3.0), sympy.Integer(3)),
        (lambda v: np.int32(2), sympy.Integer(2)),
        (lambda v: np.array(2.0), sympy.Integer(2)),
        (lambda v: Fraction(1, 4), sympy.Rational(1, 4)),
        (lambda v: sympy.Max(v, 0), maximum(0, V)),
        (lambda v: math.pi * v, math.pi * V),
        (lambda v, gain=2: gain * v, 2 * V),
        (lambda *v: v[0], V),
        (sympy.tanh, sympy.tanh(V)),
        (lambda v: sympy.Piecewise((v, v > 0), (0, True)), sympy.Piecewise((V, V > 0), (0, True))),
    ],
)
def test_laws_that_are_expressions_pass(law: Callable[..., Any], expected: sympy.Expr) -> None:
    assert apply_law(law, V) == expected


def _wrong(*_: Any) -> Any:
    return np.tanh(_[0])


def _declare_everywhere(g: BondGraph, a: Handle, b: Handle) -> dict[str, Callable[[], Any]]:
    """Every place of the builder that takes a law, given one that fails."""
    return {
        "effort": lambda: g.resistance("x", _wrong, at=a),
        "flow": lambda: g.resistance("x", flow=_wrong, at=a),
        "residual": lambda: g.resistance("x", residual=_wrong, at=a),
        "compliance": lambda: g.compliance("x", _wrong, at=a),
        "displacement": lambda: g.compliance("x", displacement=_wrong, at=a),
        "inertance": lambda: g.inertance("x", _wrong, at=a),
        "momentum": lambda: g.inertance("x", momentum=_wrong, at=a),
        "stored residual": lambda: g.inertance("x", residual=_wrong, at=a),
        "field": lambda: g.field("R", "x", [_wrong, _wrong], at=(a, b)),
        "energy": lambda: g.field("C", "x", energy=_wrong, at=(a, b)),
        "element": lambda: g.element("x", ElementType({("flow", "effort"): lambda e, f: (_wrong(e), f)}), at=(a, b)),
        "friction": lambda: friction(g, "x", _wrong, width=1.0, at=a),
        "modulus": lambda: g.transformer("x", _wrong, a, b),
        "gyrator": lambda: g.gyrator("x", None, a, b),
        "source": lambda: g.effort_source("x", _wrong, at=a),
        "flow source": lambda: g.flow_source("x", "F", at=a),
        "coefficient": lambda: g.resistance("x", [1.0], at=a),
        "inertia": lambda: g.inertance("x", "m", at=a),
        "integral": lambda: g.integral("x", _wrong, "m"),
        "implicit": lambda: g.implicit_signal("x", _wrong, "m"),
        "signal": lambda: g.signal("x", _wrong, "m"),
        "measure": lambda: g.measure("x", None, "m"),
        "revised": lambda: revise_law(g, "x0", "effort", _wrong),
    }


@pytest.mark.parametrize(
    "place", list(_declare_everywhere(BondGraph("g"), Handle("a", "1", None), Handle("b", "1", None)))
)
def test_every_place_that_takes_a_law_tells_its_element(place: str) -> None:
    g = BondGraph("g")
    a, b = g.one_junction("a", TRANSLATION), g.one_junction("b", TRANSLATION)
    g.resistance("x0", 1.0, at=a)
    with pytest.raises(LawError, match=r"^g: x0?: (the law|what is given)"):
        _declare_everywhere(g, a, b)[place]()
    assert set(g.nodes) == {"a", "b", "x0"} and not g.quantities and not g.outputs


def test_a_function_that_a_module_lacks_is_told_with_the_one_that_works() -> None:
    g = BondGraph("g")
    a = g.one_junction("a", TRANSLATION)
    with pytest.raises(LawError, match=r"has no attribute 'tanh'\) - use sympy's tanh \(from sympy import tanh\)"):
        g.resistance("r", lambda v: bondgraph.tanh(v), at=a)
    with pytest.raises(LawError, match=r"has no attribute 'nothing'\) - correct the function"):
        g.resistance("r", lambda v: bondgraph.nothing(v), at=a)


def test_the_form_of_an_element_gives_one_value_per_port() -> None:
    g = BondGraph("g")
    with pytest.raises(DeclarationError, match=r"g: x: form \('flow', 'effort'\): the law returns 1 value\(s\) for 2"):
        g.element("x", ElementType({("flow", "effort"): lambda e, f: e}))


@pytest.mark.parametrize("values", [[0.0, symbol("k")], [0.0, "a"], None])
def test_a_table_of_anything_but_numbers_is_refused(values: Any) -> None:
    with pytest.raises(DeclarationError, match="g: table torque: its points and values must be numbers"):
        BondGraph("g").table("torque", [0.0, 1.0], values)


@given(st.sampled_from(sorted(vars(math))), st.integers(1, 2))
def test_no_function_of_math_gives_anything_but_a_law_or_its_error(name: str, arguments: int) -> None:
    """Whatever function of numbers is applied to a symbol, the answer is an expression or the one error."""
    function = getattr(math, name)
    if not callable(function):
        return
    try:
        apply_law(lambda v: function(*(v,) * arguments), V, where="g: x")
    except LawError as error:
        assert error.message.startswith("g: x: the law `") and " of test_laws.py) " in error.message


def test_the_remedies_name_functions_that_exist() -> None:
    from bondgraph.declare import functions, laws

    for name in laws._OTHER_NAMES.values():
        known = hasattr(sympy, name) or hasattr(functions, name)
        assert known or (not name.isidentifier() and (name == "**" or ast.parse(name.replace("...", "1"))))


@pytest.mark.parametrize("zero", [0, 0.0, sympy.Float(0.0), sympy.Integer(0)])
def test_zero_has_every_unit_however_it_is_written(zero: object) -> None:
    """``maximum(p - full, 0.0)`` "compares Pa and 1", while 0 and 0.001 passed: Float(0.0) == 0 is false in sympy."""
    g = BondGraph("tank")
    tank = g.zero_junction("tank", HYDRAULIC)
    full, leak = g.parameter("full", 2e5, "Pa"), g.parameter("leak", 1e-9, "m^3/(s Pa)")
    g.compliance("volume", g.parameter("stiff", 1e8, "Pa/m^3"), at=tank)
    g.resistance("overflow", flow=lambda p: leak * maximum(p - full, zero), at=tank)
    assert derive(assign_causality(g)).states
    g.validate()
