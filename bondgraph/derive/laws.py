"""What the laws of elements are: their slopes, whether they are linear, and their inverse where it has closed form."""

from __future__ import annotations

import functools

import sympy
from sympy import Add, Expr, Integer, Mul, Piecewise, Pow, Symbol

from bondgraph.derive.zero import is_zero

_STEPS = (sympy.sign, sympy.floor, sympy.ceiling)


@functools.lru_cache(maxsize=8192)
def slope(law: Expr, own: Symbol) -> Expr:
    """Derivative of a law with respect to one of its variables.

    All quantities are real: a step has the slope zero and a kink that of one of its sides, where sympy's own rule for
    complex arguments gives Dirac pulses.

    Examples
    --------
    >>> v, k = sympy.symbols("v k", real=True)
    >>> slope(k * sympy.sign(v) * v**2, v)
    2*k*v*sign(v)
    """
    if own not in law.free_symbols:
        return Integer(0)
    if law == own:
        return Integer(1)
    if isinstance(law, _STEPS):
        return Integer(0)
    if isinstance(law, Add):
        return Add(*(slope(term, own) for term in law.args))
    if isinstance(law, Mul):
        factors = law.args
        parts = [(index, slope(factor, own)) for index, factor in enumerate(factors) if own in factor.free_symbols]
        return Add(*(Mul(*factors[:index], part, *factors[index + 1 :]) for index, part in parts if part != 0))
    if isinstance(law, Pow):
        return _slope_of_power(law, own)
    if isinstance(law, Piecewise):
        return Piecewise(*((slope(value, own), condition) for value, condition in law.args))
    parts = [(index, slope(argument, own)) for index, argument in enumerate(law.args, start=1)]
    return Add(*(law.fdiff(index) * part for index, part in parts if part != 0))


def _slope_of_power(law: Pow, own: Symbol) -> Expr:
    base, exponent = slope(law.base, own), slope(law.exp, own)
    parts = [law.exp * law.base ** (law.exp - 1) * base] if base != 0 else []
    if exponent != 0:
        parts.append(law * sympy.log(law.base) * exponent)
    return Add(*parts)


def linear_coefficient(law: Expr, own: Symbol) -> Expr | None:
    """The coefficient a of a law ``a*own``, or None where the law is not linear and homogeneous in ``own``.

    Examples
    --------
    >>> b, flow = sympy.symbols("b flow", real=True)
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
    >>> k, q0, q = sympy.symbols("k q0 displacement", real=True)
    >>> affine_parts(k * (q - q0), q)
    (k, -k*q0)
    """
    a = slope(law, own)
    if own in a.free_symbols:
        if not a.is_rational_function(own) or not is_zero(slope(a, own)):
            return None
        a = sympy.cancel(a)
    if a == 0:
        return None
    return a, law.xreplace({own: Integer(0)})


def solve_for(equation: Expr, own: Symbol) -> Expr | None:
    """The one value of ``own`` at which an expression vanishes, or None where that has no closed form or is not unique.

    The equation is linear in it, or rational with a numerator of the first degree.

    Examples
    --------
    >>> e, f, r, k = sympy.symbols("e f r k", real=True)
    >>> solve_for(e - r * f, f)
    e/r
    >>> solve_for(f - e / (r + k * e), e)
    -f*r/(f*k - 1)
    >>> solve_for(e - f**2, f) is None
    True
    """
    parts = affine_parts(equation, own)
    if parts is not None:
        return -parts[1] / parts[0]
    if not equation.is_rational_function(own) or equation.is_polynomial(own):
        return None
    above = sympy.Poly(sympy.fraction(sympy.together(equation))[0], own)
    while (
        above.degree() > 1 and above.nth(0) == 0 and any(power.exp.is_negative for power in _powers_of(equation, own))
    ):
        above = above.exquo(sympy.Poly(own, own))  # zero is no solution where the equation divides by the unknown
    if above.degree() != 1:
        return None
    slope_of, constant = above.all_coeffs()
    return -constant / slope_of


def _powers_of(equation: Expr, own: Symbol) -> list[Pow]:
    return [power for power in equation.atoms(Pow) if power.base == own]


def inverse(law: Expr, own: Symbol, given: Symbol) -> Expr | None:
    """``own`` as a function of the value ``given`` of a law, or None where that has no closed form or is not unique.

    Examples
    --------
    >>> b, flow, effort = sympy.symbols("b flow effort", real=True)
    >>> inverse(b * flow, flow, effort)
    effort/b
    """
    return solve_for(law - given, own)
