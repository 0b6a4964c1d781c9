"""How long an expression is: what may be repeated, and what deserves a name."""

from __future__ import annotations

from sympy import Expr


def is_small(value: Expr) -> bool:
    """Whether repeating an expression is clearer than naming it.

    Examples
    --------
    >>> import sympy
    >>> a, b = sympy.symbols("a b", real=True)
    >>> is_small(-a), is_small(1 / a), is_small(a / b), is_small(a * b + b)
    (True, True, False, False)
    """
    if value.is_Atom:
        return True
    if value.is_Pow and value.exp == -1:  # a modulus 1/a divides as a product with a, also where a is zero
        return bool(value.base.is_Atom)
    return bool(value.is_Mul and len(value.args) == 2 and value.args[0] == -1 and value.args[1].is_Atom)


def is_long(value: Expr, limit: int = 40) -> bool:
    """Whether an expression has more parts than a reader takes in, so that a part of it deserves a name.

    Examples
    --------
    >>> import sympy
    >>> many = sympy.symbols("a:40", real=True)
    >>> is_long(many[0] + 1), is_long(sum(a**2 for a in many))
    (False, True)
    """
    count, stack = 0, [value]
    while stack and count <= limit:
        count += 1
        stack.extend(stack.pop().args)
    return count > limit
