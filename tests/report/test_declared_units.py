"""A quantity declared in any unit gives the same machine: trajectories, tables and estimates agree in SI."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.cli import main
from bondgraph.coherent import coherent
from bondgraph.data.log import Log, LogChannel
from bondgraph.data.matching import match
from bondgraph.data.read import read_log
from bondgraph.data.write import csv_text
from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, ROTATION, TRANSLATION
from bondgraph.declare.files import write_graph
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.json_writer import graph_to_json
from bondgraph.report.evaluate import evaluate
from bondgraph.report.linear import linear_answer, linear_json
from bondgraph.report.manoeuvre import _quantities as panel_quantities
from bondgraph.report.plots import _quantities as plotted
from bondgraph.report.simulation import SimulationOptions, simulate_graph, trajectory_log
from bondgraph.simulate.scenario import Scenario
from bondgraph.simulate.trajectory import Trajectory
from bondgraph.units import conversion

#: Units by dimension, the coherent one first.
UNITS = {
    "voltage": ("V", "mV", "kV"),
    "current": ("A", "mA"),
    "inductance": ("H", "mH"),
    "resistance": ("ohm", "kohm"),
    "machine": ("N m/A", "N mm/mA", "V/rpm"),
    "inertia": ("kg m^2", "g m^2", "lb ft^2"),
    "drag": ("N m s", "N mm s/rad", "N m/rpm", "ft lbf s"),
    "torque": ("N m", "N mm", "ft lbf", "kN m"),
    "speed": ("rad/s", "rpm", "deg/s", "rev/min", "turn/s"),
    "angle": ("rad", "deg", "turn", "rev"),
    "power": ("W", "kW", "hp"),
    "mass": ("kg", "lb", "g", "t"),
    "force": ("N", "kN", "lbf"),
    "velocity": ("m/s", "km/h", "mph"),
    "length": ("m", "mm", "in", "km"),
    "damping": ("N s/m", "N/(km/h)", "lbf s/ft"),
    "pressure": ("Pa", "bar", "psi", "kPa"),
    "flow": ("m^3/s", "L/min"),
    "capacity": ("m^3/Pa", "L/bar"),
    "throttle": ("Pa s/m^3", "bar min/L"),
    "share": ("1", "%"),
}
SI = {name: units[0] for name, units in UNITS.items()}
SPEEDS, TORQUES = (0.0, 20.0, 60.0), (0.0, 0.05, 0.4)

unit_choices = st.fixed_dictionaries({name: st.sampled_from(units) for name, units in UNITS.items()})


def machine(units: Mapping[str, str]) -> BondGraph:
    """A motor with a tabulated load, a vehicle and a hydraulic line, each number written in the given units."""

    def written(value: float, kind: str) -> float:
        return value / coherent(units[kind])[1]

    def parameter(name: str, value: float, kind: str, bounds: tuple[float, float] | None = None) -> object:
        limits = None if bounds is None else (written(bounds[0], kind), written(bounds[1], kind))
        return g.parameter(name, written(value, kind), units[kind], "", limits)

    g = BondGraph("machine")
    voltage = g.input("voltage", units["voltage"], default=written(12.0, "voltage"))
    push = g.input("push", units["force"], default=written(300.0, "force"))
    pumped = g.input("pumped", units["flow"], default=written(1e-4, "flow"))
    load = g.table(
        "load", [written(x, "speed") for x in SPEEDS], [written(x, "torque") for x in TORQUES],
        units["torque"], units["speed"],
    )  # fmt: skip
    circuit, shaft = g.one_junction("circuit", ELECTRICAL), g.one_junction("shaft", ROTATION)
    g.effort_source("supply", voltage, at=circuit)
    g.inertance("coil", parameter("L", 0.05, "inductance"), at=circuit)
    g.resistance("winding", parameter("R", 1.5, "resistance"), at=circuit)
    g.gyrator("motor", parameter("k", 0.2, "machine"), circuit, shaft)
    g.inertance("rotor", parameter("J", 0.02, "inertia"), at=shaft)
    share = parameter("wear", 0.3, "share")
    drag = parameter("b", 0.01, "drag", (1e-3, 0.1))
    g.resistance("bearing", lambda w: (1 + share) * drag * w, at=shaft)
    g.resistance("load", lambda w: load(w), at=shaft)
    g.integral("angle", shaft.flow, units["angle"], initial=written(0.5, "angle"))
    g.signal("electric_power", voltage * circuit.flow, units["power"])
    body = g.one_junction("body", TRANSLATION)
    g.effort_source("pusher", push, at=body)
    g.inertance("mass", parameter("m", 80.0, "mass"), at=body, initial=2.0)
    g.resistance("air", parameter("c", 40.0, "damping"), at=body)
    g.integral("way", body.flow, units["length"], initial=written(1.5, "length"))
    line = g.zero_junction("line", HYDRAULIC)
    g.flow_source("pump", pumped, at=line)
    g.compliance("hose", displacement=lambda p: parameter("hose_capacity", 1e-9, "capacity") * p, at=line)
    g.resistance("valve", parameter("valve_drag", 1e9, "throttle"), at=line)
    g.measure_flow("omega", shaft, unit=units["speed"])
    g.measure_flow("current", circuit, unit=units["current"])
    g.measure_flow("velocity", body, unit=units["velocity"])
    g.measure_effort("pressure", line, unit=units["pressure"])
    return g


def run(graph: BondGraph, **options: object) -> Trajectory:
    """The machine over a second."""
    return simulate_graph(graph, None, SimulationOptions(1.0, 0.05, **options))


def in_si(log: Log) -> dict[str, np.ndarray]:
    """The channels of a table in coherent SI."""
    return {name: one.numbers * coherent(one.unit)[1] for name, one in log.channels.items()}


def assert_same(found: Mapping[str, np.ndarray], expected: Mapping[str, np.ndarray]) -> None:
    assert set(found) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-6, atol=1e-8 * np.abs(values).max(), err_msg=name)


REFERENCE = run(machine(SI), signals=True)


@settings(max_examples=15, deadline=None)
@given(unit_choices)
def test_any_declared_units_give_the_same_machine(units):
    graph = machine(units)
    trajectory = run(graph, signals=True)
    np.testing.assert_allclose(trajectory.x, REFERENCE.x, rtol=1e-6, atol=1e-9 * np.abs(REFERENCE.x).max())
    log = trajectory_log(trajectory)
    assert log.channels["omega"].unit == units["speed"] and log.channels["angle"].unit == units["angle"]
    assert log.channels["pressure"].unit == units["pressure"]
    assert log.channels["electric_power"].unit == units["power"]
    assert_same(in_si(log), in_si(trajectory_log(REFERENCE)))
    assert graph_from_json(graph_to_json(graph)) == graph or graph_to_json(graph) == graph_to_json(
        graph_from_json(graph_to_json(graph))
    )
    (point,), (known,) = (evaluate(g, [{"inputs": {"voltage": 5.0}, "parameters": {"b": 0.02}}]) for g in (graph, SAME))
    assert point["derivatives"] == pytest.approx(known["derivatives"], rel=1e-9)
    for matrix in ("A", "B", "C", "D"):
        found, expected = (linear_json(linear_answer(g, {}))[matrix] for g in (graph, SAME))
        np.testing.assert_allclose(found, expected, rtol=1e-9)


SAME = machine(SI)


@settings(max_examples=10, deadline=None)
@given(unit_choices)
def test_pictures_show_values_in_the_units_that_stand_beside_them(units):
    trajectory = run(machine(units))
    curves = {name: (unit, values) for name, unit, values in plotted(trajectory, ())}
    for name, (unit, values) in {**curves, **panel_quantities(trajectory)}.items():
        expected = panel_quantities(REFERENCE)[name]
        factor = conversion(unit or "1", expected[0] or "1")[0]
        np.testing.assert_allclose(values * factor, expected[1], rtol=1e-6, atol=1e-8 * np.abs(expected[1]).max())


@settings(max_examples=10, deadline=None)
@given(unit_choices)
def test_values_given_to_a_run_are_read_in_declared_units(units):
    """``--set``, ``--initial`` and scenarios; a table of inputs has its own units."""

    def written(value: float, kind: str) -> float:
        return value / coherent(units[kind])[1]

    def told(of: Mapping[str, str]) -> dict[str, dict[str, float]]:
        return {
            "values": {"b": 0.03 / coherent(of["drag"])[1], "voltage": 6.0 / coherent(of["voltage"])[1]},
            "initial": {"angle": 2.0 / coherent(of["angle"])[1], "momentum(rotor)": 0.4},
        }

    expected = run(machine(SI), **told(SI))
    np.testing.assert_allclose(run(machine(units), **told(units)).x, expected.x, rtol=1e-6, atol=1e-8)
    course, start = [(0.0, written(10.0, "force")), (1.0, written(90.0, "force"))], {"way": written(4.0, "length")}
    model, push = run(machine(units)).model, Scenario("a push", 1.0, {"push": course}, start)
    assert push.signal(model).at([0.0, 1.0])[model.index("input", "push")] == pytest.approx([10.0, 90.0])
    assert push.start(model) == {"way": pytest.approx(4.0)}
    table = Log("table", np.array([0.0, 1.0]), {"push": LogChannel("push", "lbf", np.array([10.0, 40.0]))})
    found, expected = (simulate_graph(machine(of), table, SimulationOptions(1.0, 0.1)) for of in (units, SI))
    np.testing.assert_allclose(found.x, expected.x, rtol=1e-6, atol=1e-8)


@settings(max_examples=10, deadline=None)
@given(units=unit_choices)
def test_a_written_table_is_read_as_the_same_log(units, tmp_path_factory):
    """A correct log in SI was converted into the declared unit and used as SI: 1e-6 m/s instead of 1.0."""
    trajectory = run(machine(units))
    path = tmp_path_factory.mktemp("run") / "run.csv"
    path.write_text(csv_text(trajectory_log(trajectory)), encoding="utf-8")
    for of in (units, SI):
        matched = match(read_log(path), run(machine(of)).model)
        np.testing.assert_allclose(matched.y, REFERENCE.y[: len(matched.y)], rtol=1e-6, atol=1e-8)


def driven(units: Mapping[str, str]) -> BondGraph:
    """A damped rotor driven by a torque."""
    g = BondGraph("driven")
    torque = g.input("torque", units["torque"], hold=True)
    shaft = g.one_junction("shaft", ROTATION)
    g.effort_source("drive", torque, at=shaft)
    g.inertance("rotor", g.parameter("J", 0.02 / coherent(units["inertia"])[1], units["inertia"]), at=shaft)
    factor = coherent(units["drag"])[1]
    b = g.parameter("b", 0.3 / factor, units["drag"], "", (0.05 / factor, 2.0 / factor))
    g.resistance("bearing", b, at=shaft)
    g.measure_flow("omega", shaft, unit=units["speed"])
    return g


ODD = SI | {"torque": "ft lbf", "inertia": "lb ft^2", "drag": "N mm s/rad", "speed": "rpm"}


@pytest.mark.slow
def test_estimates_and_reports_are_the_same_in_si(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """b = 0.5 N m s, measured in rpm, was estimated as 0.01 and called converged."""
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 3.0, 0.02)
    torque = np.where(np.floor(time / 0.3) % 2 == 0, 4.0, -1.0)
    speed, rows = 0.0, []
    for t, drive in zip(time, torque, strict=True):
        rows.append(f"{t},{drive},{(speed + 0.02 * rng.standard_normal()) * 30 / math.pi}\n")
        speed = drive / 0.5 + (speed - drive / 0.5) * math.exp(-0.5 / 0.02 * 0.02)
    log = tmp_path / "log.csv"
    log.write_text("time [s],torque [N m],omega [rpm]\n" + "".join(rows), encoding="utf-8")
    found = {}
    for name, units in (("si", SI), ("odd", ODD)):
        write_graph(driven(units), tmp_path / f"{name}.json")
        command = [str(tmp_path / f"{name}.json"), "--data", str(log)]
        free = ["--free", "b,std(omega)", "--process-noise", "none"]
        assert main(["estimate", *command, *free, "--method", "gradient", "--out", str(tmp_path / name)]) == 0
        found[name] = json.loads((tmp_path / name / "result.json").read_text(encoding="utf-8"))
        told = capsys.readouterr().out
        row = next(line for line in told.splitlines() if line.split()[:1] == ["b"])
        assert units["drag"] in row and f"{found[name]['parameters']['b']['value']:.5g}" in row
        given_drag = ["--set", f"b={0.5 / coherent(units['drag'])[1]}"]
        assert main(["filter", *command, *given_drag, "--out", str(tmp_path / f"{name}_f")]) == 0
        found[f"{name}_f"] = json.loads((tmp_path / f"{name}_f" / "result.json").read_text(encoding="utf-8"))["log"]
    si, odd = found["si"], found["odd"]
    assert si["parameters"]["b"]["value"] == pytest.approx(0.5, rel=0.02)
    assert {name: one["unit"] for name, one in odd["parameters"].items()} == {"b": "N mm s/rad", "std(omega)": "rpm"}
    for name, one in odd["parameters"].items():
        factor = coherent(one["unit"])[1]
        known = si["parameters"][name]
        spread = known["std"]
        assert one["value"] * factor == pytest.approx(known["value"], abs=1e-2 * spread)
        assert one["std"] * factor == pytest.approx(spread, rel=1e-3)
        assert np.array(one["ci95"]) * factor == pytest.approx(np.array(known["ci95"]), abs=1e-2 * spread)
        assert np.array(one["bounds"]) * factor == pytest.approx(np.array(known["bounds"]))
    assert odd["nll"] == pytest.approx(si["nll"], abs=1e-3)
    per = coherent("rpm")[1]
    for one, other in (
        (odd["innovations"]["omega"], si["innovations"]["omega"]),
        (found["odd_f"]["channels"]["omega"], found["si_f"]["channels"]["omega"]),
    ):
        assert (one["unit"], other["unit"]) == ("rpm", "rad/s")
        assert one["rmse"] * per == pytest.approx(other["rmse"], rel=1e-3)
        assert one["nis_mean"] == pytest.approx(other["nis_mean"], rel=1e-3)


@pytest.mark.slow
def test_a_closed_loop_finds_the_same_and_shows_it_in_declared_units(tmp_path: Path):
    """A drag that is not declared: errors, parameters, coefficients and the corrected graph agree in SI."""
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 8.0, 0.02)
    torque = 4 * np.sin(2 * time) + 2 * np.sin(5.1 * time)
    speed, rows = 0.0, []
    for t, drive in zip(time, torque, strict=True):
        rows.append(f"{t},{drive},{(speed + 0.02 * rng.standard_normal()) * 30 / math.pi}\n")
        for _ in range(20):
            speed += 0.001 * (drive - 0.3 * speed - 0.8 * math.tanh(speed / 0.3)) / 0.02
    (tmp_path / "log.csv").write_text("time [s],torque [N m],omega [rpm]\n" + "".join(rows), encoding="utf-8")
    options = ["--process-noise", "none", "--max-effects", "1", "--free", "b", "--no-faults"]
    found = {}
    for name, units in (("si", SI), ("odd", ODD)):
        write_graph(driven(units), tmp_path / f"{name}.json")
        command = ["close-loop", str(tmp_path / f"{name}.json"), "--data", str(tmp_path / "log.csv")]
        assert main([*command, *options, "--out", str(tmp_path / name)]) == 0
        found[name] = json.loads((tmp_path / name / "result.json").read_text(encoding="utf-8"))
    si, odd = found["si"], found["odd"]
    assert si["verdict"] == odd["verdict"] == "effect found"
    assert [one["name"] for one in si["effects"]] == [one["name"] for one in odd["effects"]]
    for state in ("nominal", "corrected"):
        for name, one in odd[state]["parameters"].items():
            known, factor = si[state]["parameters"][name], coherent(one["unit"])[1]
            assert one["value"] * factor == pytest.approx(known["value"], rel=1e-4)
            assert np.array(one["bounds"]) * factor == pytest.approx(np.array(known["bounds"]))
        for data in ("train", "holdout"):
            one, known = (result[state][data]["channels"]["omega"] for result in (odd, si))
            assert (one["unit"], known["unit"]) == ("rpm", "rad/s")
            for key in ("innovation_rmse", "simulation_rmse", "noise_std"):
                assert one[key] * coherent("rpm")[1] == pytest.approx(known[key], rel=1e-3)
    declared = json.loads((tmp_path / "odd" / "corrected_graph.json").read_text(encoding="utf-8"))["graph"]
    drag = next(one for one in declared["parameters"] if one["name"] == "b")
    assert drag["unit"] == "N mm s/rad"
    assert drag["value"] == pytest.approx(odd["corrected"]["parameters"]["b"]["value"], rel=1e-9)
