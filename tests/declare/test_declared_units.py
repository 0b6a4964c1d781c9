"""Numbers in declared units: coherent SI from the declaring line on, the declared unit kept to show them in."""

from __future__ import annotations

import json

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bondgraph.build import build
from bondgraph.coherent import coherent, displayed
from bondgraph.declare.domains import ROTATION, THERMAL, TRANSLATION, Domain
from bondgraph.declare.editing import with_values
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.json_writer import graph_to_json
from bondgraph.declare.quantities import Parameter
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.errors import DeclarationError
from bondgraph.generate.module import render
from bondgraph.simulate.model import Model

ureg = pint.UnitRegistry()


def rig() -> BondGraph:
    """Everything that can be declared in a unit, in units that are not coherent SI."""
    g = BondGraph("rig")
    push = g.input("push", "kN", default=0.5)
    mass = g.parameter("mass", 80.0, "lb", bounds=(60.0, 120.0))
    drag = g.table("drag", [0.0, 36.0, 72.0], [0.0, 0.1, 0.4], "kN", "km/h")
    body = g.one_junction("body", TRANSLATION)
    g.effort_source("force", push, at=body)
    g.inertance("sled", mass, at=body, initial=ureg.Quantity(36.0, "km/h"))
    g.resistance("air", lambda v: drag(v), at=body)
    g.integral("way", body.flow, "mm", initial=1500.0)
    g.signal("power", push * body.flow, "hp")
    g.measure_flow("speed", body, unit="mph")
    return g


def test_every_declared_number_is_coherent_si_from_the_declaring_line_on():
    g = rig()
    (push,), (mass,), (drag,), (way,), (power,) = g.inputs, g.parameters, g.tables, g.integrals, g.signals
    assert (push.default, push.unit, push.display_unit) == (500.0, "N", "kN")
    assert mass.value == pytest.approx(36.2873896) and mass.bounds == pytest.approx((27.2155422, 54.4310844))
    assert (mass.unit, mass.display_unit) == ("kg", "lb")
    assert drag.x == pytest.approx((0.0, 10.0, 20.0)) and drag.values == pytest.approx((0.0, 100.0, 400.0))
    assert (drag.unit, drag.argument_units, drag.shown_argument_units) == ("N", ("m/s",), ("km/h",))
    assert (way.initial, way.unit, way.display_unit) == (1.5, "m", "mm")
    assert (power.unit, power.display_unit) == ("W", "hp")
    assert g.nodes["sled"].initial == pytest.approx((10.0,))
    assert (g.outputs[0].unit, g.outputs[0].display_unit) == ("m/s", "mph")


def test_80_lb_are_pushed_as_36_kg():
    """The sled of 80 lb was integrated as 80 kg, the push of 0.5 kN as 0.5 N: 0.00625 m/s^2 instead of 13.8."""
    model = Model.from_text(render(derive(assign_causality(rig()))))
    rate = model.rhs(0.0, model.x0(**{model.names("state")[0]: 0.0}), model.u0(), model.theta())[0]
    assert rate == pytest.approx(500.0 / 36.2873896)


def test_a_module_keeps_the_units_in_which_its_quantities_are_shown():
    text = render(derive(assign_causality(rig())))
    model = Model.from_text(text)
    assert '("PARAMETERS", "mass", "lb"),' in text and '("OUTPUTS", "speed", "mph"),' in text
    assert model.parameters[0].display_unit == "lb" and model.parameters[0].unit == "kg"
    assert model.parameters[0].shown(model.parameters[0].value) == 80.0
    assert [info.display_unit for info in model.states] == ["m/s", "mm"]
    with pytest.raises(Exception, match=r"mass is in \[kg\] and cannot be shown in \[s\]"):
        Model.from_text(text.replace('"mass", "lb"', '"mass", "s"'))


def test_a_module_of_a_graph_in_si_says_nothing_of_it():
    g = BondGraph("si")
    g.inertance("m", g.parameter("m", 1.0, "kg"), at=g.one_junction("body", TRANSLATION))
    assert "SHOWN_UNITS" not in render(derive(assign_causality(g)))


def test_a_state_measured_under_its_own_name_is_shown_as_it_is_measured():
    g = BondGraph("rotor")
    shaft = g.one_junction("shaft", ROTATION)
    g.inertance("rotor", g.parameter("J", 1.0, "kg m^2"), at=shaft)
    g.measure_flow("omega_rotor", shaft, unit="rpm")
    (state,) = derive(assign_causality(g)).states
    assert (state.symbol.name, state.unit, state.display_unit) == ("omega_rotor", "rad/s", "rpm")


def test_graph_files_keep_declared_units_and_numbers():
    g = rig()
    data = json.loads(json.dumps(graph_to_json(g)))
    (mass,) = data["graph"]["parameters"]
    assert (mass["value"], mass["unit"], mass["bounds"]) == (80.0, "lb", [60.0, 120.0])
    table = data["graph"]["tables"]["drag"]
    assert (table["x"], table["values"], table["unit"], table["argument_units"]) == (
        [0.0, 36.0, 72.0], [0.0, 0.1, 0.4], "kN", ["km/h"]
    )  # fmt: skip
    assert data["graph"]["integrals"][0]["initial"] == 1500.0 and data["graph"]["inputs"][0]["default"] == 0.5
    assert graph_from_json(data) == g


def test_values_may_be_pint_quantities():
    g = BondGraph("g")
    g.parameter("m", ureg.Quantity(80.0, "lb"), "kg", bounds=(ureg.Quantity(60.0, "lb"), 50.0))
    g.parameter("p", ureg.Quantity(2.0, "bar"))
    g.parameter("T", ureg.Quantity(20.0, "degC"), "K")
    g.input("F", "N", default=ureg.Quantity(2.0, "kN"))
    m, p, t = g.parameters
    assert m.value == pytest.approx(36.2873896) and m.bounds == pytest.approx((27.2155422, 50.0))
    assert m.display_unit == "kg"
    assert (p.value, p.unit, p.display_unit) == (2e5, "Pa", "bar")
    g.table("torque", ureg.Quantity([0.0, 3000.0], "rpm"), [ureg.Quantity(1.0, "kN m"), 2.0], "N m", "rad/s")
    assert g.tables[0].x == pytest.approx((0.0, 314.159265)) and g.tables[0].values == pytest.approx((1000.0, 2.0))
    assert t.value == 293.15 and g.inputs[0].default == 2000.0
    with pytest.raises(DeclarationError, match=r"g: k: 80.0 lb is kg, not kg s\^-2 as 'N/m' is"):
        g.parameter("k", ureg.Quantity(80.0, "lb"), "N/m")
    with pytest.raises(DeclarationError, match=r"g: c: 3[.]0 has no unit - give one"):
        g.parameter("c", 3.0)
    spring = g.compliance("c", ureg.Quantity(2.0, "kN/m"))
    assert str(g.nodes[spring.name].law("effort")) == "2000*displacement"
    assert with_values(g, {"m": ureg.Quantity(100.0, "lb")}).parameters[0].value == pytest.approx(45.359237)


@pytest.mark.parametrize(
    ("unit", "message"),
    [
        ("degC", r"g: T: unit 'degC' has an offset - write kelvins, 293.15 K for 20 degC, or 'delta_degC'"),
        ("degF", r"g: T: unit 'degF' has an offset - write kelvins, 266.48\d* K for 20 degF, or 'delta_degF'"),
        ("dB", "g: T: unit 'dB' is a logarithm - write the ratio or the level itself"),
    ],
)
def test_units_without_a_factor_to_si_are_refused(unit, message):
    with pytest.raises(DeclarationError, match=message):
        BondGraph("g").parameter("T", 20.0, unit)
    assert coherent("delta_degC")[1] == 1.0


@pytest.mark.parametrize(
    "declare",
    [
        lambda g: g.parameter("T", ureg.Quantity(35.0, "degC")),
        lambda g: g.input("T", "degC"),
        lambda g: g.input("T", "degC", default=35.0),
        lambda g: g.integral("T", 1, "degC"),
        lambda g: g.signal("T", g.input("level", "K"), "degC"),
        lambda g: g.table("T", [0.0, 1.0], [300.0, 310.0], "degC", "s"),
        lambda g: g.table("T", [0.0, 1.0], [300.0, 310.0], "W", "degC"),
        lambda g: g.measure_effort("T", g.zero_junction("wall", THERMAL), unit="degC"),
    ],
)
def test_every_declaration_in_celsius_says_what_to_declare_instead(declare):
    with pytest.raises(DeclarationError, match=r"write kelvins, .* K for .*; columns of logs may be in"):
        declare(BondGraph("g"))


def test_a_temperature_in_celsius_is_one_in_kelvins_and_no_difference():
    """20 degC as a difference in delta_degC was read as 293.15."""
    g = BondGraph("g")
    warm = ureg.Quantity(20.0, "degC")
    g.input("ambient", "K", default=warm)
    g.integral("mean", 0, "K", initial=warm)
    assert g.inputs[0].default == g.integrals[0].initial == 293.15
    with pytest.raises(DeclarationError, match=r"g: dT: 20.0 °C is counted from another zero than kelvins"):
        g.parameter("dT", warm, "delta_degC")
    g.parameter("dT", ureg.Quantity(36.0, "delta_degF"), "K")
    assert g.parameters[-1].value == pytest.approx(20.0)


def test_values_and_bounds_are_told_in_the_declared_unit():
    with pytest.raises(DeclarationError, match=r"value 80.0 lb lies outside its bounds \(90.0, 120.0\)"):
        BondGraph("g").parameter("m", 80.0, "lb", bounds=(90.0, 120.0))
    g = BondGraph("g")
    a, b = g.parameter("a", 20.0, "mm"), g.parameter("b", 3.0, "cm")
    with pytest.raises(DeclarationError, match=r"a - b is -0.01 with a = 20 mm, b = 3 cm"):
        g.require(a - b, "it fits")


def test_a_start_value_is_one_of_the_storage():
    g = BondGraph("g")
    body = g.one_junction("body", TRANSLATION)
    with pytest.raises(DeclarationError, match=r"g: mass: initial 5.0 kg must be in 'm/s' or 'N s'"):
        g.inertance("mass", 2.0, at=body, initial=ureg.Quantity(5.0, "kg"))
    spring = g.compliance("spring", 2.0, at=body, initial=ureg.Quantity(5.0, "mm"))
    assert g.nodes[spring.name].initial == (0.005,)


@pytest.mark.parametrize(
    ("initial", "said"),
    [
        (
            ureg.Quantity(20.0, "degC"),
            r"oven: load: initial is given in '°C', but the state is the displacement in 'J'",
        ),
        (ureg.Quantity(293.0, "K"), "given in 'K', but the state is the displacement in 'J' - give it in 'J'"),
        (ureg.Quantity(880.0, "kJ"), ""),
    ],
)
def test_a_start_is_in_the_unit_of_the_state_that_the_law_decides(initial, said):
    """A load at 20 degC began with a heat of 293.15 J, that is at 0.1 K, without a word."""
    g = BondGraph("oven")
    inside = g.zero_junction("inside", THERMAL)
    g.compliance("load", lambda heat: heat / 3000.0, at=inside, initial=initial)
    if said:
        with pytest.raises(DeclarationError, match=said):
            build(g)
    else:
        assert build(g).x0().tolist() == [880e3]


def test_a_mass_starts_at_its_speed_and_no_momentum():
    g = BondGraph("car")
    body = g.one_junction("body", TRANSLATION)
    g.inertance("mass", 800.0, at=body, initial=ureg.Quantity(900.0, "N s"))
    with pytest.raises(
        DeclarationError, match=r"car: mass: initial is given in 'N s', but the state is the flow in 'm/s'"
    ):
        build(g)
    assert g.nodes["mass"].initial == (900.0,)


def test_a_part_is_bound_to_numbers_in_its_declared_units_and_to_expressions_in_si():
    part = BondGraph("part")
    body = part.one_junction("body", TRANSLATION)
    part.inertance("mass", part.parameter("m", 80.0, "lb"), at=body)
    g = BondGraph("g")
    own = g.parameter("own", 40.0, "kg")
    for name, value in (("number", 100.0), ("quantity", ureg.Quantity(45.359237, "kg")), ("expression", own)):
        g.include(name, part, bind={"m": value})
    laws = {name: str(g.flatten().nodes[f"{name}.mass"].law("flow")) for name in ("number", "quantity", "expression")}
    assert laws["expression"] == "momentum/own"
    assert laws["number"] == laws["quantity"] and "0.0220462" in laws["number"]
    assert graph_from_json(graph_to_json(g)) == g


def test_quantities_built_by_hand_and_domains_are_coherent_si():
    g = BondGraph("g")
    with pytest.raises(DeclarationError, match="unit 'lb' is not coherent SI"):
        g._declare(Parameter("m", 80.0, "lb"))
    with pytest.raises(
        DeclarationError, match="unit 'bar' is not coherent SI, in which laws are computed - write 'Pa'"
    ):
        Domain("oil", "bar", "m^3/s", "m^3", "Pa s", "p", "Q")


@given(
    st.floats(1e-6, 1e6).map(lambda value: float(f"{value:.12g}")),
    st.sampled_from(["lb", "kN", "km/h", "rpm", "deg", "psi", "L/min", "mm", "kN/mm", "ft lbf", "%", "W h"]),
)
def test_a_declared_number_is_found_again(value, unit):
    assert displayed(value * coherent(unit)[1], unit) == value
