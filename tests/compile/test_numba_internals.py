"""What is used of the insides of numba and llvmlite is there, and used through one module only."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from bondgraph.compile import numba_internals

PACKAGE = Path(numba_internals.__file__).parents[1]


def test_the_installed_versions_have_all_internals() -> None:
    assert numba_internals.missing() == ()


def test_a_missing_internal_is_named_with_the_versions(monkeypatch: pytest.MonkeyPatch) -> None:
    import numba

    monkeypatch.delattr(numba_internals.cgutils, "for_range")
    assert [text.split(" (")[0] for text in numba_internals.missing()] == ["numba.core.cgutils.for_range"]
    assert f"numba {numba.__version__}" in numba_internals.missing()[0]


def test_only_one_module_reaches_inside() -> None:
    reaching = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if any(name.startswith(("numba.core", "numba.np", "numba.cpython", "llvmlite")) for name in names):
                reaching.add(path.relative_to(PACKAGE).as_posix())
    assert reaching == {"compile/numba_internals.py"}
