"""Read the text of a generated module: check that it is one, run it, and hand back its names.

The text is restricted to what generated modules contain (imports of numpy and math, assignments, functions) and runs
without the other builtins. This keeps mistakes out; it is no protection against a hostile file, which is code like any
other.
"""

from __future__ import annotations

import ast
import builtins
import math
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

import numpy as np

from bondgraph.errors import ModelError, suggest
from bondgraph.syntax import parsed

FORMAT = "bondgraph-module/1"

#: Names every generated module has.
REQUIRED = ("NAME", "FORMAT", "STATES", "INPUTS", "PARAMETERS", "OUTPUTS", "rhs", "output")
_MODULES: Mapping[str, ModuleType] = {"numpy": np, "math": math}
_BUILTINS = ("abs", "bool", "enumerate", "float", "int", "len", "list", "max", "min", "range", "sum", "tuple", "zip")


def parse_module(text: str, source: str) -> ast.Module:
    """The syntax tree of a generated module.

    Parameters
    ----------
    text
        The module.
    source
        Where it came from, for messages.

    Raises
    ------
    ModelError
        If it is not Python, or holds what a generated module cannot hold.
    """
    try:
        tree = parsed(text)
    except (SyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None)
        raise ModelError(
            f"{source}: line {line} is not valid Python ({error.args[0]}) - regenerate the module", where=(source,)
        ) from None
    for node in tree.body:
        if not _belongs(node):
            raise ModelError(
                f"{source}: line {node.lineno} ({ast.unparse(node).splitlines()[0]!r}) does not belong in a generated"
                " module, which holds imports of numpy and math, constants and functions - regenerate it",
                where=(source,),
            )
    return tree


def _belongs(node: ast.stmt) -> bool:
    if isinstance(node, ast.Import):
        return all(alias.name in _MODULES for alias in node.names)
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant)
    if isinstance(node, ast.Assign):
        return all(isinstance(target, ast.Name) for target in node.targets)
    return isinstance(node, ast.FunctionDef) and not node.decorator_list


def run_module(module: ast.Module | str, source: str) -> dict[str, Any]:
    """The names a generated module defines, given its syntax tree or its text.

    Raises
    ------
    ModelError
        If running it fails, a required name is missing, or it is of another format.
    """
    namespace: dict[str, Any] = {"__builtins__": _restricted_builtins()}
    try:
        exec(compile(module, source, "exec"), namespace)
    except Exception as error:  # whatever the text does wrong is the module's fault, told as such
        raise ModelError(
            f"{source}: running the module failed: {type(error).__name__}: {error} - regenerate it", where=(source,)
        ) from error
    missing = [name for name in REQUIRED if name not in namespace]
    if missing:
        raise ModelError(
            f"{source}: the module has no {', '.join(missing)}{suggest(missing[0], namespace)}"
            " - it is not a generated module or was edited; regenerate it",
            where=(source, *missing),
        )
    if namespace["FORMAT"] != FORMAT:
        raise ModelError(
            f"{source}: the module is of format {namespace['FORMAT']!r}, this version reads {FORMAT!r} - regenerate it",
            where=(source, "FORMAT"),
        )
    return namespace


def _restricted_builtins() -> dict[str, Any]:
    allowed = {name: getattr(builtins, name) for name in _BUILTINS}
    return {**allowed, "__import__": _import_numeric}


def _import_numeric(name: str, *_: object) -> ModuleType:
    return _MODULES[name]


def require_function(namespace: Mapping[str, Any], name: str, source: str) -> Callable[..., Any]:
    """The function ``name`` of a module, checked to take ``(t, x, u, theta)``."""
    function: Any = namespace.get(name)
    code = getattr(function, "__code__", None)
    arguments = () if code is None else code.co_varnames[: code.co_argcount]
    if arguments != ("t", "x", "u", "theta"):
        raise ModelError(
            f"{source}: {name} must be a function of (t, x, u, theta), not of ({', '.join(arguments)})"
            " - regenerate the module",
            where=(source, name),
        )
    # np.where evaluates the branch it does not take
    quiet: Callable[..., Any] = np.errstate(all="ignore")(function)
    return quiet
