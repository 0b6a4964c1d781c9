"""Small linear systems solved symbolically."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import sympy
from sympy import Add, Expr, Integer

from bondgraph.derive.definitions import ONE, ZERO
from bondgraph.derive.zero import is_zero

__all__ = ["is_zero", "quotient", "solve_linear"]


def quotient(numerator: Expr, denominator: Expr) -> Expr:
    """``numerator/denominator`` with the fractions inside the denominator cleared.

    Examples
    --------
    >>> tau, J, m, I = sympy.symbols("tau J m I", real=True)
    >>> quotient(tau / J, 1 + m**2 * I / J)
    tau/(I*m**2 + J)
    """
    denominator = sympy.expand(denominator)
    scale = ONE
    for term in Add.make_args(denominator):
        below = (term * scale).as_numer_denom()[1]
        scale = scale * below
    if scale == 1:
        return numerator / denominator
    above = Add(*(term * scale for term in Add.make_args(numerator)))
    return above / Add(*(term * scale for term in Add.make_args(denominator)))


def solve_linear(
    matrix: list[list[Expr]],
    right: list[Expr],
    name_it: Callable[[Expr, str], Expr],
    singular: Callable[[list[int]], Exception],
    is_zero: Callable[[Expr], bool] = is_zero,
) -> list[Expr]:
    """Solve ``matrix x = right`` by elimination, naming intermediate results so that nothing swells.

    Parameters
    ----------
    matrix, right
        Square system of expressions; changed in place.
    name_it
        Turns an intermediate expression into a named one (or leaves a small one alone).
    singular
        Makes the error for the columns that have no pivot.
    is_zero
        Decides whether an entry vanishes; it must know what named results stand for.
    """
    n = len(right)
    rows = list(range(n))
    pivots: list[tuple[int, int]] = []
    for column in range(n):
        candidates = [row for row in rows if matrix[row][column] != 0 and not is_zero(matrix[row][column])]
        if not candidates:
            raise singular([column])
        row = column if column in candidates else min(candidates, key=lambda r: _cost(matrix[r]))
        rows.remove(row)
        pivots.append((row, column))
        _eliminate(matrix, right, row, column, rows, name_it)
    solution: list[Expr] = [ZERO] * n
    for row, column in reversed(pivots):
        known = [
            -matrix[row][other] * solution[other] for other in range(n) if other != column and matrix[row][other] != 0
        ]
        value = quotient(Add(right[row], *known), matrix[row][column])
        solution[column] = name_it(value, f"solution_{column}") if n > 1 else value
    return solution


def _eliminate(
    matrix: list[list[Expr]],
    right: list[Expr],
    row: int,
    column: int,
    rows: Sequence[int],
    name_it: Callable[[Expr, str], Expr],
) -> None:
    n = len(right)
    for other in rows:
        if matrix[other][column] == 0:
            continue
        ratio = name_it(quotient(matrix[other][column], matrix[row][column]), f"ratio_{other}_{column}")
        for k in range(column + 1, n):
            if matrix[row][k] != 0:
                matrix[other][k] = name_it(matrix[other][k] - ratio * matrix[row][k], f"pivot_{other}_{k}")
        matrix[other][column] = Integer(0)
        right[other] = name_it(right[other] - ratio * right[row], f"right_{other}_{column}")


def _cost(row: Sequence[Expr]) -> int:
    return sum(entry != 0 for entry in row)
