"""Graphs of Python files: found by name or alone, run once beside their siblings, failures told with their line."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from bondgraph.declare.files import load_graph
from bondgraph.errors import BondGraphError, DeclarationError

HEAD = """from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph

def mass(name):
    g = BondGraph(name)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=g.one_junction("body", TRANSLATION))
    return g
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _write(folder: Path, name: str, body: str) -> str:
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_text(HEAD + body, encoding="utf-8")
    return name


@pytest.mark.parametrize(
    ("body", "reference", "name"),
    [
        ("g = mass('sled')", "sled.py", "sled"),
        ("g = mass('sled')", "sled.py:g", "sled"),
        ("def sled() -> BondGraph:\n    return mass('sled')", "sled.py", "sled"),
        ("def sled() -> 'BondGraph':\n    return mass('sled')\ng = sled()", "sled.py", "sled"),
        ("def sled():\n    return mass('sled')", "sled.py:sled", "sled"),
        ("a, b = mass('a'), mass('b')", "sled.py:b", "b"),
    ],
)
def test_a_file_gives_its_graph(folder: Path, body: str, reference: str, name: str) -> None:
    _write(folder, "sled.py", body)
    graph = load_graph(reference)
    assert graph.name == name and graph.source == "sled.py" and set(graph.nodes) == {"body", "mass"}


def test_a_folder_and_an_absolute_path_are_named_without_the_machine(folder: Path) -> None:
    _write(folder, "machines/sled.py", "g = mass('sled')")
    assert load_graph("machines/sled.py").source == "machines/sled.py"
    assert load_graph(str(folder / "machines" / "sled.py")).source == "sled.py"


@pytest.mark.parametrize(
    ("body", "reference", "text"),
    [
        ("a, b = mass('a'), mass('b')", "two.py", "two.py: declares 2 graphs - name one of them: two.py:a, two.py:b"),
        ("a, b = mass('a'), mass('b')", "two.py:c", "two.py:c: two.py has no function or graph 'c'"),
        ("def f(): return mass('a')", "none.py", "none.py: declares no BondGraph at its top level, nor a function"),
        ("def f(n): return mass(n)", "arg.py:f", "arg.py:f: the function needs arguments"),
        ("def f(): return 3", "int.py:f", "int.py:f: gives a int, not a BondGraph"),
        ("x = 1 / 0", "zero.py", "zero.py:8: ZeroDivisionError: division by zero"),
        ("def f():\n    return mass(1, 2)", "args.py:f", "args.py:9: TypeError: mass() takes 1 positional argument"),
        ("g = mass('x')\ng.parameter('k', 1.0, 'kgg')", "unit.py", "unit.py:9: x: k: unit 'kgg' is not known"),
        ("def (", "syntax.py", "syntax.py:8: invalid syntax"),
        ("import sys; sys.exit(3)", "exit.py", "exit.py:8: the file ends the program (exit 3)"),
        ("import nowhere_at_all", "import.py", "import.py:8: ModuleNotFoundError: No module named 'nowhere_at_all'"),
        ("def rhs(t, x, u, theta): ...", "model.py", "model.py: is a generated module and declares no graph"),
    ],
)
def test_what_gives_no_graph_is_told_with_its_line(folder: Path, body: str, reference: str, text: str) -> None:
    _write(folder, reference.partition(":")[0], body)
    with pytest.raises(BondGraphError) as caught:
        load_graph(reference)
    assert caught.value.message.startswith(text)


def test_a_name_that_is_not_defined_is_told_with_the_one_that_is_close(folder: Path) -> None:
    _write(folder, "sled.py", "def sled(torque=1.0) -> BondGraph:\n    return mass(torqe)")
    with pytest.raises(
        DeclarationError, match=r"sled\.py:9: NameError: .*'torqe' is not defined; did you mean 'torque'"
    ):
        load_graph("sled.py")


def test_a_file_that_is_missing_is_told_so(folder: Path) -> None:
    with pytest.raises(DeclarationError, match=r"^sled\.py: no such file$"):
        load_graph("sled.py:g")


def test_siblings_are_imported_and_those_of_another_folder_are_others(folder: Path) -> None:
    path = list(sys.path)
    for name in ("one", "two"):
        _write(folder, f"{name}/parts.py", f"NAME = {name!r}")
        _write(folder, f"{name}/machine.py", "import parts\ng = mass(parts.NAME)")
    assert [load_graph(f"{name}/machine.py").name for name in ("one", "two")] == ["one", "two"]
    assert sys.path == path and "parts" not in sys.modules
    assert not list(folder.rglob("__pycache__"))


def test_a_sibling_may_be_imported_when_the_function_is_called(folder: Path) -> None:
    _write(folder, "late/parts.py", "NAME = 'late'")
    _write(folder, "late/machine.py", "def f() -> BondGraph:\n    import parts\n    return mass(parts.NAME)")
    assert load_graph("late/machine.py").name == "late"


def test_a_changed_file_is_run_again_and_an_unchanged_one_is_not(folder: Path) -> None:
    reference = _write(folder, "sled.py", "with open('ran', 'a') as f: f.write('x')\ng = mass('sled')")
    load_graph(reference), load_graph(reference)
    assert (folder / "ran").read_text() == "x"
    _write(folder, "sled.py", "g = mass('other')")
    assert load_graph(reference).name == "other"
