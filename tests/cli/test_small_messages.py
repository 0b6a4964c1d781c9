"""Small messages of commands: what was not written, not found, not begun or not told."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from bondgraph.cli import main
from bondgraph.data.log import Log, LogChannel
from bondgraph.report.inspection import inspect_log, inspection_text

_QUICK = ["--method", "gradient", "--starts", "1"]


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a machine that was begun with ``bondgraph new``."""
    place = tmp_path_factory.mktemp("small")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        assert main(["new", "skeleton_sled"]) == 0
    return place / "skeleton_sled"


@pytest.fixture
def machine(begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of that folder, as working folder."""
    shutil.copytree(begun, tmp_path / "skeleton_sled")
    monkeypatch.chdir(tmp_path / "skeleton_sled")
    return tmp_path / "skeleton_sled"


def test_generate_says_that_there_is_nothing_to_write(machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["generate", "skeleton_sled.py", "--folder", "models"]
    assert main(command) == 0 and "written: models/skeleton_sled.py" in capsys.readouterr().out
    assert main(command) == 0
    said = "1 generated module is what its graph gives\n"
    assert capsys.readouterr().out == f"nothing to write: {said}"
    assert main([*command, "--check"]) == 0
    assert capsys.readouterr().out == said


def test_a_report_of_a_file_is_told_what_to_name(machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "skeleton_sled.py"]) == 2
    said = capsys.readouterr().err
    assert "skeleton_sled.py: holds no report_data.npz - name the folder of a finished" in said and "Errno" not in said


def _counted(time: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Log:
    return Log("run", time, {"v": LogChannel("v", "m/s", np.sin(time))})


def test_whole_seconds_are_no_milliseconds_unless_they_jitter() -> None:
    rng = np.random.default_rng(0)
    for even in (np.arange(100.0), 60.0 * np.arange(100.0), np.delete(20.0 * np.arange(100.0), [3, 4, 50])):
        assert not any("milliseconds" in one for one in inspect_log(_counted(even)).suspicions)
    jitter = np.cumsum(20.0 + rng.integers(-1, 2, 100))
    assert any("are they milliseconds" in one for one in inspect_log(_counted(jitter)).suspicions)


def test_one_row_has_a_time_and_no_step() -> None:
    assert inspection_text(inspect_log(_counted(np.array([2.5])))).startswith("run: 1 row at 2.5 s\n")


def test_one_rate_alone_is_told_to_need_another(machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["sensitivity", "skeleton_sled.py", "--data", "run1.csv", "--free", "mass,drag"]
    assert main([*command, "--rates", "1"]) == 0
    assert "1 1/s alone says nothing of what is enough - name a higher rate" in capsys.readouterr().out
    assert main([*command, "--rates", "10,1"]) == 0
    assert "alone says nothing" not in capsys.readouterr().out


@pytest.mark.parametrize("command", ["filter", "compare", "close-loop"])
def test_a_refused_log_leaves_no_empty_folder(command: str, machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = Path("run1.csv").read_text(encoding="utf-8").splitlines()
    Path("short.csv").write_text("\n".join(rows[:4]), encoding="utf-8")
    assert main([command, "skeleton_sled.py", "--data", "short.csv", "--out", "deep/answer"]) == 2
    assert "give a longer log" in capsys.readouterr().err and not Path("deep").exists()
    Path("mine").mkdir()
    assert main([command, "skeleton_sled.py", "--data", "short.csv", "--out", "mine"]) == 2
    assert Path("mine").is_dir()  # it was there before


def test_a_resumed_estimate_says_where_there_is_nothing_to_go_on_from(
    machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        "estimate",
        "skeleton_sled.py",
        "--data",
        "run1.csv",
        "--free",
        "mass,drag",
        *_QUICK,
        "--out",
        "fit",
        "--resume",
    ]
    assert main(command) == 0
    assert "no search to go on from in fit: starting anew" in capsys.readouterr().err
    assert main(command) == 0
    assert "starting anew" not in capsys.readouterr().err
