"""The tests on every Python that the toolkit names, each in a clean environment with the installed wheel, as a table.

    python -m tests.matrix [--quick] [--python PATH ...] [--work FOLDER] [-- PYTEST OPTIONS]

Wheel and source distribution are built once. For every interpreter found an environment is made, the wheel installed
with its extra ``test``, and the tests of the source distribution run in a folder without the packages, so that nothing
but the wheel can be imported; then the tests of the house (linter, types, layout) run in the whole source distribution.
``--quick`` takes the rooms from declaration to estimation without the house: some minutes for each interpreter.

The exit status is 1 where a test or an installation fails. Interpreters that are not there are named with the ways to
get them; ``--all`` counts them as failures too.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("bondgraph", "vehicle_graphs")
#: Rooms on the way from a declaration to an estimate; what differs between interpreters (syntax trees, pickles, numba)
#: is in them.
QUICK = ("declare", "derive", "generate", "compile", "data", "filter", "estimate")
_ASK = "import sys; print('%d.%d %d.%d.%d' % (*sys.version_info[:2], *sys.version_info[:3]))"
#: Columns of the table where it is not shown in a terminal.
_WIDTH = 120


@dataclass(frozen=True)
class Row:
    """How one interpreter fared: counts of tests, seconds of installing and of testing, and what stopped it."""

    version: str
    path: Path
    passed: int = 0
    failed: int = 0
    skipped: int = 0
    installing: float = 0.0
    testing: float = 0.0
    problem: str = ""

    @property
    def good(self) -> bool:
        """Whether tests ran and all of them passed."""
        return not (self.problem or self.failed) and self.passed > 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Build, install and test, and print the table; returns the exit status."""
    options = _options(arguments)
    found = interpreters([*map(Path, options.python), *candidates()], options.only)
    missing = [version for version in options.only if version not in {key for key, _ in found.values()}]
    with tempfile.TemporaryDirectory() as scratch:
        work = (options.work or Path(scratch)).resolve()
        work.mkdir(parents=True, exist_ok=True)
        wheel, source = build(work / "dist")
        rows = []
        for path, (_, version) in sorted(found.items(), key=lambda item: tuple(map(int, item[1][1].split(".")))):
            print(f"Python {version}: {path}", flush=True)
            rows.append(tried(Row(version, path), wheel, source, work / version, options))
    Console(width=None if sys.stdout.isatty() else _WIDTH).print(table(rows))
    for version in missing:
        print(
            f"Python {version} is not on this machine: uv python install {version}, pyenv install {version} or "
            "https://www.python.org/downloads; found on PATH, in pyenv, by uv, or named with --python"
        )
    return int(not all(row.good for row in rows) or not rows or (options.all and bool(missing)))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=f"only the tests of {', '.join(QUICK)}")
    parser.add_argument("--python", action="append", default=[], metavar="PATH", help="one more interpreter to try")
    parser.add_argument(
        "--only", nargs="+", choices=versions(), default=versions(), metavar="VERSION", help="these, as 3.12 (all)"
    )
    parser.add_argument("--workers", default="auto", help="processes that run tests (default: auto)")
    parser.add_argument("--work", type=Path, help="folder that keeps distributions, environments and results")
    parser.add_argument("--all", action="store_true", help="an interpreter that is missing is a failure")
    parser.add_argument("pytest", nargs="*", help="options of pytest, after --")
    return parser.parse_args(arguments)


def versions() -> list[str]:
    """Versions of Python that the project names, the lowest first."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    prefix = "Programming Language :: Python :: 3."
    return [line.rpartition(" ")[2] for line in project["classifiers"] if line.startswith(prefix)]


def candidates() -> Iterator[Path]:
    """Places at which an interpreter of one of the versions may be."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for version in versions():
        yield from filter(None, [_path(f"python{version}"), _answer("uv", "python", "find", version)])
        yield from sorted(pyenv.glob(f"{version}.*/bin/python"), reverse=True)
        yield from sorted(pyenv.glob(f"{version}.*/python.exe"), reverse=True)
        if os.name == "nt":
            yield from filter(None, [_answer("py", f"-{version}", "-c", "import sys; print(sys.executable)")])
    yield Path(sys.executable)


def _path(name: str) -> Path | None:
    found = shutil.which(name)
    return Path(found) if found else None


def _answer(*command: str) -> Path | None:
    if not shutil.which(command[0]):
        return None
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    return Path(run.stdout.strip()) if run.returncode == 0 and run.stdout.strip() else None


def interpreters(places: Sequence[Path], wanted: Sequence[str]) -> dict[Path, tuple[str, str]]:
    """The first interpreter of each version wanted among some places, with that version and the full one.

    Examples
    --------
    >>> found = interpreters([Path("no/such/python"), Path(sys.executable), Path(sys.executable)], versions())
    >>> [path == Path(sys.executable) for path in found]
    [True]
    """
    found: dict[str, tuple[Path, str]] = {}
    for place in places:
        try:
            run = subprocess.run([place, "-c", _ASK], capture_output=True, text=True, check=False)
        except OSError:
            continue
        version, _, full = run.stdout.strip().partition(" ")
        if run.returncode == 0 and version in wanted and version not in found:
            found[version] = (place, full)
    return {path: (version, full) for version, (path, full) in found.items()}


def build(folder: Path) -> tuple[Path, Path]:
    """Wheel and source distribution of this tree; the wheel is built from the source distribution, as an index does."""
    shutil.rmtree(folder, ignore_errors=True)
    subprocess.run([sys.executable, "-m", "build", "--outdir", folder, ROOT], check=True, stdout=subprocess.DEVNULL)
    return next(folder.glob("*.whl")), next(folder.glob("*.tar.gz"))


def tried(row: Row, wheel: Path, source: Path, folder: Path, options: argparse.Namespace) -> Row:
    """One interpreter: its environment, and the tests in it."""
    shutil.rmtree(folder, ignore_errors=True)
    environment = folder / "environment"
    began = time.monotonic()
    try:
        _call(row.path, "-m", "venv", environment)
        python = environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        _call(python, "-m", "pip", "install", "--quiet", f"bondloop[test] @ {wheel.as_uri()}")
    except subprocess.CalledProcessError as error:
        said = (error.stderr.strip() or error.stdout.strip() or str(error)).splitlines()[-1]
        return replace(row, problem=f"not installed: {said}")
    row, began = replace(row, installing=time.monotonic() - began), time.monotonic()
    for name, tests in runs(unpacked(source, folder), options.quick):
        row = _tested(row, python, folder / name, tests, folder / f"{name}.xml", options)
    return replace(row, testing=time.monotonic() - began)


def _clean() -> dict[str, str]:
    """The environment without places at which another Python would look for modules, and pip for what is installed."""
    return {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME")}


def _call(*command: str | Path) -> None:
    subprocess.run(command, check=True, capture_output=True, text=True, env=_clean())


def unpacked(source: Path, folder: Path) -> Path:
    """The source distribution, whole in the folder ``source`` and without its packages in the folder ``tests``."""
    with tarfile.open(source) as packed:
        packed.extractall(folder, filter="data")
    (folder / source.name.removesuffix(".tar.gz")).rename(folder / "source")
    (folder / "tests").mkdir()
    for path in (folder / "source").iterdir():
        if path.is_dir() and path.name not in PACKAGES:
            shutil.copytree(path, folder / "tests" / path.name)
        elif path.is_file():
            shutil.copy(path, folder / "tests")
    return folder / "source"


def runs(source: Path, quick: bool) -> list[tuple[str, list[str]]]:
    """Folders in which tests run, and the tests that run there.

    Tests of the house look at the source, all others only at what is installed.
    """
    house = sorted(f"tests/{path.name}" for path in (source / "tests").glob("test_*.py"))
    if quick:
        return [("tests", [f"tests/{room}" for room in QUICK])]
    rooms = sorted(f"tests/{path.name}" for path in (source / "tests").iterdir() if path.is_dir())
    return [("tests", ["--pyargs", *PACKAGES, *rooms]), ("source", house)]


def _tested(row: Row, python: Path, folder: Path, tests: list[str], result: Path, options: argparse.Namespace) -> Row:
    command = [
        python.parent / "pytest", "-c", "pyproject.toml", "-q", "-n", options.workers, "-p", "no:cacheprovider",
        "--ignore-glob=*/documentation/scripts/*", f"--junitxml={result}", *options.pytest, *tests,
    ]  # fmt: skip
    log = result.with_suffix(".txt")
    with log.open("w", encoding="utf-8") as said:
        run = subprocess.run(command, cwd=folder, env=_clean(), stdout=said, stderr=subprocess.STDOUT, check=False)
    if not result.is_file() or run.returncode not in (0, 1):
        last = log.read_text(encoding="utf-8").strip().splitlines()[-1:]
        return replace(row, problem=f"tests ended with status {run.returncode}: {''.join(last)}")
    counts = ElementTree.parse(result).getroot().find("testsuite")
    assert counts is not None
    total, skipped, failed = (
        sum(int(counts.get(name, 0)) for name in names) for names in (("tests",), ("skipped",), ("failures", "errors"))
    )
    for line in log.read_text(encoding="utf-8").splitlines():
        if line.startswith(("FAILED", "ERROR")):
            print(f"  {line}", flush=True)
    return replace(
        row, passed=row.passed + total - skipped - failed, failed=row.failed + failed, skipped=row.skipped + skipped
    )


def table(rows: Sequence[Row]) -> Table:
    """One line per interpreter."""
    shown = Table("Python", "passed", "failed", "skipped", "installing s", "testing s", "result", "interpreter")
    for row in rows:
        counts = [f"{row.passed}", f"{row.failed}", f"{row.skipped}", f"{row.installing:.0f}", f"{row.testing:.0f}"]
        result = row.problem or ("good" if row.good else "failures" if row.failed else "no test ran")
        shown.add_row(row.version, *counts, result, str(row.path))
    return shown


if __name__ == "__main__":
    sys.exit(main())
