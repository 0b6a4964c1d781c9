"""States that start at a signal of the log: their spelling, what is refused, and that nothing on the way loses them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bondgraph.build import build
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import ROTATION, THERMAL, TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.json_writer import graph_to_json
from bondgraph.declare.quantities import Start
from bondgraph.declare.revision import revise_start
from bondgraph.errors import DeclarationError, ModelError
from bondgraph.generate.module import render
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from bondgraph.verbs import pose


def rotor(initial: object = 0.0, graph: BondGraph | None = None, **more: object) -> BondGraph:
    """A rotor driven by a torque, its speed before the log known as an input, and measured behind a gear of 4."""
    g = graph or BondGraph("spindle")
    torque = g.input("torque", "N m")
    if graph is None:
        g.input("omega_before", "rad/s", default=3.0)
    J, b = g.parameter("J", 0.02, "kg m^2", "", (0.01, 0.05)), g.parameter("b", 0.1, "N m s", "", (0.01, 1.0))
    shaft = g.one_junction("shaft", ROTATION)
    g.effort_source("drive", torque, at=shaft)
    g.inertance("rotor", J, at=shaft, initial=initial, state="omega", **more)  # type: ignore[arg-type]
    g.resistance("bearing", b, at=shaft)
    g.measure("fast", 4 * shaft.flow, "rad/s")
    return g


def with_input(share: float = 1.0) -> BondGraph:
    g = BondGraph("spindle")
    before = g.input("omega_before", "rad/s", default=3.0)
    return rotor(share * before, g)


@pytest.mark.parametrize(
    ("graph", "start", "value"),
    [
        (with_input(), Start("omega_before"), 3.0),
        (with_input(-0.5), Start("omega_before", -0.5), -1.5),
        (rotor("omega_before"), Start("omega_before"), 3.0),
        (rotor("fast"), Start("fast"), 0.0),
        (rotor("0.25*fast"), Start("fast", 0.25), 0.0),
        (rotor(("0.25*fast", 7.0)), Start("fast", 0.25), 7.0),
        (rotor(2.0), None, 2.0),
    ],
)
def test_a_state_starts_at_a_signal_and_without_a_log_at_a_number(graph, start, value):
    built = build(graph)
    assert built.graph.nodes["rotor"].start() == start
    assert built.equations.states[0].start == start
    assert built.model.x0().tolist() == [value]
    assert [(one.state, one.signal, one.factor) for one in built.model.starts] == (
        [] if start is None else [("omega", start.signal, start.factor)]
    )


def test_graph_files_keep_starts_of_storages_and_integrals():
    g = rotor(("0.25*fast", 7.0))
    shaft = "shaft"
    g.integral("turned", 1.0 * g.quantities["omega_before"].symbol, "rad", initial=(g.input("angle", "rad"), 0.5))
    springs = [g.one_junction(name, ROTATION) for name in ("left", "right")]
    g.bond(shaft, "left")
    g.bond(shaft, "right")
    g.field("C", "springs", [lambda p, q: p, lambda p, q: q], at=springs, initial=("angle", 2.0))
    data = json.loads(json.dumps(graph_to_json(g)))
    nodes = {node["id"]: node for node in data["nodes"]}
    assert nodes["rotor"]["initial"] == ["0.25*fast", 7.0]
    assert nodes["springs"]["initial"] == ["angle", 2.0]
    assert data["graph"]["integrals"][0]["initial"] == ["angle", 0.5]
    assert graph_from_json(data) == g
    nodes["rotor"]["initial"] = "fast"
    assert graph_from_json(data).nodes["rotor"].starts == (Start("fast"),)


def test_the_module_says_where_states_start_only_where_one_does():
    plain, started = build(rotor()).text, build(rotor("0.25*fast")).text
    assert "STARTS" not in plain
    assert [line for line in started.splitlines() if line not in plain.splitlines()][1:] == [
        "# state, input or output at whose first value in a log it starts, factor", "STARTS = (",
        '    ("omega", "fast", 0.25),',
    ]  # fmt: skip
    again = Model.from_text(started)
    assert again.starts == build(rotor("0.25*fast")).model.starts


@pytest.mark.parametrize("row", ['("omeg", "fast", 0.25)', '("omega", "fest", 0.25)', '("omega", "fast", None)'])
def test_a_module_whose_starts_name_nothing_is_refused(row):
    text = build(rotor("0.25*fast")).text.replace('("omega", "fast", 0.25)', row)
    with pytest.raises(ModelError, match="start"):
        Model.from_text(text)


def test_a_part_starts_at_its_own_signals_or_at_what_they_are_bound_to():
    def machine(bind: object = None) -> BondGraph:
        g = BondGraph("machine")
        speed = g.input("speed", "rad/s")
        known = {"other": 2 * speed, "number": 5.0, "sum": speed + speed * speed, None: None}[bind]  # type: ignore[index]
        g.include("front", with_input(0.5), {"hub": "shaft"}, None if known is None else {"omega_before": known})
        return g

    assert machine().flatten().nodes["front.rotor"].starts == (Start("front.omega_before", 0.5),)
    assert machine("other").flatten().nodes["front.rotor"].starts == (Start("speed", 1.0),)
    number = machine("number").flatten().nodes["front.rotor"]
    assert (number.starts, number.initial) == ((), (2.5,))
    with pytest.raises(DeclarationError, match=r"front\.rotor: initial .* is no start of a state"):
        machine("sum")
    outer = BondGraph("outer")
    outer.include("front", rotor("0.25*fast"), {"hub": "shaft"})
    assert build(outer).model.starts[0].signal == "front.fast"
    shared = BondGraph("shared")
    shared.include("front", rotor("0.25*fast"), {"hub": "shaft"}, shared=True)
    assert build(shared).model.starts[0].signal == "fast"


@pytest.mark.parametrize(
    ("initial", "message"),
    [
        ("fats", r"spindle: rotor: initial fats: no input or output 'fats'.*did you mean 'fast'"),
        ("torque", r"torque is in 'N m', the state in 'rad/s' or 'N m s' - name a signal of that unit, or"),
        ("fast/4", r"initial fast/4 is no start of a state - give a number"),
        ("0*fast", r"is no start of a state"),
        ("nan*fast", r"is no start of a state"),
        ("", r"is no start of a state"),
        ((1.0, "fast"), r"is no start of a state"),
    ],
)
def test_what_is_no_start_is_refused(initial, message):
    with pytest.raises(DeclarationError, match=message):
        build(rotor(initial))


def test_a_tie_begins_what_nothing_measures_where_a_parameter_says():
    g = BondGraph("oven")
    core, shell = (g.zero_junction(name, THERMAL) for name in ("core", "shell"))
    wall = g.one_junction("wall", THERMAL)
    C, R = g.parameter("C", 500.0, "J/K", "", (200.0, 1000.0)), g.parameter("R", 2.0, "K/W")
    g.flow_source("heater", g.input("heat", "W"), at=core)
    g.compliance("core_body", 1 / C, at=core, initial=293.15 * 500.0)
    g.compliance("shell_body", 1 / g.parameter("C_s", 300.0, "J/K"), at=shell, initial=293.15 * 300.0)
    g.bond(core, wall)
    g.bond(wall, shell)
    g.resistance("gap", R, at=wall)
    g.measure_effort("temperature", shell)
    model, time = build(g).model, 2.0 * np.arange(60)
    measured = simulate(model, time, np.full((1, 60), 20.0)).y
    log = MatchedLog("warm", time, np.full((1, 60), 20.0), measured)
    problem = pose(model, log, ["C"], ties={"x0(q_core_body)": "293.15*C"}, process_noise="none")
    members = problem.batch(problem.start[:, np.newaxis] + np.array([0.0, 0.1]))
    begun = members.x0[0][model.index("state", "q_core_body")]
    np.testing.assert_allclose(begun, 293.15 * members.theta[model.index("parameter", "C")], rtol=1e-12)
    assert begun[1] > begun[0]


def test_a_start_has_the_unit_of_the_state_and_takes_no_text():
    g = BondGraph("car")
    gear = g.input("gear", "1", letters={"H": 1.0, "L": 3.0})
    travel = g.input("travel", "m")
    body = g.one_junction("body", TRANSLATION)
    with pytest.raises(DeclarationError, match="gear takes text, a state starts at a number"):
        g.inertance("mass", 2.0, at=body, initial=gear)
    with pytest.raises(DeclarationError, match="travel is in 'm', the state in 'm/s' or"):
        g.inertance("mass", 2.0, at=body, initial=travel)
    m = g.parameter("m", 2.0, "kg")
    # a linear inertance has its flow as state, not its momentum: only the derivation knows
    g.inertance("mass", m, at=body, initial="impulse")
    g.measure("impulse", m * body.flow, "N s")
    with pytest.raises(DeclarationError, match="impulse is in 'N s', the state in 'm/s'"):
        build(g)
    with pytest.raises(DeclarationError, match="only a storage starts at a signal"):
        graph_from_json({"nodes": [{"id": "r", "kind": "R", "effort": "flow", "initial": "travel"}], "bonds": []})


def test_the_symbol_of_nothing_declared_is_refused_at_its_line():
    g = BondGraph("g")
    other = BondGraph("other").input("speed", "rad/s")
    with pytest.raises(DeclarationError, match="'speed' is not declared"):
        g.inertance("rotor", 1.0, initial=other)


def test_render_is_the_same_for_a_flattened_graph(tmp_path: Path):
    outer = BondGraph("outer")
    outer.include("front", rotor("0.25*fast"), {"hub": "shaft"})
    assert render(build(outer).equations) == render(build(outer.flatten()).equations)
    assert np.isfinite(build(outer).model.x0()).all()


def test_a_start_is_revised_where_there_is_one():
    g = BondGraph("car")
    body = g.one_junction("body", TRANSLATION)
    g.inertance("mass", 2.0, at=body, state="v")
    way = g.integral("way", body.flow, "m")
    g.measure_flow("speed", body, "")
    g.measure("travel", way, "m")
    revise_start(g, "mass", "speed")
    revise_start(g, "way", "travel", 0.5)
    assert g.nodes["mass"].starts == (Start("speed"),) and g.integrals[0].start == Start("travel", 0.5)
    with pytest.raises(DeclarationError, match="no input or output 'sped'; did you mean"):
        revise_start(g, "mass", "sped")
    with pytest.raises(DeclarationError, match="'masses' is no storage with one state and no integral; did you mean"):
        revise_start(g, "masses", "speed")
