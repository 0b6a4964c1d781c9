"""Closing loops from the command line: what is refused before anything is computed."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import pytest

import bondgraph as bg
from bondgraph.cli import main
from bondgraph.cli.loops import _journal
from tests.correct.windy_cart import write

GRAPH = "vehicle_graphs.driveline:driveline"


def test_a_loop_that_was_stopped_before_its_first_fit_starts_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = _journal(argparse.Namespace(command="close-loop", out=str(tmp_path / "none"), resume=True))
    assert "no finished fits in" in capsys.readouterr().err
    assert (tmp_path / "none").is_dir() and journal.find("a fit") is None


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--max-effects", "0", "must be at least 1"),
        ("--refits", "0", "must be at least 1"),
        ("--level", "1.5", "must lie between 0 and 1"),
    ],
)
def test_impossible_options_are_refused(option: str, value: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["close-loop", GRAPH, "--data", "run.csv", option, value])
    assert ended.value.code == 2 and said in capsys.readouterr().err


def test_a_loop_whose_refits_are_spent_says_how_to_grant_more(tmp_path: Path) -> None:
    graph, data = write(tmp_path)
    command = ["close-loop", str(graph), "--data", str(data), "--no-faults", "--max-effects", "1"]
    command += ["--effects", "quadratic_loss", "rolling_speed_loss", "--out", str(tmp_path / "loop")]
    cautions = []
    for more in (["--refits", "1"], ["--refits", "2"]):
        assert main([*command, *more]) == 0
        page = (tmp_path / "loop" / "report.html").read_text(encoding="utf-8")
        cautions.append(re.sub(r"</?span[^>]*>", "", page))  # options are kept in one line
    assert "ended with its 1 refit spent: rolling_speed_loss at body might have done better" in cautions[0]
    assert "grant more with --refits 2, in Python LoopSettings(refits=2)" in cautions[0]
    assert "might have done better" not in cautions[1]


def test_the_folder_of_a_loop_is_a_saved_correction(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    graph, data = write(tmp_path)
    command = ["close-loop", str(graph), "--data", str(data), "--no-faults", "--max-effects", "1", "--set", "mass=90"]
    assert main([*command, "--effects", "quadratic_loss", "--out", str(tmp_path / "loop")]) == 0
    told = capsys.readouterr().out
    loop = bg.Correction.load(tmp_path / "loop")
    assert loop.summary() in told and loop.verdict == loop.result["verdict"]
    assert loop.declared == bg.read_graph(tmp_path / "loop" / "declared_graph.json")
    lines = (tmp_path / "loop" / "corrected_lines.py").read_text(encoding="utf-8")
    assert lines.partition("\n")[2] == f"{loop.python_lines()}\n" != "\n"
