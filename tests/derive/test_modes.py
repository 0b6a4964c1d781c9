"""Modes of exactly derived graphs: constraint efforts, jumps of states, what is refused, files and parts."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.elements import Node
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.json_writer import graph_to_json
from bondgraph.declare.modal import clutch, friction, impact
from bondgraph.declare.quantities import symbol
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.derive.impulse import with_resets
from bondgraph.derive.modes import by_value, modes_json, modes_text
from bondgraph.errors import BondGraphError, DeclarationError, DimensionError
from bondgraph.generate.pipeline import render_graph
from bondgraph.simulate.modes import consistent_inputs
from bondgraph.simulate.simulation import simulate
from tests.simulate.machines import ball, belt, cradle, engagement, exact, geared, rectifier, train


def block(name: str = "block", state: str = "v_block") -> BondGraph:
    g = BondGraph(name)
    v = g.one_junction("v", TRANSLATION)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=v, state=state)
    g.effort_source("pull", g.input("F", "N"), at=v)
    friction(g, "floor", g.parameter("F_c", 3.0, "N"), width=g.parameter("w", 0.01, "m/s"), at=v)
    return g


def test_the_effort_of_a_locked_element_is_what_keeps_its_flow_at_zero():
    model = exact(block())
    for mode, effort in (("locked", 2.5), ("forward", 3.0), ("backward", -3.0)):
        rate = model.rhs(0.0, [0.0], model.u0(F=2.5, mode_floor=mode), model.theta())
        np.testing.assert_allclose(rate, (2.5 - effort) / 2.0, atol=1e-15)
    flow, forward, backward = model.events(0.0, [0.7], model.u0(F=2.5), model.theta())
    assert (flow, forward, backward) == pytest.approx((0.7, 0.5, 5.5))


def test_the_same_declaration_is_a_hyperbolic_tangent_where_it_is_derived_smooth():
    smooth = exact(block(), smooth=True)
    assert smooth.names("input") == ("F",)
    rate = smooth.rhs(0.0, [0.004], smooth.u0(F=1.0), smooth.theta())
    np.testing.assert_allclose(rate, (1.0 - 3.0 * np.tanh(0.4)) / 2.0, rtol=1e-14)


def test_a_static_capacity_is_a_peak_of_the_smooth_form_that_fades():
    model = exact(belt(), smooth=True)

    def force(slip):
        x = model.x0(v=0.1 - slip, q=0.0)
        return model.rhs(0.0, x, model.u0(), model.theta())[0]

    assert force(2.5e-3) == pytest.approx(2.9, abs=0.1)
    assert force(5e-2) == pytest.approx(2.0, abs=1e-9)
    assert force(-5e-2) == pytest.approx(-2.0, abs=1e-9)


def test_locked_elements_share_their_efforts_whatever_else_slips():
    """Every combination: flows of locked elements keep still, the others carry their capacity."""
    model = exact(train((1.0, 2.0, 3.0), (10.0, 20.0), (30.0,)))
    u = model.u0(F0=5.0, F1=-3.0, F2=8.0)
    rng = np.random.default_rng(0)
    modes = [model.index("input", mode.input) for mode in model.modes]
    for _ in range(20):
        u[modes] = rng.integers(-1, 2, 3)
        a = model.rhs(0.0, np.zeros(3), u, model.theta())
        rates = np.array([a[0] - a[1], a[1] - a[2], a[0]])
        held = u[modes] == 0
        np.testing.assert_allclose(rates[held], 0.0, atol=1e-13)
        events = model.events(0.0, np.zeros(3), u, model.theta()).reshape(3, 3)
        efforts = (events[:, 2] - events[:, 1]) / 2.0
        np.testing.assert_allclose(efforts[~held], (np.array([10.0, 20.0, 30.0]) * u[modes])[~held], rtol=1e-13)
        balance = np.array([efforts[0] + efforts[2], efforts[1] - efforts[0], -efforts[1]])
        np.testing.assert_allclose(np.array([1.0, 2.0, 3.0]) * a, u[:3] - balance, atol=1e-12)


def test_locking_keeps_momentum_also_through_a_gear():
    model = exact(geared())
    x = model.x0(omega_rotor_a=10.0, omega_rotor_b=4.0)
    after = model.reset("mode_plates", 0.0, x, model.u0(), model.theta())
    np.testing.assert_allclose(after, (1.0 * 10.0 + (2.0 + 27.0) * 4.0) / 30.0, rtol=1e-13)
    np.testing.assert_allclose(model.reset("mode_brake", 0.0, x, model.u0(), model.theta()), [10.0, 0.0], atol=1e-15)


def test_an_impact_reverses_the_relative_speed_and_counts_the_heat_midway():
    model = exact(cradle(2, 0.5))
    after = model.reset("mode_hit0", 0.0, model.x0(), model.u0(), model.theta())
    np.testing.assert_allclose(after[:2], [0.25, 0.75], rtol=1e-14)
    heated = exact(engagement())
    x = heated.x0()
    lost = 0.5 * 0.2 * 100.0**2 * 0.5 / 0.7
    locked = heated.reset("mode_plates", 0.0, x, heated.u0(), heated.theta())
    assert locked[heated.index("state", "heat")] == pytest.approx(lost, rel=1e-12)


def test_a_chain_of_many_clutches_is_derived_in_a_moment():
    """Twenty joints solved jointly: the text grows with them, not with their combinations."""
    few, many = (len(render_graph(train([1.0] * n, [1.0] * (n - 1)), smooth=False).text) for n in (10, 20))
    assert many < 4 * few


@pytest.mark.parametrize("make", [belt, engagement, geared, ball, cradle, rectifier])
def test_elements_with_modes_go_through_files(make):
    graph = make()
    data = json.loads(json.dumps(graph_to_json(graph)))
    assert graph_from_json(data) == graph
    assert render_graph(graph_from_json(data), smooth=False).text == render_graph(graph, smooth=False).text


def test_elements_with_modes_keep_their_names_inside_parts():
    g = BondGraph("pair")
    for name in ("left", "right"):
        g.include(name, block(state=""), {"body": "v"})
    model = exact(g)
    assert [mode.element for mode in model.modes] == ["left.floor", "right.floor"]
    assert [mode.reset for mode in model.modes] == ["reset_left_floor", "reset_right_floor"]


def test_switches_of_one_argument_have_one_side():
    equations = derive(assign_causality(rectifier()), smooth=False)
    assert [mode.symbol.name for mode in equations.modes] == ["side_diode"]
    assert by_value(equations).modes == () and by_value(equations).inputs == ()
    assert modes_text(equations) == "\nevents, where one of these passes zero\n  switch diode: effort = u_loop_diode"


def test_modes_are_told_as_data():
    (told,) = modes_json(derive(assign_causality(block()), smooth=False))
    assert (told["name"], told["kind"], told["element"]) == ("mode_floor", "friction", "floor")
    assert told["values"] == {"locked": 0.0, "forward": 1.0, "backward": -1.0}
    assert [function["is"] for function in told["functions"]] == ["v_block", "F_c - F_floor", "F_c + F_floor"]


def test_a_graph_without_modes_is_the_same_in_both_forms():
    g = BondGraph("plain")
    v = g.one_junction("v", TRANSLATION)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=v)
    causal = assign_causality(g)
    assert derive(causal, smooth=False) == derive(causal)
    assert with_resets(causal, []) == ()


def refused(graph: BondGraph) -> str:
    with pytest.raises(BondGraphError) as caught:
        derive(assign_causality(graph), smooth=False)
    return str(caught.value)


def test_elements_on_one_flow_carry_it_in_proportion_to_what_they_can_hold():
    g = block("shared")
    width = g.parameter("w_b", 0.01, "m/s")
    for name, level in (("brake", 9.0), ("drag", 0.0)):
        friction(g, name, g.parameter(f"F_{name}", level, "N"), width=width, at="v")
    g.bond(g.add_node(Node("guide", "R", laws=(("capacity", symbol("F_c")), ("width", symbol("w"))))), "v")
    model = exact(g)
    u = consistent_inputs(model, 0.0, np.zeros(1), model.u0(F=5.0), model.theta())
    assert model.rhs(0.0, [0.0], u, model.theta())[0] == pytest.approx(0.0, abs=1e-15)
    events = model.events(0.0, [0.0], u, model.theta()).reshape(4, 3)
    np.testing.assert_allclose((events[:, 2] - events[:, 1]) / 2, [1.0, 3.0, 0.0, -1.0], atol=1e-14)
    found = simulate(model, np.linspace(0.0, 1.0, 2), {"F": [10.0, 20.0]})
    assert {event.element: event.time for event in found.events} == pytest.approx(dict.fromkeys(
        ("floor", "brake", "drag", "guide"), 0.5
    ), abs=1e-9)  # fmt: skip
    assert found.state("v_block")[-1] == pytest.approx(0.5 * 5.0 * 0.5 / 2.0, abs=1e-9)


def test_of_elements_whose_flows_follow_from_each_other_the_ones_that_are_needed_hold():
    """Two masses on a floor and a joint between them: with all three locked one is not needed."""
    model = exact(train((1.0, 2.0), (3.0,), (4.0, 5.0)))
    places = [model.index("input", mode.input) for mode in model.modes]
    for seed in range(20):
        rng = np.random.default_rng(seed)
        forces = rng.uniform(-12.0, 12.0, 2)
        u = model.u0(F0=forces[0], F1=forces[1])
        u[places] = rng.integers(-1, 2, 3)
        a = model.rhs(0.0, np.zeros(2), u, model.theta())
        held = u[places] == 0
        np.testing.assert_allclose(np.array([a[0] - a[1], a[0], a[1]])[held], 0.0, atol=1e-12)
        u = consistent_inputs(model, 0.0, np.zeros(2), u, model.theta())
        events = model.events(0.0, np.zeros(2), u, model.theta()).reshape(3, 3)
        assert (events[u[places] == 0, 1:] >= -1e-12).all()


def test_a_flow_that_is_imposed_cannot_lock():
    g = BondGraph("imposed")
    v = g.one_junction("v", TRANSLATION)
    g.flow_source("motor", g.parameter("v0", 1.0, "m/s"), at=v)
    friction(g, "floor", g.parameter("F_c", 3.0, "N"), width=g.parameter("w", 0.01, "m/s"), at=v)
    assert "floor: its flow is imposed and does not react to its own effort" in refused(g)


def test_a_gap_that_does_not_open_with_the_flow_is_refused():
    g = BondGraph("wrong")
    v = g.one_junction("v", TRANSLATION)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=v)
    height = g.integral("height", v.flow, "m", initial=1.0)
    k, w = g.parameter("k", 1e6, "N/m"), g.parameter("w", 1e-6, "m")
    impact(g, "floor", -height, 0.5, stiffness=k, width=w, at=v)
    assert "its gap must open at the rate of its flow" in refused(g)


def test_an_impulse_on_an_inertance_that_is_not_constant_is_refused():
    g = BondGraph("nonlinear")
    v = g.one_junction("v", TRANSLATION)
    scale = g.parameter("p0", 1.0, "N s")
    g.inertance("mass", flow=lambda p: p / g.parameter("m", 2.0, "kg") * (1 + (p / scale) ** 2), at=v)
    friction(g, "floor", g.parameter("F_c", 3.0, "N"), width=g.parameter("w", 0.01, "m/s"), at=v)
    assert "an impulse through it acts nonlinearly on" in refused(g)


def test_a_storage_that_would_follow_the_effort_of_a_friction_is_refused():
    g = BondGraph("rate")
    a, z, b = g.one_junction("a"), g.zero_junction("z"), g.one_junction("b")
    g.inertance("rotor", 1.0, at=a)
    g.bond(a, z)
    friction(g, "plates", 3.0, width=0.01, at=z)
    g.gyrator("machine", 2.0, z, b)
    g.inertance("coil", 1.0, at=b)
    assert "plates cannot carry its stroke at z (law of plates gives an effort)" in refused(g)


@pytest.mark.parametrize("laws", [{"capacity": "3"}, {"gap": "1", "width": "1"}, {"capacity": "3", "effort": "flow"}])
def test_incomplete_laws_are_refused_at_the_declaring_line(laws):
    data = graph_to_json(block())
    (record,) = [node for node in data["nodes"] if node["id"] == "floor"]
    for key in ("capacity", "width"):
        del record[key]
    record |= laws
    with pytest.raises(DeclarationError, match="an R with modes gives capacity and width"):
        graph_from_json(data)


@pytest.mark.parametrize(("parameter", "law"), [("F_c", "capacity"), ("w", "width")])
def test_a_wrong_unit_is_found_with_the_element(parameter, law):
    data = graph_to_json(block())
    (record,) = [given for given in data["graph"]["parameters"] if given["name"] == parameter]
    record["unit"] = "kg"
    with pytest.raises(DimensionError, match=f"floor: {law} must be"):
        assign_causality(graph_from_json(data))


def test_a_clutch_may_be_named_like_anything():
    g = BondGraph("names")
    a, b = g.one_junction("a", ROTATION), g.one_junction("b", ROTATION)
    g.inertance("ra", g.parameter("locked_c", 1.0, "kg m^2"), at=a)
    g.inertance("rb", g.parameter("mode_c", 2.0, "kg m^2"), at=b)
    clutch(g, "c", g.parameter("events", 3.0, "N m"), a, b, width=g.parameter("reset_c", 0.1, "rad/s"))
    friction(g, "d", g.parameter("EVENTS", 3.0, "N m"), width=g.parameter("MODES", 0.1, "rad/s"), at=b)
    model = exact(g)
    assert model.modes[0].input == "mode_c_"
    np.testing.assert_allclose(model.rhs(0.0, [1.0, 0.0], model.u0(mode_c_=1.0), model.theta()), [-3.0, 0.0])
