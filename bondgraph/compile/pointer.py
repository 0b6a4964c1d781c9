"""Compiled functions as values that other compiled functions take as arguments (imported only where numba is)."""

from __future__ import annotations

from typing import Any

from bondgraph.compile.numba_internals import types


class CompiledFunction(types.WrapperAddressProtocol):  # type: ignore[misc]
    """The address of a C callback; its type is its signature, so that whoever calls it is compiled once.

    ``signature`` is numba's: argument types and the type of the result; ``notation`` is its text.
    """

    def __init__(self, address: int, signature: tuple[Any, Any]) -> None:
        self._address = address
        arguments, result = signature
        self._signature = (result or types.void)(*arguments)
        self.notation = str(self._signature)

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self) -> Any:
        """The numba signature."""
        return self._signature
