"""Starts of states at expressions of parameters: spelling, files, parts, modules, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.declare.editing import with_values
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.json_writer import graph_to_json
from bondgraph.errors import DeclarationError, DimensionError, ModelError
from bondgraph.report.python_lines import correction_lines


def oven(start: object = "C*T0", load: bool = True) -> bg.BondGraph:
    """A heated body of which one knows the temperature at the start, whose state is its heat."""
    g = bg.BondGraph("oven")
    C, T0 = g.parameter("C", 500.0, "J/K", "", (200.0, 1000.0)), g.parameter("T0", 290.0, "K", "", (270.0, 320.0))
    T_room, R = g.parameter("T_room", 280.0, "K"), g.parameter("R", 2.0, "K/W")
    body = g.zero_junction("body", bg.THERMAL)
    g.flow_source("heater", g.input("heat", "W", default=20.0), at=body)
    g.resistance("wall", flow=lambda T: (T - T_room) / R, at=body)
    if load:
        g.compliance("load", 1 / C, at=body, initial=C * T0 if start is None else start)
    g.measure_effort("temperature", body)
    return g


def test_a_start_moves_with_its_parameters() -> None:
    """It was refused, with its value at the declared parameters and a tie as what to give in its place."""
    model = bg.build(oven())
    assert model.x0().tolist() == [145000.0] and model.states[0].initial == 145000.0
    assert model.x0(model.theta(C=600.0)).tolist() == [174000.0]
    assert model.x0(model.theta(C=600.0), q_load=1.0).tolist() == [1.0] == model.x0(q_load=1.0).tolist()
    members = np.stack([model.theta(T0=300.0), model.theta(C=100.0)], axis=1)
    assert model.x0(members).tolist() == [[150000.0, 29000.0]]
    assert bg.build(oven(None)) == model
    assert "PARAMETER_STARTS" not in bg.build(oven(7.0)).text and "def start" not in bg.build(oven(7.0)).text


def test_a_simulation_begins_there() -> None:
    """A body of heat C T0 cools to the room with the time R C: T = T_end + (T0 - T_end) exp(-t/(R C))."""
    model, time = bg.build(oven()), np.linspace(0.0, 3000.0, 31)
    for known in ({}, {"C": 600.0, "T0": 310.0}, {"R": 1.0, "C": 250.0}):
        C, T0, R = (known.get(name, value) for name, value in (("C", 500.0), ("T0", 290.0), ("R", 2.0)))
        run = bg.simulate(model, time, theta=known)
        end = 280.0 + 20.0 * R
        np.testing.assert_allclose(run.y[0], end + (T0 - end) * np.exp(-time / (R * C)), rtol=1e-8)


def test_graph_files_parts_and_values_keep_a_start() -> None:
    g = oven()
    data = json.loads(json.dumps(graph_to_json(g)))
    assert next(node for node in data["nodes"] if node["id"] == "load")["initial"] == "C*T0"
    assert graph_from_json(data) == g
    moved = with_values(g, {"C": 600.0})
    assert moved.nodes["load"].initial == (174000.0,)
    assert graph_from_json(json.loads(json.dumps(graph_to_json(moved)))) == moved
    outer = bg.BondGraph("kitchen")
    T = outer.parameter("T_kitchen", 295.0, "K")
    outer.include("left", oven())
    outer.include("right", oven(), None, {"T0": T})
    outer.include("fixed", oven(), None, {"T0": 300.0, "C": 100.0})
    assert bg.build(outer).model.x0().tolist() == [145000.0, 147500.0, 30000.0]
    flat = outer.flatten()
    assert str(flat.nodes["right.load"].start()) == "T_kitchen*right.C" and flat.nodes["fixed.load"].starts == ()
    model = bg.build(outer).model
    assert model.x0(model.theta(**{"right.C": 400.0})).tolist() == [145000.0, 118000.0, 30000.0]
    again = graph_from_json(json.loads(json.dumps(graph_to_json(flat))))
    assert again == flat


def test_an_integral_starts_at_parameters_too() -> None:
    g = bg.BondGraph("cart")
    v, m = g.one_junction("body", bg.TRANSLATION), g.parameter("m", 2.0, "kg")
    start = g.parameter("s0", 3.0, "m")
    g.inertance("mass", m, at=v, state="v", initial=1.0)
    g.integral("place", v.flow, "m", initial=2 * start)
    model = bg.build(g)
    assert model.x0().tolist() == [1.0, 6.0] and model.x0(model.theta(s0=5.0)).tolist() == [1.0, 10.0]
    assert graph_from_json(json.loads(json.dumps(graph_to_json(g)))) == g


def test_lines_of_python_declare_the_same_start() -> None:
    assert "initial='C*T0'" in correction_lines(oven(load=False), oven())


REFUSED = {
    "an unknown name": ("C*T1", r"load: initial C\*T1 is no start of a state - give a number, an expression of"),
    "an input among them": ("C*heat", r"initial C\*heat is no start of a state"),
    "a number beside it": (("C*T0", 3.0), "is no start of a state"),
    "no value": ("C*log(T0 - 290)", r"initial .*has no value at the declared parameters"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_start_is_refused(case: str) -> None:
    start, said = REFUSED[case]
    g = bg.BondGraph("g")
    g.input("heat", "W")
    with pytest.raises(DeclarationError, match=said):
        oven(start)


def test_a_start_of_another_dimension_is_refused() -> None:
    with pytest.raises(DimensionError, match=r"initial of q_load must be kg m\^2 s\^-2 but T0 is K"):
        bg.build(oven("T0"))
    assert bg.build(oven("293.15*C")).model.x0().tolist() == [146575.0]  # kelvins that nobody wrote


def test_a_part_whose_start_is_bound_to_an_input_is_refused() -> None:
    outer = bg.BondGraph("kitchen")
    now = outer.input("T_now", "K")
    with pytest.raises(DeclarationError, match=r"left\.load: initial .*T_now.* is no start of a state"):
        outer.include("left", oven(), None, {"T0": now})


def test_a_module_that_names_no_state_is_refused() -> None:
    text = bg.build(oven()).text
    with pytest.raises(ModelError, match="is said to start where parameters say but is no state"):
        bg.Model.from_text(text.replace('PARAMETER_STARTS = ("q_load",)', 'PARAMETER_STARTS = ("p",)'))
    with pytest.raises(ModelError, match="start"):
        bg.Model.from_text(text.replace("def start(", "def begin("))
