"""Textbook graphs as a few lines of text, each with its equations written down by hand.

A case is read as a graph file (``../formats``: node-link JSON), so that it takes the way of a file a stranger writes.

Nodes, one a line: ``id kind key: value; key: value``. Bonds: ``a>b b>c``. The equations, one a line, in Python with
numpy's functions: ``der momentum(L) = ...`` is the rate of an energy variable, ``out y = ...`` an output, ``effort
a->b = ...`` and ``flow a->b = ...`` a bond's variable; any other line names an intermediate result for later lines.
"""

from __future__ import annotations

import json
import random
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

_ENERGY = re.compile(r"\b((?:displacement|momentum)\d?\([\w.]+\))")
_KINDS = ("der", "out", "effort", "flow", "signal")


@dataclass(frozen=True)
class Case:
    """One system: its graph file and its equations.

    ``size`` gives the size of states and inputs at random points where it is not one; they are drawn positive unless
    ``signed``. ``rates`` are inputs whose own rate is needed.
    """

    name: str
    nodes: str
    bonds: str
    equations: str
    parameters: str = ""
    inputs: str = ""
    head: Mapping[str, Any] = field(default_factory=dict)
    parts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    size: Mapping[str, float] = field(default_factory=dict)
    signed: bool = True
    rates: tuple[str, ...] = ()

    @property
    def graph(self) -> dict[str, Any]:
        """The graph file."""
        return graph_file(self.name, self.nodes, self.bonds, self.parameters, self.inputs, self.head, self.parts)

    def states(self) -> list[str]:
        """Energy variables, and integrals, whose rates the equations give."""
        return [line.split()[1] for line in lines(self.equations) if line.startswith("der ")]

    def point(self, seed: int) -> dict[str, Any]:
        """A random point: parameters near their values, states and inputs of their size."""
        draw = random.Random(f"{self.name} {seed}")

        def value(name: str, signed: bool) -> float:
            sign = draw.choice((-1, 1)) if signed else 1
            return sign * draw.uniform(0.3, 1.2) * self.size.get(name, 1.0)

        return {
            "t": draw.uniform(0.0, 2.0),
            "states": {name: value(name, self.signed) for name in self.states()},
            "inputs": {name: value(name, self.signed) for name in self.inputs.split()},
            "input_derivatives": {name: value(f"d_{name}", True) for name in self.rates},
            "parameters": {name: given * draw.uniform(0.8, 1.25) for name, given in values(self.parameters).items()},
        }

    def expected(self, point: Mapping[str, Any]) -> dict[tuple[str, str], float]:
        """What the equations give at a point: (kind, name) -> value."""
        scope: dict[str, Any] = {name: getattr(np, name) for name in _NUMPY}
        scope |= {"np": np, "t": point["t"], "solve": np.linalg.solve, "root": root}
        for name, rate in point["input_derivatives"].items():
            scope |= {f"d_{name}": rate, f"rate_{name}": rate}
        scope |= {_plain(name): value for name, value in point["parameters"].items()} | dict(point["inputs"])
        states = point["states"]
        found: dict[tuple[str, str], float] = {}
        for line in lines(self.equations):
            target, expression = (part.strip() for part in re.split(r"(?<![<>=!])=(?!=)", line, maxsplit=1))
            text = _ENERGY.sub(lambda match: f"_states[{match[1]!r}]", expression)
            text = re.sub(r"\blambda\b(?!\s*\w*\s*:)", "lambda_", text)
            for name in states:
                scope.setdefault(name, states[name]) if "(" not in name else None
            value = eval(text, {**scope, "_states": states})
            kind, _, name = target.partition(" ")
            if kind in _KINDS and name:
                found[kind, name] = float(value)
            else:
                scope[target] = value
        return found


_NUMPY = (
    "sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "sign", "abs", "maximum", "minimum", "where", "pi", "arcsin",
    "array", "arctan",
)  # fmt: skip


def _plain(name: str) -> str:
    return "lambda_" if name == "lambda" else name


def root(function: Any, low: float, high: float) -> float:
    """Where an increasing or decreasing function vanishes, by bisection."""
    rising = function(high) > function(low)
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (low, middle) if (function(middle) > 0) == rising else (middle, high)
    return (low + high) / 2


def lines(text: str) -> list[str]:
    """The lines of a text that say something."""
    return [line.strip() for line in text.splitlines() if line.strip()]


def values(text: str) -> dict[str, float]:
    """``a=1 b=2`` as numbers."""
    return {name: float(value) for name, value in (pair.split("=") for pair in text.split())}


def graph_file(
    name: str,
    nodes: str,
    bonds: str,
    parameters: str = "",
    inputs: str = "",
    head: Mapping[str, Any] | None = None,
    parts: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The JSON object of a graph file."""
    given = dict(head or {})
    records = [_node(line, parts or {}) for line in lines(nodes)]
    ends = [dict(zip(("source", "target"), bond.split(">"), strict=True)) for bond in bonds.split()]
    given.setdefault("inputs", [{"name": name} for name in inputs.split()])
    given.setdefault("parameters", [{"name": key, "value": value} for key, value in values(parameters).items()])
    return {
        "directed": True, "multigraph": True, "graph": {"format": "bondgraph/1", "name": name, **given},
        "nodes": records, "bonds": ends,
    }  # fmt: skip


def _node(line: str, parts: Mapping[str, Any]) -> dict[str, Any]:
    identity, kind, *rest = line.split(maxsplit=2)
    record: dict[str, Any] = {"id": identity, "kind": kind}
    for pair in rest[0].split(";") if rest else ():
        key, _, text = pair.partition(":")
        text = text.strip()
        if text.startswith("@"):
            record[key.strip()] = parts[text[1:]]
            continue
        try:
            record[key.strip()] = json.loads(text)
        except json.JSONDecodeError:
            record[key.strip()] = text
    return record
