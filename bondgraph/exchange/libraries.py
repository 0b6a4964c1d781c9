"""Libraries that only exchange needs."""

from __future__ import annotations

import importlib
from typing import Any

from bondgraph.errors import GenerationError


def library(module: str, extra: str) -> Any:
    """A module of an extra.

    Raises
    ------
    GenerationError
        If it is not installed, with what to install.

    Examples
    --------
    >>> library("there_is_no_such_module", "fmu")
    Traceback (most recent call last):
        ...
    bondgraph.errors.GenerationError: this needs there_is_no_such_module, which is not installed - run: pip install
    'bondloop[fmu]'
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.split(".")[0]
        raise GenerationError(
            f"this needs {package}, which is not installed - run: pip install 'bondloop[{extra}]'", where=(package,)
        ) from None
