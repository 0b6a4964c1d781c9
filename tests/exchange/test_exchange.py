"""What other tools make of exported models and graphs, against our own numbers."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pytest

import bondgraph as bg
from bondgraph.cli import main
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.linearisation import LinearModel
from bondgraph.errors import DeclarationError, DerivationError, GenerationError, OptionError
from bondgraph.exchange import (
    c_source,
    dot_text,
    export_fmu,
    from_control,
    from_networkx,
    mermaid_text,
    read_graphml,
    to_casadi,
    to_control,
    write_graphml,
)
from bondgraph.exchange.fmu_description import variables
from bondgraph.report.declared import drawing_of
from bondgraph.simulate.example import pendulum
from bondgraph.simulate.model import Model

GENERATED = Path(__file__).resolve().parents[2] / "generated"
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


def _points(model: Model, count: int = 5) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """States, inputs and parameters near the declared ones."""
    chance = np.random.default_rng(0)
    around = (model.x0(), model.u0(), model.theta())
    return [
        tuple(one + 0.02 * (1.0 + np.abs(one)) * chance.standard_normal(one.size) for one in around)  # type: ignore[misc]
        for _ in range(count)
    ]


@needs_compiler
@pytest.mark.parametrize("name", ["driveline", "ranger_full", "baja_launch"])
def test_c_computes_what_the_module_computes(name: str, tmp_path: Path) -> None:
    """Tables, tanh steps, look-ups and Newton's loop of the belt among them."""
    model = bg.load(GENERATED / f"{name}.py")
    (tmp_path / "model.c").write_text(c_source(model))
    flags = ["-shared", "-fPIC", "-O1", "-std=c99", "-Wall", "-Werror", "-Wno-unused-variable"]
    subprocess.run(["cc", *flags, "-o", "m.so", "model.c", "-lm"], cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "m.so"))
    pointer = ctypes.POINTER(ctypes.c_double)
    for x, u, theta in _points(model):
        for function, expected in (("rhs", model.rhs(0.3, x, u, theta)), ("output", model.output(0.3, x, u, theta))):
            found = np.empty(expected.size)
            vectors = [np.ascontiguousarray(one).ctypes.data_as(pointer) for one in (x, u, theta, found)]
            getattr(library, f"model_{function}")(ctypes.c_double(0.3), *vectors)
            np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max())


def test_c_says_what_stands_where() -> None:
    lines = c_source(bg.load(GENERATED / "driveline.py")).partition("*/")[0].splitlines()
    model = bg.load(GENERATED / "driveline.py")
    first = model.parameters[0]
    assert f"   theta[0] = {first.name} [{first.unit}], {first.value:.12g}: {first.meaning}" in lines
    sizes = len(model.states) + len(model.inputs) + len(model.parameters) + len(model.outputs)
    assert len(lines) == 1 + sizes


def test_remarks_of_a_declaration_do_not_end_a_comment_in_c() -> None:
    g = bg.BondGraph("odd")
    mass = g.parameter("m", 1.0, "kg", "a /* b */ c")
    body = g.one_junction("body", bg.TRANSLATION)
    g.inertance("mass", mass, at=body, state="v")
    g.measure_flow("speed", body)
    assert c_source(bg.build(g)).count("*/") == 1


def _simulated(path: Path, model: Model, kind: str, **how: Any) -> dict[str, np.ndarray]:
    """The FMU as FMPy validates and integrates it."""
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(path)) == []
    rows = fmpy.simulate_fmu(
        str(path), stop_time=2.0, output_interval=0.05, fmi_type=kind,
        output=[*model.names("state"), "deflection"], **how,
    )  # fmt: skip
    return {name: rows[name] for name in rows.dtype.names}


@needs_compiler
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_model_exchange_fmu_against_our_trajectory(version: Any, tmp_path: Path) -> None:
    model = pendulum()
    path = export_fmu(model, tmp_path / "swing.fmu", version)
    assert export_fmu(model, tmp_path / "again.fmu", version).read_bytes()[:200] == path.read_bytes()[:200]
    starts = {"length": 1.4, "angle": 0.3}
    found = _simulated(
        path, model, "ModelExchange", solver="CVode", relative_tolerance=1e-10, start_values={**starts, "drive": 0.2}
    )
    own = bg.simulate(model, found["time"], {"drive": 0.2}, {"length": 1.4}, {"angle": 0.3}, rtol=1e-11)
    for row, name in enumerate(model.names("state")):
        np.testing.assert_allclose(found[name], own.x[row], atol=1e-6)
    np.testing.assert_allclose(found["deflection"], own.y[0], atol=1e-6)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_co_simulation_fmu_against_our_trajectory(version: Any, tmp_path: Path) -> None:
    pytest.importorskip("pythonfmu" if version == "2.0" else "pythonfmu3")
    model = pendulum()
    path = export_fmu(model, tmp_path / "swing.fmu", version, "co-simulation")
    found = _simulated(path, model, "CoSimulation", start_values={"length": 1.4})
    own = bg.simulate(model, found["time"], theta={"length": 1.4}, rtol=1e-12)
    for row, name in enumerate(model.names("state")):
        np.testing.assert_allclose(found[name], own.x[row], atol=1e-8)


def _switched() -> Model:
    g = bg.BondGraph("motor")
    voltage = g.input("voltage", "V", "of a bridge", hold=True)
    load = g.input("load", "N m", default=0.0)
    R, k, J = g.parameter("R", 0.1, "ohm"), g.parameter("k", 0.01, "N m/A"), g.parameter("J", 5e-5, "kg m^2")
    coil, shaft = g.one_junction("coil", bg.ELECTRICAL), g.one_junction("shaft", bg.ROTATION)
    g.effort_source("bridge", voltage, at=coil)
    g.resistance("copper", R, at=coil)
    g.gyrator("motor", k, coil, shaft)
    g.effort_source("load", -load, at=shaft)
    g.inertance("rotor", J, at=shaft, state="omega")
    g.measure_flow("speed", shaft)
    return bg.build(g)


@needs_compiler
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_an_importer_stops_where_a_held_input_jumps(version: Any, tmp_path: Path) -> None:
    """CVode of FMPy ended with an error at the first jump of an input that was called continuous."""
    fmpy = pytest.importorskip("fmpy")
    model = _switched()
    assert {one.name: one.variability for one in variables(model)}["voltage"] == "discrete"
    assert {one.name: one.variability for one in variables(model)}["load"] == "continuous"
    path = export_fmu(model, tmp_path / "motor.fmu", version)
    times, volts = np.arange(0.0, 5.0, 0.5), np.random.default_rng(1).uniform(3.0, 12.0, 10)
    given = np.array(list(zip(times, volts, strict=True)), dtype=[("time", float), ("voltage", float)])
    rows = fmpy.simulate_fmu(
        str(path), stop_time=4.5, output_interval=0.5, input=given, relative_tolerance=1e-9, output=["speed"]
    )
    own = bg.simulate(model, times, {"voltage": volts, "load": 0.0}, rtol=1e-11).y[0]
    last = np.searchsorted(rows["time"], times, side="right") - 1
    np.testing.assert_allclose(rows["speed"][last], own, rtol=1e-6, atol=1e-6 * own.max())


def test_variables_of_an_fmu_have_names_of_their_own() -> None:
    names = [one.name for one in variables(bg.load(GENERATED / "driveline.py"))]
    assert len(set(names)) == len(names)


def test_what_is_no_fmu_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"an FMU is called NAME\.fmu"):
        export_fmu(pendulum(), tmp_path / "swing.zip")
    with pytest.raises(OptionError, match=r"versions are 2\.0 and 3\.0"):
        export_fmu(pendulum(), tmp_path / "swing.fmu", "1.0")  # type: ignore[arg-type]


def _stopped() -> bg.BondGraph:
    g = bg.BondGraph("block")
    body = g.one_junction("body", bg.TRANSLATION)
    g.inertance("mass", g.parameter("mass", 80.0, "kg"), at=body, initial=2.0)
    width = g.parameter("width", 0.01, "m/s")
    bg.friction(g, "floor", g.parameter("F", 30.0, "N"), width=width, at=body)
    return g


def test_modes_have_no_form_in_c_nor_casadi() -> None:
    exact = bg.build(_stopped(), smooth=False)
    with pytest.raises(GenerationError, match="modes have no form in C - derive the graph smooth"):
        c_source(exact)
    pytest.importorskip("casadi")
    with pytest.raises(GenerationError, match="modes have no smooth function"):
        to_casadi(exact)
    with pytest.raises(GenerationError, match="ranger_full: the algebraic loop _solve_r_s is solved by iteration"):
        to_casadi(bg.load(GENERATED / "ranger_full.py"))


@pytest.mark.parametrize("name", ["driveline", "baja_launch"])
def test_casadi_functions_and_their_derivatives(name: str) -> None:
    casadi = pytest.importorskip("casadi")
    model = bg.load(GENERATED / f"{name}.py")
    rhs, output = to_casadi(model)
    arguments = [
        casadi.SX.sym(one, size) for one, size in zip("txup", (1, *map(len, _points(model, 1)[0])), strict=True)
    ]
    slope = casadi.Function("slope", arguments, [casadi.jacobian(rhs(*arguments), arguments[1])])
    for x, u, theta in _points(model, 3):
        expected = model.rhs(0.0, x, u, theta)
        np.testing.assert_allclose(rhs(0.0, x, u, theta).full().ravel(), expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(output(0.0, x, u, theta).full().ravel(), model.output(0.0, x, u, theta), rtol=1e-9)
        jacobian = model.jacobian_x(0.0, x, u, theta)
        scale = 1e-8 * np.abs(jacobian).max()
        np.testing.assert_allclose(slope(0.0, x, u, theta).full(), jacobian, rtol=1e-7, atol=scale)


def _motor() -> bg.BondGraph:
    g = bg.BondGraph("motor")
    loop, shaft = g.one_junction("loop", bg.ELECTRICAL), g.one_junction("shaft", bg.ROTATION)
    g.effort_source("supply", g.input("u", "V"), at=loop)
    g.inertance("L", g.parameter("L_a", 0.01, "H", "", (0.001, 0.1)), at=loop, state="i")
    g.resistance("R", lambda i: 1.0 * i, at=loop)
    g.gyrator("machine", 0.1, loop, shaft)
    g.inertance("rotor", 0.02, at=shaft, state="omega")
    g.resistance("bearing", lambda w: 0.1 * w * abs(w), at=shaft)
    g.measure_flow("speed", shaft)
    return g


def test_linear_models_go_to_python_control_and_back() -> None:
    control = pytest.importorskip("control")
    linear = bg.linearise(bg.build(_motor()), x={"omega": 5.0})
    system = to_control(linear)
    frequencies = np.array([0.1, 3.0, 200.0])
    ours = [(linear.C @ np.linalg.solve(1j * w * np.eye(2) - linear.A, linear.B) + linear.D)[0, 0] for w in frequencies]
    np.testing.assert_allclose(system(1j * frequencies), ours, rtol=1e-10)
    back = from_control(system, linear.units)
    assert isinstance(back, LinearModel) and (back.states, back.inputs, back.outputs) == (
        linear.states, linear.inputs, linear.outputs,
    )  # fmt: skip
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(back, name), getattr(linear, name))
    with pytest.raises(DerivationError, match=r"has samples every 0\.1 s"):
        from_control(control.c2d(system, 0.1))


def test_graphs_go_to_graphml_and_networkx_and_back(tmp_path: Path) -> None:
    graph = _motor()
    write_graphml(graph, tmp_path / "motor.graphml")
    assert read_graphml(tmp_path / "motor.graphml") == graph
    assert from_networkx(nx.read_graphml(tmp_path / "motor.graphml")) == graph
    assert nx.read_graphml(tmp_path / "motor.graphml").nodes["rotor"]["kind"] == "I"
    with pytest.raises(DeclarationError, match="cannot be read as GraphML"):
        read_graphml(Path(__file__))
    with pytest.raises(DeclarationError, match="the edges have no direction"):
        from_networkx(nx.Graph())


def test_dot_and_mermaid_hold_every_node_bond_and_stroke(tmp_path: Path) -> None:
    drawing = drawing_of(assign_causality(_motor()))
    dot, mermaid = dot_text(drawing), mermaid_text(drawing)
    assert dot.count(" -> ") == mermaid.count(" -- ") == len(drawing.bonds)
    assert all(f"{node.kind} {node.name}" in mermaid for node in drawing.nodes)  # "runners" came out as "ru  ers"
    strokes = [bond.stroke for bond in drawing.bonds]
    assert dot.count("arrowtail=tee") == mermaid.count("|–") == strokes.count("source")
    assert dot.count("arrowhead=teelnormal") == mermaid.count("–|") == strokes.count("target")
    if shutil.which("dot"):
        subprocess.run(["dot", "-Tsvg", "-o", str(tmp_path / "g.svg")], input=dot, text=True, check=True)


@pytest.mark.parametrize(
    ("form", "beginning"), [("dot", "digraph"), ("mermaid", "flowchart"), ("c", "/* Equations of")]
)
def test_export_prints_text(form: str, beginning: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "vehicle_graphs.driveline:driveline", "--to", form]) == 0
    assert capsys.readouterr().out.startswith(beginning)


def test_export_writes_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for form in ("fmu", "graphml"):
        assert main(["export", "vehicle_graphs.driveline:driveline", "--to", form]) == 0
    assert (tmp_path / "driveline.fmu").read_bytes()[:2] == b"PK"
    assert read_graphml(tmp_path / "driveline.graphml").name == "driveline"
    assert main(["export", "vehicle_graphs.driveline:driveline", "--to", "fmu", "--out", "a.zip"]) == 2
    assert "an FMU is called NAME.fmu" in capsys.readouterr().err


def _warm() -> Model:
    """A body whose heat starts at capacity times temperature."""
    g = bg.BondGraph("warm")
    C, T0, R = g.parameter("C", 500.0, "J/K"), g.parameter("T0", 290.0, "K"), g.parameter("R", 2.0, "K/W")
    body = g.zero_junction("body", bg.THERMAL)
    g.flow_source("heater", g.input("heat", "W", default=20.0), at=body)
    g.resistance("wall", flow=lambda T: (T - 280.0) / R, at=body)
    g.compliance("load", 1 / C, at=body, initial=C * T0, state="q")
    g.measure_effort("deflection", body)
    return bg.build(g)


@needs_compiler
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_an_fmu_starts_where_its_parameters_say(version: Any, tmp_path: Path) -> None:
    model = _warm()
    path = export_fmu(model, tmp_path / "warm.fmu", version)
    how: dict[str, Any] = {"solver": "CVode", "relative_tolerance": 1e-10}
    for given in ({}, {"C": 700.0, "T0": 310.0}):
        found = _simulated(path, model, "ModelExchange", start_values=given, **how)
        own = bg.simulate(model, found["time"], theta=given, rtol=1e-11)
        np.testing.assert_allclose(found["q"], own.x[0], rtol=1e-8)
        np.testing.assert_allclose(found["deflection"], own.y[0], rtol=1e-8)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_co_simulation_starts_where_its_parameters_say(version: Any, tmp_path: Path) -> None:
    pytest.importorskip("pythonfmu" if version == "2.0" else "pythonfmu3")
    model = _warm()
    path = export_fmu(model, tmp_path / "warm.fmu", version, "co-simulation")
    found = _simulated(path, model, "CoSimulation", start_values={"C": 700.0, "T0": 310.0})
    own = bg.simulate(model, found["time"], theta={"C": 700.0, "T0": 310.0}, rtol=1e-12)
    np.testing.assert_allclose(found["q"], own.x[0], rtol=1e-8)


@needs_compiler
def test_c_starts_where_parameters_say(tmp_path: Path) -> None:
    model = _warm()
    source, library = tmp_path / "warm.c", tmp_path / "warm.so"
    source.write_text(c_source(model))
    subprocess.run(["cc", "-shared", "-fPIC", "-o", str(library), str(source), "-lm"], check=True)
    x, u, theta, found = model.x0(), model.u0(), model.theta(C=700.0), np.empty(1)
    pointers = [one.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for one in (x, u, theta, found)]
    ctypes.CDLL(str(library)).model_start(ctypes.c_double(0.0), *pointers)
    assert found.tolist() == model.x0(theta).tolist() == [203000.0]
    assert "model_start" not in c_source(pendulum())
