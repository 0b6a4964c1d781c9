"""A candidate that fails is an outcome: what can go wrong with one of many must not end the search of the others."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from bondgraph.errors import BondGraphError
from bondgraph.simulate.model import Model

_Found = TypeVar("_Found")

#: What a model that is not the user's own may raise: it is refused, diverges, or its numbers overflow. Mistakes in the
#: program itself (a wrong type, a missing name) are none of it.
FAILURES = (BondGraphError, np.linalg.LinAlgError, ArithmeticError)


def reason(error: BaseException) -> str:
    """Why something failed, in one line.

    Examples
    --------
    >>> reason(ZeroDivisionError("division by zero"))
    'division by zero (ZeroDivisionError)'
    """
    if isinstance(error, BondGraphError):
        return error.message
    return f"{' '.join(str(error).split())} ({type(error).__name__})"


def attempted(action: Callable[[], _Found], failed: Callable[[str], _Found]) -> _Found:
    """The result of an action, or of ``failed`` with the reason where it could not be done.

    Examples
    --------
    >>> attempted(lambda: np.linalg.inv(np.zeros((1, 1))).item(), lambda why: why)
    'Singular matrix (LinAlgError)'
    """
    try:
        return action()
    except FAILURES as error:
        return failed(reason(error))


def has_rates(model: Model) -> bool:
    """True for a model whose equations have finite values where it is declared: its implicit loops have a solution."""

    def finite() -> bool:
        return bool(np.isfinite(model.rhs(0.0, model.x0(), model.u0(), model.theta())).all())

    with np.errstate(all="ignore"):
        return attempted(finite, lambda why: False)
