"""Equations of a model as C: the operations of its tape, one line each, with the loops that solve algebraic loops.

The tape is the list of assignments from which kernels are printed too, so that this text computes the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from bondgraph.compile.front.model_program import ModelProgram
from bondgraph.compile.front.solver import LoopPrograms, loop_programs
from bondgraph.compile.ir.tape import TRUTHS, Operation, Program
from bondgraph.errors import GenerationError, require_kind
from bondgraph.simulate.model import Model

_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/", "lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==",
          "ne": "!=", "and": "&&", "or": "||"}  # fmt: skip
_CALLS = {"tanh": "tanh", "sin": "sin", "cos": "cos", "tan": "tan", "arcsin": "asin", "arccos": "acos",
          "arctan": "atan", "sinh": "sinh", "cosh": "cosh", "arcsinh": "asinh", "arccosh": "acosh",
          "arctanh": "atanh", "exp": "exp", "log": "log", "sqrt": "sqrt", "abs": "fabs", "floor": "floor",
          "arctan2": "atan2", "pow": "pow", "sign": "sign_of", "minimum": "least_of", "maximum": "most_of"}  # fmt: skip

#: Functions that C lacks; a text holds those that it calls.
_HELPERS = {
    "sign_of": "static double sign_of(double a) { return a > 0.0 ? 1.0 : a < 0.0 ? -1.0 : a; }",
    "least_of": "static double least_of(double a, double b) { return a != a ? a : b != b ? b : a < b ? a : b; }",
    "most_of": "static double most_of(double a, double b) { return a != a ? a : b != b ? b : a > b ? a : b; }",
    "count_below": """\
/* how many of the increasing knots are not above a number */
static int count_below(const double *knots, int n, double a) {
  int low = 0, high = n;
  while (low < high) {
    int middle = (low + high) / 2;
    if (a < knots[middle]) high = middle; else low = middle + 1;
  }
  return low;
}""",
}


def c_source(model: Model) -> str:
    """C functions ``model_rhs`` and ``model_output`` of a model; they need ``math.h`` and nothing else.

    ``void model_rhs(double t, const double *x, const double *u, const double *theta, double *dx)`` writes dx/dt,
    ``model_output`` in the same way y, in the order and units of the model, which a comment at the top lists with the
    declared values. Where states start at an expression of parameters ``model_start`` writes the initial states into
    its last argument, the others as they are in ``x``.

    Parameters
    ----------
    model
        The model, without modes.

    Raises
    ------
    GenerationError
        If the model has modes, whose events a function of a point cannot tell.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> text = c_source(pendulum())
    >>> print("".join(line for line in text.splitlines(keepends=True) if "theta[0] = " in line).strip())
    theta[0] = length [m], 1: pivot to bob
    >>> print(text[text.index("void model_rhs"):text.index("void model_output")])
    void model_rhs(double t, const double *x, const double *u, const double *theta, double *dx) {
      const double v_7 = sin(x[0]);
      dx[0] = x[1];
      dx[1] = ((u[0] - (x[1] * theta[1])) - ((theta[2] / theta[0]) * v_7));
    }
    """
    require_kind("c_source", model, Model, "model")
    if model.modes:
        raise GenerationError(
            f"{model.name}: modes have no form in C - derive the graph smooth (without --exact)", where=(model.name,)
        )
    program = model.program.anew()
    solvers = {name: loop_programs(program.reader, solver) for name, solver in program.reader.solvers.items()}
    parts = {name: program.tape.program(rows) for name, rows in program.rows.items()}
    everything = [*parts.values(), *(part for loop in solvers.values() for part in (loop.start, loop.turn, loop.end))]
    arrays: dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]] = {}
    for part in everything:
        arrays |= part.arrays
    tables = [
        f"static const double {key}[] = {{{', '.join(_number(float(value)) for value in values.ravel())}}};"
        for key, values in arrays.items()
    ]
    functions = [_solver(name, loop, _arguments(program, name)) for name, loop in solvers.items()]
    for name, part in parts.items():
        result = {"rhs": "dx", "output": "y", "start": "x0"}[name]
        lines = _computed(part, [f"{result}[{k}]" for k in range(len(part.results))])
        functions.append(
            f"void model_{name}(double t, const double *x, const double *u, const double *theta, double *{result}) {{\n"
            + "\n".join(f"  {line}" for line in lines)
            + "\n}"
        )
    body = "\n".join([*tables, *functions, ""])
    helpers = [text for name, text in _HELPERS.items() if f"{name}(" in body]
    return "\n".join([*_legend(model), "#include <math.h>", "", *helpers, body])


def _legend(model: Model) -> list[str]:
    """A comment that says what stands at each place of the vectors: name, unit, declared value, meaning."""
    kinds: tuple[tuple[str, Sequence[Any], str], ...] = (
        ("x", model.states, "initial"), ("u", model.inputs, "default"), ("theta", model.parameters, "value"),
        ("y", model.outputs, ""),
    )  # fmt: skip
    rows = [
        f"{vector}[{k}] = {info.name} [{info.unit}]"
        + (f", {getattr(info, value):.12g}" if value else "")
        + (f": {info.meaning}" if info.meaning else "")
        for vector, infos, value in kinds
        for k, info in enumerate(infos)
    ]
    safe = [" ".join(row.split()).replace("*/", "* /").replace("/*", "/ *") for row in rows]
    return [
        f"/* Equations of {model.name}: {model.digest}. t in s, all in coherent SI.",
        *(f"   {r}" for r in safe),
        "*/",
    ]


#: How elements of the vectors of a model are read.
_LEAVES = {"x": "x[{}]", "u": "u[{}]", "theta": "theta[{}]", "t": "t", "argument": "a[{}]", "carried": "c[{}]"}


def _arguments(program: ModelProgram, name: str) -> int:
    return len(program.reader.solvers[name].function.args.args)


def _solver(name: str, loop: LoopPrograms, arguments: int) -> str:
    """A function that runs the turns of a loop until it has settled; arguments in ``a``, unknowns into ``found``."""
    carried = len(loop.turn.results) - 1
    start = _computed(loop.start, [f"c[{k}]" for k in range(carried)])
    names = [f"n[{k}]" for k in range(carried + 1)]
    turn = _computed(loop.turn, names)
    end = _computed(loop.end, [f"found[{k}]" for k in range(len(loop.end.results))])
    return "\n".join(
        [
            f"static void {name}(const double *a, double *found) {{ /* {arguments} arguments */",
            f"  double c[{carried}], n[{carried + 1}];",
            "  {", *(f"    {line}" for line in start), "  }",
            f"  for (int k = 0; k < {loop.limit}; k++) {{", *(f"    {line}" for line in turn),
            f"    for (int i = 0; i < {carried}; i++) c[i] = n[i];",
            f"    if (n[{carried}] == 0.0) break;", "  }",
            *(f"  {line}" for line in end), "}",
        ]
    )  # fmt: skip


def _computed(program: Program, targets: Sequence[str]) -> list[str]:
    """The lines of a program, and those that hand its results over."""
    texts, lines = _written(program)
    return lines + [f"{target} = {texts[result]};" for target, result in zip(targets, program.results, strict=True)]


def _written(program: Program) -> tuple[list[str], list[str]]:
    """The text by which each operation is read, and the lines that compute those with a name."""
    uses = [0] * len(program.operations)
    for operation in program.operations:
        for argument in operation.arguments:
            uses[argument] += 1
    texts: list[str] = []
    lines: list[str] = []
    for k, operation in enumerate(program.operations):
        given = [texts[argument] for argument in operation.arguments]
        if operation.kind == "solve":
            name = f"solved_{k}"
            lines.append(f"double {name}[{operation.value[1]}];")
            lines.append(f"{operation.value[0]}((const double[]){{{', '.join(given)}}}, {name});")
            texts.append(name)
            continue
        text = _expression(program, operation, given)
        if operation.kind in ("constant", "leaf", "item") or (uses[k] < 2 and operation.kind in _INFIX):
            texts.append(text)
            continue
        kind = "int" if operation.kind in (*TRUTHS, "search", "offset") else "double"
        name = f"{program.names.get(k, 'v')}_{k}"
        lines.append(f"const {kind} {name} = {_bare(text)};")
        texts.append(name)
    return texts, lines


def _bare(text: str) -> str:
    """A text without the parentheses round the whole of it."""
    depth = 0
    for k, letter in enumerate(text):
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if depth == 0 and k < len(text) - 1:
            return text
    return text[1:-1]


def _expression(program: Program, operation: Operation, given: Sequence[str]) -> str:
    kind, value = operation.kind, operation.value
    if kind == "constant":
        return _number(value)
    if kind == "leaf":
        return _LEAVES[value[0]].format(value[1])
    if kind in _INFIX:
        return f"({given[0]} {_INFIX[kind]} {given[1]})"
    if kind in _CALLS:
        return f"{_CALLS[kind]}({', '.join(given)})"
    if kind == "search":
        return f"count_below({value}, {len(program.arrays[value])}, {given[0]})"
    if kind == "gather":
        width = program.arrays[value].shape[-1]
        place = f"(int)({given[0]})" if len(given) == 1 else f"(int)({given[0]})*{width} + (int)({given[1]})"
        return f"{value}[{place}]"
    forms = {
        "neg": "(-{0})",
        "not": "(!{0})",
        "where": "({0} ? {1} : {2})",
        "offset": "({0} + {v})",
        "item": "{0}[{v}]",
    }
    return forms[kind].format(*given, v=value)


def _number(value: float) -> str:
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    return repr(value) if value >= 0.0 and not (value == 0.0 and math.copysign(1.0, value) < 0) else f"({value!r})"
