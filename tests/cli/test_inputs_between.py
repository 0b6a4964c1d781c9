"""``--inputs-between``: a table of inputs held, straight or band limited between its samples."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bondgraph.cli import main


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """A voltage that is 12 V in one sample of four, and zero before and after."""
    path = tmp_path / "table.csv"
    path.write_text("time [s],u_a [V]\n0,0\n1,12\n2,0\n3,0\n", encoding="utf-8")
    return path


def current(motor_file: Path, table: Path, *options: str) -> list[float]:
    """Current of the motor every half second."""
    out = table.with_name("out.csv")
    command = ["simulate", str(motor_file), "--inputs", str(table), "--step", "0.5", "--out", str(out), *options]
    assert main(command) == 0
    with out.open(encoding="utf-8") as stream:
        return [float(row["i_L [A]"]) for row in csv.DictReader(stream)]


def test_a_held_input_acts_from_its_sample_on(motor_file: Path, table: Path) -> None:
    held = current(motor_file, table, "--inputs-between", "held")
    assert held[:3] == [0.0, 0.0, 0.0]  # at 0, 0.5 and 1 s
    assert held[3] > 5.0  # at 1.5 s, long after the time constant of the armature
    assert current(motor_file, table, "--inputs-between", "u_a=held") == held


def test_an_input_is_straight_unless_another_way_is_asked_for(motor_file: Path, table: Path) -> None:
    straight = current(motor_file, table)
    assert straight == current(motor_file, table, "--inputs-between", "linear")
    assert 4.0 < straight[1] < 6.0  # half of the voltage at 0.5 s


def test_a_band_limited_input_follows_its_sines(motor_file: Path, tmp_path: Path) -> None:
    """Of a sine with five samples a period: the current is nearest to that of many samples."""
    sine = tmp_path / "sine.csv"
    found = {}
    for name, step, options in (
        ("band", 0.2, ("--inputs-between", "band")), ("linear", 0.2, ()), ("dense", 0.01, ()),
    ):  # fmt: skip
        rows = "".join(f"{t:.3f},{12.0 * np.sin(2.0 * np.pi * t)}\n" for t in np.arange(0.0, 10.0 + step / 2, step))
        sine.write_text("time [s],u_a [V]\n" + rows, encoding="utf-8")
        found[name] = np.array(current(motor_file, sine, *options))
    inner = slice(4, -4)  # at its ends the sum of sincs lacks a side
    off = {name: np.abs(found[name] - found["dense"])[inner].max() for name in ("band", "linear")}
    assert off["band"] < 0.2 * off["linear"]


@pytest.mark.parametrize(
    ("way", "said"),
    [
        ("cubic", "--inputs-between cubic: write held, linear, band, or input=way such as force=band"),
        ("u_b=held", "no input 'u_b'; did you mean 'u_a'"),
        ("=held", "--inputs-between =held"),
    ],
)
def test_ways_that_there_are_not_are_refused(
    motor_file: Path, table: Path, way: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", str(motor_file), "--inputs", str(table), "--inputs-between", way]) == 2
    assert said in capsys.readouterr().err


def test_codes_stay_held(motor: dict[str, Any], table: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motor["graph"]["inputs"].append({"name": "gear", "unit": "1", "letters": {"L": 1.0}})
    path = table.with_name("coded.json")
    path.write_text(json.dumps(motor), encoding="utf-8")
    command = ["simulate", str(path), "--inputs", str(table), "--set", "gear=L", "--plot", str(table) + ".png"]
    assert main([*command, "--inputs-between", "band"]) == 0
    capsys.readouterr()
    assert main([*command, "--inputs-between", "gear=band"]) == 2
    assert "input gear cannot be 'band limited' between samples - use 'hold'" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["filter", "estimate", "compare", "close-loop"])
def test_commands_with_logs_take_it(
    command: str, motor_file: Path, table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, str(motor_file), "--data", str(table), "--inputs-between", "cubic"]) == 2
    assert "--inputs-between cubic" in capsys.readouterr().err


def test_a_generated_module_has_it_written_in_it(
    motor_file: Path, table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = table.with_name("models")
    assert main(["generate", str(motor_file), "--folder", str(folder)]) == 0
    module = str(folder / "dc_motor.py")
    assert main(["filter", module, "--data", str(table), "--inputs-between", "held"]) == 2
    assert "name the graph" in capsys.readouterr().err
