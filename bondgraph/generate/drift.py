"""Generated modules on disk against what their graphs give now: render, compare, write.

A folder of generated modules is compared as a whole, so a module whose graph is gone is found as well as one that was
edited or has fallen behind. Modules of graphs that are declared elsewhere may stand beside them and are left alone.
"""

from __future__ import annotations

import difflib
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bondgraph.declare.files import load_graph
from bondgraph.errors import GenerationError
from bondgraph.files import write_text
from bondgraph.generate.pipeline import render_graph

#: Files of a folder of modules that are not generated.
_KEPT = ("__init__.py",)
_COMMAND = re.compile(r"^# Regenerate with: +bondgraph generate (\S+)", re.MULTILINE)
_VERSIONS = re.compile(r"^# Generator: bondgraph \S+, sympy \S+\.", re.MULTILINE)


@dataclass(frozen=True)
class Difference:
    """One module that is not what its graph gives: the file, in what way, and the unified diff of it."""

    file: str
    kind: Literal["missing", "changed", "superfluous"]
    diff: str


def exact_name(name: str) -> str:
    """The name of the exactly derived module of a graph, which may stand beside the smooth one.

    Examples
    --------
    >>> exact_name("clutch")
    'clutch_exact'
    """
    return f"{name}_exact"


def render_all(
    references: Iterable[str], *, smooth: bool = True, options: Mapping[str, Sequence[str]] | None = None
) -> dict[str, str]:
    """Texts of several graphs by the names of their modules.

    Parameters
    ----------
    references
        ``FILE.py``, ``FILE.py:name``, ``module:name`` or the path of a graph file, as for every command.
    smooth
        Derive switches, friction and impacts smooth; else with modes, in modules called ``<name>_exact``.
    options
        Further options of the command that regenerates a module, by the reference of its graph.

    Raises
    ------
    GenerationError
        If two graphs have the same name or a name cannot be that of a module.
    BondGraphError
        If a graph is refused.
    """
    modules: dict[str, str] = {}
    for reference in references:
        graph = load_graph(reference)
        if not graph.name.isidentifier():
            raise GenerationError(
                f"{reference}: the graph is called {graph.name!r}, which cannot be the name of a module"
                " - name it with letters, digits and underscores",
                where=(reference,),
            )
        if {graph.name, exact_name(graph.name)} & modules.keys():
            raise GenerationError(
                f"{reference}: another graph is called {graph.name!r} too - give one of them another name",
                where=(reference, graph.name),
            )
        words = (
            "bondgraph",
            "generate",
            reference,
            *(() if smooth else ("--exact",)),
            *(options or {}).get(reference, ()),
        )
        command = shlex.join(words)
        name = graph.name if smooth else exact_name(graph.name)
        modules[name] = render_graph(graph, command, name=name, smooth=smooth).text
    return modules


def check(folder: Path, modules: Mapping[str, str], complete: bool = True) -> tuple[Difference, ...]:
    """Differences between the modules in a folder and the texts they should have, in order of their names.

    Versions of the generator in the header are no difference: equal equations are told by their digest.

    Parameters
    ----------
    folder
        Where the modules are.
    modules
        Text by name.
    complete
        Whether ``modules`` are all that their package declares; then other modules of it are superfluous.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as name:
    ...     _ = write(Path(name), {"car": "rate = 1"})
    ...     [(d.file, d.kind) for d in check(Path(name), {"car": "rate = 2", "truck": ""})]
    [('car.py', 'changed'), ('truck.py', 'missing')]
    """
    found = {path.stem: path.read_text(encoding="utf-8") for path in _generated_files(folder)}
    differences = []
    for name in sorted({*modules, *(_of_the_same_package(found, modules) if complete else ())}):
        if name not in found:
            differences.append(Difference(f"{name}.py", "missing", _diff(name, "", modules[name])))
        elif name not in modules:
            differences.append(Difference(f"{name}.py", "superfluous", _diff(name, found[name], "")))
        elif _comparable(found[name]) != _comparable(modules[name]):
            differences.append(Difference(f"{name}.py", "changed", _diff(name, found[name], modules[name])))
    return tuple(differences)


def explain(differences: Sequence[Difference], command: str) -> str:
    """Differences as text: what is wrong, the diffs, and the command that accepts them; empty where there are none."""
    if not differences:
        return ""
    said = ", ".join(f"{difference.file} ({difference.kind})" for difference in differences)
    diffs = "\n".join(difference.diff for difference in differences)
    return f"{diffs}\ngenerated modules are not what their graphs give: {said} - accept the change with: {command}"


def write(folder: Path, modules: Mapping[str, str], complete: bool = False) -> tuple[Path, ...]:
    """Write the modules that differ; the folder is made where it is missing.

    Parameters
    ----------
    folder
        Where the modules go.
    modules
        Text by name.
    complete
        Whether ``modules`` are all that their package declares; then other modules of it are removed.

    Returns
    -------
    tuple[Path, ...]
        Files written or removed.

    Raises
    ------
    GenerationError
        If a file to be removed is no generated module.
    """
    folder.mkdir(parents=True, exist_ok=True)
    touched = []
    for difference in check(folder, modules, complete):
        path = folder / difference.file
        if difference.kind == "superfluous":
            _remove(path)
        else:
            write_text(path, modules[path.stem])
        touched.append(path)
    return tuple(touched)


def _remove(path: Path) -> None:
    if not path.read_text(encoding="utf-8").startswith("# Generated from "):
        raise GenerationError(
            f"{path}: stands among generated modules but is none - move it elsewhere", where=(path.name,)
        )
    path.unlink()


def _of_the_same_package(found: Mapping[str, str], modules: Mapping[str, str]) -> list[str]:
    """Names of files whose header names a package of the modules, or none at all."""
    packages = {"", *map(_package, modules.values())}
    return [name for name, text in found.items() if _package(text) in packages]


def _package(text: str) -> str:
    """The first part of the reference in a header: ``cars`` of ``cars.sedan:front``, ``sled`` of ``sled.py``."""
    command = _COMMAND.search(text)
    return command.group(1).partition(".")[0] if command else ""


def _generated_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.py") if path.name not in _KEPT)


def _comparable(text: str) -> str:
    return _VERSIONS.sub("# Generator:", text, count=1)


def _diff(name: str, old: str, new: str) -> str:
    lines = difflib.unified_diff(
        old.splitlines(keepends=True), new.splitlines(keepends=True), f"{name}.py", f"{name}.py (from its graph)"
    )
    return "".join(lines)
