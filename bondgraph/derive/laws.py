"""What the laws of elements allow: which strokes, whether they are linear, and their inverse where it has closed form."""

from __future__ import annotations

import functools

from sympy import Expr, Integer, Symbol, diff

from bondgraph.declare.elements import Node
from bondgraph.declare.quantities import symbol


@functools.lru_cache(maxsize=4096)
def slope(law: Expr, own: Symbol) -> Expr:
    """Derivative of a law with respect to one of its variables."""
    if own not in law.free_symbols:
        return Integer(0)
    return diff(law, own)


def linear_coefficient(law: Expr, own: Symbol) -> Expr | None:
    """The coefficient a of a law ``a*own``, or None where the law is not linear and homogeneous in ``own``.

    Examples
    --------
    >>> b, flow = symbol("b"), symbol("flow")
    >>> linear_coefficient(b * flow, flow)
    b
    >>> linear_coefficient(flow**3, flow) is None
    True
    """
    factors = law.as_independent(own, as_Add=False)
    return factors[0] if factors[1] == own else None


def affine_parts(law: Expr, own: Symbol) -> tuple[Expr, Expr] | None:
    """``(a, b)`` of a law ``a*own + b``, or None where the law is not affine in ``own``.

    Examples
    --------
    >>> k, q0, q = symbol("k"), symbol("q0"), symbol("displacement")
    >>> affine_parts(k * (q - q0), q)
    (k, -k*q0)
    """
    a = slope(law, own)
    if own in a.free_symbols:
        a = a.simplify()
        if own in a.free_symbols:
            return None
    if a == 0:
        return None
    return a, law.xreplace({own: Integer(0)})


def inverse(law: Expr, own: Symbol, given: Symbol) -> Expr | None:
    """``own`` as a function of the value ``given`` of an affine law, or None.

    Examples
    --------
    >>> inverse(symbol("b") * symbol("flow"), symbol("flow"), symbol("effort"))
    effort/b
    """
    parts = affine_parts(law, own)
    if parts is None:
        return None
    return (given - parts[1]) / parts[0]


def law_strokes(node: Node) -> tuple[bool | None, ...]:
    """For each port of an R: True where its law can only take the effort, False only the flow, None either.

    Examples
    --------
    >>> flow = symbol("flow")
    >>> law_strokes(Node("r", "R", laws=(("effort", flow**3),)))
    (False,)
    >>> law_strokes(Node("r", "R", laws=(("effort", 2 * flow),)))
    (None,)
    """
    if node.kind != "R":
        return (None,) * node.ports
    if node.is_field:
        given = node.laws[0][0]
        fixed = None if given.startswith("residual") else given.startswith("flow")
        return (fixed,) * node.ports
    laws = dict(node.laws)
    if "residual" in laws or len(laws) == 2:
        return (None,)
    given, law = next(iter(laws.items()))
    own = symbol("flow" if given == "effort" else "effort")
    if inverse(law, own, symbol(given)) is not None:
        return (None,)
    return (given == "flow",)
