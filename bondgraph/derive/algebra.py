"""What computer algebra cannot do with a law, told as an error of the law."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from bondgraph.errors import DerivationError

#: Ways in which sympy fails inside: comparisons of no numbers, conditions without a variable, and the like.
_FAILURES = (ArithmeticError, AttributeError, LookupError, NotImplementedError, RecursionError, TypeError, ValueError)


@contextmanager
def algebra(where: str) -> Iterator[None]:
    """Turn a failure inside computer algebra into an error that names the graph or element.

    Raises
    ------
    DerivationError
        With the failure as its cause.

    Examples
    --------
    >>> try:
    ...     with algebra("block: floor"):
    ...         raise TypeError("Invalid NaN comparison")
    ... except DerivationError as error:
    ...     print(error.message.partition(" - ")[0])
    block: floor: computer algebra fails at a law (TypeError: Invalid NaN comparison)
    """
    try:
        yield
    except _FAILURES as error:
        raise DerivationError(
            f"{where}: computer algebra fails at a law ({type(error).__name__}: {error}) - write the law in a simpler "
            "form: no division by zero, and no condition without a variable",
            where=(where,),
        ) from error
