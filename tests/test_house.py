"""House rules checked by other programs: linter, formatter, types, drift of generated modules, README against CI."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import vehicle_graphs
from bondgraph.generate.drift import check, explain, render_all

ROOT = Path(__file__).resolve().parents[1]


def _run(*arguments: str, **environment: str) -> str:
    run = subprocess.run(
        arguments, cwd=ROOT, capture_output=True, text=True, env={**os.environ, **environment}, check=False
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


@pytest.mark.parametrize("arguments", [("check",), ("format", "--check")], ids=" ".join)
def test_ruff_is_content(arguments: tuple[str, ...]) -> None:
    _run(sys.executable, "-m", "ruff", *arguments, ".")


def test_mypy_is_content() -> None:
    _run(sys.executable, "-m", "mypy")


def test_generated_modules_are_what_their_graphs_give() -> None:
    modules = render_all(vehicle_graphs.GENERATED)
    assert modules
    message = explain(check(ROOT / "generated", modules), "bondgraph generate")
    assert not message, message


def _readme_commands() -> list[str]:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL)
    return [line for block in blocks for line in block.splitlines() if line.startswith("python3 -m venv ")]


def test_readme_has_one_command_to_see_it_work_and_one_to_test_it() -> None:
    demo, tests = _readme_commands()
    for command in (demo, tests):
        make, install, run = command.split(" && ")
        assert make == "python3 -m venv .venv"
        assert install.startswith(".venv/bin/python -m pip install ")
        assert run.startswith(".venv/bin/")
    assert demo.endswith("bondgraph demo") and " -m pytest" in tests


@pytest.mark.skipif(os.name == "nt", reason="a shell script")
def test_ci_runs_the_command_of_the_readme() -> None:
    tests = _readme_commands()[1]
    assert _run("bash", ".ci/run", "--print", CI="").splitlines() == [tests]
    slow = ".venv/bin/python -m pytest -n auto -m slow"
    assert _run("bash", ".ci/run", "--print", CI="true").splitlines() == [tests, slow]
    assert os.access(ROOT / ".ci" / "run", os.X_OK)


def test_the_python_blocks_of_the_readme_run() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert blocks
    for block in blocks:
        _run(sys.executable, "-W", "error", "-c", block)


def test_nothing_is_left_unfinished() -> None:
    marks = re.compile(r"\b(TODO|FIXME|XXX|HACK)\b|raise NotImplementedError")
    found = [
        f"{path.relative_to(ROOT)}:{number}"
        for folder in ("bondgraph", "vehicle_graphs", "generated", "tests", ".ci")
        for path in sorted((ROOT / folder).rglob("*"))
        if path.is_file() and path.suffix in (".py", ".md", "") and path != Path(__file__)
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if marks.search(line)
    ]
    assert found == []
