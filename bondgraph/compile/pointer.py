"""Compiled functions as values that other compiled functions take as arguments (imported only where numba is)."""

from __future__ import annotations

from typing import Any

from bondgraph.compile.numba_internals import types


class CompiledFunction(types.WrapperAddressProtocol):  # type: ignore[misc]
    """The address of a C callback; its type is its signature, so that whoever calls it is compiled once."""

    def __init__(self, callback: Any) -> None:
        self._callback = callback

    def __wrapper_address__(self) -> int:
        return int(self._callback.address)

    def signature(self) -> Any:
        """The numba signature."""
        return self._callback._sig
