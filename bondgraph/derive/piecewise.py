"""Loops whose laws are straight between kinks: solved branch by branch in closed form, without iteration.

A loop of one unknown whose laws are affine but for ``minimum``, ``maximum`` and ``Abs`` (a clutch that the weaker side
limits, a stop, a preload) has one candidate per combination of branches, the root of a straight line. The candidate at
which the equation with all its kinks holds is the solution. Newton's method may cycle between the branches of such a
loop for ever, as it does where a branch has a gain above one.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

from sympy import Abs, Add, Expr, Integer, Mul, Piecewise, Rational, Symbol

from bondgraph.declare.functions import maximum, minimum
from bondgraph.derive.size import is_small

#: Loops with more combinations of branches than this are left to an iteration.
_MOST_BRANCHES = 8

#: A candidate gives way to another whose remainder is smaller than its own by this factor. The remainder of a root is
#: rounding; where two candidates are both roots (at a kink, where they coincide) the first is kept.
_CLEARLY_BETTER = Rational(1, 10**6)

#: Gives an expression a name, if it deserves one: ``name_it(value, hint)``.
Namer = Callable[[Expr, str], Expr]

_Line = tuple[Expr, Expr]


def lines_of(law: Expr, own: Symbol) -> tuple[_Line, ...] | None:
    """The straight lines ``(slope, constant)`` that a law follows between its kinks; None where it has other parts.

    Examples
    --------
    >>> a, b, x = (Symbol(name, real=True) for name in "abx")
    >>> lines_of(minimum(a, b * maximum(x, 0)), x)
    ((0, a), (b, 0), (0, 0))
    >>> lines_of(x**3, x) is None
    True
    """
    found = _lines(law, own)
    return None if found is None else tuple(dict.fromkeys(found))


def _lines(law: Expr, own: Symbol) -> list[_Line] | None:
    if own not in law.free_symbols:
        return [(Integer(0), law)]
    if law == own:
        return [(Integer(1), Integer(0))]
    if isinstance(law, minimum | maximum | Abs):
        parts = [_lines(argument, own) for argument in law.args]
        lines = [line for part in parts if part is not None for line in part]
        if any(part is None for part in parts):
            return None
        return lines if len(law.args) == 2 else [*lines, *((-a, -b) for a, b in lines)]
    if isinstance(law, Add):
        return _combined(law, own)
    if isinstance(law, Mul):
        factor, rest = law.as_independent(own, as_Add=False)
        inner = None if isinstance(rest, Mul) else _lines(rest, own)
        return None if inner is None else [(factor * a, factor * b) for a, b in inner]
    return None


def _combined(law: Add, own: Symbol) -> list[_Line] | None:
    constant, rest = law.as_independent(own, as_Add=True)
    parts = [_lines(term, own) for term in Add.make_args(rest)]
    combinations = 1
    for part in parts:
        if part is None:
            return None
        combinations *= len(part)
    if combinations > _MOST_BRANCHES:
        return None
    chosen = itertools.product(*(part for part in parts if part is not None))
    return [(Add(*(a for a, _ in terms)), Add(constant, *(b for _, b in terms))) for terms in chosen]


def solve_piecewise(law: Expr, own: Symbol, name_it: Namer) -> Expr | None:
    """The solution of ``own = law(own)`` for a law that is straight between kinks, or None for other laws.

    ``name_it`` may give names to the candidates and to what remains of the equation at each of them. Where the gain of
    the loop exceeds one on both sides of a kink there may be several solutions; the first in the order of the law's
    branches is taken, those that do not depend on the unknown coming before the others.

    Examples
    --------
    >>> a, b, c, x = (Symbol(name, real=True) for name in "abcx")
    >>> steps = []
    >>> def name_it(value, hint):
    ...     steps.append(f"{hint} = {value}")
    ...     return Symbol(hint, real=True)
    >>> solve_piecewise(minimum(a, b + c * x), x, name_it)
    Piecewise((branch_2, remainder_2 < remainder_1/1000000), (branch_1, True))
    >>> steps[:2]
    ['branch_1 = a', 'remainder_1 = Abs(branch_1 - minimum(a, b + branch_1*c))']
    """
    if not _is_straight_between_kinks(law, own):
        return None
    law = _with_names(law, own, name_it)
    lines = lines_of(law, own) or ()
    roots = [constant / (1 - slope) for slope, constant in sorted(lines, key=lambda line: line[0] != 0)]
    candidates = list(dict.fromkeys(roots))
    best = remainder = Integer(0)
    for number, root in enumerate(candidates, start=1):
        candidate = name_it(root, f"branch_{number}")
        left = name_it(Abs(law.xreplace({own: candidate}) - candidate), f"remainder_{number}")
        if number == 1:
            best, remainder = candidate, left
            continue
        better = left < remainder * _CLEARLY_BETTER
        best = Piecewise((candidate, better), (best, True))
        if number < len(candidates):
            best = name_it(best, f"best_of_{number}")
            remainder = name_it(Piecewise((left, better), (remainder, True)), f"least_of_{number}")
    return best


def _is_straight_between_kinks(law: Expr, own: Symbol) -> bool:
    lines = lines_of(law, own)
    return lines is not None and 2 <= len(lines) <= _MOST_BRANCHES and all(slope != 1 for slope, _ in lines)


def _with_names(law: Expr, own: Symbol, name_it: Namer) -> Expr:
    """The law with names for what does not depend on the unknown, which every branch would repeat."""
    given: dict[Expr, Expr] = {}

    def part(value: Expr) -> Expr:
        if is_small(value) or value.is_Number:
            return value
        if value not in given:
            given[value] = name_it(value, f"part_{len(given) + 1}")
        return given[value]

    def rebuilt(value: Expr) -> Expr:
        if own not in value.free_symbols:
            return part(value)
        if isinstance(value, Add | Mul):
            fixed, rest = value.as_independent(own, as_Add=isinstance(value, Add))
            return value.func(part(fixed), *(rebuilt(term) for term in value.func.make_args(rest)))
        return value.func(*(rebuilt(argument) for argument in value.args)) if value.args else value

    return rebuilt(law)
