"""``--executor``: what commands write does not depend on who computed it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import bondgraph as bg
from bondgraph.cli import main


@pytest.fixture
def sled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a new machine with two logs."""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "sled"]) == 0
    monkeypatch.chdir(tmp_path / "sled")
    return tmp_path / "sled"


def _written(folder: str) -> dict[str, object]:
    content = json.loads(Path(folder, "result.json").read_text(encoding="utf-8"))
    return {name: value for name, value in content.items() if name != "seconds"}


def test_sensitivities_by_threads_are_those_of_one(sled: Path) -> None:
    pytest.importorskip("SALib")
    asked = [
        "sensitivity",
        "sled.py",
        "--data",
        "run1.csv",
        "--free",
        "mass,drag",
        "--global",
        "morris",
        "--samples",
        "8",
    ]
    assert main([*asked, "--out", "here"]) == 0
    assert main([*asked, "--out", "there", "--executor", "threads:3"]) == 0
    assert _written("here") == _written("there")


@pytest.mark.slow
def test_estimates_profiles_and_loops_by_processes_are_those_of_one(sled: Path) -> None:
    asked = ["estimate", "sled.py", "--data", "run1.csv", "--profile"]
    assert main([*asked, "--out", "here"]) == 0
    assert main([*asked, "--out", "there", "--executor", "processes:2"]) == 0
    assert _written("here") == _written("there")
    asked = ["close-loop", "sled.py", "--data", "run1.csv", "--holdout", "run2.csv"]
    assert main([*asked, "--out", "loop"]) == 0
    assert main([*asked, "--out", "spread", "--executor", "processes:2"]) == 0
    assert _written("loop") == _written("spread")
    assert Path("loop/fits.json").read_bytes() == Path("spread/fits.json").read_bytes()
    verb = bg.close_loop("sled.py", "run1.csv", "run2.csv", executor="threads:2")
    known = json.loads(Path("loop/result.json").read_text(encoding="utf-8"))
    assert verb.verdict == known["verdict"] and verb.nominal_train.nll == known["nominal"]["train"]["nll"]
