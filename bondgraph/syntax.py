"""Python text as a syntax tree, from any thread.

Python 3.11 counts the depth of the tree that it builds for all threads together. Where the collection of garbage lets
another thread parse in between, it raises a SystemError (https://github.com/python/cpython/issues/106905).
"""

from __future__ import annotations

import ast
import threading
from typing import Literal, overload

_lock = threading.RLock()  # garbage may parse too


@overload
def parsed(text: str, mode: Literal["exec"] = ...) -> ast.Module: ...
@overload
def parsed(text: str, mode: Literal["eval"]) -> ast.Expression: ...
def parsed(text: str, mode: Literal["exec", "eval"] = "exec") -> ast.Module | ast.Expression:
    """The tree of a text, of one thread after the other.

    Raises
    ------
    SyntaxError, ValueError
        If it is not Python.

    Examples
    --------
    >>> ast.unparse(parsed("1.2*(k_f)", mode="eval"))
    '1.2 * k_f'
    """
    with _lock:
        return ast.parse(text) if mode == "exec" else ast.parse(text, mode="eval")
