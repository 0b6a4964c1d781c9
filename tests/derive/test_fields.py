"""Storages and resistances with several ports, in every causality; laws in every form; elements of one's own."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import sympy

from bondgraph.declare.graph import BondGraph, ElementType
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.derive.equations import ImplicitLoop
from bondgraph.errors import CausalityError, DeclarationError
from tests.derive.compare import compare, loaded
from tests.derive.spec import damper, derivatives, force, graph, mass, outputs, same, speed, spring

VALUES = {"m": 1.0, "M": 2.0, "k": 3.0, "b": 0.4, "n": 5.0, "c": 0.7}
ENERGY = "k*displacement1**2/2 + n*displacement2**2/2 + c*displacement1*displacement2"


def imposed(drive: str) -> BondGraph:
    """A C field whose port 1 is at a source of effort and port 2 at a source of effort or at a mass."""
    nodes = {"s": force("sin(u)"), "C": ("C", {"ports": 2, "energy": ENERGY}), "a": "0", "r": damper()}
    bonds = "s->a a->C a->r"
    if drive == "effort":
        nodes |= {"t": force("u**2"), "z": "0"}
        bonds += " t->z z->C"
    else:
        nodes |= {"v": "1", "M": mass()}
        bonds += " v->C v->M"
    wanted = [{"name": "q1", "variable": "displacement1", "at": "C"}, {"name": "f1", "variable": "flow1", "at": "C"}]
    return graph(nodes, bonds, VALUES, "u", outputs=wanted)


def test_a_field_with_both_ports_imposed_has_no_state():
    g = imposed("effort")
    assert assign_causality(g).derivative == (("C", 1), ("C", 2))
    determinant = "(k*n - c**2)"
    assert same(outputs(g), q1=f"(n*sin(u) - c*u**2)/{determinant}", f1=f"(n*cos(u) - 2*c*u)*d_u/{determinant}")
    assert compare(g) == ""


def test_a_field_with_one_port_imposed_has_one_state():
    g = imposed("mass")
    causal = assign_causality(g)
    assert causal.derivative == (("C", 1),)
    assert same(derivatives(g), q_C2="f_M", f_M="-(n*q_C2 + c*(sin(u) - c*q_C2)/k)/m")
    assert same(outputs(g), q1="(sin(u) - c*q_C2)/k", f1="(cos(u)*d_u - c*f_M)/k")
    assert compare(g) == ""


def test_a_nonlinear_field_in_derivative_causality_is_solved_by_iteration():
    energy = ENERGY + " + b*(displacement1 + displacement2)**4/4"
    nodes = {
        "s": force("sin(u)"), "C": ("C", {"ports": 2, "energy": energy}), "a": "0", "r": damper(),
        "v": "1", "M": mass(),
    }  # fmt: skip
    g = graph(nodes, "s->a a->C a->r v->C v->M", VALUES, "u")
    loops = [step for step in derive(assign_causality(g)).assignments if isinstance(step, ImplicitLoop)]
    assert [[unknown.name for unknown in loop.unknowns] for loop in loops] == [["q_C1"]]
    assert [compare(g, seed) for seed in range(4)] == [""] * 4
    both = graph(nodes | {"t": force("u"), "v": "0"}, "s->a a->C a->r v->C t->v v->M", VALUES | {"m": 1.0}, "u")
    assert [compare(both, seed) for seed in range(3)] == [""] * 3


def test_ports_of_one_field_on_one_junction_depend_on_each_other():
    nodes = {
        "v": "1",
        "m": mass(),
        "I": ("I", {"ports": 2, "laws": ["k*momentum1 - c*momentum2", "n*momentum2 - c*momentum1"]}),
    }
    g = graph(nodes | {"F": force()}, "F->v v->m v->I v->I", VALUES, "u")
    assert len(assign_causality(g).derivative) == 2
    inertia = "(m + (k + n + 2*c)/(k*n - c**2))"
    assert same(derivatives(g), f_m=f"u/{inertia}")
    assert compare(g) == ""


def test_a_field_of_three_ports_in_all_mixtures_of_causality():
    """A mutual inductance of three coils, each driven by a voltage or by a current."""
    laws = [
        "k*momentum1 + b*momentum2 + c*momentum3", "b*momentum1 + n*momentum2 + m*momentum3/4",
        "c*momentum1 + m*momentum2/4 + M*momentum3",
    ]  # fmt: skip
    for drives in itertools.product(("Se", "Sf"), repeat=3):
        nodes: dict = {f"a{i}": "1" for i in range(3)} | {"L": ("I", {"ports": 3, "laws": laws})}
        for i, drive in enumerate(drives):
            nodes[f"s{i}"] = force(f"u*{i + 1}") if drive == "Se" else speed(f"u**2 + {i}")
            nodes[f"r{i}"] = damper()
        bonds = " ".join(f"s{i}->a{i} a{i}->L a{i}->r{i}" for i in range(3))
        g = graph(nodes, bonds, VALUES, "u")
        assert len(derive(assign_causality(g)).states) == drives.count("Se")
        assert compare(g, 2) == "", drives


def test_a_field_of_off_diagonal_laws_is_solved_by_the_laws_that_fit():
    """Each effort depends on the other port's displacement alone."""
    field = ("C", {"ports": 2, "laws": ["k*displacement2", "k*displacement1"]})
    nodes = {"s": force("sin(u)"), "t": force("u"), "a": "0", "z": "0", "C": field, "r": damper()}
    g = graph(
        nodes, "s->a a->C a->r t->z z->C", VALUES, "u", outputs=[{"name": "q1", "variable": "displacement1", "at": "C"}]
    )
    assert same(outputs(g), q1="u/k")


@pytest.mark.parametrize("drives", list(itertools.product(("Se", "Sf"), repeat=2)))
def test_a_linear_resistance_field_is_inverted_where_needed(drives):
    field = ("R", {"ports": 2, "laws": ["k*flow1 + c*flow2", "b*flow1 + n*flow2"]})
    nodes = {"R": field} | {
        f"s{i}": force("u") if drive == "Se" else speed("u**2") for i, drive in enumerate(drives)
    } | {"a": "1", "z": "1"}  # fmt: skip
    wanted = [{"name": f"{v}{i}", "variable": f"{v}{i}", "at": "R"} for v in ("effort", "flow") for i in (1, 2)]
    g = graph(nodes, "s0->a a->R s1->z z->R", VALUES, "u", outputs=wanted)
    found = outputs(g)
    values = {
        symbol.name: value
        for symbol, value in zip(sympy.symbols("k c b n u", real=True), (3.0, 0.7, 0.4, 5.0, 0.6), strict=True)
    }
    e1, e2, f1, f2 = (
        float(found[name].xreplace({s: values[s.name] for s in found[name].free_symbols})) for name in found
    )
    np.testing.assert_allclose([e1, e2], [3.0 * f1 + 0.7 * f2, 0.4 * f1 + 5.0 * f2], rtol=1e-12)
    assert compare(g) == ""


def test_a_nonlinear_resistance_field_keeps_its_form():
    field = ("R", {"ports": 2, "laws": ["k*flow1**3 + c*flow2", "n*flow2"]})
    with pytest.raises(CausalityError, match="law of R gives the effort"):
        assign_causality(graph({"R": field, "s": force("1"), "a": "1", "m": mass()}, "s->R a->R a->m", VALUES))
    residuals = ["effort1 - k*flow1 - k*flow1**3 - c*flow2", "effort2 - n*flow2 - c*flow1"]
    free = graph(
        {"R": ("R", {"ports": 2, "residuals": residuals}), "s": force("u"), "a": "1", "m": mass()},
        "s->R a->R a->m",
        VALUES,
        "u",
    )
    assert [compare(free, seed) for seed in range(3)] == [""] * 3


@pytest.mark.parametrize("form", ["effort", "displacement", "both", "energy", "residual"])
@pytest.mark.parametrize("place", ["independent", "dependent"])
def test_a_compliance_may_be_given_in_any_form(form, place):
    """effort = k*q + k*q**3 and its inverse by Cardano's formula, as state and as a dependent storage."""
    half = "3*sqrt(3)*effort/(2*k)"
    inverse = f"2*sinh(log({half} + sqrt(({half})**2 + 1))/3)/sqrt(3)"
    laws = {
        "effort": {"effort": "k*displacement + k*displacement**3"},
        "displacement": {"displacement": inverse},
        "both": {"effort": "k*displacement + k*displacement**3", "displacement": inverse},
        "energy": {"energy": "k*displacement**2/2 + k*displacement**4/4"},
        "residual": {"residual": "effort - k*displacement - k*displacement**3"},
    }
    nodes = {"C": ("C", laws[form]), "z": "0", "r": damper()}
    if place == "independent":
        g = graph(nodes | {"s": speed()}, "s->z z->C z->r", VALUES, "u")
        reference = graph(nodes | {"s": speed(), "C": ("C", laws["effort"])}, "s->z z->C z->r", VALUES, "u")
        x = np.array([0.3])
    else:
        wanted = [{"name": "f", "variable": "flow", "at": "C"}]
        g = graph(nodes | {"s": force("sin(u)")}, "s->z z->C z->r", VALUES, "u", outputs=wanted)
        reference = graph(
            nodes | {"s": force("sin(u)"), "C": ("C", laws["both"])}, "s->z z->C z->r", VALUES, "u", outputs=wanted
        )
        x = np.zeros(0)
    assert compare(g) == ""
    values = []
    for each in (g, reference):
        equations = derive(assign_causality(each))
        module, theta = loaded(equations), np.array([q.value for q in equations.parameters])
        u = np.array([0.4, 0.2][: len(equations.inputs)])
        values.append((module["rhs"](0.0, x, u, theta), module["output"](0.0, x, u, theta)))
    for a, b in zip(*values, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10)


@pytest.mark.parametrize(
    "laws", [{"momentum": "m*flow + flow**3"}, {"residual": "momentum - m*flow - flow**3"}, {"momentum": "m*flow"}]
)
def test_an_inertance_may_be_given_by_its_momentum(laws):
    nodes = {"F": force(), "v": "1", "I": ("I", laws), "k": spring()}
    g = graph(nodes, "F->v v->I v->k", VALUES, "u")
    assert [compare(g, seed) for seed in range(2)] == ["", ""]
    assert [state.variable for state in derive(assign_causality(g)).states] == ["momentum", "displacement"]


def test_the_search_for_a_root_starts_where_it_is_told():
    """effort**3 - effort = flow has three roots near zero; the declared start picks one."""
    for guess, root in ((1.0, 1.0), (-1.0, -1.0)):
        nodes = {"s": speed(), "v": "1", "r": ("R", {"residual": "effort**3 - effort - flow", "initial": guess})}
        g = graph(nodes, "s->v v->r", {}, "u", outputs=[{"name": "e", "variable": "effort", "at": "r"}])
        found = loaded(derive(assign_causality(g)))["output"](0.0, np.zeros(0), np.array([0.001]), np.zeros(0))
        np.testing.assert_allclose(found, [root], atol=1e-3)


def motor() -> ElementType:
    R, k = sympy.symbols("R k", real=True)
    return ElementType(
        {
            ("flow", "effort"): lambda u, omega: ((u - k * omega) / R, -k * (u - k * omega) / R),
            ("effort", "effort"): lambda i, omega: (R * i + k * omega, -k * i),
        }
    )


def motor_drive(source: str) -> BondGraph:
    g = BondGraph("drive")
    u, _, _, J = g.input("u", ""), g.parameter("R", 2.0, ""), g.parameter("k", 0.3, ""), g.parameter("J", 0.1, "")
    supply, shaft = g.one_junction("supply"), g.one_junction("shaft")
    (g.effort_source if source == "voltage" else g.flow_source)("s", u, at=supply)
    machine = g.element("machine", motor(), at=(supply, shaft))
    g.inertance("rotor", J, at=shaft)
    g.measure("u_m", machine.port(1).effort, "")
    g.measure("i_m", machine.port(1).flow, "")
    return g


def test_an_element_of_ones_own_takes_the_strokes_that_its_forms_allow():
    voltage, current = motor_drive("voltage"), motor_drive("current")
    assert same(derivatives(voltage), f_rotor="k*(u - k*f_rotor)/(R*J)")
    assert same(derivatives(current), f_rotor="k*u/J")
    assert same(outputs(current), u_m="R*u + k*f_rotor", i_m="u")
    assert compare(voltage) == "" and compare(current) == ""


def test_an_element_of_ones_own_refuses_other_strokes():
    g = BondGraph("blocked")
    u, _, _ = g.input("u", ""), g.parameter("R", 2.0, ""), g.parameter("k", 0.3, "")
    supply, shaft = g.one_junction("supply"), g.zero_junction("shaft")
    g.effort_source("s", u, at=supply)
    g.element("machine", motor(), at=(supply, shaft))
    g.effort_source("t", u, at=shaft)
    with pytest.raises(CausalityError, match=r"law of machine|machine gives"):
        assign_causality(g)


def test_an_element_of_ones_own_may_be_modulated_and_follow_a_state_of_its_own():
    """The bristle model of friction (Canudas de Wit et al. 1995, IEEE Trans. Autom. Control 40(3))."""
    g = BondGraph("bristle")
    values = {"m": 1.0, "s0": 1e3, "s1": 30.0, "Fc": 1.0}
    F = g.input("F", "")
    m, s0, s1, Fc = (g.parameter(name, value, "") for name, value in values.items())
    v = g.one_junction("v")
    g.effort_source("push", F, at=v)
    g.inertance("mass", m, at=v)
    z = g.integral("z", lambda z: v.flow - s0 * sympy.Abs(v.flow) / Fc * z, "")
    friction = ElementType({("effort",): lambda w: (s0 * z + s1 * (w - s0 * sympy.Abs(w) / Fc * z),)})
    g.element("friction", friction, at=(v,))
    assert same(
        derivatives(g), f_mass="(F - s0*z - s1*(f_mass - s0*Abs(f_mass)*z/Fc))/m", z="f_mass - s0*Abs(f_mass)*z/Fc"
    )


@pytest.mark.parametrize(
    ("forms", "text"),
    [
        ({("effort", "power"): lambda a, b: (a, b)}, "a port gives its 'effort' or its 'flow'"),
        ({("effort", "flow"): lambda a, b: (a,)}, "returns 1 value"),
    ],
)
def test_forms_are_checked(forms, text):
    with pytest.raises(DeclarationError, match=text):
        ElementType(forms).laws()


def test_a_form_uses_what_it_takes():
    g = BondGraph("form")
    effort1 = sympy.Symbol("effort1", real=True)
    with pytest.raises(DeclarationError, match="may use flow1"):
        g.element("x", ElementType({("effort",): lambda f: (effort1 + f,)}))
