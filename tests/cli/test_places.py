"""Where commands write: never outside what was named, whole or not at all, and said in words where they cannot."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bondgraph.cli import main
from bondgraph.data.log import Log, LogChannel, MatchedLog
from bondgraph.errors import DataError
from tests.forked import run_forked

ROOT = Path(__file__).resolve().parents[2]


def _said(capsys: pytest.CaptureFixture[str]) -> str:
    said = capsys.readouterr().err
    assert said.startswith("bondgraph ") and said.count("\n") == 1
    return said


def _write(path: Path, motor: dict[str, Any]) -> str:
    path.write_text(json.dumps(motor), encoding="utf-8")
    return str(path)


def _log(path: Path, rows: int = 40) -> str:
    time = np.arange(rows) * 0.05
    speed = 0.4 * (1.0 - np.exp(-time)) + 0.01 * np.sin(40.0 * time)
    lines = [f"{t},{6.0 if t > 0.2 else 0.0},{w}" for t, w in zip(time, speed, strict=True)]
    path.write_text("\n".join(["time [s],u_a [V],omega [rad/s]", *lines, ""]), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "a/b"])
@pytest.mark.parametrize("command", ["draw", "close-loop", "simulate"])
def test_a_graph_cannot_lead_out_of_the_folder(
    name: str, command: str, motor: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    inside = tmp_path / "one" / "two"
    inside.mkdir(parents=True)
    monkeypatch.chdir(inside)
    motor["graph"]["name"] = name
    given = [command, _write(inside / "motor.json", motor)]
    options = {"draw": [], "close-loop": ["--data", "run.csv"], "simulate": ["--until", "1"]}
    before = sorted(tmp_path.rglob("*"))
    assert main(given + options[command]) == 2
    assert f"name {name!r} holds '/'" in _said(capsys)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_drawing_without_a_file_goes_into_the_working_folder(
    motor_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert main(["draw", str(motor_file)]) == 0
    assert [path.name for path in Path().iterdir()] == ["dc_motor.svg"]


def test_logs_take_no_name_that_leads_elsewhere() -> None:
    channels = {"v": LogChannel("v", "m/s", np.zeros(1))}
    for name in ("../x", "a/b", ""):
        with pytest.raises(DataError, match="log: name"):
            Log(name, np.zeros(1), channels)
        with pytest.raises(DataError, match="log: name"):
            MatchedLog(name, np.zeros(1), np.zeros((0, 1)), np.zeros((0, 1)))


@pytest.mark.rendered
@pytest.mark.parametrize("name", [r"x$\bad{$.csv", "a$b$c.csv", "run 7 (wet) ü.csv"])
def test_a_log_may_have_any_letter_in_its_name(name: str, motor_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["filter", str(motor_file), "--data", _log(tmp_path / name), "--out", str(out)]) == 0
    stem = name.removesuffix(".csv")
    names = {f"{stem}_states.csv", f"{stem}_states.png", "result.json", "report.html", "report_data.npz"}
    assert {path.name for path in out.iterdir()} == names


@pytest.mark.rendered
def test_a_graph_may_have_a_dollar_in_its_name(motor: dict[str, Any], tmp_path: Path) -> None:
    motor["graph"]["name"] = r"a$\frac{b$"
    graph = _write(tmp_path / "motor.json", motor)
    for ending in ("svg", "png", "pdf"):
        assert main(["draw", graph, "-o", str(tmp_path / f"drawn.{ending}")]) == 0
    assert main(["simulate", graph, "--until", "1", "--plot", str(tmp_path / "run.png")]) == 0
    assert main(["linearise", graph, "--bode", str(tmp_path / "bode.png")]) == 0


@pytest.mark.parametrize("command", ["filter", "estimate", "close-loop", "demo"])
def test_a_file_in_place_of_the_folder(
    command: str, motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    taken = tmp_path / "taken"
    taken.write_text("mine", encoding="utf-8")
    given = [command] if command == "demo" else [command, str(motor_file), "--data", _log(tmp_path / "run.csv")]
    assert main([*given, "--out", str(taken)]) == 2
    assert "taken: is a file, not a folder - name another folder" in capsys.readouterr().err
    assert taken.read_text(encoding="utf-8") == "mine"


def test_the_answer_of_another_command_is_not_overwritten(
    motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before, a comparison took the place of result.json and report.html of whatever had been found there."""
    given, out = [str(motor_file), "--data", _log(tmp_path / "run.csv")], tmp_path / "out"
    assert main(["filter", *given, "--out", str(out)]) == 0
    kept = {path.name: path.read_bytes() for path in out.iterdir()}
    for command in ("compare", "estimate", "profile", "sensitivity", "close-loop"):
        assert main([command, *given, "--out", str(out)]) == 2
        said = capsys.readouterr().err
        assert "out: holds the answer of bondgraph filter, which this one would overwrite - name another" in said
    assert main(["inspect", given[-1], "--out", str(out)]) == 2
    assert {path.name: path.read_bytes() for path in out.iterdir()} == kept
    assert main(["filter", *given, "--out", str(out)]) == 0  # its own answer is replaced
    (out / "report_data.npz").write_bytes(b"damaged")
    assert main(["compare", *given, "--out", str(out)]) == 0


def test_a_folder_that_takes_nothing_is_said_before_the_search(
    motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "replace", _refusing(PermissionError(13, "Permission denied")))
    given = ["estimate", str(motor_file), "--data", _log(tmp_path / "run.csv"), "--out", str(tmp_path / "fit")]
    assert main(given) == 2
    assert "fit: nothing can be written to this folder (Permission denied)" in capsys.readouterr().err
    assert not (tmp_path / "fit").exists()


def _refusing(error: OSError) -> Any:
    def refuse(*_: object) -> None:
        raise error

    return refuse


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="nothing is read-only for this user")
def test_a_read_only_folder(motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "fixed").mkdir(mode=0o500)
    assert main(["draw", str(motor_file), "-o", str(tmp_path / "fixed" / "a.svg")]) == 2
    assert "a.svg: Permission denied - name a place where you may read and write" in _said(capsys)


@pytest.mark.parametrize(
    "given",
    [
        ["draw", "-o", "{}.svg"],
        ["simulate", "--until", "1", "--out", "{}.csv"],
        ["simulate", "--until", "1", "--plot", "{}.png"],
        ["linearise", "--bode", "{}.png"],
    ],
    ids=" ".join,
)
@pytest.mark.parametrize(("place", "problem"), [("none/a", "does not exist"), ("folder", "is a folder")])
def test_a_file_that_cannot_be_is_said_first(
    given: list[str], place: str, problem: str, motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for ending in ("svg", "csv", "png"):
        (tmp_path / f"folder.{ending}").mkdir()
    options = [option.format(tmp_path / place) for option in given[1:]]
    assert main([given[0], str(motor_file), *options]) == 2
    assert problem in _said(capsys)


def _on_a_full_disk(bytes_left: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    code = (
        f"import resource, sys\nresource.setrlimit(resource.RLIMIT_FSIZE, ({bytes_left}, {bytes_left}))\n"
        "from bondgraph.cli import main\nsys.exit(main(sys.argv[1:]))\n"
    )
    return run_forked(code, arguments, cwd=ROOT)


@pytest.mark.skipif(os.name != "posix", reason="no such limit")
@pytest.mark.parametrize(
    "given",
    [
        ["draw", "-o", "a.svg"], ["draw", "-o", "a.png"], ["draw", "-o", "a.pdf"],
        ["simulate", "--until", "1", "--out", "a.csv"], ["simulate", "--until", "1", "--plot", "a.png"],
        ["linearise", "--bode", "a.svg"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_a_full_disk_leaves_what_was_there(given: list[str], motor_file: Path, tmp_path: Path) -> None:
    target = tmp_path / given[-1]
    target.write_text("the one before", encoding="utf-8")
    run = _on_a_full_disk(500, given[0], str(motor_file), *given[1:-1], str(target))
    assert run.returncode == 2, run.stderr
    assert f"{target}: File too large - make room, or write to another disk" in run.stderr
    assert "Traceback" not in run.stderr
    assert target.read_text(encoding="utf-8") == "the one before"
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no such device")
@pytest.mark.parametrize(
    "command", [["equations"], ["linearise"], ["simulate", "--until", "1", "--set", "u_a=12"]], ids=" ".join
)
def test_an_answer_that_cannot_be_written(command: list[str], motor_file: Path) -> None:
    words = [command[0], str(motor_file), *command[1:]]
    if command[0] == "equations":  # one as from a shell
        with open("/dev/full", "w") as full:
            run = subprocess.run(
                [sys.executable, "-m", "bondgraph.cli", *words],
                cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True, check=False,
            )  # fmt: skip
    else:
        code = "import sys\nfrom bondgraph.cli import main\nsys.exit(main(sys.argv[1:]))\n"
        run = run_forked(code, words, cwd=ROOT, stdout=Path("/dev/full"))
    assert (run.returncode, run.stderr) == (
        2, f"bondgraph {command[0]}: the answer: No space left on device - make room, or write to another disk\n",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        (["estimate", "--seed", "-1"], "must be a whole number of at least 0"),
        (["simulate", "--until", "nan"], "nan must be a finite number"),
        (["simulate", "--until", "inf"], "inf must be a finite number"),
        (["simulate", "--until", "1", "--step", "0"], "must be a positive number"),
    ],
    ids=str,
)
def test_an_option_that_cannot_be(given: list[str], problem: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([given[0], "motor.json", *(["--data", "run.csv"] if given[0] == "estimate" else []), *given[1:]])
    assert ended.value.code == 2 and problem in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        (["simulate", "--until", "1", "--step", "1e-12"], "--step 1e-12: gives more than 100000000 points"),
        (["simulate", "--until", "1", "--set", "J=inf"], "--set J=inf: the value must be a finite number"),
        (["simulate", "--until", "1", "--set", "J=nan"], "--set J=nan: the value must be a finite number"),
        (["linearise", "--at", "u_a=inf"], "--at u_a=inf: the value must be a finite number"),
        (["simulate", "--until", "1", "--initial", "omega_rotor=-inf"], "must be a finite number"),
        (["evaluate", "--points", "{folder}"], "cannot be read (Is a directory)"),
    ],
    ids=str,
)
def test_a_value_that_cannot_be(
    given: list[str], problem: str, motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([given[0], str(motor_file), *(one.format(folder=tmp_path) for one in given[1:])]) == 2
    assert problem in _said(capsys)
