"""Symbolic LU factors of a sparse matrix: the order of elimination and the straight-line operations.

For Rosenbrock methods, W = g I - J with g = 1/(gamma h). Pivots stay on the diagonal, which for small steps is the
largest of its row and column; the next pivot is the one that can fill in least (Markowitz 1957, Management Science
3(3)). A pivot that has lost all its digits makes the result nan, which the caller sees as a failed step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bondgraph.compile.ir.tape import Tape

#: A pivot below this share of the diagonal element it started from is rounding error.
_PIVOT = 1e-14

Entries = dict[tuple[int, int], int]


@dataclass(frozen=True)
class SparseFactors:
    """Factors of a matrix as nodes: below the diagonal L (unit diagonal), above it U, and the inverses of U's diagonal.

    ``order`` (n,) is the order of elimination; ``entries`` are by row and column of the matrix itself.
    """

    order: tuple[int, ...]
    entries: Mapping[tuple[int, int], int]
    inverse_pivots: Mapping[int, int]


def elimination_order(size: int, places: Sequence[tuple[int, int]]) -> tuple[int, ...]:
    """Order of diagonal pivots that fills in little: least (row entries - 1) (column entries - 1) first.

    Examples
    --------
    >>> elimination_order(3, [(0, 1), (1, 0), (0, 2), (2, 0)])
    (1, 0, 2)
    """
    rows: dict[int, set[int]] = {i: {i} for i in range(size)}
    for row, column in places:
        rows[row].add(column)
    order = []
    while rows:
        columns = {k: {i for i in rows if k in rows[i]} for k in rows}
        pivot = min(rows, key=lambda k: ((len(rows[k] & rows.keys()) - 1) * (len(columns[k]) - 1), k))
        order.append(pivot)
        for i in columns[pivot] - {pivot}:
            rows[i] |= rows[pivot]
        del rows[pivot]
    return tuple(order)


def factorise(tape: Tape, size: int, jacobian: Mapping[tuple[int, int], int], diagonal: int) -> SparseFactors:
    """Factors of ``diagonal`` I - J.

    Parameters
    ----------
    tape
        Where the operations go.
    size
        Rows of the matrix.
    jacobian
        Nodes of the entries of J that are not zero.
    diagonal
        Node of g.
    """
    order = elimination_order(size, list(jacobian))
    entries: Entries = {place: tape.neg(node) for place, node in jacobian.items()}
    for k in range(size):
        entries[k, k] = tape.sub(diagonal, jacobian[k, k]) if (k, k) in jacobian else diagonal
    started = {k: entries[k, k] for k in range(size)}
    inverse: dict[int, int] = {}
    for step, k in enumerate(order):
        inverse[k] = _guarded_inverse(tape, entries[k, k], started[k])
        later = order[step + 1 :]
        for i in later:
            if (i, k) not in entries:
                continue
            entries[i, k] = tape.mul(entries[i, k], inverse[k])
            for j in later:
                if (k, j) in entries:
                    change = tape.mul(entries[i, k], entries[k, j])
                    entries[i, j] = tape.sub(entries[i, j], change) if (i, j) in entries else tape.neg(change)
    return SparseFactors(order, {place: node for place, node in entries.items() if place[0] != place[1]}, inverse)


def substitute(tape: Tape, factors: SparseFactors, right: Sequence[int]) -> list[int]:
    """Solution of the factored system for a right-hand side, as nodes."""
    order, entries = factors.order, factors.entries
    values = list(right)
    for step, i in enumerate(order):
        for j in order[:step]:
            if (i, j) in entries:
                values[i] = tape.sub(values[i], tape.mul(entries[i, j], values[j]))
    for step in reversed(range(len(order))):
        i = order[step]
        for j in order[step + 1 :]:
            if (i, j) in entries:
                values[i] = tape.sub(values[i], tape.mul(entries[i, j], values[j]))
        values[i] = tape.mul(values[i], factors.inverse_pivots[i])
    return values


def _guarded_inverse(tape: Tape, pivot: int, started: int) -> int:
    """1/pivot, nan where the pivot has lost its digits."""
    inverse = tape.div(1.0, pivot)
    if pivot == started:
        return inverse
    size = tape.mul(tape.function("abs", started), _PIVOT)
    usable = tape.compare("gt", tape.function("abs", pivot), size)
    return tape.where(usable, inverse, float("nan"))
