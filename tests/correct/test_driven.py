"""Which states process noise drives: efforts that nobody knows act on flows, leaks on charges, volumes and heat."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bondgraph.build import build
from bondgraph.cli import main
from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, ROTATION, THERMAL
from bondgraph.declare.files import write_graph
from bondgraph.declare.graph import BondGraph


def oven() -> BondGraph:
    g = BondGraph("oven")
    body = g.zero_junction("body", THERMAL)
    g.flow_source("heater", g.input("heat", "W"), at=body)
    g.compliance("mass", 1 / g.parameter("capacity", 500.0, "J/K", "", (100.0, 2000.0)), at=body, state="stored")
    g.resistance("wall", flow=1 / g.parameter("R", 2.0, "K/W", "", (0.5, 10.0)), at=body)
    g.measure_effort("temperature", body, "above the room")
    return g


def tank() -> BondGraph:
    g = BondGraph("tank")
    bottom = g.zero_junction("bottom", HYDRAULIC)
    g.flow_source("pump", g.input("inflow", "m^3/s"), at=bottom)
    g.compliance("water", g.parameter("stiff", 2e4, "Pa/m^3", "", (1e3, 1e5)), at=bottom, state="volume")
    g.resistance("outlet", flow=1 / g.parameter("R", 2e5, "Pa s/m^3", "", (1e4, 1e6)), at=bottom)
    g.measure_effort("pressure", bottom)
    return g


def motor() -> BondGraph:
    """A motor that warms: current, speed, angle of a shaft, heat."""
    g = BondGraph("motor")
    loop, shaft, copper = (
        g.one_junction("loop", ELECTRICAL),
        g.one_junction("shaft", ROTATION),
        g.zero_junction("copper", THERMAL),
    )
    R, L = g.parameter("R", 1.0, "ohm"), g.parameter("L", 0.01, "H")
    g.effort_source("supply", g.input("u", "V"), at=loop)
    g.inertance("coil", L, at=loop, state="current")
    g.resistance("winding", R, at=loop)
    g.gyrator("machine", g.parameter("k", 0.1, "N m/A"), loop, shaft)
    g.inertance("rotor", g.parameter("J", 0.01, "kg m^2"), at=shaft, state="speed")
    g.compliance("spring", g.parameter("c", 5.0, "N m/rad"), at=shaft, state="twist")
    g.flow_source("losses", R * loop.flow**2, at=copper)
    g.compliance("mass", 1 / g.parameter("C", 50.0, "J/K"), at=copper, state="stored")
    g.resistance("cooling", flow=1 / g.parameter("R_t", 2.0, "K/W"), at=copper)
    g.measure_effort("temperature", copper)
    return g


@pytest.mark.parametrize(
    ("graph", "driven"), [(oven(), ("stored",)), (tank(), ("volume",)), (motor(), ("current", "speed", "stored"))]
)
def test_noise_drives_heat_and_volumes_as_it_drives_speeds(graph: BondGraph, driven: tuple[str, ...]) -> None:
    """Heat in J was taken for a torque in N m, and not driven beside mechanical states."""
    assert build(graph).driven == driven


@pytest.mark.parametrize(
    ("graph", "state", "units", "rate", "size"),
    [(oven(), "stored", ("W", "K"), 300.0, 900.0), (tank(), "volume", ("m^3/s", "Pa"), 1e-3, 3e-5)],
)
def test_an_estimate_says_which_states_noise_drives(
    graph: BondGraph, state: str, units: tuple[str, str], rate: float, size: float, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """--process-noise free was silently none for states that are displacements."""
    model = build(graph).model
    rng = np.random.default_rng(3)
    time = (5.0 if state == "stored" else 0.5) * np.arange(300)
    step = float(time[1])
    u = rate * np.repeat(rng.uniform(0.0, 1.0, 15), 20)
    x, seen = 0.0, []
    for k in range(300):
        seen.append(float(model.output(0.0, [x], [u[k]], model.theta())[0]))
        slope = float(model.rhs(0.0, [x], [u[k]], model.theta())[0])
        x += slope * step + size * np.sqrt(step) * rng.standard_normal() / 10.0
    y = np.array(seen) + 0.002 * np.ptp(seen) * rng.standard_normal(300)
    names = (model.inputs[0].name, model.outputs[0].name)
    rows = [f"time [s],{names[0]} [{units[0]}],{names[1]} [{units[1]}]"]
    rows += [f"{a!r},{b!r},{c!r}" for a, b, c in zip(map(float, time), map(float, u), map(float, y), strict=True)]
    (tmp_path / "run.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    write_graph(graph, tmp_path / "graph.json")
    command = ["estimate", str(tmp_path / "graph.json"), "--data", str(tmp_path / "run.csv"), "--out", str(tmp_path)]
    main([*command, "--method", "gradient", "--certify", "none"])
    told = capsys.readouterr().out
    values = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert f"process({state})" in json.dumps(values)
    assert f"Process noise drives {state}" in told
    main([*command, "--method", "gradient", "--certify", "none", "--process-noise", "none"])
    assert "Process noise drives no state" in capsys.readouterr().out
