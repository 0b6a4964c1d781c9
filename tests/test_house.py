"""House rules checked by other programs: linter, formatter, types, drift of generated modules, README against CI."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import bondgraph
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


def _readme_scripts() -> dict[str, str]:
    """The python blocks of each section, which go on from each other, as one script."""
    sections = re.split(r"^## ", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    scripts = {
        section.partition("\n")[0]: "\n".join(re.findall(r"```python\n(.*?)```", section, flags=re.DOTALL))
        for section in sections
    }
    return {title: script for title, script in scripts.items() if script}


def _run_script(script: str, folder: Path) -> str:
    places = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", script], cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": places},
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


def test_the_first_code_of_the_readme_is_the_front_door() -> None:
    first = next(iter(_readme_scripts().values()))
    assert first.startswith("import bondgraph as bg\n")
    assert "from bondgraph" not in first


@pytest.mark.slow
def test_the_example_of_the_readme_finds_the_wind(tmp_path: Path) -> None:
    script = _readme_scripts()["How a machine is declared"]
    said = _run_script(script, tmp_path)
    assert "effect found: The declared model lacks quadratic_loss at body" in said
    assert re.search(r"c_quadratic_loss_body = 1\.(4|5)\d N/\(m/s\)\^2", said)
    assert re.search(r"^mass +kg +\d+", said, flags=re.MULTILINE)
    assert {path.name for path in (tmp_path / "loop").iterdir()} >= {"report.html", "result.json", "sled.py"}


def test_the_other_python_blocks_of_the_readme_run(tmp_path: Path) -> None:
    scripts = _readme_scripts()
    declared, *rest = scripts.pop("How a machine is declared").partition("\nmodel = bg.build(")
    assert scripts and rest
    for script in (declared, *scripts.values()):
        _run_script(script, tmp_path)


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


def test_the_citation_and_the_change_log_name_the_version() -> None:
    citation = (ROOT / ".github" / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(rf"^version: {re.escape(bondgraph.__version__)}$", citation, flags=re.MULTILINE)
    changes = (ROOT / ".github" / "CHANGELOG.md").read_text(encoding="utf-8")
    released, said = re.findall(r"^## ([\d.]+\d)(.*)$", changes, re.MULTILINE)[0]
    version, development, _ = bondgraph.__version__.partition(".dev")
    assert (version, bool(development)) == (released, said == ", unreleased")
