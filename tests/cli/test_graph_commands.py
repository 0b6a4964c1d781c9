"""equations, evaluate, draw and generate: answers, and refusals with their message and exit status."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import sympy

import bondgraph as bg
from bondgraph.cli import COMMANDS, main


def test_equations_are_those_of_the_textbook(motor_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["equations", str(motor_file), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert [(s["name"], s["element"], s["variable"], s["unit"]) for s in answer["states"]] == [
        ("i_L", "L", "flow", "A"),
        ("omega_rotor", "rotor", "flow", "rad/s"),
    ]
    derived = {name: sympy.sympify(text) for name, text in answer["derivatives"].items()}
    u_a, R_a, i_L, k_m, omega, L_a, b, J = sympy.symbols("u_a R_a i_L k_m omega_rotor L_a b J")
    assert sympy.simplify(derived["i_L"] - (u_a - R_a * i_L - k_m * omega) / L_a) == 0
    assert sympy.simplify(derived["omega_rotor"] - (k_m * i_L - b * omega) / J) == 0
    assert answer["outputs"] == {"omega": "omega_rotor"}
    assert answer["inputs"] == ["u_a"] and answer["parameters"]["k_m"] == 0.1
    strokes = {(bond["source"], bond["target"]): bond["stroke"] for bond in answer["causality"]["bonds"]}
    assert strokes["loop", "L"] == "target" and strokes["loop", "R"] == "source"
    assert answer["causality"]["derivative"] == [] and answer["causality"]["loops"] == []


def test_equations_as_text_say_why(motor_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["equations", str(motor_file)]) == 0
    text = capsys.readouterr().out
    assert "source supply imposes the effort" in text and "d(i_L)/dt" in text


def test_equations_as_latex(motor_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["equations", str(motor_file), "--latex"]) == 0
    text = capsys.readouterr().out
    assert "\\omega" in text and text.count("{") == text.count("}")


def test_evaluate_in_energy_variables(motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = tmp_path / "points.json"
    point = {
        "states": {"momentum(L)": 0.02, "omega_rotor": 30.0},
        "inputs": {"u_a": 12.0},
        "parameters": {"R_a": 2.0},
    }
    points.write_text(json.dumps([point]), encoding="utf-8")
    assert main(["evaluate", str(motor_file), "--points", str(points), "--json"]) == 0
    (answer,) = json.loads(capsys.readouterr().out)
    assert answer["derivatives"]["momentum(L)"] == pytest.approx(12.0 - 2.0 * 2.0 - 0.1 * 30.0)
    assert answer["derivatives"]["omega_rotor"] == pytest.approx((0.1 * 2.0 - 0.1 * 30.0) / 0.02)
    assert answer["outputs"] == {"omega": 30.0}
    assert answer["bonds"]["loop->R"] == pytest.approx({"effort": 4.0, "flow": 2.0})
    assert answer["signals"]["flow(shaft)"] == 30.0


def test_draw_writes_a_picture(motor_file: Path, tmp_path: Path) -> None:
    target = tmp_path / "motor.svg"
    assert main(["draw", str(motor_file), "-o", str(target)]) == 0
    assert "<svg" in target.read_text(encoding="utf-8")


def test_generate_finds_drift(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "generated")
    assert main(["generate", "driveline", "--folder", folder]) == 0
    assert main(["generate", "driveline", "--folder", folder, "--check"]) == 0
    module = tmp_path / "generated" / "driveline.py"
    module.write_text(module.read_text(encoding="utf-8").replace("c_aero*", "2*c_aero*"), encoding="utf-8")
    capsys.readouterr()
    assert main(["generate", "driveline", "--folder", folder, "--check"]) == 1
    said = capsys.readouterr().out
    assert "2*c_aero*" in said and "bondgraph generate driveline" in said


def _refused(graph: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(graph), encoding="utf-8")
    assert main(["equations", str(path), "--json"]) == 2
    captured = capsys.readouterr()
    error: dict[str, Any] = json.loads(captured.out)["error"]
    assert error["message"] in captured.err
    return error


def test_two_sources_on_one_junction_are_refused(
    motor: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motor["nodes"].append({"id": "imposed", "kind": "Sf", "flow": "1"})
    motor["nodes"].append({"id": "imposed_too", "kind": "Sf", "flow": "2"})
    motor["bonds"] += [{"source": name, "target": "shaft"} for name in ("imposed", "imposed_too")]
    error = _refused(motor, tmp_path, capsys)
    assert error["type"] == "CausalityError"
    assert {"imposed", "imposed_too"} <= set(error["where"])


def test_a_wrong_unit_names_its_element(
    motor: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motor["graph"]["parameters"][4]["unit"] = "N m"
    error = _refused(motor, tmp_path, capsys)
    assert error["type"] == "DimensionError" and "bearing" in error["message"]


def test_an_unknown_key_is_named(motor: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motor["nodes"][3]["efort"] = motor["nodes"][3].pop("effort")
    error = _refused(motor, tmp_path, capsys)
    assert error["type"] == "DeclarationError" and "'efort'" in error["message"] and "'effort'" in error["message"]


def test_a_file_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["equations", "no_such_graph.json"]) == 2
    assert "no such file" in capsys.readouterr().err


def test_an_unknown_function_is_met_with_a_suggestion(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["equations", "vehicle_graphs.driveline:drivline"]) == 2
    assert "did you mean 'driveline'" in capsys.readouterr().err


@pytest.mark.parametrize("command", COMMANDS)
def test_help_teaches(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    examples = capsys.readouterr().out.split("examples:")[1]
    assert f"bondgraph {command}" in examples
    for reference, free in re.findall(r"(vehicle_graphs\.\S+) .*--free ([\w,]+)", examples):
        bounded = {one.name for one in bg.build(reference).parameters if one.lower is not None}
        assert set(free.split(",")) <= bounded, examples  # else the example ends in a refusal


def test_either_of_two_geared_inertias_may_be_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Points say which storages are independent; both descriptions of one motion give one answer."""
    nodes = [
        {"id": "drive", "kind": "Se", "effort": "6"},
        {"id": "a", "kind": "1"},
        {"id": "one", "kind": "I", "flow": "momentum/2"},
        {"id": "gear", "kind": "TF", "modulus": "3"},
        {"id": "b", "kind": "1"},
        {"id": "two", "kind": "I", "flow": "momentum/0.5"},
    ]
    pairs = (("drive", "a"), ("a", "one"), ("a", "gear"), ("gear", "b"), ("b", "two"))
    graph = {
        "directed": True, "multigraph": True, "graph": {"format": "bondgraph/1", "name": "geared"}, "nodes": nodes,
        "bonds": [{"source": source, "target": target} for source, target in pairs],
    }  # fmt: skip
    (tmp_path / "geared.json").write_text(json.dumps(graph), encoding="utf-8")
    points = [{"states": {"momentum(one)": 8.0}}, {"states": {"momentum(two)": 6.0}}]
    (tmp_path / "points.json").write_text(json.dumps(points), encoding="utf-8")
    assert main(["evaluate", str(tmp_path / "geared.json"), "--points", str(tmp_path / "points.json")]) == 0
    first, second = json.loads(capsys.readouterr().out)
    rate = 6.0 / (2.0 + 9.0 * 0.5)
    assert first["derivatives"] == pytest.approx({"momentum(one)": 2.0 * rate})
    assert second["derivatives"] == pytest.approx({"momentum(two)": 0.5 * 3.0 * rate})
    assert first["bonds"]["b->two"] == pytest.approx(second["bonds"]["b->two"])


@pytest.mark.rendered
def test_linearise_prints_modes_and_transfer_functions(
    motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "bode.svg"
    assert main(["linearise", str(motor_file), "--transfer", "u_a", "omega", "--bode", str(picture)]) == 0
    text = capsys.readouterr().out
    assert "eigenvalue [1/s]" in text and "k_m/(J*L_a*s**2" in text
    assert picture.read_text(encoding="utf-8").startswith("<?xml")
    assert main(["linearise", str(motor_file), "--at", "J=0.05", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["A"][1] == pytest.approx([0.1 / 0.05, -0.1 / 0.05])


def test_linearise_takes_values_as_other_commands_do(motor_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["linearise", str(motor_file), "--at", "J=0.05", "--at", "u_a=3", "--json"]) == 0
    expected = capsys.readouterr().out
    assert main(["linearise", str(motor_file), "--set", "J=0.05", "u_a=3", "--json"]) == 0
    assert capsys.readouterr().out == expected


def test_linearise_refuses_what_is_no_number(motor_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["linearise", str(motor_file), "--at", "J=heavy"]) == 2
    assert "must be a number" in capsys.readouterr().err
