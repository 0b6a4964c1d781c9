"""sensitivity, design and profiles from the command line: tables, files, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bondgraph.cli import main


def test_sensitivity_prints_tables_and_writes_a_picture_and_a_report(
    motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "found"
    command = ["sensitivity", str(motor_file), "--data", str(run_file), "--free", "b,R_a", "--out", str(out)]
    assert main([*command, "--process-noise", "none", "--rates", "100,50"]) == 0
    said = capsys.readouterr().out
    assert "std alone" in said and "rate [1/s]" in said and "free " in said
    assert {path.name for path in out.iterdir()} == {"result.json", "sensitivity.png", "rates.png", "report.html"}
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Rate of samples" in page and "std joint" in page
    assert "http" not in page.replace("http://www.w3.org", "")  # the name space of pictures
    for told in (said, page):  # of values far from what logs say the two tables differ, up to 26 times
        assert "estimate first, and look again" in " ".join(told.split())
    written = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert [row["rate"] for row in written["rates"]] == [100.0, 50.0]


def test_sensitivity_answers_in_json_over_the_whole_bounds(
    motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("SALib")
    command = ["sensitivity", str(motor_file), "--data", str(run_file), "--free", "b,R_a", "--process-noise", "none"]
    asked = ["--global", "morris", "--samples", "4", "--response", "omega:last", "--json", "--out", str(tmp_path / "g")]
    assert main([*command, *asked]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert set(answer["parameters"]) == {"b", "R_a", "std(omega)"}
    (found,) = answer["global"]
    assert found["response"] == "omega:last" and found["parameters"]["b"]["mu_star"] > 0.0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--rates", "fast"], "give samples per second, such as 40,20,10,5"),
        (["--global", "sobol", "--samples", "100"], "a power of two"),
        (["--global", "morris", "--response", "omeg"], "did you mean 'omega'?"),
        (["--declared-noise"], "declares no noise"),
        (["--response", "omega"], "--response: it is one of --global - add --global morris or sobol"),
        (["--samples", "64"], "--samples: it is one of --global"),
    ],
)
def test_impossible_sensitivities_are_refused(
    options: list[str], said: str, motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["sensitivity", str(motor_file), "--data", str(run_file), "--free", "b", "--out", str(tmp_path / "no")]
    assert main([*command, *options]) == 2
    assert said in capsys.readouterr().err


@pytest.fixture
def plans(tmp_path: Path) -> list[str]:
    """Two manoeuvres: a constant voltage, and one that alternates."""
    found = []
    for name, period in (("still", 100), ("lively", 10)):
        rows = "".join(f"{0.01 * k:.2f},{12.0 if (k // period) % 2 == 0 else 2.0}\n" for k in range(60))
        path = tmp_path / f"{name}.csv"
        path.write_text("time [s],u_a [V]\n" + rows, encoding="utf-8")
        found.append(str(path))
    return found


def test_design_ranks_manoeuvres_and_tells_rivals_apart(
    motor: dict[str, Any], motor_file: Path, plans: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bearing = next(node for node in motor["nodes"] if node["id"] == "bearing")
    bearing["effort"] = "c*flow*abs(flow)"
    motor["graph"]["parameters"][-1] = {"name": "c", "value": 0.02, "unit": "N m s^2", "bounds": [0.001, 0.5]}
    rival = tmp_path / "turbulent.json"
    rival.write_text(json.dumps(motor), encoding="utf-8")
    out = tmp_path / "design"
    command = ["design", str(motor_file), "--rival", str(rival), "--inputs", *plans, "--noise", "omega=0.05"]
    assert main([*command, "--free", "b,R_a", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "tells most: " in said and "told worst" in said and "nats/s" in said
    names = {"result.json", "design.png", "discrimination.png", "report.html"}
    assert {path.name for path in out.iterdir()} == names
    written = json.loads((out / "result.json").read_text(encoding="utf-8"))
    gains = {row["manoeuvre"]: row["gain"] for row in written["information"]["manoeuvres"]}
    assert set(gains) == {"still", "lively"} and all(gain > 0.0 for gain in gains.values())
    assert written["discrimination"]["margin"] == pytest.approx(np.log(99.0))


def test_design_reads_logs_by_the_options_of_all_commands_with_logs(
    motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """``--units``, ``--time``, windows and ways between samples were unknown to it, and ``--map`` took one pair."""
    plan, log = tmp_path / "plan.csv", tmp_path / "run.csv"
    rows = [f"{10 * k},{12000 if (k // 10) % 2 == 0 else 2000},{0.1 * k:.3f}\n" for k in range(60)]
    plan.write_text("clock,volts,turns\n" + "".join(rows), encoding="utf-8")
    log.write_text("clock,volts,turns\n" + "".join(rows), encoding="utf-8")
    options = ["--time", "clock", "--units", "clock=ms", "volts=mV", "turns=rad/s", "--map", "volts=u_a", "turns=omega"]
    command = ["design", str(motor_file), "--noise", "omega=0.05", "--free", "b", "--json", "--inputs", str(plan)]
    command += ["--data", str(log), *options, "--inputs-between", "held"]
    found = []
    for part in ((), ("--from", "0.1", "--until", "0.4")):
        assert main([*command, *part, "--out", str(tmp_path / "out")]) == 0
        rows_told = json.loads(capsys.readouterr().out)["information"]["manoeuvres"]
        found.append(next(row for row in rows_told if row["manoeuvre"] == "plan"))
    assert [round(row["duration"], 6) for row in found] == [0.59, 0.3]
    assert found[0]["gain"] > found[1]["gain"] > 0.0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--noise", "omega=0.05"], "no manoeuvre is planned"),
        ([], "no noise of a sensor is known"),
        (["--noise", "omgea=0.05"], "has no output 'omgea'; did you mean 'omega'? - it has omega"),
        (["--noise", "omega=-1"], "a standard deviation above zero"),
        (["--noise", "omega=0.05", "--rate", "0"], "give samples per second above zero"),
    ],
)
def test_impossible_designs_are_refused(
    options: list[str], said: str, motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["design", str(motor_file), "--out", str(tmp_path / "no"), *options]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.rendered
def test_estimate_writes_profiles(
    motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "fit"
    command = ["estimate", str(motor_file), "--data", str(run_file), "--free", "b", "--process-noise", "none"]
    assert main([*command, "--method", "gradient", "--certify", "none", "--profile", "b", "--out", str(out)]) == 0
    assert "profile from" in capsys.readouterr().out
    (profile,) = json.loads((out / "profile.json").read_text(encoding="utf-8")).values()
    assert profile["interval"][0] < profile["value"] < profile["interval"][1]
    assert (out / "profile.png").stat().st_size > 5_000
