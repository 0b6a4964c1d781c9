"""LaTeX of equations: balanced, deterministic, every name under a symbol of its own, units and meanings listed."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy import Abs, Integer, Piecewise, Rational, exp, sign, sqrt, tanh

from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.functions import maximum, minimum, table_function
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Input, Parameter, Table, symbol
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.derive.equations import Assignment, ImplicitLoop, OutputEquation, State, StateEquations
from bondgraph.derive.latex import latex
from bondgraph.errors import BondGraphError
from tests.derive.random_graphs import RandomGraph


def by_hand(states=(), inputs=(), parameters=(), assignments=(), derivatives=(), outputs=(), tables=()):
    return StateEquations(
        "by_hand", "", "", tuple(State(symbol(name), "", 0.0, "", "", "flow") for name in states), tuple(inputs),
        tuple(Parameter(name, 1.0, "") for name in parameters), tuple(tables), tuple(assignments),
        tuple(derivatives), tuple(outputs),
    )  # fmt: skip


def check_balanced(text):
    """Braces, environments, \\left and \\right, dollars and alignment marks come in pairs."""
    plain = re.sub(r"\\[\\{}$&%#_]", "", text)
    depth = 0
    for character in plain:
        depth += {"{": 1, "}": -1}.get(character, 0)
        assert depth >= 0
    assert depth == 0
    opened = []
    for kind, name in re.findall(r"\\(begin|end)\{([a-z*]+)\}", text):
        if kind == "begin":
            opened.append(name)
        else:
            assert opened.pop() == name
    assert opened == []
    assert len(re.findall(r"\\left\b", text)) == len(re.findall(r"\\right\b", text))
    items = [line for line in text.splitlines() if line.startswith(r"\item")]
    assert all(re.sub(r"\\\$", "", item).count("$") % 2 == 0 for item in items)
    for block in re.findall(r"\\begin\{align\*\}\n(.*?)\n\\end\{align\*\}", text, flags=re.S):
        outside = re.sub(r"\\begin\{cases\}.*?\\end\{cases\}", "", block, flags=re.S)
        lines = outside.split(" \\\\\n")
        assert all(line.count("&") == 1 for line in lines)
        assert "_" not in re.sub(r"\\_|_\{", "", block)  # a raw underscore would be a subscript of one letter


def lines_of(text):
    return [line.removesuffix(r" \\") for line in text.splitlines() if "&=" in line]


def car():
    g = BondGraph("car")
    tau, grade = g.input("tau_engine", "N m", "torque of the engine"), g.input("grade", "1")
    J, m = g.parameter("J_primary", 0.015, "kg m^2", "engine & sheave"), g.parameter("m", 260.0, "kg", "100 % laden")
    c, r = g.parameter("c_aero", 1e-7, "kg/m"), g.parameter("r_wheel", 0.28, "m")
    primary, body = g.one_junction("primary", ROTATION), g.one_junction("body", TRANSLATION)
    g.effort_source("combustion", tau, at=primary)
    g.inertance("primary_inertia", J, at=primary, state="omega_primary")
    shaft = g.zero_junction("shaft", ROTATION)
    g.bond(primary, shaft)
    g.compliance("shaft_spring", 900.0, at=shaft)
    g.transformer("wheel", r, shaft, body)
    g.inertance("car", m, at=body)
    g.resistance("aero", lambda v: c * v * Abs(v), at=body)
    g.effort_source("hill", -m * g.parameter("g", 9.81, "m/s^2") * grade, at=body)
    g.measure_flow("speed", "body", "speed over ground")
    g.measure_flow("omega_primary", "primary", "crankshaft")
    return derive(assign_causality(g))


def test_the_equations_of_a_car():
    text = latex(car())
    check_balanced(text)
    rate = r"\frac{\tau_{\mathrm{engine}} - \tau_{\mathrm{shaft}}}{J_{\mathrm{primary}}}"
    force = r"\frac{\tau_{\mathrm{shaft}}}{r_{\mathrm{wheel}}} - F_{\mathrm{aero}} - g \, \mathrm{grade} \, m"
    assert lines_of(text) == [
        r"\tau_{\mathrm{shaft}} &= 900 \, q_{\mathrm{shaft}\,\mathrm{spring}}",
        r"F_{\mathrm{aero}} &= c_{\mathrm{aero}} \, v_{\mathrm{car}} \, \left|{v_{\mathrm{car}}}\right|",
        rf"\dot{{\omega}}_{{\mathrm{{primary}}}} &= {rate}",
        r"\dot{q}_{\mathrm{shaft}\,\mathrm{spring}} &= \omega_{\mathrm{primary}} - \frac{v_{\mathrm{car}}}"
        r"{r_{\mathrm{wheel}}}",
        rf"\dot{{v}}_{{\mathrm{{car}}}} &= \frac{{{force}}}{{m}}",
        r"\mathrm{speed} &= v_{\mathrm{car}}",
    ]


def test_symbols_are_listed_with_unit_value_and_meaning():
    text = latex(car())
    for line in (
        r"\item $\omega_{\mathrm{primary}}$ [$\mathrm{rad}/\mathrm{s}$]: flow of primary\_inertia (state)",
        r"\item $\tau_{\mathrm{engine}}$ [$\mathrm{N}\,\mathrm{m}$]: torque of the engine (input)",
        r"\item $J_{\mathrm{primary}} = 0.015$ [$\mathrm{kg}\,\mathrm{m}^{2}$]: engine \& sheave (parameter)",
        r"\item $m = 260$ [$\mathrm{kg}$]: 100 \% laden (parameter)",
        r"\item $c_{\mathrm{aero}} = 1 \cdot 10^{-7}$ [$\mathrm{kg}/\mathrm{m}$] (parameter)",
        r"\item $F_{\mathrm{aero}}$ [$\mathrm{N}$]: effort of aero",
        r"\item $\mathrm{speed}$ [$\mathrm{m}/\mathrm{s}$]: speed over ground (output)",
        r"\item $\omega_{\mathrm{primary}}$ [$\mathrm{rad}/\mathrm{s}$]: crankshaft (output)",
    ):
        assert line in text.splitlines()


def test_assignments_can_be_left_out():
    whole, short = latex(car()), latex(car(), assignments=False)
    assert "effort of aero" in whole and "effort of aero" not in short
    assert [line for line in lines_of(whole) if line.startswith(r"\dot")] == [
        line for line in lines_of(short) if line.startswith(r"\dot")
    ]
    check_balanced(short)


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("omega", r"\omega"), ("Omega_2", r"\Omega_{2}"), ("J2", "J_{2}"), ("tau12_x", r"\tau_{12\,\mathrm{x}}"),
        ("cd_area", r"\mathrm{cd}_{\mathrm{area}}"), ("k_theta", r"k_{\theta}"),
        ("motor.k_m", r"k_{\mathrm{m},\,\mathrm{motor}}"),
        ("axle.left_hub.J", r"J_{\mathrm{axle},\,\mathrm{left}\,\mathrm{hub}}"), ("R_10k", r"R_{\mathrm{10k}}"),
        ("_raw", r"\mathrm{\_raw}"), ("x_", r"\mathrm{x\_}"), ("lambda", r"\lambda"),
    ],
)  # fmt: skip
def test_names_become_symbols(name, shown):
    text = latex(by_hand(states=(name,), derivatives=(-symbol(name),)))
    assert text.splitlines()[1].endswith(f"&= - {shown}")
    check_balanced(text)


def test_two_names_never_share_a_symbol():
    names = ("J2", "J_2", "k_m", "a.k", "a.b_c", "b_c.a", "tau", "x_y_z", "x_y.z", "z.x_y")
    text = latex(by_hand(parameters=names))
    shown = [line.split(" = ")[0] for line in text.splitlines() if line.startswith(r"\item")]
    assert len(set(shown)) == len(names)
    assert r"\item $\mathtt{J\_2} = 1$ (parameter)" in text


def test_rates_of_inputs_have_a_dot_and_declared_names_do_not():
    rate = Input("d_F_push", "", "rate of F_push (a storage depends on it)")
    text = latex(by_hand(states=("x",), inputs=(Input("F_push", ""), rate), derivatives=(symbol("d_F_push"),)))
    assert r"\dot{x} &= \dot{F}_{\mathrm{push}}" in text
    text = latex(by_hand(states=("x",), parameters=("d_x",), derivatives=(symbol("d_x"),)))
    assert r"\dot{x} &= d_{\mathrm{x}}" in text


def test_outputs_that_share_a_name_are_told_apart():
    x, a = symbol("x"), symbol("a")
    same, other = OutputEquation(x, x, "m", "as it is"), OutputEquation(a, 2 * x, "m", "twice")
    text = latex(by_hand(states=("x",), parameters=("a",), derivatives=(a,), outputs=(same, other)))
    assert lines_of(text) == [r"\dot{x} &= a", r"y_{\mathrm{a}} &= 2 \, x"]
    assert r"\item $x$ [$\mathrm{m}$]: as it is (output)" in text
    assert r"\item $y_{\mathrm{a}}$ [$\mathrm{m}$]: twice (output)" in text


def test_functions_of_laws():
    x, a = symbol("x"), symbol("a")
    f, h = table_function("torque_map"), table_function("grid", 2)
    tables = (
        Table("torque_map", (0.0, 1.0), (0.0, 1.0), unit="N m", meaning="measured"),
        Table("grid", (0.0, 1.0), ((0.0, 1.0), (1.0, 2.0)), y=(0.0, 1.0)),
    )
    derivatives = (
        minimum(x, a) ** 2 + maximum(0, x), f(x) * table_function("torque_map", 1, (1,))(x) ** 2,
        h(x, a) + table_function("grid", 2, (1, 0))(x, a) + table_function("grid", 2, (0, 1))(x, a),
        Piecewise((x, (x > a) & (a > 0)), (sqrt(Abs(x)) * sign(x), True)), tanh(x / a) ** 2 * exp(-x) * 1.5e-9,
        Rational(1, 3) * x**Rational(-3, 2), Integer(0),
    )  # fmt: skip
    states = ("x", *(f"s{i}" for i in range(len(derivatives) - 1)))
    text = latex(by_hand(states=states, parameters=("a",), derivatives=derivatives, tables=tables))
    check_balanced(text)
    for part in (
        r"\min^{2}\left(x, a\right)", r"\max\left(0, x\right)", r"\operatorname{torque\_map}\left(x\right)",
        r"\operatorname{torque\_map}'^{2}\left(x\right)", r"\partial_{1}\operatorname{grid}\left(x, a\right)",
        r"\partial_{2}\operatorname{grid}\left(x, a\right)", r"\begin{cases}", r"\tanh^{2}{\left(\frac{x}{a} \right)}",
        r"\item $\operatorname{torque\_map}$ [$\mathrm{N}\,\mathrm{m}$]: measured (table)", r"\dot{s}_{5} &= 0",
    ):  # fmt: skip
        assert part in text


def test_loops_are_shown_as_what_they_solve():
    z, w, s = symbol("F_b"), symbol("w"), symbol("s_in_loop")
    loop = ImplicitLoop(
        "loop", (z, w), (Integer(0),) * 2, (s + z - 2, w**3 - z), ("N", "m/s"),
        (Assignment(s, z * w, "N", "inner"),), "loop of belt",
    )  # fmt: skip
    text = latex(by_hand(states=("x",), assignments=(loop,), derivatives=(z,)))
    check_balanced(text)
    assert lines_of(text) == [
        r"s_{\mathrm{in}\,\mathrm{loop}} &= F_{\mathrm{b}} \, w",
        r"0 &= F_{\mathrm{b}} + s_{\mathrm{in}\,\mathrm{loop}} - 2",
        r"0 &= w^{3} - F_{\mathrm{b}} \quad \text{(solved for $F_{\mathrm{b}}, w$)}",
        r"\dot{x} &= F_{\mathrm{b}}",
    ]
    assert r"\item $F_{\mathrm{b}}$ [$\mathrm{N}$]: loop of belt" in text


def test_a_symbol_that_is_not_declared_is_shown_as_it_is():
    assert r"\dot{x} &= \mathtt{k\_1}" in latex(by_hand(states=("x",), derivatives=(symbol("k_1"),)))


def test_equations_of_nothing_are_nothing():
    assert latex(by_hand()) == ""


def test_random_graphs_are_balanced_and_complete():
    printed = 0
    for seed in range(800, 825):
        try:
            equations = derive(assign_causality(RandomGraph(seed, linear=False).graph), bonds=True)
        except BondGraphError:
            continue
        text = latex(equations)
        check_balanced(text)
        assert r"\mathrm{effort(" in text and r"{\to}" in text
        rates = [line for line in lines_of(text) if line.startswith(r"\dot")]
        assert len(rates) >= len(equations.states)
        printed += 1
    assert printed >= 8


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.text(max_size=30), st.text(alphabet="kgmsNA VWrad/^*()2-.%°µ", max_size=12))
def test_any_meaning_and_unit_is_balanced(meaning, unit):
    output = OutputEquation(symbol("y_1"), symbol("x"), unit, "".join(filter(str.isprintable, meaning)))
    check_balanced(latex(by_hand(states=("x",), derivatives=(Integer(1),), outputs=(output,))))


def test_text_is_the_same_under_every_hash_seed():
    program = "from tests.derive.test_latex import car, latex\nprint(latex(car()))"
    environment = {**os.environ, "PYTHONHASHSEED": "99", "PYTHONPATH": os.getcwd()}
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True)
    assert run.stdout == latex(car()) + "\n"
