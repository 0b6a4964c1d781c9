"""Generated modules on disk: what is missing, changed or left over is found, shown and repaired."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bondgraph.errors import DimensionError, GenerationError
from bondgraph.generate.drift import check, explain, render_all, write
from bondgraph.generate.pipeline import render_graph
from bondgraph.simulate.model import Model

HEADER = "# Generated from a.py -- do not edit.\n"
MODULES = {"car": HEADER + "mass = 1\nlength = 2\n", "truck": HEADER + "mass = 2\n"}


def _graph_file(folder: Path, name: str, unit: str = "N s/m") -> str:
    graph = {
        "directed": True,
        "multigraph": True,
        "graph": {
            "format": "bondgraph/1",
            "name": name,
            "parameters": [
                {"name": "m", "value": 2.0, "unit": "kg", "bounds": [1.0, 3.0]},
                {"name": "b", "value": 0.5, "unit": unit},
            ],
            "outputs": [{"name": "speed", "variable": "flow", "at": "body"}],
        },
        "nodes": [
            {"id": "body", "kind": "1", "domain": "translation"},
            {"id": "mass", "kind": "I", "flow": "momentum/m"},
            {"id": "drag", "kind": "R", "effort": "b*flow"},
        ],
        "bonds": [{"source": "body", "target": "mass"}, {"source": "body", "target": "drag"}],
    }
    path = folder / f"{name}.json"
    path.write_text(json.dumps(graph), encoding="utf-8")
    return str(path)


def test_what_was_written_does_not_differ(tmp_path: Path) -> None:
    assert write(tmp_path / "new", MODULES) == (tmp_path / "new" / "car.py", tmp_path / "new" / "truck.py")
    (tmp_path / "new" / "__init__.py").write_text('"""Generated."""\n')
    assert check(tmp_path / "new", MODULES) == ()
    assert write(tmp_path / "new", MODULES, complete=True) == ()


def test_a_missing_an_edited_and_a_left_over_module_are_found_and_shown(tmp_path: Path) -> None:
    write(tmp_path, {"car": MODULES["car"].replace("length = 2", "length = 3"), "tram": HEADER})
    found = check(tmp_path, MODULES)
    assert [(d.file, d.kind) for d in found] == [
        ("car.py", "changed"),
        ("tram.py", "superfluous"),
        ("truck.py", "missing"),
    ]
    assert "-length = 3\n+length = 2\n" in found[0].diff and found[0].diff.startswith("--- car.py\n+++ car.py (from")
    message = explain(found, "bondgraph generate")
    assert "car.py (changed), tram.py (superfluous), truck.py (missing)" in message
    assert message.endswith("accept the change with: bondgraph generate") and found[2].diff in message
    assert explain((), "bondgraph generate") == ""


def test_one_module_can_be_compared_and_written_by_itself(tmp_path: Path) -> None:
    write(tmp_path, {"tram": HEADER})
    only = {"car": MODULES["car"]}
    assert [d.kind for d in check(tmp_path, only, complete=False)] == ["missing"]
    assert write(tmp_path, only) == (tmp_path / "car.py",)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["car.py", "tram.py"]


def test_writing_all_removes_what_is_left_over_but_never_a_file_of_a_person(tmp_path: Path) -> None:
    write(tmp_path, {"tram": HEADER})
    assert set(write(tmp_path, MODULES, complete=True)) == {tmp_path / f"{n}.py" for n in ("car", "tram", "truck")}
    assert not (tmp_path / "tram.py").exists()
    (tmp_path / "notes.py").write_text("mine = True\n")
    with pytest.raises(GenerationError, match=r"notes.py: stands among generated modules but is none"):
        write(tmp_path, MODULES, complete=True)
    assert (tmp_path / "notes.py").exists()


def test_writing_all_of_a_package_leaves_modules_of_other_graphs_alone(tmp_path: Path) -> None:
    """``bondgraph generate``, called beside somebody's own machine, removed the module of that machine."""
    regenerate = HEADER + "# Regenerate with:  bondgraph generate {}\n"
    own, old = regenerate.format("sled.py"), regenerate.format("cars.tram:tram")
    write(tmp_path, {"sled": own, "tram": old})
    declared = {"car": regenerate.format("cars.car:car")}
    assert [(d.file, d.kind) for d in check(tmp_path, declared)] == [("car.py", "missing"), ("tram.py", "superfluous")]
    write(tmp_path, declared, complete=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["car.py", "sled.py"]


def test_another_version_of_the_generator_is_no_difference_but_other_equations_are(tmp_path: Path) -> None:
    line = "# Generator: bondgraph 0.1.0, sympy 1.14.0.  Equations: 0123456789abcdef\n"
    write(tmp_path, {"car": line + "mass = 1\n"})
    assert check(tmp_path, {"car": line.replace("1.14.0", "1.15.0rc1") + "mass = 1\n"}) == ()
    assert len(check(tmp_path, {"car": line.replace("0123", "1123") + "mass = 1\n"})) == 1


def test_graph_files_become_modules_that_load(tmp_path: Path) -> None:
    references = [_graph_file(tmp_path, "sled"), _graph_file(tmp_path, "cart")]
    modules = render_all(references)
    assert list(modules) == ["sled", "cart"]
    assert modules["cart"].splitlines()[1] == f"# Regenerate with:  bondgraph generate {references[1]}"
    model = Model.from_text(modules["sled"])
    assert model.names("parameter") == ("m", "b")
    assert model.rhs(0.0, [4.0], [], model.theta()).tolist() == [-1.0]


def test_graphs_that_cannot_be_modules_are_refused(tmp_path: Path) -> None:
    good = _graph_file(tmp_path, "sled")
    with pytest.raises(GenerationError, match="another graph is called 'sled' too"):
        render_all([good, good])
    with pytest.raises(GenerationError, match="the graph is called 'two words', which cannot be the name of a module"):
        render_all([_graph_file(tmp_path, "two words")])
    with pytest.raises(DimensionError):
        render_all([_graph_file(tmp_path, "wrong", unit="N")])


def test_rendering_a_graph_twice_gives_the_same_text(tmp_path: Path) -> None:
    from bondgraph.declare.files import load_graph

    reference = _graph_file(tmp_path, "sled")
    assert render_graph(load_graph(reference)).text == render_graph(load_graph(reference)).text
