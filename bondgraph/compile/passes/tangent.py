"""Derivatives of programs by forward differentiation, operation by operation.

Every node carries its derivative in one direction; a node that does not depend on the direction carries none, so that
nothing which is zero is written. The derivatives are nodes of the same tape and may be differentiated again. An
algebraic loop r(z, a) = 0 follows from the implicit function theorem,

    dr/dz * dz = -dr/da * da,

with the residuals taken from the text of the function that solves it. At a kink (``abs``, ``minimum``, ``maximum``,
``where``) the derivative is that of the branch taken; a step has derivative zero. Griewank and Walther (2008),
Evaluating Derivatives, chapters 3 and 15.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from bondgraph.compile.front.parse import Reader
from bondgraph.compile.ir.tape import Operation, Tape, reachable

#: Derivatives of nodes in one direction; a node that is not in it has none.
Derivatives = dict[int, int]


def tangents(reader: Reader, results: Sequence[int], seeds: Mapping[int, int]) -> tuple[int, ...]:
    """Derivatives of nodes in the direction in which each seed has the given derivative.

    Parameters
    ----------
    reader
        The tape, and the functions of its module for algebraic loops.
    results
        Nodes to differentiate.
    seeds
        Derivative (a node) of each node that moves, such as 1 for one state.

    Returns
    -------
    tuple[int, ...]
        One node per result, the constant 0 where it does not move.
    """
    derivatives: Derivatives = dict(seeds)
    _sweep(reader, results, derivatives)
    zero = reader.tape.constant(0.0)
    return tuple(derivatives.get(node, zero) for node in results)


def _sweep(reader: Reader, results: Sequence[int], derivatives: Derivatives) -> None:
    """Fill in the derivatives of all that the results need; what is there already is kept."""
    tape = reader.tape
    moving = set(derivatives)
    for node in reachable(tape.operations, results, stop=moving):
        operation = tape.operations[node]
        if node in derivatives or not any(argument in derivatives for argument in operation.arguments):
            continue
        if operation.kind == "solve":  # the derivative belongs to its items
            derivatives[node] = node
            continue
        if operation.kind == "item":
            _differentiate_loop(reader, operation.arguments[0], derivatives)
            continue
        found = _rule(tape, operation, node, derivatives)
        if not tape.is_zero(found):
            derivatives[node] = found


def _differentiate_loop(reader: Reader, call: int, derivatives: Derivatives) -> None:
    """Derivatives of all unknowns of a loop."""
    tape = reader.tape
    solver = reader.solvers[tape.operations[call].value[0]]
    arguments = tape.operations[call].arguments
    unknowns = tape.solve(solver.name, arguments, solver.unknowns)
    residuals = reader.residuals(solver, unknowns, arguments[solver.unknowns :])
    zero, one = tape.constant(0.0), tape.constant(1.0)
    fixed = {node: derivative for node, derivative in derivatives.items() if node != call}
    fixed.update(dict.fromkeys(unknowns, zero))
    right = [tape.neg(part) for part in tangents(reader, residuals, fixed)]
    columns = [
        tangents(reader, residuals, {other: one if other == unknown else zero for other in unknowns})
        for unknown in unknowns
    ]
    if all(tape.is_zero(part) for part in right):
        solution: Sequence[int] = [zero for _ in unknowns]
    else:
        solution = _solve_linear(tape, [list(row) for row in zip(*columns, strict=True)], right)
    derivatives.update(zip(unknowns, solution, strict=True))


def _solve_linear(tape: Tape, matrix: list[list[int]], right: list[int]) -> list[int]:
    """Solution of a small system by Gaussian elimination with the largest pivot first."""
    size = len(right)
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for k in range(size):
        for i in range(k + 1, size):
            larger = tape.compare("gt", tape.function("abs", rows[i][k]), tape.function("abs", rows[k][k]))
            pairs = [
                (tape.where(larger, b, a), tape.where(larger, a, b)) for a, b in zip(rows[k], rows[i], strict=True)
            ]
            rows[k], rows[i] = [a for a, _ in pairs], [b for _, b in pairs]
        for i in range(k + 1, size):
            factor = tape.div(rows[i][k], rows[k][k])
            rows[i] = [tape.sub(b, tape.mul(factor, a)) for a, b in zip(rows[k], rows[i], strict=True)]
    solution = [0] * size
    for i in reversed(range(size)):
        total = rows[i][size]
        for j in range(i + 1, size):
            total = tape.sub(total, tape.mul(rows[i][j], solution[j]))
        solution[i] = tape.div(total, rows[i][i])
    return solution


def _rule(tape: Tape, operation: Operation, node: int, derivatives: Derivatives) -> int:
    """Derivative of one operation."""
    zero = tape.constant(0.0)
    moves = [derivatives.get(argument, zero) for argument in operation.arguments]
    choice = _CHOICES.get(operation.kind)
    if choice is not None:
        return choice(tape, operation.arguments, moves)
    total = zero
    for slope, move in zip(_SLOPES[operation.kind], moves, strict=True):
        if not tape.is_zero(move):
            total = tape.add(total, tape.mul(slope(tape, operation.arguments, node), move))
    return total


Choice = Callable[[Tape, Sequence[int], Sequence[int]], int]
Slope = Callable[[Tape, Sequence[int], int], int]


def _chosen(kind: str) -> Choice:
    return lambda tape, a, d: tape.where(tape.compare(kind, a[0], a[1]), d[0], d[1]) if d[0] != d[1] else d[0]


def _none(tape: Tape, arguments: Sequence[int], moves: Sequence[int]) -> int:
    return tape.constant(0.0)


#: Derivatives that are not a sum of slopes times derivatives.
_CHOICES: dict[str, Choice] = {
    "add": lambda tape, a, d: tape.add(d[0], d[1]),
    "sub": lambda tape, a, d: tape.sub(d[0], d[1]),
    "neg": lambda tape, a, d: tape.neg(d[0]),
    "where": lambda tape, a, d: tape.where(a[0], d[1], d[2]),
    "minimum": _chosen("le"),
    "maximum": _chosen("ge"),
    **dict.fromkeys(
        ("sign", "floor", "search", "offset", "gather", "lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not"), _none
    ),
}


def _one_minus_square(tape: Tape, node: int) -> int:
    return tape.sub(1.0, tape.mul(node, node))


def _one_plus_square(tape: Tape, node: int) -> int:
    return tape.add(1.0, tape.mul(node, node))


def _norm(tape: Tape, a: Sequence[int]) -> int:
    return tape.add(tape.mul(a[0], a[0]), tape.mul(a[1], a[1]))


#: Slopes of an operation with respect to each argument, given the arguments and the operation's own node.
_SLOPES: dict[str, tuple[Slope, ...]] = {
    "mul": (lambda tape, a, y: a[1], lambda tape, a, y: a[0]),
    "div": (lambda tape, a, y: tape.div(1.0, a[1]), lambda tape, a, y: tape.neg(tape.div(y, a[1]))),
    "pow": (
        lambda tape, a, y: tape.mul(a[1], tape.power(a[0], tape.sub(a[1], 1.0))),
        lambda tape, a, y: tape.mul(y, tape.function("log", a[0])),
    ),
    "tanh": (lambda tape, a, y: _one_minus_square(tape, y),),
    "sin": (lambda tape, a, y: tape.function("cos", a[0]),),
    "cos": (lambda tape, a, y: tape.neg(tape.function("sin", a[0])),),
    "tan": (lambda tape, a, y: _one_plus_square(tape, y),),
    "arcsin": (lambda tape, a, y: tape.div(1.0, tape.function("sqrt", _one_minus_square(tape, a[0]))),),
    "arccos": (lambda tape, a, y: tape.div(-1.0, tape.function("sqrt", _one_minus_square(tape, a[0]))),),
    "arctan": (lambda tape, a, y: tape.div(1.0, _one_plus_square(tape, a[0])),),
    "arctan2": (
        lambda tape, a, y: tape.div(a[1], _norm(tape, a)),
        lambda tape, a, y: tape.neg(tape.div(a[0], _norm(tape, a))),
    ),
    "sinh": (lambda tape, a, y: tape.function("cosh", a[0]),),
    "cosh": (lambda tape, a, y: tape.function("sinh", a[0]),),
    "arcsinh": (lambda tape, a, y: tape.div(1.0, tape.function("sqrt", _one_plus_square(tape, a[0]))),),
    "arccosh": (lambda tape, a, y: tape.div(1.0, tape.function("sqrt", tape.sub(tape.mul(a[0], a[0]), 1.0))),),
    "arctanh": (lambda tape, a, y: tape.div(1.0, _one_minus_square(tape, a[0])),),
    "exp": (lambda tape, a, y: y,),
    "log": (lambda tape, a, y: tape.div(1.0, a[0]),),
    "sqrt": (lambda tape, a, y: tape.div(0.5, y),),
    "abs": (lambda tape, a, y: tape.function("sign", a[0]),),
}
