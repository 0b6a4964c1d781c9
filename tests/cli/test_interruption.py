"""Ctrl-C and SIGTERM at every stage: no traceback, the status of the signal, what there is stays, and how to go on."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bondgraph.cli import main
from bondgraph.report.progress import WorkProgress
from tests.cli.test_places import _log

SIGNALS = [(signal.SIGINT, 130), (signal.SIGTERM, 143)]

_STOPPING = """
import os
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.graph import BondGraph

def graph():
    os.kill(os.getpid(), {number})

def drag(graph: BondGraph, place: Place) -> Effect | None:
    os.kill(os.getpid(), {number})
"""


@pytest.fixture(autouse=True)
def _interruptible() -> Iterator[None]:
    """Ctrl-C as a terminal gives it: a process that was started in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(params=SIGNALS, ids=["Ctrl-C", "SIGTERM"])
def stopping(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, int]:
    """A module that stops the process by a signal while it is used, and the exit status."""
    number, status = request.param
    name = f"stops_by_{int(number)}"
    (tmp_path / f"{name}.py").write_text(_STOPPING.format(number=int(number)), encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, name, raising=False)
    return name, status


@pytest.mark.parametrize("command", ["equations", "estimate", "close-loop"])
def test_while_a_graph_is_read(
    command: str, stopping: tuple[str, int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    module, status = stopping
    data = [] if command == "equations" else ["--data", "run.csv", "--out", str(tmp_path / "out")]
    handlers = [signal.getsignal(one) for one, _ in SIGNALS]
    assert main([command, f"{module}:graph", *data]) == status
    said = capsys.readouterr().err
    assert said.startswith(f"bondgraph {command}: interrupted") and "Traceback" not in said
    assert ("go on with --resume" in said) == (command != "equations")
    assert [signal.getsignal(one) for one, _ in SIGNALS] == handlers


def test_inside_a_closed_loop(
    stopping: tuple[str, int], motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    module, status = stopping
    out = tmp_path / "loop"
    given = ["close-loop", str(motor_file), "--data", _log(tmp_path / "run.csv", 300), "--out", str(out)]
    assert main([*given, "--effects", module]) == status
    assert f"what is finished stands in {out} - go on with --resume" in capsys.readouterr().err
    finished = json.loads((out / "fits.json").read_text(encoding="utf-8"))
    assert main([*given, "--effects", module, "--resume"]) == status
    assert json.loads((out / "fits.json").read_text(encoding="utf-8")) == finished


@pytest.mark.parametrize(("number", "status"), SIGNALS, ids=["Ctrl-C", "SIGTERM"])
def test_inside_a_search(
    number: signal.Signals, status: int, motor_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    def stop(*_: object) -> None:
        os.kill(os.getpid(), number)

    out = tmp_path / "fit"
    given = ["estimate", str(motor_file), "--data", _log(tmp_path / "run.csv"), "--free", "b", "--out", str(out)]
    with monkeypatch.context() as patched:
        patched.setattr(WorkProgress, "trace", stop)
        assert main([*given, "--process-noise", "none"]) == status
    assert "go on with --resume" in capsys.readouterr().err
    assert {"checkpoint.npz", "report.html", "result.json"} <= {path.name for path in out.iterdir()}
    assert main([*given, "--process-noise", "none", "--resume"]) == 0
