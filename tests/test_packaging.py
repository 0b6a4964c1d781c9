"""What is shipped: contents of wheel and source distribution, work outside a checkout, an overwritten front door."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

import bondgraph
import vehicle_graphs

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("bondgraph", "vehicle_graphs")


def _run(site: Path, folder: Path, *arguments: str, status: int = 0) -> subprocess.CompletedProcess[str]:
    """Python in a folder with the packages of ``site`` before all others."""
    run = subprocess.run(
        [sys.executable, *arguments], cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(site)},
    )  # fmt: skip
    assert run.returncode == status, run.stdout + run.stderr
    return run


def _built(builder: str, folder: Path) -> Path:
    """The wheel or source distribution of this tree, as an index would get it."""
    builders = pytest.importorskip("hatchling.builders", reason="needs hatchling, of the extra test")
    assert builders
    if not (ROOT / "pyproject.toml").is_file():
        pytest.skip("needs the source of the toolkit")
    code = (
        "import sys\n"
        f"from hatchling.builders.{builder} import {builder.capitalize()}Builder as Builder\n"
        "print(*Builder(sys.argv[1]).build(directory=sys.argv[2], versions=['standard']))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(ROOT), str(folder)], capture_output=True, text=True, check=True
    )
    return Path(run.stdout.split()[-1])


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _built("wheel", tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def site(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds what the wheel installs."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(folder)
    return folder


def _files(package: str) -> set[str]:
    return {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_the_wheel_holds_the_two_packages_with_all_their_files_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as packed:
        names = {name for name in packed.namelist() if not name.partition("/")[0].endswith(".dist-info")}
    assert names == {name for package in PACKAGES for name in _files(package)}


def test_the_source_distribution_holds_what_its_tests_need(tmp_path: Path) -> None:
    with tarfile.open(_built("sdist", tmp_path)) as packed:
        names = {member.name.partition("/")[2]: member for member in packed.getmembers() if member.isfile()}
    for folder in (*PACKAGES, "generated", "tests", ".ci", ".github"):
        assert _files(folder) <= set(names)
    beside = {name for name in names if "/" not in name}
    assert beside == {"pyproject.toml", "README.md", "LICENSE", "PKG-INFO", ".gitignore"}
    assert names[".ci/run"].mode & 0o100


@pytest.mark.slow
def test_an_installed_toolkit_begins_generates_and_builds_outside_a_checkout(site: Path, tmp_path: Path) -> None:
    _run(site, tmp_path, "-m", "bondgraph", "new", "sled")
    _run(site, tmp_path, "-m", "bondgraph", "generate", "sled/sled.py")
    assert "written" in _run(site, tmp_path, "-m", "bondgraph", "generate").stdout
    names = {path.name for path in (ROOT / "generated").glob("*.py")} - {"__init__.py"}
    assert len(names) == len(vehicle_graphs.GENERATED)
    assert {path.name for path in (tmp_path / "generated").iterdir()} == {*names, "sled.py"}
    for name in names:
        assert (tmp_path / "generated" / name).read_bytes() == (ROOT / "generated" / name).read_bytes()
    code = (
        "import sys, bondgraph as bg\n"
        "model = bg.build('sled/sled.py')\n"
        "assert bg.load('generated/sled.py').names('state') == model.model.names('state')\n"
        "log = bg.read_log(sys.argv[1])\n"
        "print(bg.__file__, (bg.filter_log(model, log).log_likelihood > -1e9).all())"
    )
    log = next(str(path) for path in sorted((tmp_path / "sled").glob("*.csv")))
    found, finite = _run(site, tmp_path, "-c", code, log).stdout.split()
    assert Path(found) == site / "bondgraph" / "__init__.py" and finite == "True"


@pytest.fixture
def foreign(tmp_path: Path) -> Iterator[Path]:
    """A folder in which another distribution has been installed over this one."""
    shutil.copytree(
        Path(bondgraph.__file__).parent, tmp_path / "bondgraph", ignore=shutil.ignore_patterns("__pycache__")
    )
    (tmp_path / "bondgraph" / "__init__.py").write_text("")
    (tmp_path / "bondgraph" / "core.py").write_text("")
    metadata = tmp_path / "bonds-0.2.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: bonds\nVersion: 0.2.0\n")
    (metadata / "RECORD").write_text("bondgraph/__init__.py,,\nbondgraph/core.py,,\n")
    yield tmp_path
    shutil.rmtree(tmp_path / "bondgraph")


_ADVICE = (
    "the distribution bonds has an import package of the same name and was installed over it - python -m pip uninstall "
    "bonds, then python -m pip install --force-reinstall --no-deps bondloop; where both are needed, each in a virtual "
    "environment of its own"
)


def test_a_command_says_that_another_distribution_was_installed_over_this_one(foreign: Path) -> None:
    for arguments in (("--help",), ("new", "sled"), ("demo",)):
        said = _run(foreign, foreign, "-m", "bondgraph", *arguments, status=2)
        file = foreign / "bondgraph" / "__init__.py"
        assert said.stderr == f"bondgraph: {file} is not the one of bondloop: {_ADVICE}\n"
        assert said.stdout == ""
    assert not (foreign / "sled.py").exists()


@pytest.mark.parametrize("room", ["declare", "estimate", "report"])
def test_a_room_says_that_another_distribution_was_installed_over_this_one(foreign: Path, room: str) -> None:
    said = _run(foreign, foreign, "-c", f"import bondgraph.{room}", status=1)
    assert said.stderr.splitlines()[-1].startswith("ImportError: ") and _ADVICE in said.stderr


def test_a_front_door_that_another_distribution_took_away_is_told(foreign: Path) -> None:
    (foreign / "bondgraph" / "__init__.py").unlink()
    shutil.rmtree(foreign / "bonds-0.2.0.dist-info")
    said = _run(foreign, foreign, "-S", "-m", "bondgraph", "--help", status=2)  # -S: no checkout on the path
    assert "lacks its __init__.py: another distribution was installed over it, or was removed again" in said.stderr
    assert said.stderr.endswith("each in a virtual environment of its own\n") and len(said.stderr.splitlines()) == 1
