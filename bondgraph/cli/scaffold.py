"""The folder that ``new`` writes: a graph, two logs and a script that runs."""

from __future__ import annotations

import importlib.resources
import importlib.util
import keyword
import os
import shutil
from pathlib import Path
from typing import Any

from bondgraph.errors import OptionError
from bondgraph.files import write_text

_TEMPLATE = "templates/machine.py.txt"


def write_scaffold(name: str, parent: Path) -> Path:
    """Write the folder ``name`` with ``name.py`` and its logs.

    Raises
    ------
    OptionError
        If the name is none of Python, is taken, or the folder exists.
    """
    if not name.isidentifier() or keyword.iskeyword(name):
        raise OptionError(f"new {name}: a name has letters, digits and underscores, such as sled", where=(name,))
    folder = parent / name
    if folder.exists():
        raise OptionError(f"new {name}: {folder} exists - choose another name, or delete it", where=(str(folder),))
    found = importlib.util.find_spec(name)
    if found is not None:
        place = f", {found.origin}" if found.has_location else ""
        raise OptionError(f"new {name}: there is a module of this name{place} - choose another name", where=(name,))
    folder.mkdir()
    try:
        template = importlib.resources.files("bondgraph.cli").joinpath(_TEMPLATE).read_text(encoding="utf-8")
        write_text(folder / f"{name}.py", template.replace("@NAME@", name))
        _write_logs(folder, name)
    except BaseException:
        shutil.rmtree(folder)
        raise
    return folder


def _write_logs(folder: Path, name: str) -> None:
    """Let the machine write its logs into the folder."""
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    assert spec is not None and spec.loader is not None
    machine: Any = importlib.util.module_from_spec(spec)
    before = Path.cwd()
    try:
        os.chdir(folder)
        spec.loader.exec_module(machine)
        machine.write_logs()
    finally:
        os.chdir(before)
