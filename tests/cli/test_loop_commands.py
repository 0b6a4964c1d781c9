"""Closing loops from the command line: what is refused before anything is computed."""

from __future__ import annotations

from pathlib import Path

import pytest

from bondgraph.cli import main

GRAPH = "vehicle_graphs.driveline:driveline"


def test_there_must_be_something_to_go_on_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from vehicle_graphs.demo import write_drives

    (first, _), _, _ = write_drives(1, tmp_path, None)
    command = ["close-loop", GRAPH, "--data", str(first), "--out", str(tmp_path / "none"), "--resume"]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert "there are no finished fits in" in said and "start without it" in said
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [("--max-effects", "0", "must be at least 1"), ("--level", "1.5", "must lie between 0 and 1")],
)
def test_impossible_options_are_refused(option: str, value: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["close-loop", GRAPH, "--data", "run.csv", option, value])
    assert ended.value.code == 2 and said in capsys.readouterr().err
