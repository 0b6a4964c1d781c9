"""The cache of compiled code: a damaged or full one is compiled anew, one that others may write is refused."""

from __future__ import annotations

import hashlib
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bondgraph.compile import cache
from bondgraph.errors import OptionError
from tests.forked import run_forked

ROOT = Path(__file__).resolve().parents[2]

_TWICE = '''
import sys
import numpy as np
from numba import njit
from bondgraph.compile.lanes.object_code import load_functions
from bondgraph.compile.machine_code import HEADER, load_compiled
made = load_compiled(HEADER.format(title="doubles") + """
@_jit
def twice(x):
    return 2.0 * x
""")
printed = load_functions("""
def half(w, n):
    for l in range(n):
        w[8 + l] = 0.5*w[0 + l]
""", {"half": "void(float64[::1], int64)"})
w = np.full(16, 4.0)
njit(lambda f, w: f(w, 8))(printed["half"], w)
print(made.twice(4.0), w[8])
print(*(sum(counted.values()) for counted in (made.twice.stats.cache_hits, made.twice.stats.cache_misses)))
'''


def _run(folder: Path, before: str = "", path: str = "") -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, cache.CACHE_VARIABLE: str(folder), "PYTHONPATH": path, "TMPDIR": str(folder.parent)}
    if not path:
        return run_forked(before + _TWICE, cwd=ROOT, environment=environment)
    return subprocess.run(
        [sys.executable, "-c", before + _TWICE], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )


def _answer(run: subprocess.CompletedProcess[str]) -> list[str]:
    assert run.returncode == 0, run.stderr
    return run.stdout.split("\n")[:2]


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache folder as a first run leaves it; to be copied, not to be changed."""
    folder = tmp_path_factory.mktemp("filled") / "cache"
    assert _answer(_run(folder)) == ["8.0 2.0", "0 1"]
    return folder


@pytest.fixture
def folder(filled: Path, tmp_path: Path) -> Path:
    """A filled cache folder of one's own; copies keep the times of files, by which numba trusts its code."""
    return shutil.copytree(filled, tmp_path / "cache")


def test_a_copied_folder_serves(folder: Path) -> None:
    assert _answer(_run(folder)) == ["8.0 2.0", "1 0"]


@pytest.mark.parametrize("ending", ["nbi", "nbc", "o"])
@pytest.mark.parametrize("damage", ["cut short", "emptied", "garbage", "one bit"])
def test_damaged_machine_code_is_compiled_anew(ending: str, damage: str, folder: Path) -> None:
    files = sorted((folder / "__pycache__").glob(f"*.{ending}"))
    assert len(files) == 1
    for file in files:
        content = file.read_bytes()
        flipped = bytes([content[len(content) // 2] ^ 4])
        file.write_bytes({
            "cut short": content[: len(content) // 2], "emptied": b"", "garbage": os.urandom(len(content)),
            "one bit": content[: len(content) // 2] + flipped + content[len(content) // 2 + 1 :],
        }[damage])  # fmt: skip
    run = _run(folder)
    assert _answer(run) == ["8.0 2.0", "1 0" if ending == "o" else "0 1"]
    assert run.stderr == ""
    assert _answer(_run(folder)) == ["8.0 2.0", "1 0"]


def test_planted_pickles_without_a_seal_are_not_unpickled(folder: Path, tmp_path: Path) -> None:
    planted = tmp_path / "ran"
    for file in (folder / "__pycache__").iterdir():
        file.write_bytes(pickle.dumps("0") + pickle.dumps(_Runs(planted)))
    assert _answer(_run(folder)) == ["8.0 2.0", "0 1"]
    assert not planted.exists()


@pytest.mark.parametrize("lacking", [b"cbondgraph.arrays\nNoSuchType\n.", b"cbondgraph.no_such_module\nAny\n."])
def test_machine_code_of_another_version_is_compiled_anew(lacking: bytes, folder: Path) -> None:
    """AttributeError: Can't get attribute 'Robustness' on <module 'bondgraph.filter.kernel_types'>."""
    for file in (folder / "__pycache__").glob("*.nbi"):
        with file.open("rb") as opened:
            version = pickle.load(opened)
        content = pickle.dumps(version) + lacking
        file.write_bytes(content + hashlib.sha256(content).digest())
    run = _run(folder)
    assert _answer(run) == ["8.0 2.0", "0 1"] and run.stderr == ""


class _Runs:
    """Makes a file where it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, (str(self.path),)


def test_a_full_disk_leaves_code_compiled_and_not_kept(folder: Path) -> None:
    for file in (folder / "__pycache__").iterdir():
        file.unlink()
    limited = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (1500, 1500))\n"
    run = _run(folder, limited)
    assert _answer(run) == ["8.0 2.0", "0 1"]
    assert run.stderr.count("cannot be kept there") == 1
    assert "Traceback" not in run.stderr


def test_without_room_for_a_source_code_is_compiled_from_memory(tmp_path: Path) -> None:
    limited = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n"
    run = _run(tmp_path / "cache", limited)
    assert _answer(run) == ["8.0 2.0", "0 1"]


@pytest.mark.skipif(os.name != "posix", reason="other systems have no such modes")
@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o720])
@pytest.mark.parametrize("part", ["", "__pycache__"])
def test_a_folder_that_others_may_write_is_refused(
    mode: int, part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "cache"
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(folder))
    cache.cache_folder()
    (folder / part).chmod(mode)
    with pytest.raises(OptionError, match="can be written by other users") as refused:
        cache.cache_folder()
    assert refused.value.where[0] == str(folder / part)
    (folder / part).chmod(0o755)
    assert cache.cache_folder() == folder


@pytest.mark.skipif(os.name != "posix", reason="other systems have no such owners")
def test_a_folder_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.raises(OptionError, match="cache: this folder of compiled models belongs to another user"):
        cache.cache_folder()


def test_a_broken_numba_is_said_once_and_numpy_serves(tmp_path: Path) -> None:
    (tmp_path / "numba").mkdir()
    (tmp_path / "numba" / "__init__.py").write_text("raise ImportError('Numba needs NumPy 1.26 or less')\n")
    run = subprocess.run(
        [sys.executable, "-c", _PENDULUM], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (run.returncode, run.stdout) == (0, "numpy numpy\n"), run.stderr
    assert run.stderr.count("numba cannot be loaded (ImportError: Numba needs NumPy 1.26 or less)") == 1


_PENDULUM = """
from bondgraph.simulate.example import pendulum
print(pendulum().compiled.backend, pendulum().compiled.backend)
"""
