"""Integrals of laws in closed form, for the energy that a storage holds."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import sympy
from scipy.interpolate import PchipInterpolator
from sympy import Abs, Add, Expr, Mul, Piecewise, Pow, Rational, Symbol

from bondgraph.declare.expressions import FUNCTIONS
from bondgraph.declare.floats import float_value
from bondgraph.declare.functions import TableFunction, maximum, minimum, switch
from bondgraph.declare.quantities import Table
from bondgraph.derive.definitions import ZERO
from bondgraph.derive.jacobian import gradient


def integral(law: Expr, own: Symbol, tables: Mapping[str, Table] | None = None) -> Expr | None:
    """The integral of a law over its own variable from zero, real where the law is; None where it has no closed form.

    Tables of one argument are integrated exactly, interval by interval, where their declaration is given.

    Examples
    --------
    >>> from bondgraph.declare.quantities import symbol
    >>> k, q, a = symbol("k"), symbol("displacement"), symbol("a")
    >>> integral(k * q + a * q**3, q)
    a*displacement**4/4 + displacement**2*k/2
    >>> integral(k * maximum(q - a, 0), q)
    -k*maximum(-a, 0)**2/2 + k*maximum(-a + displacement, 0)**2/2
    """
    terms = [_term(term, own, tables or {}) for term in Add.make_args(sympy.expand(law, deep=False))]
    if any(term is None for term in terms):
        return None
    whole = Add(*terms)
    start = whole.xreplace({own: ZERO})
    return whole - start if not start.has(sympy.nan, sympy.oo, -sympy.oo, sympy.zoo) else whole


def line_integral(laws: Sequence[Expr], own: Sequence[Symbol]) -> Expr | None:
    """The energy of a field along a path that raises one variable after the other."""
    parts = []
    for i, (law, variable) in enumerate(zip(laws, own, strict=True)):
        part = integral(law.xreplace(dict.fromkeys(own[i + 1 :], ZERO)), variable)
        if part is None:
            return None
        parts.append(part)
    return Add(*parts)


def _term(term: Expr, own: Symbol, tables: Mapping[str, Table]) -> Expr | None:
    factor, rest = term.as_independent(own, as_Add=False)
    known = _tabulated(rest, own, tables) if isinstance(rest, TableFunction) else _known(rest, own)
    if known is None and not rest.has(TableFunction, switch, minimum, maximum):
        known = _by_sympy(rest, own)
    return None if known is None else factor * known


def _tabulated(rest: Expr, own: Symbol, tables: Mapping[str, Table]) -> Expr | None:
    """The integral of a table: a polynomial between each two points, straight lines beyond the ends."""
    argument = rest.args[0]
    slope = gradient(argument, {own}).get(own, ZERO)
    if (
        own in slope.free_symbols
        or slope == 0
        or len(rest.args) > 1
        or rest.derivative
        or rest.table_name not in tables
    ):
        return None
    table = tables[rest.table_name]
    whole = PchipInterpolator(table.x, table.values).antiderivative()
    beyond = float(table.values[0]) * (argument - table.x[0]), float(whole(table.x[-1]))  # type: ignore[arg-type]
    parts = [(beyond[0], argument < table.x[0])]
    for start, end, coefficients in zip(table.x, table.x[1:], whole.c.T, strict=False):
        terms = (float(c) * (argument - start) ** k for k, c in enumerate(reversed(coefficients)))
        parts.append((Add(*terms), argument < end))
    last = beyond[1] + float(table.values[-1]) * (argument - table.x[-1])  # type: ignore[arg-type]
    return Piecewise(*parts, (last, True)) / slope


def _known(rest: Expr, own: Symbol) -> Expr | None:
    """Integrals of the functions that laws are made of, in arguments that are linear in the variable."""
    if rest == 1:
        return own
    inner = next((node for node in sympy.preorder_traversal(rest) if _is_function(node, own)), None)
    if inner is None:
        return own ** (rest.exp + 1) / (rest.exp + 1) if _is_power(rest, own) else (own**2 / 2 if rest == own else None)
    argument = next(part for part in inner.args if own in part.free_symbols)
    slope = gradient(argument, {own}).get(own, ZERO)
    if own in slope.free_symbols or slope == 0:
        return None
    u = sympy.Dummy(real=True)
    found = _in_argument(rest.xreplace({argument: u}).xreplace({-argument: -u}), u, own)
    return None if found is None else found.xreplace({u: argument}) / slope


def _is_function(node: Expr, own: Symbol) -> bool:
    kinds = (*_ANTIDERIVATIVES, Abs, sympy.sign, minimum, maximum)
    return isinstance(node, kinds) and own in node.free_symbols


def _is_power(rest: Expr, own: Symbol) -> bool:
    return isinstance(rest, Pow) and rest.base == own and rest.exp.is_Number and rest.exp != -1


_ANTIDERIVATIVES: dict[Any, Callable[[Expr], Expr]] = {
    sympy.sin: lambda u: -sympy.cos(u),
    sympy.cos: sympy.sin,
    sympy.tan: lambda u: -sympy.log(Abs(sympy.cos(u))),
    sympy.tanh: lambda u: sympy.log(sympy.cosh(u)),
    sympy.sinh: sympy.cosh,
    sympy.cosh: sympy.sinh,
    sympy.exp: sympy.exp,
    sympy.atan: lambda u: u * sympy.atan(u) - sympy.log(1 + u**2) / 2,
}


def _in_argument(rest: Expr, u: Symbol, own: Symbol) -> Expr | None:
    """The integral of a product of powers of ``u``, ``Abs(u)``, ``sign(u)``, or of one function of ``u``."""
    if own in rest.free_symbols:
        return None
    if type(rest) in _ANTIDERIVATIVES:
        return _ANTIDERIVATIVES[type(rest)](u)
    power, odd = ZERO, False
    for factor in Mul.make_args(rest):
        base, exponent = factor.as_base_exp()
        if u in exponent.free_symbols:
            return None
        if isinstance(base, minimum | maximum):
            return _one_sided(rest, base, exponent, u)
        if base in (u, sympy.sign(u)) and exponent.is_Integer:
            odd ^= bool(exponent % 2)
            power += exponent if base == u else ZERO
        elif base == Abs(u):
            power += exponent
        else:
            return None
    if power == -1:
        return None
    raised = Abs(u) ** (power + 1) / (power + 1)
    return raised if odd else sympy.sign(u) * raised


def _one_sided(rest: Expr, base: Expr, exponent: Expr, u: Symbol) -> Expr | None:
    """Contacts: ``maximum(u, c)`` as ``c + maximum(u - c, 0)``, likewise the minimum."""
    level = base.args[1] if base.args[0] == u else base.args[0]
    if rest != base**exponent or u in level.free_symbols or u not in base.args or exponent == -1:
        return None
    if level != 0 and exponent != 1:
        return None
    above = base.func(u - level, ZERO) ** (exponent + 1) / (exponent + 1)
    return level * u + above if exponent == 1 else above


def _by_sympy(rest: Expr, own: Symbol) -> Expr | None:
    """What sympy's rules integrate, if it is real and its derivative gives the law back."""
    folded = sympy.piecewise_fold(rest) if rest.has(Piecewise) else rest
    try:
        found = sympy.integrate(folded, own, manual=None if rest.has(Piecewise) else True)
    except Exception:  # sympy's integrals and limits raise many kinds where they meet an unknown sign
        return None
    found = found.replace(sympy.log, lambda value: sympy.log(Abs(value)))
    vocabulary = (*(function for function in FUNCTIONS.values() if isinstance(function, type)), Piecewise)
    if found.has(sympy.I, sympy.nan, sympy.Integral):
        return None
    known = all(isinstance(node, vocabulary) for node in found.atoms(sympy.Function))
    return found if known and agree(gradient(found, {own}).get(own, ZERO), rest) else None


def agree(found: Expr, law: Expr) -> bool:
    """Whether an expression equals a law at random points where the law is real and no larger than a float."""
    if found.has(TableFunction) or law.has(TableFunction):
        return False
    draw = random.Random(0)
    symbols = sorted(found.free_symbols | law.free_symbols, key=str)
    for trial in range(8):
        sign = -1 if trial % 2 else 1
        point = {used: sign * Rational(draw.randrange(1, 2000), 1000) for used in symbols}
        if not all(math.isfinite(float_value(part, point)) for part in (found, law)):
            continue
        a, b = (part.xreplace(point).evalf(30) for part in (found, law))
        if b.is_real and b.is_finite and abs(a - b) > (abs(a) + abs(b)) * Rational(1, 10**12):
            return False
    return True
