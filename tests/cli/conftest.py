"""A motor as a graph file, written anew for each test, and a run of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

MOTOR: dict[str, Any] = {
    "directed": True,
    "multigraph": True,
    "graph": {
        "format": "bondgraph/1",
        "name": "dc_motor",
        "doc": "armature, gyrator, rotor",
        "inputs": [{"name": "u_a", "unit": "V", "meaning": "armature voltage"}],
        "parameters": [
            {"name": "L_a", "value": 0.01, "unit": "H", "bounds": [0.001, 0.1]},
            {"name": "R_a", "value": 1.0, "unit": "ohm", "bounds": [0.1, 10.0]},
            {"name": "k_m", "value": 0.1, "unit": "N m / A"},
            {"name": "J", "value": 0.02, "unit": "kg m^2"},
            {"name": "b", "value": 0.1, "unit": "N m s", "bounds": [0.01, 1.0]},
        ],
        "outputs": [{"name": "omega", "variable": "flow", "at": "shaft"}],
    },
    "nodes": [
        {"id": "supply", "kind": "Se", "effort": "u_a"},
        {"id": "loop", "kind": "1", "domain": "electrical"},
        {"id": "L", "kind": "I", "flow": "momentum/L_a"},
        {"id": "R", "kind": "R", "effort": "R_a*flow"},
        {"id": "machine", "kind": "GY", "modulus": "k_m"},
        {"id": "shaft", "kind": "1", "domain": "rotation"},
        {"id": "rotor", "kind": "I", "flow": "momentum/J"},
        {"id": "bearing", "kind": "R", "effort": "b*flow"},
    ],
    "bonds": [
        {"source": "supply", "target": "loop"},
        {"source": "loop", "target": "L"},
        {"source": "loop", "target": "R"},
        {"source": "loop", "target": "machine"},
        {"source": "machine", "target": "shaft"},
        {"source": "shaft", "target": "rotor"},
        {"source": "shaft", "target": "bearing"},
    ],
}


@pytest.fixture
def motor() -> dict[str, Any]:
    """The graph as a JSON object that a test may spoil."""
    copied: dict[str, Any] = json.loads(json.dumps(MOTOR))
    return copied


@pytest.fixture
def motor_file(motor: dict[str, Any], tmp_path: Path) -> Path:
    """The graph as a file."""
    path = tmp_path / "motor.json"
    path.write_text(json.dumps(motor), encoding="utf-8")
    return path


@pytest.fixture
def run_file(tmp_path: Path) -> Path:
    """A noisy run of the motor with a friction of 0.1 N m s, whose current is not measured."""
    time = 0.01 * np.arange(80)
    voltage = np.where((time // 0.2).astype(int) % 2 == 0, 12.0, 4.0)
    speed, current, rows = 0.0, 0.0, []
    noise = np.random.default_rng(1).normal(size=time.size)
    for k, t in enumerate(time):
        rows.append(f"{t:.3f},{voltage[k]},{speed + 0.02 * noise[k]:.6f}\n")
        for _ in range(50):
            current, speed = (
                current + 0.0002 * (voltage[k] - current - 0.1 * speed) / 0.01,
                speed + 0.0002 * (0.1 * current - 0.1 * speed) / 0.02,
            )
    path = tmp_path / "run.csv"
    path.write_text("time [s],u_a [V],omega [rad/s]\n" + "".join(rows), encoding="utf-8")
    return path
