"""The assignment of a model that is the first to give no finite number, and the values it was worked out of."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.compile.loader import parse_module, run_module
from bondgraph.simulate.model import Model

#: Products of numbers below this do not overflow.
_LARGE = float(np.sqrt(np.finfo(float).max))


@dataclass(frozen=True)
class Undefined:
    """An assignment of a generated module, its ``value``, the quantities in it, and the states, all at one point.

    Examples
    --------
    >>> print(Undefined("Q = c*np.sqrt(p)", float("nan"), {"p": -3.0}, {"q": -0.1}))
    Q = c*np.sqrt(p) is nan with p = -3, at q = -0.1
    """

    assignment: str
    value: float
    quantities: dict[str, float]
    states: dict[str, float]

    def __str__(self) -> str:
        used = ", ".join(f"{name} = {value:.4g}" for name, value in self.quantities.items())
        at = ", ".join(f"{name} = {value:.4g}" for name, value in self.states.items() if name not in self.quantities)
        return f"{self.assignment} is {self.value:g}{f' with {used}' if used else ''}{f', at {at}' if at else ''}"


def first_undefined(
    model: Model, function: str, t: float, x: FloatArray, u: FloatArray, theta: FloatArray
) -> Undefined | None:
    """The first assignment of ``"rhs"`` or ``"output"`` that is not finite at some of the points x (n_x, points).

    None where all are finite, a point is not, or numbers only grew too large on their way.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> model = pendulum()
    >>> found = first_undefined(model, "rhs", 0.0, model.x0()[:, np.newaxis], model.u0(), model.theta(length=0.0))
    >>> found.assignment, found.quantities
    ('restoring = gravity / length * np.sin(angle)', {'gravity': 9.81, 'length': 0.0, 'angle': 0.5})
    """
    tree = parse_module(model.text, model.name)
    scope = run_module(tree, model.name)
    body = next(node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == function)
    local = dict(zip((argument.arg for argument in body.args.args), (t, x, u, theta), strict=True))
    with np.errstate(all="ignore"):
        for statement in body.body:
            if not isinstance(statement, ast.Assign):
                continue
            exec(compile(ast.Module([statement], []), model.name, "exec"), scope, local)
            found = _where_undefined([local[name] for name in _names(statement.targets[0])], x.shape[1])
            if found is not None:
                return _told(model, statement, local, x, *found)
    return None


def _where_undefined(values: Sequence[Any], points: int) -> tuple[int, float] | None:
    """The first point at which a value is not finite, and the value there."""
    for value in values:
        each = np.broadcast_to(np.asarray(value, dtype=np.float64), (points,))
        spoilt = np.flatnonzero(~np.isfinite(each))
        if spoilt.size:
            return int(spoilt[0]), float(each[spoilt[0]])
    return None


def _told(
    model: Model, statement: ast.Assign, local: dict[str, Any], x: FloatArray, point: int, value: float
) -> Undefined | None:
    if not np.isfinite(x[:, point]).all():
        return None
    used = dict.fromkeys(node.id for node in ast.walk(statement.value) if isinstance(node, ast.Name))
    known = {name: local[name] for name in used if name in local and name not in ("x", "u", "theta")}
    size = x.shape[1]
    quantities = {
        name: float(np.broadcast_to(np.asarray(held, dtype=np.float64), (size,))[point]) for name, held in known.items()
    }
    states = dict(zip(model.names("state"), map(float, x[:, point]), strict=True))
    if np.isinf(value) and any(abs(held) > _LARGE for held in quantities.values()):
        return None
    return Undefined(ast.unparse(statement), value, quantities, states)


def _names(target: ast.expr) -> list[str]:
    return [node.id for node in ast.walk(target) if isinstance(node, ast.Name)]
