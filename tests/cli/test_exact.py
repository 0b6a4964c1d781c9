"""--exact in every command that derives: events told, modes listed, modules of their own name, smooth by default."""

from __future__ import annotations

import csv
import io
import json
import runpy
from pathlib import Path

import pytest

from bondgraph.cli import main
from bondgraph.declare.json_writer import graph_to_json
from tests.simulate.machines import ball, belt, engagement


@pytest.fixture
def clutch_file(tmp_path: Path) -> Path:
    path = tmp_path / "engagement.json"
    path.write_text(json.dumps(graph_to_json(engagement())), encoding="utf-8")
    return path


def test_simulate_tells_events_and_writes_modes(clutch_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", str(clutch_file), "--until", "2", "--step", "0.5", "--exact", "--set", "torque=0"]) == 0
    told = capsys.readouterr()
    assert told.err == "1 event\n  t = 0.714285714286 s: plates locks\n"
    rows = list(csv.DictReader(io.StringIO(told.out)))
    assert [float(row["mode_plates [1]"]) for row in rows] == [1.0, 1.0, 0.0, 0.0, 0.0]
    assert float(rows[-1]["omega_rotor_1 [rad/s]"]) == pytest.approx(20.0 / 0.7, rel=1e-12)


def test_without_the_flag_the_same_graph_is_smooth(clutch_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", str(clutch_file), "--until", "2", "--step", "0.5", "--set", "torque=0"]) == 0
    told = capsys.readouterr()
    assert told.err == "" and "mode_plates" not in told.out


@pytest.mark.rendered
def test_a_picture_has_its_events_marked(clutch_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "run.svg"
    assert main(["simulate", str(clutch_file), "--until", "2", "--exact", "--plot", str(picture)]) == 0
    assert "plates locks" in capsys.readouterr().err
    assert picture.stat().st_size > 1000


def test_equations_list_what_ends_the_modes(clutch_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["equations", str(clutch_file), "--exact"]) == 0
    assert "friction plates: flow of plates = " in capsys.readouterr().out
    assert main(["equations", str(clutch_file), "--exact", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert [mode["element"] for mode in answer["modes"]] == ["plates"] and "mode_plates" in answer["inputs"]
    assert main(["equations", str(clutch_file), "--exact", "--latex"]) == 0
    text = capsys.readouterr().out
    assert text.count("{") == text.count("}")
    assert main(["equations", str(clutch_file), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert "modes" not in answer and answer["inputs"] == ["torque", "grip"]


def test_evaluate_takes_the_modes_that_fit_or_those_given(
    clutch_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = tmp_path / "points.json"
    still = {"states": {"omega_rotor_1": 3.0, "omega_rotor_2": 3.0}, "inputs": {"torque": 7.0}}
    slipping = {"states": {"omega_rotor_1": 3.0, "omega_rotor_2": 5.0}, "inputs": {"torque": 7.0}}
    told = {"states": still["states"], "inputs": {"torque": 7.0, "mode_plates": "forward"}}
    points.write_text(json.dumps([still, slipping, told]), encoding="utf-8")
    assert main(["evaluate", str(clutch_file), "--points", str(points), "--exact"]) == 0
    answers = json.loads(capsys.readouterr().out)
    torques = [answer["outputs"]["clutch_torque"] for answer in answers]
    assert torques == pytest.approx([5.0, -20.0, 20.0])


def test_generate_writes_a_module_of_its_own_name(
    clutch_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "generated"
    for flags in ([], ["--exact"]):
        assert main(["generate", str(clutch_file), "--folder", str(folder), *flags]) == 0
        assert main(["generate", str(clutch_file), "--folder", str(folder), "--check", *flags]) == 0
    assert sorted(path.name for path in folder.iterdir()) == ["engagement.py", "engagement_exact.py"]
    smooth, exact = (runpy.run_path(str(folder / name)) for name in ("engagement.py", "engagement_exact.py"))
    assert "MODES" not in smooth and [row[2] for row in exact["MODES"]] == ["plates"]
    assert exact["NAME"] == "engagement_exact"
    assert "--exact" in (folder / "engagement_exact.py").read_text(encoding="utf-8").splitlines()[1]
    capsys.readouterr()
    assert main(["generate", "--exact"]) == 2
    assert "needs the NAMEs" in capsys.readouterr().err


def test_an_endless_run_tells_its_events_and_what_to_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = graph_to_json(belt())
    (grip,) = [node for node in data["nodes"] if node["id"] == "grip"]
    for key in ("capacity", "static", "width"):
        del grip[key]
    grip["effort"] = "F_sliding*(2*switch(flow, width) - 1)"
    path = tmp_path / "sliding.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    assert main(["simulate", str(path), "--until", "1", "--exact"]) == 2
    told = capsys.readouterr().err
    assert "grip switches, flow becomes" in told and "declare it as a friction, which can lock" in told


def test_many_events_are_cut_short_in_the_middle(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "ball.json"
    path.write_text(json.dumps(graph_to_json(ball())), encoding="utf-8")
    picture = tmp_path / "ball.png"
    assert main(["simulate", str(path), "--until", "5", "--exact", "--plot", str(picture)]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) < 45 and any("more events" in line for line in lines)
    assert "floor comes to rest" in lines[-2]
