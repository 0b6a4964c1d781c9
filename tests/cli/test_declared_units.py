"""A graph file in units of its own at the command line: what is read and what is shown beside each unit."""

from __future__ import annotations

import copy
import csv
import json
import math
from pathlib import Path
from typing import Any

import pytest

from bondgraph.cli import main


@pytest.fixture
def odd_file(motor: dict[str, Any], tmp_path: Path) -> Path:
    """The motor of the other tests, declared in millivolts, millihenries and revolutions per minute."""
    odd = copy.deepcopy(motor)
    head = odd["graph"]
    head["inputs"][0] |= {"unit": "mV", "default": 12000.0}
    head["parameters"][0] |= {"value": 10.0, "unit": "mH", "bounds": [1.0, 100.0]}
    head["parameters"][4] |= {"value": 0.1 * math.pi / 30, "unit": "N m/rpm", "bounds": [0.001, 0.1]}
    head["outputs"][0]["unit"] = "rpm"
    head["integrals"] = [{"name": "angle", "of": "flow(shaft)", "unit": "deg", "initial": 90.0}]
    path = tmp_path / "odd.json"
    path.write_text(json.dumps(odd), encoding="utf-8")
    return path


def last_row(command: list[str], capsys: pytest.CaptureFixture[str]) -> dict[str, float]:
    assert main(command) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    return {name: float(value) for name, value in rows[-1].items()}


def test_a_simulation_is_told_and_tells_in_declared_units(
    odd_file: Path, motor_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The output in rpm printed rad/s under [rpm]."""
    times = ["--until", "1", "--step", "0.5"]
    plain = last_row(["simulate", str(motor_file), *times, "--set", "u_a=6", "--set", "L_a=0.02"], capsys)
    odd = last_row(
        ["simulate", str(odd_file), *times, "--set", "u_a=6000", "--set", "L_a=20", "--initial", "angle=180"], capsys
    )
    assert plain["omega [rad/s]"] > 1.0
    assert odd["omega [rpm]"] * math.pi / 30 == pytest.approx(plain["omega [rad/s]"], rel=1e-7)
    assert odd["angle [deg]"] > 180.0
    started = last_row(["simulate", str(odd_file), "--until", "1e-9", "--step", "1e-9"], capsys)
    assert started["angle [deg]"] == pytest.approx(90.0)


def test_equations_and_matrices_hold_in_coherent_si(
    odd_file: Path, motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = []
    for path in (odd_file, motor_file):
        assert main(["equations", str(path), "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0]["parameters"] == pytest.approx(found[1]["parameters"])
    assert {one["name"]: one["unit"] for one in found[0]["states"]}["angle"] == "rad"
    points = tmp_path / "points.json"
    points.write_text('[{"states": {"momentum(L)": 0.01, "momentum(rotor)": 0.3}, "inputs": {"u_a": 5.0}}]', "utf-8")
    answers = []
    for path in (odd_file, motor_file):
        assert main(["evaluate", str(path), "--points", str(points)]) == 0
        answers.append(json.loads(capsys.readouterr().out)[0]["derivatives"])
    for name, rate in answers[1].items():
        assert answers[0][name] == pytest.approx(rate)


def test_an_operating_point_is_given_and_printed_in_declared_units(
    odd_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["linearise", str(odd_file), "--at", "u_a=6000", "--at", "angle=45"]) == 0
    told = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["u_a", "6000", "mV", "input"] in told
    assert next(words for words in told if words[:1] == ["angle"])[:3] == ["angle", "45", "deg"]
    assert main(["linearise", str(odd_file), "--at", "u_a=6000", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["u"] == {"u_a": 6.0}


def test_a_graph_file_that_counts_turns_per_minute_is_refused(
    motor: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motor["graph"]["outputs"][0]["unit"] = "1/min"
    path = tmp_path / "turns.json"
    path.write_text(json.dumps(motor), encoding="utf-8")
    assert main(["equations", str(path)]) == 2
    assert "write 'rpm' or 'turn/s' for revolutions, 'rad/s' for radians" in capsys.readouterr().err
