"""Closing loops from the command line: what is refused before anything is computed."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from bondgraph.cli import main
from bondgraph.cli.loops import _journal

GRAPH = "vehicle_graphs.driveline:driveline"


def test_a_loop_that_was_stopped_before_its_first_fit_starts_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = _journal(argparse.Namespace(out=str(tmp_path / "none"), resume=True))
    assert "no finished fits in" in capsys.readouterr().err
    assert (tmp_path / "none").is_dir() and journal.find("a fit") is None


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [("--max-effects", "0", "must be at least 1"), ("--level", "1.5", "must lie between 0 and 1")],
)
def test_impossible_options_are_refused(option: str, value: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["close-loop", GRAPH, "--data", "run.csv", option, value])
    assert ended.value.code == 2 and said in capsys.readouterr().err
