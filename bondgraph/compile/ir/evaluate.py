"""Run a program in numpy, for one point or a batch: what kernels are compared with, and what serves without numba."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.compile.ir.tape import FUNCTIONS, Operation, Program

_DIRECT: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in (*FUNCTIONS, "minimum", "maximum", "arctan2", "where")},
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": np.divide,
    "neg": operator.neg,
    "pow": np.power,
    **{name: getattr(operator, name) for name in ("lt", "le", "gt", "ge", "eq", "ne")},
    "and": np.logical_and,
    "or": np.logical_or,
    "not": np.logical_not,
}


def evaluate(program: Program, leaves: Mapping[str, Any], solvers: Mapping[str, Callable[..., Any]]) -> list[Any]:
    """Values of the results of a program.

    Parameters
    ----------
    program
        What to run.
    leaves
        Vectors by name, each indexed by position: arrays (rows, *batch).
    solvers
        The functions of the module, which solve its algebraic loops.

    Returns
    -------
    list
        One number or array (*batch) per result.

    Examples
    --------
    >>> from bondgraph.compile.ir.tape import Tape
    >>> tape = Tape()
    >>> square = tape.power(tape.leaf("x", 0), 2.0)
    >>> [float(value) for value in evaluate(tape.program([square]), {"x": np.array([3.0])}, {})]
    [9.0]
    """
    values: list[Any] = []
    with np.errstate(all="ignore"):
        for operation in program.operations:
            arguments = [values[argument] for argument in operation.arguments]
            values.append(_run(program, operation, arguments, leaves, solvers))
    return [values[result] for result in program.results]


def _run(
    program: Program,
    operation: Operation,
    arguments: Sequence[Any],
    leaves: Mapping[str, Any],
    solvers: Mapping[str, Callable[..., Any]],
) -> Any:
    kind, value = operation.kind, operation.value
    if kind == "constant":
        return value
    if kind == "leaf":
        vector, position = value
        return leaves[vector][position]
    if kind == "search":
        return np.searchsorted(program.arrays[str(value)], arguments[0], side="right")
    if kind == "offset":
        return arguments[0] + value
    if kind == "gather":
        return program.arrays[str(value)][tuple(arguments)]
    if kind == "solve":
        solved = solvers[value[0]](*arguments)
        return solved if isinstance(solved, tuple) else (solved,)
    if kind == "item":
        return arguments[0][value]
    return _DIRECT[kind](*arguments)


def stack_rows(values: Sequence[Any], batch: tuple[int, ...]) -> FloatArray:
    """Results, each a number or of the batch shape, as one array (rows, *batch)."""
    rows = np.empty((len(values), *batch))
    for i, value in enumerate(values):
        rows[i] = value
    return rows
