"""simulate, filter, estimate and sensitivity on small logs; bad logs and options with message and exit status 2."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bondgraph.cli import main


@pytest.fixture
def run_file(motor_file: Path, tmp_path: Path) -> Path:
    """A simulated run of the motor with a noisy speed."""
    inputs = tmp_path / "inputs.csv"
    rows = "".join(f"{t},{u}\n" for t, u in ((0.0, 0), (0.2, 12), (1.0, 12), (1.2, 4), (2.0, 4)))
    inputs.write_text("time [s],u_a [V]\n" + rows, encoding="utf-8")
    clean = tmp_path / "clean.csv"
    command = ["simulate", str(motor_file), "--inputs", str(inputs), "--step", "0.01", "--set", "b=0.12"]
    assert main([*command, "--out", str(clean)]) == 0
    with clean.open(encoding="utf-8") as stream:
        table = list(csv.DictReader(stream))
    rng = np.random.default_rng(0)
    noisy = tmp_path / "run.csv"
    with noisy.open("w", encoding="utf-8") as stream:
        stream.write("time [s],u_a [V],omega [rpm]\n")
        for row in table:
            t = float(row["time [s]"])
            u = float(np.interp(t, [0.0, 0.2, 1.0, 1.2, 2.0], [0, 12, 12, 4, 4]))
            speed = (float(row["omega [rad/s]"]) + 0.02 * rng.standard_normal()) * 30.0 / np.pi
            stream.write(f"{t},{u},{speed}\n")
    return noisy


def test_simulate_reaches_the_stationary_speed(motor_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["simulate", str(motor_file), "--until", "20", "--step", "10", "--set", "u_a=12", "--set", "b=0.05"]
    assert main([*command, "--initial", "omega_rotor=3", "--all"]) == 0
    lines = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert float(lines[0]["omega_rotor [rad/s]"]) == 3.0
    current = 12.0 / (1.0 + 0.1**2 / 0.05)
    assert float(lines[-1]["i_L [A]"]) == pytest.approx(current, rel=1e-7)
    assert float(lines[-1]["effort(loop->R) [V]"]) == pytest.approx(current, rel=1e-7)


def test_simulate_tells_a_person_what_came_out_and_gives_programs_the_table(
    motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["simulate", str(motor_file), "--until", "2", "--set", "u_a=12"]
    assert main(command) == 0
    table = capsys.readouterr().out
    assert table.count("\n") == 1002
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert main([*command, "--out", "-"]) == 0
    assert capsys.readouterr().out == table
    assert main([*command, "--all"]) == 0
    rows = list(csv.DictReader(table.splitlines()))
    speeds = [float(row["omega [rad/s]"]) for row in rows]
    told = capsys.readouterr().out
    (line,) = (line.split() for line in told.splitlines() if line.startswith("omega "))
    assert [float(cell) for cell in line[2:]] == pytest.approx(
        [speeds[0], speeds[-1], min(speeds), max(speeds)], rel=1e-3
    )
    assert "1001 rows from 0 to 2 s" in told and "--out -" in told and told.count("\n") < 12
    assert "efforts and flows of bonds, which the table has too: 14" in told
    assert main([*command, "--out", str(tmp_path / "run.csv")]) == 0
    assert (tmp_path / "run.csv").read_text(encoding="utf-8") == table
    said = capsys.readouterr()
    assert "1001 rows" in said.out and "--out" not in said.out and "written: " in said.err


@pytest.mark.rendered
def test_estimate_recovers_the_changed_parameter(
    motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "fit"
    command = ["estimate", str(motor_file), "--data", str(run_file), "--free", "b", "--method", "gradient"]
    assert main([*command, "--out", str(out)]) == 0
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    low, high = result["parameters"]["b"]["ci95"]
    assert low < 0.12 < high and high - low < 0.01
    assert set(result) >= {"parameters", "nll", "evaluations", "seconds", "innovations", "correlation", "outcome"}
    assert "http" not in (out / "report.html").read_text(encoding="utf-8").replace("http://www.w3.org", "")
    assert "b" in capsys.readouterr().out


def test_what_is_known_of_parameters_is_said_on_the_command_line(
    motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Bounds of one's own, a prior that outweighs the log, a lower rate, and a held-out log."""
    held_out, out = tmp_path / "other.csv", tmp_path / "fit"
    held_out.write_text(run_file.read_text(encoding="utf-8"), encoding="utf-8")
    known = ["--free", "b=0.05:0.3", "--prior", "b=0.125+-1e-6", "--rate", "25", "--starts", "2"]
    command = ["estimate", str(motor_file), "--data", str(run_file), "--holdout", str(held_out), *known]
    assert main([*command, "--method", "gradient", "--process-noise", "none", "--out", str(out)]) == 0
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert result["parameters"]["b"]["bounds"] == [0.05, 0.3]
    assert result["parameters"]["b"]["value"] == pytest.approx(0.125, rel=1e-4)
    (unseen,) = result["held_out"]
    assert unseen["log"] == "other" and unseen["nll"] < unseen["declared_nll"]
    said, page = capsys.readouterr().out, (out / "report.html").read_text("utf-8")
    assert "other" in said and "Held out" in page
    speed = unseen["channels"]["omega"]
    assert speed["unit"] == "rad/s" and speed["noise_std"] > 0.0
    assert speed["simulation_rmse"] < 0.5 * speed["declared_simulation_rmse"]
    table = said[said.index("held out: before and after") :]
    assert "omega [rad/s]" in table and f"{speed['simulation_rmse']:.2g}" in table and "held out" in table


def test_sensitivity_knows_ties_and_priors(
    motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is tied is not free, and no parameter is known worse than its prior says."""
    known = ["--tie", "b=0.12*R_a", "--prior", "L_a=0.5+-1e-6", "--rate", "25"]
    command = ["sensitivity", str(motor_file), "--data", str(run_file), *known, "--json", "--out", str(tmp_path / "s")]
    assert main(command) == 0
    found = json.loads(capsys.readouterr().out)
    assert {"R_a", "L_a"} <= set(found["parameters"]) and "b" not in found["parameters"]
    assert 0.0 < found["ranking"]["L_a"]["std_joint"] <= 1e-6 < found["ranking"]["R_a"]["std_joint"]


@pytest.mark.parametrize(("option", "message"), [
    (("--free", "b=3"), "write it as name or name=lower:upper"),
    (("--free", "bb=1:2"), "dc_motor has no parameter 'bb'"),
    (("--prior", "drag=1+-2"), "has no parameter 'drag' - it has L_a, R_a"),
    (("--set", "drag=3"), "no parameter 'drag' - it has L_a, R_a"),
    (("--prior", "b=many"), "write it as name=mean"),
    (("--prior", "b=1*/0.5"), "the factor 0.5 must be above one"),
    (("--prior", "J=1+-0.5"), "prior of 'J': it is not free"),
    (("--tie", "b"), "write it as name=expression"),
    (("--tie", "b=2*c"), "there is no one parameter 'c'"),
    (("--holdout", "SAME"), "a log that was trained on confirms nothing"),
])  # fmt: skip
def test_wishes_that_cannot_be_read_are_refused(
    motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: tuple, message: str
) -> None:
    words = [str(run_file) if word == "SAME" else word for word in option]
    command = ["estimate", str(motor_file), "--data", str(run_file), "--out", str(tmp_path / "out"), *words]
    assert main(command) == 2
    assert message in capsys.readouterr().err


@pytest.mark.rendered
def test_filter_writes_states_with_bands(motor_file: Path, run_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "filtered"
    assert main(["filter", str(motor_file), "--data", str(run_file), "--smooth", "--out", str(out)]) == 0
    header = (out / "run_states.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header == "time [s],i_L [A],i_L_std [A],omega_rotor [rad/s],omega_rotor_std [rad/s]"
    assert (out / "run_states.png").stat().st_size > 10_000


def test_what_is_not_measured_can_start_settled(motor_file: Path, tmp_path: Path) -> None:
    """A motor at speed under voltage: its current has settled long before the log begins."""
    log, out = tmp_path / "late.csv", tmp_path / "filtered"
    rows = "".join(f"{0.01 * k:.2f},12,{60.0 + 0.1 * (k % 2)}\n" for k in range(60))
    log.write_text("time [s],u_a [V],omega [rad/s]\n" + rows, encoding="utf-8")
    command = ["filter", str(motor_file), "--data", str(log), "--out", str(out)]
    starts = {}
    for rule in ("measured", "settled"):
        assert main([*command, "--start", rule]) == 0
        first = (out / "late_states.csv").read_text(encoding="utf-8").splitlines()[1]
        starts[rule] = float(first.split(",")[1])
    assert starts["measured"] == pytest.approx(0.0, abs=1e-6)
    assert starts["settled"] == pytest.approx((12.0 - 0.1 * 60.0) / 1.0, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--until", "2", "--set", "Jj=0.05"], "no parameter or input of this name; did you mean 'J'?"),
        (["--until", "2", "--set", "J"], "write it as name=value"),
        (["--until", "2", "--initial", "omega=1"], "did you mean 'omega_rotor'?"),
        ([], "needs --until"),
        (["--inputs", "nothing.csv"], "no such file"),
    ],
)
def test_bad_options_of_simulate(
    motor_file: Path, options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", str(motor_file), *options]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("time [s],omega [rpn]\n0,1\n1,2\n", "did you mean 'rpm'"),
        ("time [s],omega [kg]\n0,1\n1,2\n", "omega"),
        ("time [s],omega [rpm]\n0,1\n0,2\n", "increas"),
        ("time [s],torque [N m]\n0,1\n1,2\n", "none of the outputs"),
    ],
)
def test_bad_logs_are_told_and_nothing_is_written(
    motor_file: Path, tmp_path: Path, table: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "bad.csv"
    log.write_text(table, encoding="utf-8")
    out = tmp_path / "fit"
    assert main(["estimate", str(motor_file), "--data", str(log), "--out", str(out)]) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()


def test_an_option_that_is_unknown_exits_with_2(motor_file: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["simulate", str(motor_file), "--untill", "2"])
    assert ended.value.code == 2


def test_a_log_cannot_be_trained_on_and_held_out(
    motor_file: Path, run_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["close-loop", str(motor_file), "--data", str(run_file), "--holdout", str(run_file)]
    assert main(command) == 2
    assert "confirms nothing" in capsys.readouterr().err


def test_unknown_effects_module(motor_file: Path, run_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["close-loop", str(motor_file), "--data", str(run_file), "--effects", "no_such_effects"]) == 2
    assert "--effects no_such_effects: there is no module 'no_such_effects'" in capsys.readouterr().err


@pytest.fixture
def silent_file(run_file: Path, tmp_path: Path) -> Path:
    """The same run without its voltage."""
    path = tmp_path / "silent.csv"
    rows = [row.split(",") for row in run_file.read_text(encoding="utf-8").splitlines()]
    path.write_text("".join(f"{row[0]},{row[2]}\n" for row in rows), encoding="utf-8")
    return path


@pytest.mark.parametrize("command", ["filter", "estimate", "sensitivity", "close-loop"])
def test_a_log_without_an_input_is_refused(
    command: str, motor_file: Path, silent_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before, the motor was filtered as if its voltage were zero."""
    out = tmp_path / "out"
    assert main([command, str(motor_file), "--data", str(silent_file), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "no values for the input 'u_a' [V] of dc_motor" in said and "--set u_a=0" in said
    assert not out.exists()


def test_a_generated_module_knows_which_inputs_a_log_must_hold(
    motor_file: Path, silent_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["generate", str(motor_file), "--folder", str(tmp_path / "models")]) == 0
    command = ["filter", str(tmp_path / "models" / "dc_motor.py"), "--data", str(silent_file)]
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
    assert "no values for the input 'u_a' [V]" in capsys.readouterr().err
    assert main([*command, "--set", "u_a=12", "--out", str(tmp_path / "out")]) == 0
    assert "input 'u_a' is not in the log; 12 V is taken as given" in capsys.readouterr().err


def test_a_declared_default_is_taken_and_told(
    motor: dict[str, Any], silent_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motor["graph"]["inputs"][0]["default"] = 0.0
    path = tmp_path / "coasting.json"
    path.write_text(json.dumps(motor), encoding="utf-8")
    assert main(["filter", str(path), "--data", str(silent_file), "--out", str(tmp_path / "out")]) == 0
    assert "input 'u_a' is not in the log; 0 V is taken from the declaration" in capsys.readouterr().err


def test_simulate_refuses_a_table_without_an_input_and_tells_what_rests(
    motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "table.csv"
    table.write_text("time [s]\n0\n1\n", encoding="utf-8")
    command = ["simulate", str(motor_file), "--out", str(tmp_path / "run.csv")]
    assert main([*command, "--inputs", str(table)]) == 2
    assert "no values for the input 'u_a' [V] of dc_motor" in capsys.readouterr().err
    assert main([*command, "--inputs", str(table), "--set", "u_a=1"]) == 0
    capsys.readouterr()
    assert main([*command, "--until", "1"]) == 0
    assert "input 'u_a' has no value; 0 V is taken - give it with --set u_a=VALUE" in capsys.readouterr().err
    assert main([*command, "--until", "1", "--set", "u_a=1"]) == 0
    assert "u_a" not in capsys.readouterr().err


@pytest.fixture
def wrong_file(run_file: Path, tmp_path: Path) -> Path:
    """The same run of a motor whose speed swings more than its model can say."""
    path = tmp_path / "wrong.csv"
    header, *rows = run_file.read_text(encoding="utf-8").splitlines()
    values = [[float(word) for word in row.split(",")] for row in rows]
    more = "".join(f"{t},{u},{speed * (1.0 + 0.2 * np.sin(6.0 * t))}\n" for t, u, speed in values)
    path.write_text(f"{header}\n{more}", encoding="utf-8")
    return path


@pytest.mark.parametrize("command", ["filter", "estimate"])
def test_a_log_that_the_model_does_not_explain_is_told(
    command: str, motor_file: Path, wrong_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before, a whiteness of p = 1e-237 stood in result.json alone."""
    out = tmp_path / "out"
    options = ["--set", "b=0.12"] if command == "filter" else ["--free", "b", "--method", "gradient"]
    options += [] if command == "filter" else ["--process-noise", "none"]
    words = [command, str(motor_file), *options, "--out", str(out)]
    assert main([*words, "--data", str(wrong_file)]) == 0
    said = capsys.readouterr().out
    assert "omega: one-step error" in said and "times its noise" in said
    assert f"the model does not explain this log - look at {out / 'report.html'}" in said and "close-loop" in said
    assert "the model does not explain this log" in (out / "report.html").read_text(encoding="utf-8")
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    (found,) = (result if command == "estimate" else result["wrong"])["misfits"]
    assert found["channel"] == "omega" and found["coloured"] and found["whiteness_p"] < 1e-20
    assert main([*words, "--strict", "--data", str(wrong_file)]) == 1
    capsys.readouterr()
    assert main([*words, "--strict", "--data", str(run_file)]) == 0
    assert "does not explain" not in capsys.readouterr().out + (out / "report.html").read_text(encoding="utf-8")


def spoilt(run_file: Path) -> Path:
    """The run with every fiftieth reading far off."""
    header, *rows = run_file.read_text(encoding="utf-8").splitlines()
    rows = [f"{row.rpartition(',')[0]},900.0" if k % 50 == 25 else row for k, row in enumerate(rows)]
    path = run_file.with_name("spoilt.csv")
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def test_robust_commands_are_not_led_astray(
    motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = str(spoilt(run_file))
    command = ["estimate", str(motor_file), "--data", data, "--free", "b", "--method", "gradient", "--certify", "none"]
    assert main([*command, "--robust", "student", "--out", str(tmp_path / "fit")]) == 0
    result = json.loads((tmp_path / "fit" / "result.json").read_text(encoding="utf-8"))
    low, high = result["parameters"]["b"]["ci95"]
    assert low < 0.12 < high and high - low < 0.02
    filtered = ["filter", str(motor_file), "--data", data, "--set", "b=0.12", "--out", str(tmp_path / "filtered")]
    capsys.readouterr()
    assert main([*filtered, "--robust", "gate"]) == 0
    said = capsys.readouterr().out
    assert " refused by the gate" in said and "filter without --robust" not in said  # some readings, all spoilt
    assert main([*filtered, "--set", "b=1.0", "--robust", "gate"]) == 0
    said = capsys.readouterr().out  # it said that the noises are taken too large, since nothing passed the gate
    assert "the model or its noises are wrong rather than the sensor - filter without --robust" in said
    assert "taken too large" not in said and ", refused ones as zero" in said
    assert "No channel contradicts" not in said  # nor does any that was not followed agree
    for text, said in (("cauchy", "kind 'cauchy' is not known"), ("gate:2", "give a number from 0.5 to 1")):
        assert main([*filtered, "--robust", text]) == 2
        assert said in capsys.readouterr().err
