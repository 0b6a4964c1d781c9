"""Equations of a model as CasADi functions, for optimal control and other derivative-based tools."""

from __future__ import annotations

from typing import Any

import numpy as np

from bondgraph.compile.ir.tape import FUNCTIONS, Operation, Program
from bondgraph.errors import GenerationError, require_kind
from bondgraph.exchange.libraries import library
from bondgraph.simulate.model import Model
from bondgraph.text import inflected


def to_casadi(model: Model) -> tuple[Any, Any]:
    """CasADi functions ``rhs(t, x, u, theta)`` and ``output(t, x, u, theta)`` of a model, in its units.

    Parameters
    ----------
    model
        The model; tables and smooth laws are taken as they are, and derivatives by CasADi are exact.

    Raises
    ------
    GenerationError
        If CasADi is not installed, the model has modes, or an algebraic loop without closed form.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = pendulum()
    >>> rhs, output = to_casadi(swing)
    >>> rhs(0.0, [0.1, 0.0], [0.0], swing.theta()).full().ravel().round(4).tolist()
    [0.0, -0.9794]
    """
    require_kind("to_casadi", model, Model, "model")
    casadi = library("casadi", "casadi")
    if model.modes:
        raise GenerationError(
            f"{model.name}: modes have no smooth function - derive the graph smooth (without --exact)",
            where=(model.name,),
        )
    program = model.program.anew()
    loops = program.reader.solvers
    if loops:
        raise GenerationError(
            f"{model.name}: the algebraic {inflected(loops, 'loop', 'loops')} {', '.join(loops)} "
            f"{inflected(loops, 'is', 'are')} solved by iteration, which has no form in CasADi"
            " - export C, or break the loop by a small storage",
            where=(model.name,),
        )
    t = casadi.SX.sym("t")
    sizes = {"x": len(model.states), "u": len(model.inputs), "theta": len(model.parameters)}
    vectors = {name: casadi.SX.sym(name, size) for name, size in sizes.items()}
    leaves = {**vectors, "t": t}
    arguments = [t, *vectors.values()]
    made = []
    for name, rows, result in (("rhs", program.rows["rhs"], "dx"), ("output", program.rows["output"], "y")):
        values = _values(casadi, program.tape.program(rows), leaves)
        made.append(casadi.Function(name, arguments, [casadi.vertcat(*values)], ["t", *vectors], [result]))
    return made[0], made[1]


def _values(casadi: Any, program: Program, leaves: dict[str, Any]) -> list[Any]:
    values: list[Any] = []
    for operation in program.operations:
        values.append(_value(casadi, program, operation, [values[k] for k in operation.arguments], leaves))
    return [values[result] for result in program.results]


def _value(casadi: Any, program: Program, operation: Operation, given: list[Any], leaves: dict[str, Any]) -> Any:
    kind, value = operation.kind, operation.value
    if kind == "constant":
        return casadi.SX(value)
    if kind == "leaf":
        return leaves[value[0]][value[1]]
    if kind == "search":
        return sum((casadi.if_else(given[0] < knot, 0, 1) for knot in program.arrays[value]), casadi.SX(0))
    if kind == "offset":
        return given[0] + value
    if kind == "gather":
        return _picked(casadi, program.arrays[value], given)
    names = {"abs": "fabs", "minimum": "fmin", "maximum": "fmax", "arctan2": "atan2", "and": "logic_and",
             "or": "logic_or", "not": "logic_not", "where": "if_else"}  # fmt: skip
    infix = {"add": "__add__", "sub": "__sub__", "mul": "__mul__", "div": "__truediv__", "pow": "__pow__",
             "neg": "__neg__", "lt": "__lt__", "le": "__le__", "gt": "__gt__", "ge": "__ge__", "eq": "__eq__",
             "ne": "__ne__"}  # fmt: skip
    if kind in infix:
        return getattr(given[0], infix[kind])(*given[1:])
    inverse = kind.replace("arc", "a") if kind in FUNCTIONS else kind
    return getattr(casadi, names.get(kind, inverse))(*given)


def _picked(casadi: Any, numbers: np.ndarray[Any, np.dtype[np.float64]], indices: list[Any]) -> Any:
    """The element of a table at indices that are expressions, without branches."""
    found = casadi.SX(0)
    for place in np.ndindex(numbers.shape):
        here = casadi.SX(1)
        for index, wanted in zip(indices, place, strict=True):
            here = here * casadi.if_else(index == wanted, 1, 0)
        found = found + here * float(numbers[place])
    return found
