"""Compile generated modules with numba, cached by content.

The scalar form of a module and the kernels that use it are written into one source file, named by the digest of what it
holds, in a cache folder of the user. numba keeps its machine code beside that file, so a model is compiled once per
machine and a later start only loads it. Without numba the same interface runs the numpy form.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.util
import inspect
import os
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import platformdirs

from bondgraph.errors import ModelError
from bondgraph.simulate.arrays import FloatArray
from bondgraph.simulate.loader import parse_module
from bondgraph.simulate.model import Model
from bondgraph.simulate.scalar import scalar_source

#: Environment variable that names another cache folder.
CACHE_VARIABLE = "BONDGRAPH_CACHE_DIR"

_HEADER = '''"""Compiled form of the generated module {name!r}; written by bondgraph, safe to delete."""
from __future__ import annotations

import math

import numpy as np
from numba import njit

# contract: a*b + c in one rounding. numpy's rules for division by zero. Threads run it side by side.
_jit = njit(cache=True, nogil=True, error_model="numpy", fastmath={{"contract"}})
'''

_lock = threading.Lock()
_fallback_said = False


@dataclass(frozen=True)
class CompiledModel:
    """Scalar functions of one model.

    ``rhs_into(t, x, u, theta, dx)`` and ``output_into(t, x, u, theta, y)`` take C-contiguous float vectors and write
    their last argument. ``backend`` is ``"numba"`` or, where numba is not installed, ``"numpy"``.
    """

    rhs_into: Callable[[float, FloatArray, FloatArray, FloatArray, FloatArray], None]
    output_into: Callable[[float, FloatArray, FloatArray, FloatArray, FloatArray], None]
    backend: str


def compile_model(model: Model) -> CompiledModel:
    """The scalar functions of a model, compiled where numba is installed.

    Examples
    --------
    >>> import numpy as np
    >>> from bondgraph.simulate.example import pendulum
    >>> model, dx = pendulum(), np.empty(2)
    >>> compile_model(model).rhs_into(0.0, model.x0(), model.u0(), model.theta(), dx)
    >>> bool(np.allclose(dx, model.rhs(0.0, model.x0(), model.u0(), model.theta())))
    True
    """
    module = load_kernels(model)
    if module is not None:
        return CompiledModel(module.rhs_into, module.output_into, "numba")

    def rhs_into(t: float, x: FloatArray, u: FloatArray, theta: FloatArray, dx: FloatArray) -> None:
        dx[...] = model.rhs(t, x, u, theta)

    def output_into(t: float, x: FloatArray, u: FloatArray, theta: FloatArray, y: FloatArray) -> None:
        y[...] = model.output(t, x, u, theta)

    return CompiledModel(rhs_into, output_into, "numpy")


def load_kernels(model: Model, kernels: Sequence[ModuleType] = ()) -> Any:
    """A module with the compiled scalar functions of ``model`` and of the kernels that call them.

    Parameters
    ----------
    model
        The model.
    kernels
        Python modules whose functions are written in the part of the language numba compiles, and call ``rhs_into`` and
        ``output_into`` by name.

    Returns
    -------
    module or None
        None where numba is not installed; that is said once.
    """
    if not _has_numba():
        _say_fallback()
        return None
    source = assemble(model, kernels)
    name = f"bondgraph_compiled_{hashlib.sha256(source.encode()).hexdigest()[:24]}"
    with _lock:
        if name not in sys.modules:
            sys.modules[name] = _load(name, _stored(name, source), source)
        return sys.modules[name]


def assemble(model: Model, kernels: Sequence[ModuleType] = ()) -> str:
    """The source that numba compiles: header, scalar functions of the model, functions of the kernels."""
    parts = [_HEADER.format(name=model.name), scalar_source(parse_module(model.text, model.name), "@_jit")]
    for kernel in kernels:
        parts.extend(_kernel_functions(kernel))
    return "\n\n".join(parts) + "\n"


def _kernel_functions(kernel: ModuleType) -> list[str]:
    """The functions and constants of a kernel module, without its imports and types."""
    text = inspect.getsource(kernel)
    parts = []
    for node in ast.parse(text).body:
        segment = ast.get_source_segment(text, node) or ""
        if isinstance(node, ast.FunctionDef):
            parts.append(f"@_jit\n{segment}")
        elif isinstance(node, ast.Assign):
            parts.append(segment)
    return parts


def cache_folder() -> Path:
    """Folder of the compiled models: ``$BONDGRAPH_CACHE_DIR``, else the user's cache folder, made if missing.

    A folder that cannot be written is replaced by a temporary one, and the models are then compiled in every run.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    folder = Path(chosen) if chosen else Path(platformdirs.user_cache_dir("bondgraph", appauthor=False)) / "compiled"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        if os.access(folder, os.W_OK):
            return folder
    except OSError as error:
        if chosen:
            raise ModelError(f"{CACHE_VARIABLE}={chosen}: cannot be used as a folder: {error}") from None
    if chosen:
        raise ModelError(f"{CACHE_VARIABLE}={chosen}: the folder cannot be written - name another one")
    return _temporary_folder()


@functools.cache
def _temporary_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="bondgraph-"))


def _stored(name: str, source: str) -> Path:
    """The source in the cache folder. An equal file is left alone: numba trusts its machine code by the file's time."""
    path = cache_folder() / f"{name}.py"
    content = source.encode()
    if not path.is_file() or path.read_bytes() != content:
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{name}", delete=False) as file:
            file.write(content)
        os.replace(file.name, path)
    return path


def _load(name: str, path: Path, source: str) -> ModuleType:
    specification = importlib.util.spec_from_file_location(name, path)
    if specification is None:
        raise ModelError(f"{path}: cannot be loaded as a module - delete the file", where=(str(path),))
    module = importlib.util.module_from_spec(specification)
    # registered first: numba finds the globals of cached functions through sys.modules
    sys.modules[name] = module
    try:
        exec(compile(source, str(path), "exec"), module.__dict__)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _has_numba() -> bool:
    try:
        return importlib.util.find_spec("numba") is not None
    except ValueError:  # a module that was blocked or half-loaded has no specification
        return False


def _say_fallback() -> None:
    global _fallback_said
    if not _fallback_said:
        _fallback_said = True
        warnings.warn(
            "numba is not installed: models run in plain numpy, with the same results and much slower"
            " - install the package 'numba' to compile them",
            stacklevel=4,
        )
