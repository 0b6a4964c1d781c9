"""numba's decorators with machine code that is kept between runs, and checked before it is used (imports numba).

numba keeps machine code in pickles. Each file gets a seal here, the digest of what it holds: a truncated or garbled one
is compiled again and written anew, and never unpickled. Where nothing can be written, code serves without being kept.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba

from bondgraph.compile.cache import is_whole, say_not_kept, seal
from bondgraph.compile.numba_internals import UNCOUNTED, caching

_njit: Any = numba.njit  # typed in part only

# contract: a*b + c in one rounding. error_model: numpy's rules for division by zero. nogil: threads run side by side.
_OPTIONS = {"error_model": "numpy", "fastmath": {"contract"}}
# Arrays belong to who calls from Python, so references to them need not be counted. Else every call between compiled
# functions counts those of all arrays up and down, atomically: half of the time of the filter's own algebra.
_UNCOUNTED = {**_OPTIONS, **UNCOUNTED}


def jit(function: Callable[..., Any]) -> Any:
    """The function compiled when it is called first, once for each kind of arguments; it must not make arrays."""
    return _keeping(_njit(nogil=True, **_UNCOUNTED)(function))


def unfused(function: Callable[..., Any]) -> Any:
    """As :func:`jit`, but every product is rounded before it is added to anything, as numpy does."""
    return _keeping(_njit(nogil=True, **{**_UNCOUNTED, "fastmath": False})(function))


def inner(function: Callable[..., Any]) -> Any:
    """The same for a function that only compiled ones call: the wrappers for Python take half of the compile time."""
    return _keeping(_njit(nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, **_UNCOUNTED)(function))


def _keeping(dispatcher: Any) -> Any:
    if hasattr(dispatcher, "py_func"):  # numba hands the function back where it is told not to compile
        dispatcher._cache = _cache_of(dispatcher.py_func)
    return dispatcher


def _cache_of(function: Callable[..., Any]) -> Any:
    """Where the machine code of a function is kept: beside its source, or nowhere."""
    try:
        return _SealedCache(function)
    except (RuntimeError, OSError):  # numba's way to say that no place beside the source can be written
        return caching.NullCache()


class _BesideTheSource(caching.CompileResultCacheImpl):  # type: ignore[misc]
    """No other place: only the folder of the sources has been checked to be the user's own."""

    _locator_classes = (caching.InTreeCacheLocator,)


class _SealedCache(caching.FunctionCache):  # type: ignore[misc]
    _impl_class = _BesideTheSource

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        base, stamp = self._impl.filename_base, self._impl.locator.get_source_stamp()
        self._cache_file = _SealedFiles(self._cache_path, base, stamp)

    def save_overload(self, signature: Any, data: Any) -> None:
        try:
            super().save_overload(signature, data)
        except OSError as error:
            say_not_kept(self._cache_path, error)


class _SealedFiles(caching.IndexDataCacheFile):  # type: ignore[misc]
    """Files that end in the digest of what stands before; unpickling stops before it."""

    @contextlib.contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        with super()._open_for_write(filepath) as file:
            content = io.BytesIO()
            yield content
            file.write(content.getvalue() + seal(content.getvalue()))

    def _load_index(self) -> dict[Any, Any]:
        if not is_whole(Path(self._index_path)):
            return {}
        try:
            return dict(super()._load_index())
        except (AttributeError, ImportError):  # of another version of this package, whose types are not these
            return {}

    def _load_data(self, name: str) -> Any:
        path = Path(self._data_path(name))
        if not is_whole(path):
            path.unlink(missing_ok=True)
            raise FileNotFoundError(str(path))  # which numba takes for code that is not kept any more
        return super()._load_data(name)
