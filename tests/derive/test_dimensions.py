"""Units: every law and every derived equation is homogeneous, or refused with the element's name."""

from __future__ import annotations

import pytest
import sympy

from bondgraph.declare.dimensions import DimensionReader, MismatchError
from bondgraph.declare.domains import CHEMICAL, ELECTRICAL, HYDRAULIC, ROTATION, THERMAL, TRANSLATION
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.errors import DeclarationError, DimensionError
from bondgraph.units import dimension, dimension_text
from tests.derive.spec import damper, force, graph, mass

DOMAINS = (ELECTRICAL, TRANSLATION, ROTATION, HYDRAULIC, THERMAL, CHEMICAL)


@pytest.mark.parametrize("domain", DOMAINS, ids=lambda domain: domain.name)
def test_every_domain_carries_its_units_through_the_equations(domain):
    """A source, a linear storage of each kind and a resistance, with the coefficients' units from the domain's."""
    e, f, q, p = domain.effort_unit, domain.flow_unit, domain.displacement_unit, domain.momentum_unit
    g = BondGraph("units")
    u = g.input("u", e)
    k, m = g.parameter("k", 1.0, f"({e})/({q})"), g.parameter("m", 1.0, f"({p})/({f})")
    r, n = g.parameter("r", 1.0, f"({e})/({f})"), g.parameter("n", 2.0, "1")
    a, b = g.one_junction("a", domain), g.one_junction("b", domain)
    g.effort_source("s", u, at=a)
    g.inertance("I", m, at=a)
    g.compliance("C", k, at=a)
    g.transformer("t", n, a, b)
    g.inertance("J", m, at=b)
    g.resistance("R", r, at=b)
    g.measure_effort("e_R", "R", unit=e)
    equations = derive(assign_causality(g))
    check_dimensions(equations)
    assert [dimension(state.unit) for state in equations.states] == [dimension(f), dimension(q)]


def declare_wrongly(name: str, g: BondGraph, j: Handle) -> None:
    """Declare something called ``wrong`` whose unit does not fit."""

    def x(unit: str) -> sympy.Symbol:
        return g.parameter("x", 1.0, unit)

    if name == "resistance":
        g.resistance("wrong", x("kg"), at=j)
    elif name == "nonlinear resistance":
        g.resistance("wrong", lambda v: x("N s/m") * v * abs(v), at=j)
    elif name == "compliance":
        g.compliance("wrong", x("N s/m"), at=j)
    elif name == "inertance":
        g.inertance("wrong", x("kg m^2"), at=j)
    elif name == "effort source":
        g.effort_source("wrong", x("V"), at=j)
    elif name == "flow source":
        g.flow_source("wrong", x("rpm"), at=j)
    elif name == "argument":
        force = g.parameter("F", 1.0, "N")
        g.resistance("wrong", lambda v: force * sympy.tanh(v / x("m")), at=j)
    elif name == "comparison":
        force, limit = g.parameter("F", 1.0, "N"), x("m")
        g.resistance("wrong", lambda v: force * sympy.Piecewise((1, v > limit), (0, True)), at=j)
    elif name == "transformer":
        g.transformer("wrong", x("1"), j, g.one_junction("w", ROTATION))
    elif name == "gyrator":
        g.gyrator("wrong", x("1"), j, g.one_junction("w", ELECTRICAL))
    elif name == "field":
        g.field("C", "wrong", energy=lambda a, b: x("N") * (a + b) ** 2, at=(j, j))
    elif name == "signal":
        g.signal("wrong", j.flow * x("kg"), "N")
    elif name == "integral":
        g.integral("wrong", j.flow * x("kg"), "N")
    elif name == "output":
        g.measure("wrong", j.flow * x("kg"), "N")
    elif name == "signal of another element":
        momentum = Handle("m", "I", TRANSLATION).momentum
        g.resistance("wrong", lambda v: x("N s/m^2") * v * momentum, at=j)


WRONG = (
    "resistance", "nonlinear resistance", "compliance", "inertance", "effort source", "flow source", "argument",
    "comparison", "transformer", "gyrator", "field", "signal", "integral", "output", "signal of another element",
)  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_unit_names_its_element(name):
    g = BondGraph("g")
    j = g.one_junction("j", TRANSLATION)
    g.inertance("m", g.parameter("m", 1.0, "kg"), at=j)
    declare_wrongly(name, g, j)
    if "w" in g.nodes:
        g.inertance("J", 1.0, at="w")
    with pytest.raises(DimensionError) as caught:
        check_dimensions(derive(assign_causality(g)))
    assert caught.value.where == ("wrong",) and caught.value.message.startswith("g: wrong: ")


def test_tables_have_units_of_argument_and_value():
    def machine(argument: str, value: str) -> BondGraph:
        g = BondGraph("engine")
        shaft = g.one_junction("shaft", ROTATION)
        torque = g.table("torque", [0.0, 100.0, 200.0], [1.0, 3.0, 2.0], value, argument)
        g.inertance("J", g.parameter("J", 1.0, "kg m^2"), at=shaft)
        g.effort_source("engine", g.parameter("share", 0.9, "1") * torque(shaft.flow), at=shaft)
        return g

    check_dimensions(derive(assign_causality(machine("rad/s", "N m"))))
    with pytest.raises(DimensionError, match="table torque takes m but flow\\(shaft\\) is s\\^-1"):
        assign_causality(machine("m", "N m"))
    with pytest.raises(DimensionError, match="engine: effort must be"):
        assign_causality(machine("rad/s", "N"))


def test_what_has_no_unit_is_not_checked():
    nodes = {
        "F": force("sin(t)*9.81"),
        "v": "1",
        "m": mass(),
        "b": ("R", {"effort": "3*tanh(flow) + 2"}),
        "d": damper(),
    }
    g = graph(nodes, "F->v v->m v->b v->d", {"m": 1, "b": 2})
    check_dimensions(derive(assign_causality(g)))
    g._nodes["v"] = g.nodes["v"].__class__("v", "1", TRANSLATION)
    check_dimensions(derive(assign_causality(g)))


def test_a_number_beside_declared_quantities_is_a_pure_number():
    b, v, x = sympy.symbols("b v x", real=True)
    reader = DimensionReader({b: dimension("N s/m"), v: dimension("m/s"), x: dimension("m")}, {b}, {})
    assert dimension_text(reader.of(2 * b * v)) == "kg m s^-2"
    assert reader.of(2 * v) is None
    assert reader.of(v * x**2) == dimension("m^3/s")
    assert reader.of(sympy.sqrt(v * v * b * b)) == dimension("N")
    assert reader.of(sympy.Piecewise((b, v > 0), (0, True))) == dimension("N s/m")
    with pytest.raises(MismatchError, match=r"adds .* and .*"):
        reader.of(b * v + b * x)
    with pytest.raises(MismatchError, match="needs a pure number"):
        reader.of(sympy.exp(b * v))


def test_an_unknown_unit_is_refused_where_it_is_declared():
    with pytest.raises(DeclarationError, match="g: m: unit 'kgg' is not known"):
        BondGraph("g").parameter("m", 1.0, "kgg")


def test_rates_of_inputs_have_units():
    g = BondGraph("driven")
    v = g.one_junction("v", TRANSLATION)
    g.flow_source("s", g.input("u", "m/s"), at=v)
    g.inertance("m", g.parameter("m", 2.0, "kg"), at=v)
    g.measure_effort("F", "m", unit="N")
    equations = derive(assign_causality(g))
    check_dimensions(equations)
    assert dimension(equations.inputs[1].unit) == dimension("m/s^2")


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("Nm", "N m"),
        ("Nms/rad", "N m s"),
        ("Ns/m", "N s/m"),
        ("m3/s", "m^3/s"),
        ("Ohm", "ohm"),
        ("-", "1"),
        ("Vs", "Wb"),
    ],
)
def test_units_written_as_one_word_are_products(written, meant):
    assert dimension(written) == dimension(meant)


@pytest.mark.parametrize("weight", [lambda m, a: -9.81 * m, lambda m, a: -m * a / 1.3])
def test_a_number_with_digits_may_be_a_constant_of_nature(weight):
    g = BondGraph("falling")
    m, a = g.parameter("m", 2.0, "kg"), g.parameter("a", 9.8, "m/s^2")
    v = g.one_junction("v", TRANSLATION)
    g.effort_source("weight", weight(m, a), at=v)
    g.inertance("mass", m, at=v)
    check_dimensions(derive(assign_causality(g)))


def test_rates_tell_the_dimension_of_states_without_a_domain():
    g = BondGraph("coil")
    u, L, R = g.input("u", "V"), g.parameter("L", 0.1, "H"), g.parameter("R", 5.0, "F")
    loop = g.one_junction("loop")
    g.effort_source("supply", u, at=loop)
    g.inertance("coil", L, at=loop)
    g.resistance("wire", R, at=loop)
    with pytest.raises(DimensionError, match=r"d\(f_coil\)/dt: .* adds .*u.*kg m\^2 s\^-3 A\^-1"):
        check_dimensions(derive(assign_causality(g)))


def _capacity(g: BondGraph) -> None:
    g.compliance("tank", g.parameter("C", 2e-10, "m^3/Pa"), at=g.zero_junction("line", HYDRAULIC))


def _conductance(g: BondGraph) -> None:
    g.resistance("wall", g.parameter("UA", 60.0, "W/K"), at=g.one_junction("between", THERMAL))


def _area(g: BondGraph) -> None:
    line, rod = g.zero_junction("line", HYDRAULIC), g.one_junction("rod", TRANSLATION)
    g.effort_source("pump", g.input("p", "Pa"), at=line)
    g.inertance("mass", g.parameter("m", 1.0, "kg"), at=rod)
    g.transformer("piston", 2 * g.parameter("area", 2e-3, "m^2"), line, rod)


@pytest.mark.parametrize(
    ("declare", "hint"), [(_capacity, "1/C"), (_conductance, "1/UA"), (_area, "1/(2*area)")], ids=["C", "UA", "area"]
)
def test_a_coefficient_given_as_its_reciprocal_is_told(declare, hint):
    """A capacity where a stiffness belongs, a conductance for a resistance, an area for an effort per effort."""
    g = BondGraph("lift")
    declare(g)
    with pytest.raises(DimensionError) as refused:
        assign_causality(g)
    assert str(refused.value).endswith(f" - correct the law or its units; the reciprocal would fit: {hint}")


def test_no_reciprocal_is_offered_where_none_fits():
    g = BondGraph("lift")
    g.compliance("tank", g.parameter("C", 2e-10, "m^3"), at=g.zero_junction("line", HYDRAULIC))
    with pytest.raises(DimensionError, match=r"correct the law or its units\Z"):
        assign_causality(g)
