"""Calls of kernels: each is compiled for the kinds of what it is given, and kept between runs (imports numba)."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from bondgraph.compile.kernels import arguments as given
from bondgraph.compile.kernels import compiler, values
from bondgraph.compile.lanes import instructions
from bondgraph.compile.lanes.object_code import load_entry

_COMPILER = tuple(Path(str(module.__file__)) for module in (given, compiler, values, instructions))
_ENTRY = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)


class Kernel:
    """A function of kernel modules that Python can call; other threads run meanwhile.

    Parameters
    ----------
    sources
        The texts of the modules.
    name
        The function.
    """

    def __init__(self, sources: Sequence[str], name: str) -> None:
        self._sources, self._name = tuple(sources), name
        self._entries: dict[tuple[Any, ...], Any] = {}

    def __call__(self, *arguments: Any) -> int:
        """Call it; an integer that it returns, else 0."""
        return self.prepared(*arguments)()

    def prepared(self, *arguments: Any) -> Callable[[], int]:
        """A call with arguments whose contents change only: it takes no time to look at them again."""
        words, kinds = given.words_of(arguments)
        if kinds not in self._entries:
            self._entries[kinds] = _ENTRY(self._address(arguments))
        # a partial function keeps the arguments as long as their addresses may be used
        return functools.partial(_call, self._entries[kinds], words.buffer_info()[0], (words, arguments))

    def _address(self, arguments: Sequence[Any]) -> int:
        kinds = [given.kind_of(argument) for argument in arguments]
        parts = (*self._sources, self._name, repr(kinds))
        return load_entry(_COMPILER, parts, lambda: compiler.kernel_module(self._sources, self._name, kinds))


def _call(entry: Any, address: int, kept: Any) -> int:
    return int(entry(address))
