"""Graph files spoiled at random, and random laws, and what is done with each: read, derive, render, load, evaluate."""

from __future__ import annotations

import copy
import functools
import json
import random
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from bondgraph.declare.files import graph_to_json, load_graph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import Derivation, check_closed
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.errors import DeclarationError
from bondgraph.generate.module import render
from bondgraph.simulate.model import Model
from tests.cli.conftest import MOTOR

NUMBERS: tuple[Any, ...] = (
    0, -1, 1, 0.1, -0.0, 1e308, -1e308, 5e-324, 10**400, 2**63, float("nan"), float("inf"), 1_000_000_000, True, "1",
)  # fmt: skip
NAMES = (
    "", "x", "t", "pi", "flow", "flow1", "effort(R)", "../x", "a.b", ".", "a b", "ä", "x" * 3000, "__class__", "lambda",
    "if", "\x00", "$\\bad{$", "<script>", "None", "R", "loop", "1", "%s", "{0}",
)  # fmt: skip
UNITS = ("N m", "9**9**9**9", "degC**2/dB", "dB", "rpm", "1", "m^(1/2)", "m^-3", "kg", "degC", "m^1e9", "%", "Hz", "[")
KINDS = ("0", "1", "Se", "Sf", "R", "C", "I", "TF", "GY", "X", "graph", "Q")
LAWS = (
    "flow > 0", "(flow>0)*R_a", "Piecewise()", "Piecewise((1, 2))", "Piecewise((flow, flow > 0), (0, True))", "1/0",
    "((9**1000)**1000)**1000", "floor(exp(10000000))", "abs(" * 80 + "flow" + ")" * 80, "asin(3)*flow", "sqrt(-1)",
    "flow*sqrt(-R_a)", "0*flow", "flow/0", "log(0)", "flow**flow", "effort(R)", "displacement(L)", "momentum(L)",
    "__import__('os')", "a.__class__", "(lambda: 0)()", "flow if flow > 0 else -flow", "max()", "max(flow)", "sin()",
    "switch(flow, 0)", "switch(flow, R_a)", "atan2(flow, 0)", "Mod(flow, 0)", "Heaviside(flow, 7)", "clip(flow, 1, 0)",
    "flow1", "effort + flow", "t", "u_a", "flow(shaft) - flow(shaft)", "1e400", "1" * 400, "0x10", "1_000", "1j", "",
    "flow =", "flow; flow", "flow\n", "not flow", "min(flow, True)", "sign(flow)*abs(flow)**0.5", "exp(exp(flow))",
    "tan(pi/2)", "cbrt(-8)", "pow(flow, 1e308)", "flow**(1/3)", "And(flow > 0, t < 1)", "T(flow)", "T(flow, t)", "T",
)  # fmt: skip


@functools.cache
def _bases() -> tuple[dict[str, Any], ...]:
    """Valid files: a motor, one without units, and graphs with parts, tables, signals, fields and modes."""
    plain = copy.deepcopy(MOTOR)
    for group in ("inputs", "parameters", "outputs"):
        for record in plain["graph"][group]:
            record.pop("unit", None)
    for node in plain["nodes"]:
        node.pop("domain", None)
    plain["graph"]["tables"] = {"T": {"x": [0, 1, 2], "values": [0, 1, 4]}}
    plain["graph"]["signals"] = [{"name": "slip", "is": "flow(shaft)*2"}]
    plain["graph"]["integrals"] = [{"name": "angle", "of": "flow(shaft)", "initial": 0.5}]
    plain["graph"]["requirements"] = [{"positive": "J", "reason": "a rotor has inertia"}]
    part = {"id": "p", "kind": "graph", "graph": copy.deepcopy(MOTOR), "ports": {"out": "shaft"}, "bind": {"b": "c"}}
    whole = {
        "graph": {"name": "whole", "parameters": [{"name": "c", "value": 0.1, "unit": "N m s"}]},
        "nodes": [part, {"id": "load", "kind": "R", "effort": "c*flow"}],
        "bonds": [{"source": "p.out", "target": "load"}],
    }
    field: dict[str, Any] = {
        "graph": {"name": "field", "parameters": [{"name": "k", "value": 2}]},
        "nodes": [
            {"id": "f", "kind": "C", "ports": 2, "energy": "k*displacement1**2 + displacement1*displacement2"},
            {"id": "a", "kind": "1"}, {"id": "b", "kind": "1"},
            {"id": "m", "kind": "I", "flow": "momentum/k"}, {"id": "r", "kind": "R", "residual": "effort - k*flow**3"},
        ],
        "bonds": [
            {"source": s, "target": t} for s, t in (("a", "f"), ("b", "f"), ("a", "m"), ("b", "r"))
        ],
    }  # fmt: skip
    declared = graph_to_json(load_graph("vehicle_graphs.driveline:driveline"))
    return MOTOR, plain, plain, whole, field, json.loads(json.dumps(declared))


def spoiled(draw: random.Random) -> str:
    """A valid file changed in one to three places."""
    data = copy.deepcopy(draw.choice(_bases()))
    for _ in range(draw.choice((1, 1, 2, 3))):
        draw.choice(_CHANGES)(data, draw)
    return json.dumps(data)


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Every container of a file with each of its keys."""
    keys: Any = value.keys() if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    here = [(value, key) for key in keys]
    return here + [place for key in keys for place in _places(value[key])]


def _drop(data: Any, draw: random.Random) -> None:
    place, key = draw.choice(_places(data))
    del place[key]


def _rename(data: Any, draw: random.Random) -> None:
    place, key = draw.choice([found for found in _places(data) if isinstance(found[0], dict)])
    place[draw.choice((*NAMES, "kind", "laws", "ports", "energy", "initial", "flow", "residual"))] = place.pop(key)


def _retype(data: Any, draw: random.Random) -> None:
    place, key = draw.choice(_places(data))
    place[key] = draw.choice((None, True, [], {}, "", 0, 1.5, [1], {"a": 1}, [[]], place[key], [place[key]], str(key)))


def _swap(data: Any, draw: random.Random) -> None:
    (one, first), (other, second) = draw.sample(_places(data), 2)
    one[first], other[second] = copy.deepcopy(other[second]), copy.deepcopy(one[first])


def _repeat(data: Any, draw: random.Random) -> None:
    lists = [place[key] for place, key in _places(data) if isinstance(place[key], list) and place[key]]
    if lists:
        chosen = draw.choice(lists)
        chosen.append(copy.deepcopy(draw.choice(chosen)))


def _nest(data: Any, draw: random.Random) -> None:
    place, key = draw.choice(_places(data))
    value = place[key]
    for _ in range(draw.choice((1, 3, 200))):
        value = [value] if draw.random() < 0.5 else {"graph": value}
    place[key] = value


def _replace(keys: tuple[str, ...], values: tuple[Any, ...]) -> Callable[[Any, random.Random], None]:
    def change(data: Any, draw: random.Random) -> None:
        found = [place for place in _places(data) if place[1] in keys]
        if found:
            place, key = draw.choice(found)
            place[key] = draw.choice(values)

    return change


def _number(data: Any, draw: random.Random) -> None:
    found = [place for place in _places(data) if isinstance(place[0][place[1]], int | float)]
    if found:
        place, key = draw.choice(found)
        place[key] = draw.choice(NUMBERS)


_LAW_KEYS = ("effort", "flow", "momentum", "displacement", "energy", "residual", "modulus", "is", "of", "positive")


def _law(data: Any, draw: random.Random) -> None:
    laws = [place for place in _places(data) if place[1] in _LAW_KEYS]
    if laws:
        place, key = draw.choice(laws)
        place[key] = draw.choice((draw.choice(LAWS), random_law(draw, 3)))


_CHANGES = (
    _drop, _rename, _retype, _swap, _repeat, _nest, _number, _number, _law, _law, _law,
    _replace(("name", "id", "source", "target", "at", "state"), NAMES), _replace(("unit", "domain"), UNITS),
    _replace(("kind",), KINDS), _replace(("ports",), (0, 2, 3, 200, 10**9, "2", {})),
    _replace(("initial", "bounds", "x", "values"), ([], [0], [1, 0], [0, 0], [[0, 1], [1]], 1, "a", None, [None])),
)  # fmt: skip


# ------------------------------------------------------------------ laws

_ATOMS = ("flow", "flow", "flow", "r", "m", "t", "1", "2", "0.5", "-1", "0", "pi", "1e-9", "1e9", "v", "flow(shaft)")
_ONE = (
    "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "sec", "csc", "cot",
    "exp", "log", "sqrt", "cbrt", "abs", "sign", "floor", "ceiling", "Heaviside", "T",
)  # fmt: skip
_TWO = ("min", "max", "atan2", "Mod", "pow", "switch", "Heaviside", "maximum")


def random_law(draw: random.Random, depth: int) -> str:
    """A law of the grammar that parses, whatever its value."""
    if depth == 0 or draw.random() < 0.15:
        return draw.choice(_ATOMS)
    one, two = (random_law(draw, depth - 1) for _ in range(2))
    return draw.choice(
        (
            f"({one} {draw.choice('+-*/')} {two})",
            f"({one} {draw.choice('+-*/')} {two})",
            f"({one})**{draw.choice(('2', '3', '0.5', '-1', '(1/3)', '1.5', two))}",
            f"{draw.choice(_ONE)}({one})",
            f"{draw.choice(_TWO)}({one}, {two})",
            f"clip({one}, {two}, {draw.choice(_ATOMS)})",
            f"({one} if {_condition(draw, depth)} else {two})",
            f"Piecewise(({one}, {_condition(draw, depth)}), ({two}, True))",
        )
    )


def _condition(draw: random.Random, depth: int) -> str:
    compared = f"{random_law(draw, depth - 1)} {draw.choice(('<', '<=', '>', '>=', '==', '!='))} {draw.choice(_ATOMS)}"
    return draw.choice((compared, compared, f"not {compared}", f"({compared}) and t > 1", f"Or({compared}, m < 1)"))


def _of(law: str, variable: str) -> str:
    """A law in another variable than the flow; signals stay."""
    return re.sub(r"\bflow\b(?!\()", variable, law)


_SHAFT = (("drive", "shaft"), ("shaft", "rotor"), ("shaft", "bearing"))


def lawful(draw: random.Random) -> str:
    """A machine without units whose laws are random: a resistance, a source, a storage, or both forms of one."""
    law, other = random_law(draw, draw.choice((2, 3, 4))), random_law(draw, 3)
    bearing = draw.choice(
        (
            {"effort": law}, {"effort": law}, {"flow": _of(law, "effort")},
            {"residual": f"effort - {law}"}, {"effort": law, "flow": _of(other, "effort")},
        )
    )  # fmt: skip
    return json.dumps(
        {
            "graph": {
                "name": "lawful",
                "inputs": [{"name": "v"}],
                "parameters": [{"name": "r", "value": 0.3}, {"name": "m", "value": draw.choice((2.0, -2.0, 0.0))}],
                "tables": {"T": {"x": [0, 1, 3], "values": [0, 2, 3]}},
                "outputs": [{"name": "y", "is": _of(random_law(draw, 2), "t")}],
            },
            "nodes": [
                {"id": "drive", "kind": "Se", "effort": draw.choice(("v", "v", _of(other, "t")))},
                {"id": "shaft", "kind": "1"},
                {"id": "rotor", "kind": "I", "flow": draw.choice(("momentum", "momentum", _of(law, "momentum")))},
                {"id": "bearing", "kind": "R", **bearing},
            ],
            "bonds": [{"source": s, "target": t} for s, t in _SHAFT],
        }
    )  # fmt: skip


def worked_through(text: str) -> None:
    """Everything that is done with a graph file: what is accepted has equations that load and can be evaluated."""
    try:
        data = json.loads(text)
    except ValueError as error:
        raise DeclarationError(f"not JSON ({error})") from None
    equations = Derivation(assign_causality(graph_from_json(data, "fuzzed.json"))).equations()
    check_closed(equations)
    check_dimensions(equations)
    model = Model.from_text(render(equations))
    x, u, theta = model.x0(), model.u0(), model.theta()
    assert model.rhs(0.0, x, u, theta).shape == (len(model.states),)
    assert np.asarray(model.output(0.0, x, u, theta)).shape == (len(model.outputs),)


def _bearing(**laws: str) -> dict[str, Any]:
    """A rotor without units on a bearing with these laws."""
    return {
        "graph": {
            "name": "found",
            "parameters": [{"name": "r", "value": 0.3}, {"name": "m", "value": 2.0}],
            "inputs": [{"name": "v"}],
        },
        "nodes": [
            {"id": "drive", "kind": "Se", "effort": "v"}, {"id": "shaft", "kind": "1"},
            {"id": "rotor", "kind": "I", "flow": "momentum"}, {"id": "bearing", "kind": "R", **laws},
        ],
        "bonds": [{"source": s, "target": t} for s, t in _SHAFT],
    }  # fmt: skip


def _measured(expression: str) -> dict[str, Any]:
    """The rotor on a plain bearing, and an output of this expression."""
    graph = _bearing(effort="r*flow")
    return {**graph, "graph": {**graph["graph"], "outputs": [{"name": "y", "is": expression}]}}


#: What searches found, made small.
FOUND = {
    "a condition compares a complex branch": _bearing(
        effort="(clip(v, 1, flow) if sqrt(Piecewise((t, 1 >= flow), (-1, True))) >= flow else Mod(t, r))"
    ),
    "conditions in conditions with numbers put in": _bearing(
        effort="Piecewise((r, not tan(1e-9) > 1e9), (m**2, True))",
        flow="Piecewise((switch(effort, t), Or((9 if effort < 0 and t > 1 else sinh(-1)) <= 1e-9, m < 1)), (1, True))",
    ),
    "a switch without width inside a condition": _measured(
        "Piecewise(((1e-9 + 1), switch(0, 0) < t), ((flow(shaft) * v), True))"
    ),
    "a condition without a variable in a slope": _bearing(
        flow="clip(max(Mod(clip(0, m, 2), (effort if t == m else pi)), Heaviside(maximum(pi, 2), abs(t))),"
        " ceiling(floor((1e-9 - -1))), 1e-9)"
    ),
    "a switch of numbers beside a number in a condition": _bearing(
        effort="cos(0)",
        flow="(Piecewise(((0.5)**2, Or(switch(effort, effort) != effort, m < 1)), ((r)**0.5, True))"
        " if flow(shaft) == effort else 1e9)",
    ),
    "a smaller one of a number and pi beside a number in a condition": _measured(
        "Piecewise((Piecewise((v, Or(minimum(pi, 2) != 1, m < 1)), (1, True)), flow(shaft) > 1), (0, True))"
    ),
    "the sine of a power without end in laws of both forms": _bearing(
        effort="flow**1e9 / (flow(shaft) / 0.5)", flow="1/sin(effort**(1/3))"
    ),
    "the sine of a power without end of a parameter": _bearing(effort="flow*sin(m**1e9)"),
    "the sine of a power without end in a loop": _bearing(residual="effort*sin(r**1e9) - flow*cos(m**1e9)"),
    "a step of a root that is not real at the declared value": _measured("Heaviside((-m)**0.5)"),
    "a remainder by zero at the declared value": _measured("clip(Mod(1e-9, m - 2), (1e-9)**0.5, 1)"),
    "a table whose name no program can print": {
        "graph": {"name": "g", "tables": {"T\0": {"x": [0, 1], "values": [0, 2]}}},
        "nodes": [],
        "bonds": [],
    },
    "a name without end": {"graph": {"name": "g", "x" * 5000: 1}, "nodes": [], "bonds": []},
}
