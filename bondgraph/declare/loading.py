"""Graphs of Python files and modules, found by their reference.

A reference is ``FILE.py`` (its only graph), ``FILE.py:name`` or ``module:name``; the name is that of a graph or of a
function that returns one. A file need not belong to a package: it runs under a name of its own while its folder is on
the path, so that its siblings can be imported, and nothing is written beside it.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import inspect
import os
import sys
import sysconfig
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from bondgraph.declare.graph import BondGraph
from bondgraph.errors import BondGraphError, DeclarationError, suggest

#: Folders whose code is nobody's declaration: this package, the libraries, the standard library.
_NOT_OURS = (str(Path(__file__).resolve().parents[1]), *(sysconfig.get_path(name) for name in ("purelib", "stdlib")))

#: What every generated module defines.
_RATES = b"\ndef rhs("


def split_reference(reference: str) -> tuple[str, str]:
    """File or module of a reference, and the name in it or nothing.

    Examples
    --------
    >>> split_reference("machines/sled.py"), split_reference("sled.py:sled"), split_reference("machines.sled:sled")
    (('machines/sled.py', ''), ('sled.py', 'sled'), ('machines.sled', 'sled'))
    """
    if reference.endswith(".py"):
        return reference, ""
    place, colon, name = reference.rpartition(":")
    return (place, name) if colon else (reference, "")


def is_file_reference(reference: str) -> bool:
    """Whether a reference names a Python file, and not a module."""
    return split_reference(reference)[0].endswith(".py")


def is_code_reference(reference: str) -> bool:
    """Whether a reference names Python code, and not a JSON file.

    Examples
    --------
    >>> [is_code_reference(one) for one in ("motor.json", "sled.py", "machines.sled:sled", "sled")]
    [False, True, True, False]
    """
    place, name = split_reference(reference)
    return is_file_reference(reference) or bool(place and name and not name.endswith(".json"))


def is_model_file(reference: str) -> bool:
    """Whether a reference is a file of Python that holds the functions of a model, as generated, and no declaration."""
    path = Path(reference)
    return path.suffix == ".py" and path.is_file() and _RATES in path.read_bytes()


def load_module(reference: str) -> ModuleType:
    """The module of a reference; a file is run once as long as its text and the way to it are the same.

    Raises
    ------
    DeclarationError
        If there is no such file or module, or it fails; the message says in which line.
    """
    place, _ = split_reference(reference)
    if is_file_reference(reference):
        return _file_module(Path(place), reference)
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    with told_where(reference):
        try:
            return importlib.import_module(place)
        except ModuleNotFoundError as error:
            if error.name and (place == error.name or place.startswith(error.name + ".")):
                raise DeclarationError(f"{reference}: there is no module {error.name!r}", where=(reference,)) from None
            raise


def python_graph(reference: str) -> BondGraph:
    """The graph of a Python file or module.

    Raises
    ------
    DeclarationError
        If there is none of that name, or none or several where no name is given, or the code fails.
    """
    module = load_module(reference)
    place, name = split_reference(reference)
    chosen = _named(module, name, reference) if name else _only(module, reference)
    graph = _graph(chosen, reference)
    graph.source = graph.source or _source(place)
    return graph


def _source(place: str) -> str:
    if not place.endswith(".py"):
        return place.replace(".", "/") + ".py"
    path = Path(place)
    return path.name if path.is_absolute() else path.as_posix()


def _named(module: ModuleType, name: str, reference: str) -> Any:
    found = getattr(module, name, None)
    if isinstance(found, BondGraph) or callable(found):
        return found
    known = [other for other, value in vars(module).items() if callable(value) and not other.startswith("_")]
    known += [other for other, value in vars(module).items() if isinstance(value, BondGraph)]
    place = split_reference(reference)[0]
    raise DeclarationError(
        f"{reference}: {place} has no function or graph {name!r}{suggest(name, known)}", where=(reference,)
    )


def _only(module: ModuleType, reference: str) -> Any:
    """The only graph that a file declares; a function and what it returned count once."""
    found = _declared(module)
    if not found:
        raise DeclarationError(
            f"{reference}: declares no BondGraph at its top level, nor a function annotated '-> BondGraph' - name the "
            f"function that returns it, as in {reference}:name",
            where=(reference,),
        )
    names = list(found)
    first = _graph(found[names[0]], reference)
    if any(_graph(found[other], f"{reference}:{other}") != first for other in names[1:]):
        listed = ", ".join(f"{reference}:{name}" for name in names)
        raise DeclarationError(
            f"{reference}: declares {len(names)} graphs - name one of them: {listed}", where=(reference, *names)
        )
    return first


def _declared(module: ModuleType) -> dict[str, Any]:
    """Graphs of a module, and its own functions that say they return one and need no arguments."""
    return {
        name: value
        for name, value in vars(module).items()
        if not name.startswith("_") and (isinstance(value, BondGraph) or _gives_graph(value, module))
    }


def _gives_graph(value: Any, module: ModuleType) -> bool:
    if not inspect.isfunction(inspect.unwrap(value) if callable(value) else value):
        return False
    if getattr(value, "__module__", "") != module.__name__:
        return False
    given = inspect.get_annotations(inspect.unwrap(value)).get("return")
    required = [
        parameter
        for parameter in inspect.signature(value).parameters.values()
        if parameter.default is parameter.empty
        and parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
    ]
    return not required and (given is BondGraph or (isinstance(given, str) and given.endswith("BondGraph")))


def _graph(chosen: Any, reference: str) -> BondGraph:
    """A graph, or what a function returns if it is one."""
    if not isinstance(chosen, BondGraph):
        chosen = _called(chosen, reference)
    if not isinstance(chosen, BondGraph):
        raise DeclarationError(f"{reference}: gives a {type(chosen).__name__}, not a BondGraph", where=(reference,))
    return chosen


def _called(function: Callable[..., Any], reference: str) -> Any:
    place, _ = split_reference(reference)
    folder = Path(place).resolve().parent if is_file_reference(reference) else None
    with told_where(reference), _on_path(folder):
        try:
            inspect.signature(function).bind()
        except TypeError as error:
            raise DeclarationError(
                f"{reference}: the function needs arguments ({error}) - give one that returns a graph without",
                where=(reference,),
            ) from None
        except ValueError:  # a callable without a signature
            pass
        return function()


# ------------------------------------------------------------------ running a file


def _file_module(path: Path, reference: str) -> ModuleType:
    try:
        source = path.read_bytes()
    except FileNotFoundError:
        raise DeclarationError(f"{path}: no such file", where=(reference,)) from None
    except OSError as error:
        raise DeclarationError(f"{path}: cannot be read ({error.strerror})", where=(reference,)) from None
    if _RATES in source:
        raise DeclarationError(
            f"{path}: is a generated module and declares no graph - give the graph that it was generated from",
            where=(reference,),
        )
    resolved = path.resolve()
    key = hashlib.sha256(b"\0".join((str(path).encode(), str(resolved).encode(), source))).hexdigest()[:12]
    name = f"_graph_file_{key}_{resolved.stem}"
    if name not in sys.modules:
        module = ModuleType(name)
        module.__file__ = str(resolved)
        sys.modules[name] = module
        try:
            with told_where(reference), _on_path(resolved.parent):
                exec(compile(source, str(path), "exec"), module.__dict__)
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]


@contextlib.contextmanager
def _on_path(folder: Path | None) -> Iterator[None]:
    """A folder first on the path, without bytecode written there; what is imported from it is forgotten at the end.

    Another file with siblings of the same names then gets its own ones.
    """
    if folder is None or str(folder) in map(os.path.abspath, sys.path):
        yield
        return
    before, quiet = set(sys.modules), sys.dont_write_bytecode
    sys.path.insert(0, str(folder))
    sys.dont_write_bytecode = True
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        sys.dont_write_bytecode = quiet
        for name in sys.modules.keys() - before:
            if Path(getattr(sys.modules[name], "__file__", None) or ".").parent == folder and "." not in name:
                del sys.modules[name]


# ------------------------------------------------------------------ failures


@contextlib.contextmanager
def told_where(reference: str) -> Iterator[None]:
    """Failures of declaring code as one message that says in which line; errors of the toolkit keep their type.

    Raises
    ------
    BondGraphError
        For whatever the code raised.
    """
    try:
        yield
    except BondGraphError as error:
        line = _line_of(error)
        if line and not error.message.startswith(line):
            error.args = (f"{line}: {error.message}",)
        raise
    except SyntaxError as error:
        raise DeclarationError(
            f"{_shown(error.filename or reference)}:{error.lineno}: {error.msg} - correct the line", where=(reference,)
        ) from None
    except SystemExit as error:
        raise DeclarationError(
            f"{_line_of(error) or reference}: the file ends the program (exit {error.code}) - keep what is not "
            "declaration under if __name__ == '__main__'",
            where=(reference,),
        ) from None
    except RecursionError as error:
        raise DeclarationError(f"{_line_of(error) or reference}: recursion without end", where=(reference,)) from None
    except Exception as error:
        raise DeclarationError(
            f"{_line_of(error) or reference}: {type(error).__name__}: {error}{_meant(error)}", where=(reference,)
        ) from error


def _meant(error: BaseException) -> str:
    """A hint at the name that is close to one that is not defined where an error arose."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    if not isinstance(error, NameError) or not error.name or not frames:
        return ""
    return suggest(error.name, [*frames[-1].f_locals, *frames[-1].f_globals])


def _line_of(error: BaseException) -> str:
    """``file:line`` of the innermost declaring code that an error came through, empty where there is none."""
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        if not frame.filename.startswith(("<", *_NOT_OURS)):
            return f"{_shown(frame.filename)}:{frame.lineno}"
    return ""


def _shown(filename: str) -> str:
    """A file as seen from the working directory where it lies below it."""
    path = Path(filename)
    below = path.is_absolute() and path.is_relative_to(Path.cwd())
    return str(path.relative_to(Path.cwd()) if below else path)
