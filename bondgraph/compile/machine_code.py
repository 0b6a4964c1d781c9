"""Compile generated modules with numba, cached by content.

The scalar form of a model is written into a source file, named by the digest of what it holds, in a cache folder of the
user. numba keeps its machine code beside that file: a model is compiled once per machine, and a later start only loads
it. Kernels that are the same for every model are compiled once for all models: the large ones by this package
(:mod:`bondgraph.compile.kernels`), as is the form of a model for many states at once
(:mod:`bondgraph.compile.lanes.load`), the others by numba. Without numba the numpy form runs instead.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib
import importlib.util
import inspect
import linecache
import sys
import threading
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from bondgraph.arrays import FloatArray
from bondgraph.compile import table_kernel
from bondgraph.compile.cache import store
from bondgraph.compile.loader import parse_module
from bondgraph.compile.scalar import scalar_source
from bondgraph.errors import ModelError
from bondgraph.syntax import parsed

Scalar = Callable[[float, FloatArray, FloatArray, FloatArray, FloatArray], None]
Batched = Callable[[float, FloatArray, FloatArray, FloatArray], FloatArray]

HEADER = '''"""{title}; written by bondgraph, safe to delete."""
from __future__ import annotations

import math

import numpy as np

from bondgraph.compile.kept import inner as _inner, jit as _jit, unfused as _unfused
'''

_lock = threading.Lock()


@dataclass(frozen=True)
class CompiledModel:
    """Compiled functions of one model.

    ``rhs_into(t, x, u, theta, dx)`` and ``output_into(t, x, u, theta, y)`` take C-contiguous float vectors and write
    their last argument. ``backend`` is ``"numba"`` or, where numba is not installed, ``"numpy"``. Many states at once
    are the matter of :mod:`bondgraph.compile.lanes.load`.
    """

    rhs_into: Scalar
    output_into: Scalar
    backend: str


def compile_model(text: str, name: str, rhs: Batched, output: Batched) -> CompiledModel:
    """The scalar functions of a model, compiled where numba is installed.

    Parameters
    ----------
    text, name
        The generated module and its name.
    rhs, output
        Its numpy form, which serves where numba is missing.

    Examples
    --------
    >>> import numpy as np
    >>> from bondgraph.simulate.example import pendulum
    >>> model, dx = pendulum(), np.empty(2)
    >>> compiled = compile_model(model.text, model.name, model.rhs, model.output)
    >>> compiled.rhs_into(0.0, model.x0(), model.u0(), model.theta(), dx)
    >>> bool(np.allclose(dx, model.rhs(0.0, model.x0(), model.u0(), model.theta())))
    True
    """
    if has_numba():
        module = load_compiled(model_source(text, name))
        return CompiledModel(module.rhs_into, module.output_into, "numba")

    def rhs_into(t: float, x: FloatArray, u: FloatArray, theta: FloatArray, dx: FloatArray) -> None:
        dx[...] = rhs(t, x, u, theta)

    def output_into(t: float, x: FloatArray, u: FloatArray, theta: FloatArray, y: FloatArray) -> None:
        y[...] = output(t, x, u, theta)

    return CompiledModel(rhs_into, output_into, "numpy")


def model_source(text: str, name: str) -> str:
    """The source that numba compiles for the generated module of one model."""
    parts = [
        HEADER.format(title=f"Compiled form of the generated module {name!r}"),
        *_functions(table_kernel, "@_inner\n"),
        scalar_source(parse_module(text, name), "@_jit", "@_inner"),
    ]
    return "\n\n".join(parts) + "\n"


@functools.cache
def load_kernel(*kernels: ModuleType, fused: bool = True) -> Any:
    """The functions of kernel modules, compiled together; kernels take the functions of a model as arguments.

    Parameters
    ----------
    *kernels
        The modules; they make no arrays.
    fused
        Whether a product and a sum may be rounded as one; if not, what they give has numpy's bits.

    Raises
    ------
    ModelError
        If numba is not installed; ask :func:`has_numba` first.
    """
    _ask_for_numba(kernels)
    title = f"Compiled form of {', '.join(kernel.__name__ for kernel in kernels)}"
    outer, within = "@_jit\n", "@_inner\n"
    if not fused:
        outer = within = "@_unfused\n"
    parts = [HEADER.format(title=title), *(part for kernel in kernels for part in _functions(kernel, outer, within))]
    return load_compiled("\n\n".join(parts) + "\n")


@functools.cache
def load_translated(name: str, *kernels: ModuleType) -> Any:
    """A function of kernel modules as a :class:`bondgraph.compile.kernels.calls.Kernel`: compiled by this package.

    Raises
    ------
    ModelError
        If numba is not installed; ask :func:`has_numba` first.
    """
    _ask_for_numba(kernels)
    calls = importlib.import_module("bondgraph.compile.kernels.calls")
    return calls.Kernel([inspect.getsource(kernel) for kernel in kernels], name)


def _ask_for_numba(kernels: tuple[ModuleType, ...]) -> None:
    if not has_numba():
        raise ModelError(f"{kernels[0].__name__}: numba is not installed - install the package 'numba'")


def has_numba() -> bool:
    """True where numba is installed and works; a broken one is reported once."""
    try:
        found = importlib.util.find_spec("numba") is not None
    except ValueError:  # a module that was blocked or half-loaded has no specification
        found = False
    broken = _numba_problem() if found else ""
    if not found or broken:
        _say_fallback(f"cannot be loaded ({broken})" if broken else "is not installed")
    return found and not broken


@functools.cache
def _numba_problem() -> str:
    """Why numba cannot be loaded (another numpy, a missing library), empty where it can."""
    try:
        importlib.import_module("bondgraph.compile.kept")
    except Exception as error:  # whatever a broken installation raises
        return f"{type(error).__name__}: {error}"
    return ""


@functools.cache
def _say_fallback(problem: str) -> None:
    warnings.warn(
        f"numba {problem}: models run in plain numpy, with the same results and much slower"
        " - install the package 'numba' to compile them",
        stacklevel=4,
    )


@functools.cache
def _functions(kernel: ModuleType, decorator: str, within: str = "@_inner\n") -> tuple[str, ...]:
    """The functions and constants of a kernel module, without its imports and types; the public ones as asked for."""
    text = inspect.getsource(kernel)
    parts = []
    for node in parsed(text).body:
        segment = ast.get_source_segment(text, node) or ""
        if isinstance(node, ast.FunctionDef):
            parts.append((within if node.name.startswith("_") else decorator) + segment)
        elif isinstance(node, ast.Assign):
            parts.append(segment)
    return tuple(parts)


def load_compiled(source: str) -> ModuleType:
    """The module of a source, from the cache folder, once per process."""
    name = f"bondgraph_compiled_{hashlib.sha256(source.encode()).hexdigest()[:24]}"
    with _lock:
        if name not in sys.modules:
            _run(name, source)
        return sys.modules[name]


def _run(name: str, source: str) -> None:
    path = str(store(f"{name}.py", source) or f"<{name}>")
    if path.startswith("<"):  # no disk takes it: its text is kept for those who read it, its machine code is not
        linecache.cache[path] = (len(source), None, source.splitlines(keepends=True), path)
    module = ModuleType(name)
    module.__file__ = path
    # registered first: numba finds the globals of cached functions through sys.modules
    sys.modules[name] = module
    try:
        exec(compile(source, path, "exec"), module.__dict__)
    except BaseException:
        del sys.modules[name]
        raise
