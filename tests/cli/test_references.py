"""Graphs of one's own files at the command line: README's examples as printed, the command in a generated header."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bondgraph.cli import main
from bondgraph.data import read_log

README = Path(__file__).resolve().parents[2] / "README.md"
EXAMPLES = ("sled", "block")


def _blocks(kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder with README's examples as files, as a reader saves them."""
    monkeypatch.chdir(tmp_path)
    for name in EXAMPLES:
        (code,) = [block for block in _blocks("python") if f'BondGraph("{name}"' in block]
        (tmp_path / f"{name}.py").write_text(code, encoding="utf-8")
    return tmp_path


def test_the_examples_of_the_readme_run_as_printed(folder: Path) -> None:
    lines = [line for block in _blocks("sh") for line in block.splitlines()]
    commands = [shlex.split(line, comments=True) for line in lines if re.search(r"\b(sled|block)\.py", line)]
    assert {command[1] for command in commands} >= {"draw", "equations", "generate", "simulate"}
    for command in commands:
        assert command[0] == "bondgraph" and main(command[1:]) == 0, command
    written = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert written >= {"sled.svg", "push.csv", "stop.png", "generated/sled.py", "generated/block_exact.py"}


@pytest.mark.parametrize(
    "options",
    [["sled.py"], ["sled.py:sled"], ["block.py", "--exact"], ["sled.py", "--folder", "my models"], ["sub dir/sled.py"]],
    ids=" ".join,
)
def test_the_command_in_a_generated_header_reproduces_the_module(
    folder: Path, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "sub dir").mkdir()
    (folder / "sub dir" / "sled.py").write_text((folder / "sled.py").read_text())
    assert main(["generate", *options]) == 0
    written = Path(capsys.readouterr().out.partition("written: ")[2].strip())
    text = written.read_bytes()
    command = re.search(r"^# Regenerate with:  (.*)$", text.decode(), flags=re.MULTILINE)
    assert command is not None
    written.unlink()
    words = shlex.split(command[1])
    assert words[0] == "bondgraph" and main(words[1:]) == 0
    assert written.read_bytes() == text
    assert main([*words[1:], "--check"]) == 0


def test_a_package_without_its_own_graphs_is_not_needed_for_a_file(folder: Path) -> None:
    assert main(["generate", "sled.py", "--graphs", "no_such_package"]) == 0


@pytest.mark.parametrize("command", ["draw", "equations", "linearise", "simulate", "filter", "close-loop", "generate"])
def test_a_file_that_fails_is_one_message_with_its_line(
    folder: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "bad.py").write_text("x = 1\ny = x / 0\n")
    data = ["--data", "log.csv"] if command in ("filter", "close-loop") else []
    assert main([command, "bad.py", *data]) == 2
    said = capsys.readouterr()
    assert said.err == f"bondgraph {command}: bad.py:2: ZeroDivisionError: division by zero\n" and not said.out
    assert {path.name for path in folder.iterdir()} == {"bad.py", "sled.py", "block.py"}


def test_a_generated_module_is_filtered_and_a_file_that_declares_too(folder: Path) -> None:
    assert main(["simulate", "sled.py", "--until", "5", "--step", "0.1", "--set", "force=50", "--out", "run.csv"]) == 0
    assert main(["generate", "sled.py"]) == 0
    assert read_log("run.csv").channel("force").numbers.tolist() == [50.0] * 51  # its inputs are written too
    for model in ("sled.py", "generated/sled.py"):
        assert main(["filter", model, "--data", "run.csv", "--out", "filtered"]) == 0


def test_python_dash_m_is_the_command() -> None:
    for module in ("bondgraph", "bondgraph.cli"):
        run = subprocess.run([sys.executable, "-m", module, "--version"], capture_output=True, text=True, check=True)
        assert run.stdout.startswith("bondgraph ")


@pytest.fixture
def push(folder: Path) -> np.ndarray:
    """Times, forces and noisy speeds of the sled, pushed to and fro."""
    time = 0.1 * np.arange(300)
    force = 100.0 + 80.0 * np.sign(np.sin(0.7 * time))
    table = "".join(f"{t},{f}\n" for t, f in zip(time, force, strict=True))
    (folder / "inputs.csv").write_text("time [s],force [N]\n" + table)
    assert main(["simulate", "sled.py", "--inputs", "inputs.csv", "--out", "clean.csv"]) == 0
    speed = read_log("clean.csv").channel("speed").numbers
    return np.c_[time, force, speed + 0.05 * np.random.default_rng(0).standard_normal(time.size)]


@pytest.mark.parametrize(
    ("scales", "said"),
    [
        (
            (1.0, 3.6),
            r"output 'speed': measured values are 3\.[56]\d* \+- \S+ times the modelled ones, .* km/h read as m/s",
        ),
        ((1000.0, 1.0), r"times are 100 s apart, but the model follows the log as if they were 100 ms"),
        ((1.0, 1.0), ""),
    ],
)
def test_a_log_in_other_units_is_pointed_out(
    folder: Path, push: np.ndarray, scales: tuple[float, float], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    table = push * np.array([scales[0], 1.0, scales[1]])
    table[:, 0] = np.round(table[:, 0], 3)
    rows = "".join(",".join(map(repr, map(float, row))) + "\n" for row in table)
    (folder / "run.csv").write_text("time [s],force [N],speed [m/s]\n" + rows)
    assert main(["filter", "sled.py", "--data", "run.csv", "--out", "filtered"]) == 0
    printed, report = capsys.readouterr().out, (folder / "filtered" / "report.html").read_text()
    suspected = bool(said)
    assert bool(re.search(r"which suggests|the model follows the log as if", printed)) == suspected
    assert ("Check the log:" in report) == suspected and re.search(said, printed)
