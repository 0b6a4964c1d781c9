"""Damaged, oversized and strange logs: each is refused in words; spoiled bytes never end in anything else."""

from __future__ import annotations

import gzip
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from bondgraph.data import apart
from bondgraph.data.formats import table
from bondgraph.data.read import read_log
from bondgraph.errors import DataError
from tests.data import fuzzed_logs
from tests.limited import Findings, mutants, survey


def _refused(path: Path, content: bytes, message: str) -> None:
    path.write_bytes(content)
    with pytest.raises(DataError, match=message) as refused:
        read_log(path)
    assert refused.value.message.startswith(path.name) and len(refused.value.message) < 600


@pytest.mark.parametrize("kind", fuzzed_logs.FORMATS)
@pytest.mark.parametrize("damage", ["cut short", "emptied", "garbage", "cut at the end"])
def test_a_damaged_file_is_refused(kind: str, damage: str, tmp_path: Path) -> None:
    raw = fuzzed_logs.content(kind)
    changed = {
        "cut short": raw[: len(raw) // 2], "emptied": b"", "garbage": np.random.default_rng(0).bytes(len(raw)),
        "cut at the end": raw[:-4],
    }[damage]  # fmt: skip
    if kind == ".csv" and "cut" in damage:
        changed += b",,,,"
    if kind == ".mf4" and damage == "cut at the end":
        return  # its last bytes are no part of the signals
    _refused(tmp_path / f"run{kind}", changed, "not a readable|is empty|has . cells|no unit")


@pytest.mark.parametrize("place", [12, 40, -6])
def test_garbled_gz_is_refused(place: int, tmp_path: Path) -> None:
    raw = bytearray(fuzzed_logs.content(".csv.gz"))
    raw[place] ^= 0xFF
    _refused(tmp_path / "run.csv.gz", bytes(raw), "this is not a readable CSV file")


def test_a_file_is_weighed_before_it_is_read(tmp_path: Path) -> None:
    for kind in fuzzed_logs.FORMATS:
        path = tmp_path / f"sparse{kind}"
        with path.open("wb") as file:
            file.truncate(2 << 30)
        with pytest.raises(DataError, match=r"holds 2.1 GB, at most 1.1 GB are read - cut the log into parts"):
            read_log(path)


def test_a_small_file_that_unpacks_to_a_large_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "LARGEST", 1 << 20)
    _refused(tmp_path / "bomb.csv.gz", fuzzed_logs.gzip_bomb(4 << 20), "bomb.csv.gz: holds 0.0 GB, at most")


@pytest.mark.parametrize(
    ("does", "problem"), [("os._exit(11)", "ended with status 11"), ("time.sleep(60)", "more than 3 s")]
)
def test_a_library_that_breaks_or_hangs_at_a_file(
    does: str, problem: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "asammdf.py").write_text(f"import os, time\nMDF = lambda *_: {does}\n", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    if "sleep" in does:
        monkeypatch.setattr(apart, "_LONGEST", 3.0)
    _refused(tmp_path / "run.mf4", b"MDF", problem)


def test_modules_in_the_working_folder_are_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("numpy", "scipy", "asammdf", "json"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\nraise SystemExit(0)\n")
    monkeypatch.chdir(tmp_path)
    assert len(read_log(_mat(tmp_path / "run.mat"))) == 3
    assert not (tmp_path / "ran").exists()


def _mat(path: Path, **changed: Any) -> Path:
    content = {"time": np.arange(3.0), "v": np.arange(3.0), "units": {"time": "s", "v": "m/s"}} | changed
    scipy.io.savemat(path, content)
    return path


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"v": 3.0}, "variable 'v' has 1 values for 3 times"),
        ({"v": "abc"}, "variable 'v' is no vector"),
        ({"v": np.zeros((3, 2))}, "variable 'v' is no vector"),
        ({"time": np.zeros((3, 2))}, "variable 'time' is no vector"),
        ({"v": {"a": 1.0}}, "variable 'v' is no vector"),
        ({"v": np.arange(3) * 1j}, "is not a number"),
        ({"units": "m/s"}, "variable 'units' is missing"),
        ({"units": {"time": "s", "v": 3.0}}, "unit '3.0'"),
        ({"comment": "a fine day"}, "struct 'units' has no field 'comment'"),
    ],
    ids=str,
)
def test_variables_that_are_no_signals(changed: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=message):
        read_log(_mat(tmp_path / "run.mat", **changed))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time [s],v [9**9**9**9]\n0,1\n", "column 'v' has unit"),
        ("time [s],v [degC**2/dB]\n0,1\n", "column 'v' has unit"),
        ("time [s],v [text]\n0," + "x" * 500 + "\n", "column 'v' has a cell of 500 letters .row 2."),
        ("time [s],v [m/s]\n0," + "9" * 400 + "\n", "column 'v' has a cell of 400 letters"),
        ("time [s],v [m/s]\n0,1e999\n", "column 'v' is infinite in row 2"),
        ("time [s],v [m/s]\n0,\x00\n", "holds zero bytes"),
    ],
    ids=range(6),
)
def test_cells_and_units_that_cannot_be(text: str, message: str, tmp_path: Path) -> None:
    _refused(tmp_path / "run.csv", text.encode(), message)


def test_a_packed_log_is_still_read(tmp_path: Path) -> None:
    path = tmp_path / "RUN.CSV.GZ"
    path.write_bytes(gzip.compress(b"time [s],v [m/s]\n0,1\n"))
    assert read_log(path).name == "RUN"


#: Seeds that the suite repeats; the command goes on from there.
MOST = 1_000


def _search(kind: str, seconds: float, first: int = 0, most: int | None = None) -> Findings:
    made = mutants(lambda draw: fuzzed_logs.spoiled(kind, draw), kind, seconds, first, most)
    return survey("tests.data.fuzzed_logs:read", made)


@pytest.mark.slow
@pytest.mark.parametrize("kind", fuzzed_logs.FORMATS)
def test_nothing_but_logs_and_messages(kind: str) -> None:
    found = _search(kind, 60.0 if kind in (".mat", ".v73.mat", ".mf4") else 20.0, most=MOST)
    print(found)
    assert found.counts["refused"]
    assert not found.bad, "\n\n".join(problem for _, problem in found.bad[:3])


if __name__ == "__main__":
    result = _search(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]))
    print(result, *(problem for _, problem in result.bad), sep="\n\n")
