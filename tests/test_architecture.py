"""The house: which rooms there are, who may look into whom, and how large things may become."""

from __future__ import annotations

import ast
import fnmatch
import functools
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import networkx as nx
import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "bondgraph"

VISIBLE = {"pyproject.toml", "bondgraph", "vehicle_graphs", "generated", "tests", "README.md", "LICENSE"}
FOUNDATION = ("version", "text", "syntax", "shown", "errors", "lazy", "files", "frames", "units", "coherent", "arrays")
DESIGN_TIME = ("declare", "derive", "generate")
RUN_TIME = ("execute", "compile", "data", "simulate", "filter", "estimate")
ON_TOP = ("effects", "correct", "report", "exchange", "documentation", "cli")
#: Single files above the halves: from a graph to a model.
FRONT = ("asking", "build", "verbs")
ROOMS = (*DESIGN_TIME, *RUN_TIME, *ON_TOP)

#: What each room may import besides itself. The halves do not know each other; what is on top may use both.
MAY_IMPORT: dict[str, tuple[str, ...]] = {
    "version": (),
    "text": (),
    "syntax": (),
    "shown": ("text",),
    "lazy": ("errors",),
    "frames": ("errors",),
    "errors": (),
    "files": ("errors",),
    "units": ("errors",),
    "coherent": ("errors", "units"),
    "arrays": ("errors",),
    **{room: (*FOUNDATION, *DESIGN_TIME[:i]) for i, room in enumerate(DESIGN_TIME)},
    **{room: (*FOUNDATION, *RUN_TIME[:i]) for i, room in enumerate(RUN_TIME)},
    "compile": FOUNDATION,
    "data": FOUNDATION,
    "build": (*FOUNDATION, *DESIGN_TIME, "compile", "simulate"),
    "asking": (*FOUNDATION, *RUN_TIME, "verbs"),
    "verbs": (*FOUNDATION, *RUN_TIME, "correct"),
    **{room: (*FOUNDATION, *DESIGN_TIME, *RUN_TIME, "build", *ON_TOP[:i]) for i, room in enumerate(ON_TOP)},
    "effects": (*FOUNDATION, "declare", "derive"),
}

#: Rooms inside ``compile`` and which others each may import; a front differentiates what it has read by a pass.
COMPILE: dict[str, tuple[str, ...]] = {
    "ir": (),
    "front": ("ir", "passes"),
    "passes": ("ir", "front"),
    "lanes": ("ir", "front", "passes"),
    "kernels": ("lanes",),
}

#: Rooms inside ``correct``, in the order in which a loop goes through them; what stands beside them is the loop itself.
CORRECT = ("models", "fits", "scores", "places", "evidence", "search", "shapes")

MODULE_LINES = 400
MODULE_LINES_AT_MOST = 600
FUNCTION_LINES = 45
#: Modules longer than that, and why they are one module.
LONG_MODULES: dict[str, str] = {
    "derive/jacobian.py": "one sweep over all assignments and the rules it applies",
    "derive/transfer.py": "one computation: determinants in three kinds of exact arithmetic, and their roots",
}


#: Tutorials: scripts that pages include, no modules of the package.
SCRIPTS = PACKAGE / "documentation" / "scripts"


def _modules(folder: Path = PACKAGE) -> list[Path]:
    return sorted(
        path for path in folder.rglob("*.py") if "__pycache__" not in path.parts and SCRIPTS not in path.parents
    )


def _name(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def _room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _imports(path: Path) -> tuple[tuple[int, str], ...]:
    """Full names of everything a module imports, wherever in it, with the line."""
    return _read(path.read_text(encoding="utf-8"))[0]


@functools.cache
def _read(text: str) -> tuple[tuple[tuple[int, str], ...], tuple[tuple[str, int], ...]]:
    """The imports of a module, and its functions with their lines: each module is parsed for one test only."""
    imports: list[tuple[int, str]] = []
    functions: list[tuple[str, int]] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            imports += ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            imports += ((node.lineno, f"{base}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.FunctionDef):
            functions.append((node.name, _body_lines(node)))
    return tuple(imports), tuple(functions)


def _import_errors(path: Path) -> list[str]:
    errors = []
    for line, name in _imports(path):
        parts = name.split(".")
        if parts[0] in ("vehicle_graphs", "generated", "tests", ""):
            errors.append(
                f"{_name(path)}:{line} imports {name}: the toolkit knows no vehicle, and imports are absolute"
            )
        elif parts[0] == "bondgraph" and len(parts) > 1 and not parts[1].startswith("__"):
            if parts[1] not in (_room(path), *MAY_IMPORT[_room(path)]):
                errors.append(f"{_name(path)}:{line} imports {name}: {_room(path)} must not know {parts[1]}")
        elif parts[0] in ("sympy", "networkx") and _room(path) in (*FOUNDATION, *RUN_TIME):
            errors.append(f"{_name(path)}:{line} imports {name}: it is run-time code")
    return errors


def test_the_visible_top_level_is_the_agreed_one() -> None:
    ignored = [line.strip("/") for line in (ROOT / ".gitignore").read_text().split()]
    found = {
        path.name
        for path in ROOT.iterdir()
        if not path.name.startswith(".") and not any(fnmatch.fnmatch(path.name, pattern) for pattern in ignored)
    }
    assert found - {"PKG-INFO"} == VISIBLE  # a source distribution has that file too


def test_every_module_has_a_place() -> None:
    found = {path.name for path in PACKAGE.iterdir() if path.name != "__pycache__"}
    top = {"__init__.py", "__main__.py", "py.typed", *(f"{name}.py" for name in (*FOUNDATION, *FRONT))}
    assert found == {*top, *ROOMS}
    for path in _modules():
        assert (path.parent / "__init__.py").is_file(), f"{_name(path)} is in a folder without __init__.py"


def test_tests_mirror_the_rooms() -> None:
    folders = {path.name for path in (ROOT / "tests").iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders <= {*ROOMS, "vehicle_graphs", "benchmarks", "verification"}


@pytest.mark.parametrize("path", [pytest.param(path, id=_name(path)) for path in _modules() if path.parent != PACKAGE])
def test_imports_point_one_way(path: Path) -> None:
    assert _import_errors(path) == []


@pytest.mark.parametrize("name", [f"{name}.py" for name in (*FOUNDATION, *FRONT)])
def test_imports_of_single_files_point_one_way(name: str) -> None:
    assert _import_errors(PACKAGE / name) == []


def test_a_wrong_import_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "PACKAGE", tmp_path)
    (tmp_path / "filter").mkdir()
    path = tmp_path / "filter" / "ukf.py"
    for line in (
        "import sympy",
        "from networkx import DiGraph",
        "from bondgraph.derive.equations import State",
        "from bondgraph import estimate",
        "from . import gains",
        "def f():\n    import vehicle_graphs.baja",
    ):
        path.write_text(line)
        assert len(_import_errors(path)) == 1, line
    path.write_text(
        "import bondgraph\nfrom bondgraph.simulate.model import Model\nfrom bondgraph.errors import FilterError"
    )
    assert _import_errors(path) == []


def test_rooms_inside_correct_import_one_way() -> None:
    assert {path.name for path in (PACKAGE / "correct").iterdir() if path.is_dir()} - {"__pycache__"} == set(CORRECT)
    later = {
        room: tuple(f"bondgraph.correct.{one}" for one in CORRECT[i + 1 :]) + _of_the_loop()
        for i, room in enumerate(CORRECT)
    }
    errors = [
        f"{_name(path)}:{line} imports {name}"
        for room, unknown in later.items()
        for path in _modules(PACKAGE / "correct" / room)
        for line, name in _imports(path)
        if any(name == one or name.startswith(f"{one}.") for one in unknown)
    ]
    assert errors == []


def test_rooms_inside_compile_import_one_way() -> None:
    assert {path.name for path in (PACKAGE / "compile").iterdir() if path.is_dir()} - {"__pycache__"} == set(COMPILE)
    errors = [
        f"{_name(path)}:{line} imports {name}"
        for room, known in COMPILE.items()
        for path in _modules(PACKAGE / "compile" / room)
        for line, name in _imports(path)
        if name.startswith("bondgraph.compile.") and name.split(".")[2] in set(COMPILE) - {room, *known}
    ]
    assert errors == []


def _of_the_loop() -> tuple[str, ...]:
    modules = (path.stem for path in (PACKAGE / "correct").glob("[!_]*.py"))
    return tuple(f"bondgraph.correct.{name}" for name in modules if name != "constants")  # the ground floor


def _module(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def _circles(paths: list[Path]) -> list[list[str]]:
    """Modules that import each other round a circle, wherever they do it, in a function or for types alone too."""
    known = {_module(path): path for path in paths}
    network = nx.DiGraph()
    for name, path in known.items():
        for _, imported in _imports(path):
            target = imported if imported in known else imported.rpartition(".")[0]
            if target in known:
                network.add_edge(name, target)
    return [sorted(circle) for circle in nx.strongly_connected_components(network) if len(circle) > 1]


def test_no_modules_import_each_other_round_a_circle() -> None:
    assert _circles([*_modules(), *_modules(ROOT / "vehicle_graphs")]) == []


def test_a_circle_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    (tmp_path / "house").mkdir()
    lines = {
        "door": "from house.wall import stone\nfrom house import roof",
        "wall": "def build():\n    from house.roof import beam",
        "roof": "if TYPE_CHECKING:\n    from house import wall",
    }
    for name, text in lines.items():
        (tmp_path / "house" / f"{name}.py").write_text(text)
    assert _circles(_modules(tmp_path)) == [["house.roof", "house.wall"]]


_LOADED = """
import importlib, pkgutil, sys
import bondgraph
for room in sys.argv[1:]:
    package = importlib.import_module(f"bondgraph.{room}")
    for found in pkgutil.walk_packages(package.__path__, f"bondgraph.{room}."):
        importlib.import_module(found.name)
print(*(name for name in ("sympy", "networkx") if name in sys.modules))
print(*sorted({name.split(".")[1] for name in sys.modules if name.startswith("bondgraph.")}))
"""


def test_the_run_time_half_loads_neither_sympy_nor_networkx_nor_the_design_time_half() -> None:
    run = subprocess.run(
        [sys.executable, "-c", _LOADED, *RUN_TIME], check=True, capture_output=True, text=True, cwd=ROOT
    )
    heavy, rooms = run.stdout.split("\n")[:2]
    assert heavy == ""
    assert set(rooms.split()) <= {*FOUNDATION, *RUN_TIME}


#: Where a model is made of a text: of a graph's or its equations', of a file's, of a graph's with bonds as outputs, of
#: state equations without a graph, of a saved result's.
MODEL_MAKERS = {
    "build.py",
    "simulate/between.py",
    "report/simulation.py",
    "simulate/model.py",
    "simulate/example.py",
    "simulate/state_space.py",
    "simulate/stored.py",
}


def test_a_graph_becomes_a_model_in_one_place() -> None:
    """Two pipelines and a half stood in ``correct``, ``generate`` and ``report``."""
    rendering = {
        _name(path) for path in _modules() for _, name in _imports(path) if name == "bondgraph.generate.module.render"
    }
    assert rendering == {"build.py", "generate/pipeline.py", "generate/__init__.py"}
    calls = re.compile(r"\b(Model|cls)\.from_text\(")
    assert {_name(path) for path in _modules() if calls.search(path.read_text(encoding="utf-8"))} <= MODEL_MAKERS


def test_nothing_reaches_into_correct_for_a_model() -> None:
    folders = (PACKAGE, ROOT / "vehicle_graphs", ROOT / "tests")
    found = [
        f"{path}:{line}"
        for folder in folders
        for path in _modules(folder)
        for line, name in _imports(path)
        if name.startswith("bondgraph.correct.") and name.rpartition(".")[2] in ("build", "BuiltModel", "Model")
    ]
    assert found == []


def test_modules_stay_small() -> None:
    lengths = {_name(path): len(path.read_text(encoding="utf-8").splitlines()) for path in _modules()}
    too_long = {name: lines for name, lines in lengths.items() if lines > MODULE_LINES}
    assert {n: lines for n, lines in too_long.items() if lines > MODULE_LINES_AT_MOST} == {}
    assert {name for name in too_long if name not in LONG_MODULES} == set()
    assert {name for name in LONG_MODULES if name not in too_long} == set(), "no longer long: take it off the list"


def _body_lines(function: ast.FunctionDef) -> int:
    first = function.body[0]
    has_docstring = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    start = first.end_lineno if has_docstring else function.lineno
    return (function.end_lineno or 0) - (start or 0)


def test_functions_stay_small() -> None:
    too_long = [
        f"{_name(path)}: {name} has {lines} lines"
        for path in _modules()
        for name, lines in _read(path.read_text(encoding="utf-8"))[1]
        if lines > FUNCTION_LINES
    ]
    assert too_long == []


def test_every_path_that_pyproject_names_exists() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    tool = project["tool"]
    named = [project["project"]["readme"], *project["project"]["license-files"]]
    named += [*tool["pytest"]["ini_options"]["testpaths"], *tool["mypy"]["packages"], *tool["ruff"]["extend-exclude"]]
    named += [tool["hatch"]["version"]["path"], *tool["hatch"]["build"]["targets"]["wheel"]["packages"]]
    named += tool["hatch"]["build"]["targets"]["sdist"]["only-include"]
    named += [script.partition(":")[0].replace(".", "/") for script in project["project"]["scripts"].values()]
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_what_is_imported_is_declared_and_what_is_declared_is_imported() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {_distribution(requirement) for requirement in project["dependencies"]}
    optional = {_distribution(r) for extra in project["optional-dependencies"].values() for r in extra}
    own = {*sys.stdlib_module_names, "bondgraph", "vehicle_graphs", "generated"}
    paths = [*_modules(), *_modules(ROOT / "vehicle_graphs")]
    imported = {name.split(".")[0].lower() for path in paths for _, name in _imports(path)} - own
    assert imported - needed - optional == set()
    assert needed - imported == set()


def _distribution(requirement: str) -> str:
    return re.split(r"[^\w-]", requirement)[0].lower()
