"""new, inspect, compare, completion, and the options that all commands with logs share."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.cli import COMMANDS, main
from bondgraph.data.pairs import factor_suspicions
from bondgraph.report.comparison import compare_logs
from bondgraph.report.inspection import inspect_log
from bondgraph.simulate.example import pendulum


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that ``new`` wrote."""
    place = tmp_path_factory.mktemp("new")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        assert main(["new", "toboggan"]) == 0
    return place / "toboggan"


@pytest.fixture
def machine(begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of that folder, as working folder."""
    shutil.copytree(begun, tmp_path / "toboggan")
    monkeypatch.chdir(tmp_path / "toboggan")
    return tmp_path / "toboggan"


@pytest.mark.rendered
def test_what_new_writes_can_be_laid_over_its_logs(machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written = {path.name for path in machine.iterdir()} - {"__pycache__"}  # which Python may write
    assert written == {"run1.csv", "run2.csv", "toboggan.py"}
    assert main(["compare", "toboggan.py", "--data", "run1.csv", "run2.csv"]) == 0
    assert "speed [m/s]" in capsys.readouterr().out
    result = json.loads((machine / "compared" / "result.json").read_text())
    found = result["logs"]["run1"]["channels"]["speed"]
    simulated = bg.read_log("compared/run1_simulated.csv").channel("speed").numbers
    error = bg.read_log("run1.csv").channel("speed").numbers - simulated
    assert found["rms"] == pytest.approx(np.sqrt(np.mean(error**2))) and found["mean"] == pytest.approx(error.mean())
    assert abs(found["largest"]) == pytest.approx(np.abs(error).max())
    assert (machine / "compared" / "run2_compared.png").stat().st_size > 10_000
    assert main(["compare", "toboggan.py", "--data", "run1.csv", "--set", "mass=95", "drag=17", "--out", "set"]) == 0
    better = json.loads((machine / "set" / "result.json").read_text())["logs"]["run1"]["channels"]["speed"]
    assert better["rms"] < 0.7 * found["rms"]


@pytest.mark.parametrize(
    ("name", "said"),
    [("a-b", "letters, digits and underscores"), ("json", "there is a module of this name, "), ("toboggan", "exists")],
)
def test_names_that_a_machine_cannot_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "toboggan").mkdir()
    assert main(["new", name]) == 2
    assert said in capsys.readouterr().err


def test_simulate_takes_a_log_with_measured_and_other_columns(
    machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (machine / "run1.csv").read_text().splitlines()
    rows = "\n".join(f"{line.replace(',', ';').replace('.', ',')};20" for line in text[1:])
    (machine / "wide.csv").write_text("stamp;push [N];speed;air [degC]\n" + rows)
    command = ["simulate", "toboggan.py", "--inputs", "wide.csv", "--time", "stamp", "--units", "stamp=s", "speed=m/s"]
    command += ["--map", "push=force", "--from", "5", "--until", "6", "--out", "out.csv"]
    assert main([*command, "--start", "measured"]) == 0
    assert "columns the model does not use: air" in capsys.readouterr().err
    out, log = bg.read_log("out.csv"), bg.read_log("run1.csv")
    np.testing.assert_allclose(out.time, log.time[(log.time >= 5.0) & (log.time <= 6.0)])
    assert out.channel("v").numbers[0] == pytest.approx(log.channel("speed").numbers[50])
    assert main(command) == 0
    assert bg.read_log("out.csv").channel("v").numbers[0] == 0.0


def test_windows_are_parts_of_logs(machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["filter", "toboggan.py", "--data", "run1.csv", "--out", "filtered", "--from", "10", "--until", "12"]
    assert main(command) == 0
    log = bg.read_log(machine / "filtered" / "run1_states.csv")
    assert (log.time[0], log.time[-1]) == (10.0, 12.0)
    assert main([*command[:-4], "--from", "50"]) == 2
    assert "no samples from 50 s" in capsys.readouterr().err


def test_logs_are_cut_where_time_jumps(machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The force in the gap is not known: the second part starts anew, and is simulated from there."""
    lines = (machine / "run1.csv").read_text().splitlines()
    (machine / "torn.csv").write_text("\n".join([*lines[:100], *lines[160:]]))
    command = ["compare", "toboggan.py", "--data", "torn.csv"]
    assert main(command) == 0
    assert "if the machine did something else meanwhile give --split-gaps" in capsys.readouterr().err
    assert main([*command, "--split-gaps", "--out", "parts"]) == 0
    assert "time jumps" not in capsys.readouterr().err
    found = json.loads((machine / "parts" / "result.json").read_text())["logs"]
    assert list(found) == ["torn.1", "torn.2"]
    log, part = bg.read_log("run1.csv"), bg.read_log("parts/torn.2_simulated.csv")
    assert part.time[0] == log.time[159]
    assert part.channel("speed").numbers[0] == pytest.approx(log.channel("speed").numbers[159])
    assert main(["filter", "toboggan.py", "--data", "torn.csv", "--split-gaps", "--out", "filtered"]) == 0
    assert (machine / "filtered" / "torn.2_states.csv").exists()


def test_a_report_is_written_again_as_it_was(machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["filter", "toboggan.py", "--data", "run1.csv", "--out", "filtered", "--until", "4"]) == 0
    page = machine / "filtered" / "report.html"
    before = page.read_text()
    page.unlink()
    assert main(["report", "filtered"]) == 0
    assert page.read_text() == before
    assert main(["report", "."]) == 2
    assert "holds no report_data.npz - name the folder of a finished filter" in capsys.readouterr().err
    (machine / "filtered" / "report_data.npz").write_bytes(b"PK")
    assert main(["report", "filtered"]) == 2
    assert "it is damaged or of another version" in capsys.readouterr().err


@pytest.mark.rendered
def test_inspect_tells_rates_gaps_and_suspicious_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time = np.arange(400) * 0.05
    speed = 10.0 + np.sin(time)
    lines = "\n".join(
        f"{t:.2f};{v:.6f};{'' if k % 2 or 100 < k < 200 else f'{3.6 * v:.6f}'};{'H' if t > 5 else 'L'}".replace(
            ".", ","
        )
        for k, (t, v) in enumerate(zip(time, speed, strict=True))
    )
    (tmp_path / "run.csv").write_text("time;gps;dash;gear\ns;m/s;m/s;text\n" + lines)
    command = ["inspect", str(tmp_path / "run.csv")]
    assert main([*command, "--plot", str(tmp_path / "run.png")]) == 0
    out = capsys.readouterr().out
    assert "'dash' is 3.6 times 'gps', which suggests km/h read as m/s" in out
    assert "column 'dash' has no measurement from 5 s to 10 s (rows 104 to 202)" in out and "H, L" in out
    assert (tmp_path / "run.png").stat().st_size > 10_000
    assert main([*command, "--out", str(tmp_path / "seen")]) == 0
    said = capsys.readouterr()
    assert said.out == out and said.err.endswith(f"report: {tmp_path / 'seen' / 'report.html'}\n")
    page = (tmp_path / "seen" / "report.html").read_text()
    assert "which suggests km/h read as m/s" in page and "gps [m/s]" in page and "data:image/" in page
    written = json.loads((tmp_path / "seen" / "result.json").read_text())
    assert [(one["name"], one["mean"] is None) for one in written["channels"]][-1] == ("gear", True)
    assert (tmp_path / "seen" / "run_channels.png").stat().st_size > 10_000
    assert main([*command, "--json", "--until", "4"]) == 0
    found = json.loads(capsys.readouterr().out)
    rates = {one["name"]: one["rate"] for one in found["channels"]}
    assert rates["gps"] == pytest.approx(20.0) and rates["dash"] == pytest.approx(10.0) and found["rows"] == 81


def test_a_slope_in_another_unit_is_suspected_and_a_right_one_is_not() -> None:
    time = np.linspace(0.0, 20.0, 2001)
    place, rate = 100.0 * np.sin(0.3 * time), 30.0 * np.cos(0.3 * time)

    def suspicions(factor: float) -> list[str]:
        channels = {"x": bg.LogChannel("x", "m", place), "v": bg.LogChannel("v", "m/s", factor * rate)}
        return factor_suspicions(bg.Log("run", time, channels))

    assert suspicions(1.0) == []
    (found,) = suspicions(3.6)
    assert found.startswith("the integral of 'v' is 3.6 times 'x', which suggests km/h read as m/s")


def test_comparing_a_model_with_its_own_simulation_finds_no_error() -> None:
    model, time = pendulum(), np.arange(200) * 0.02
    run = bg.simulate(model, time)
    log = bg.MatchedLog("own", time, run.u, run.y)
    compared = compare_logs(model, [log], initial="model")
    error = compared.runs[0].errors[0]
    assert error.rms < 1e-7 and error.fit == pytest.approx(1.0) and compared.suspicions == ()


def test_an_inspection_has_no_row_for_what_is_not_there() -> None:
    log = bg.Log("run", np.arange(3.0), {"v": bg.LogChannel("v", "?", np.array([1.0, np.nan, 2.0]))})
    (row,) = inspect_log(log).channels
    assert (row.samples, row.missing, row.lowest, row.highest) == (2, 1, 1.0, 2.0)


def test_times_of_a_day_have_no_exponent(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "\n".join(f"{60 * k},{k % 7}" for k in range(1441))
    (tmp_path / "day.csv").write_text(f"time [s],v [m/s]\n{rows}\n")
    assert main(["inspect", str(tmp_path / "day.csv")]) == 0
    assert "1441 rows from 0 to 86400 s; a row every 60 s" in capsys.readouterr().out
    assert "1441 samples, 0 to 86400 s" in repr(bg.read_log(tmp_path / "day.csv"))


def test_completion_knows_all_commands(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "completion.sh"
    script.write_text(capsys.readouterr().out)
    assert all(name in script.read_text() for name in COMMANDS)
    assert subprocess.run(["bash", "-n", str(script)], check=False).returncode == 0


def test_units_are_pairs_or_a_file(machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", "run1.csv", "--units", "speed"]) == 2
    assert "write it as column=unit, such as speed=km/h" in capsys.readouterr().err
    (machine / "units.json").write_text('{"speed": "km/h"}')
    assert main(["inspect", "run1.csv", "--units", "units.json"]) == 0
    assert "speed [km/h]" in capsys.readouterr().out
