"""Compare the derived, rendered and loaded equations of a graph with the oracle's solution at a random point."""

from __future__ import annotations

import random
from typing import Any

import numpy as np

from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import CausalGraph, assign_causality
from bondgraph.derive.derivation import check_closed, derive
from bondgraph.derive.equations import StateEquations
from bondgraph.derive.rules import bond_variables
from bondgraph.generate.module import render
from tests.derive.oracle import STORED, Oracle, Solution


def loaded(equations: StateEquations) -> dict[str, Any]:
    """The rendered module, executed; it needs numpy only."""
    module: dict[str, Any] = {}
    exec(compile(render(equations), equations.name, "exec"), module)
    return module


def energy_names(causal: CausalGraph) -> dict[str, str]:
    """State name -> energy variable as a signal (``momentum(rotor)``), for the independent storages."""
    variables = bond_variables(causal)
    found = {}
    for node in causal.graph.nodes.values():
        for port in range(1, node.ports + 1) if node.kind in STORED else ():
            state = variables.state_of(node.name, port)
            if state is not None:
                number = port if node.ports > 1 else ""
                found[state.symbol.name] = f"{STORED[node.kind]}{number}({node.name})"
    return found


def random_point(equations: StateEquations, seed: int, size: float = 0.7) -> dict[str, dict[str, float]]:
    rng = random.Random(f"point {seed}")
    return {
        "x": {state.symbol.name: rng.uniform(-size, size) for state in equations.states},
        "u": {quantity.name: rng.uniform(-size, size) for quantity in equations.inputs},
        "theta": {quantity.name: quantity.value for quantity in equations.parameters},
    }


def evaluate(module: dict[str, Any], point: dict[str, dict[str, float]], t: float) -> tuple[np.ndarray, np.ndarray]:
    vectors = [np.array(list(point[key].values()), dtype=float) for key in ("x", "u", "theta")]
    return module["rhs"](t, *vectors), module["output"](t, *vectors)


def compare(graph: BondGraph, seed: int = 0, tolerance: float = 1e-7, independent: tuple[str, ...] = ()) -> str:
    """What differs between derivation and oracle at a random point; empty where nothing does."""
    causal = assign_causality(graph, independent)
    equations = derive(causal, bonds=True)
    check_closed(equations)
    module = loaded(equations)
    point, t = random_point(equations, seed), 0.3
    derivatives, outputs = evaluate(module, point, t)
    count = len(graph.flatten().bonds)
    first = len(equations.outputs) - 2 * count
    efforts, flows = outputs[first : first + count], outputs[first + count :]
    if not np.all(np.isfinite([*derivatives, *efforts, *flows])):
        return unsolved(causal, point, count, t)
    solution = oracle_solution(causal, point, efforts, flows, t)
    return differences(causal, equations, derivatives, efforts, flows, solution, tolerance)


def unsolved(causal: CausalGraph, point: dict[str, dict[str, float]], count: int, t: float) -> str:
    """A nonlinear loop that the derived model does not solve must have no solution that the oracle finds."""
    rng = np.random.default_rng(count)
    for _ in range(5):
        efforts, flows = rng.normal(size=count), rng.normal(size=count)
        solution = oracle_solution(causal, point, efforts, flows, t)
        if solution.residual < 1e-8 and not solution.uncertain:
            return (
                f"the derived equations give nan, but a solution is efforts {solution.efforts}, flows {solution.flows}"
            )
    return ""


def oracle_solution(
    causal: CausalGraph, point: dict[str, dict[str, float]], efforts: np.ndarray, flows: np.ndarray, t: float
) -> Solution:
    """The oracle's solution nearest to the derived one (the only one of a linear graph)."""
    names = energy_names(causal)
    inertia = inertias(causal)
    known = {}
    for state, value in point["x"].items():
        energy = names.get(state, state)
        known[energy] = value * inertia.get(state, 1.0)
    declared = {quantity.name for quantity in causal.graph.inputs}
    inputs = {name: value for name, value in point["u"].items() if name in declared}
    rates = {name.removeprefix("d_"): value for name, value in point["u"].items() if name not in declared}
    for quantity in causal.graph.inputs:
        inputs.setdefault(quantity.name, quantity.default)
    start = {f"e_{i}": value for i, value in enumerate(efforts)} | {f"f_{i}": value for i, value in enumerate(flows)}
    return Oracle(causal.graph).solve(known, point["theta"], inputs, rates, start, t)


def inertias(causal: CausalGraph) -> dict[str, float]:
    """The inertia by which a flow state must be multiplied to give the momentum."""
    variables = bond_variables(causal)
    values = {quantity.symbol: quantity.value for quantity in causal.graph.parameters}
    found = {}
    for state in variables.states:
        if state.variable == "flow":
            inertia = variables.constant_inertia(causal.graph.nodes[state.element])
            assert inertia is not None
            found[state.symbol.name] = float(inertia.xreplace(values))
    return found


def differences(
    causal: CausalGraph,
    equations: StateEquations,
    derivatives: np.ndarray,
    efforts: np.ndarray,
    flows: np.ndarray,
    solution: Solution,
    tolerance: float,
) -> str:
    if solution.residual > 1e-8:
        return f"the oracle did not converge: residual {solution.residual}"
    if solution.uncertain:
        return f"the bond equations do not determine {', '.join(solution.uncertain)}"
    names, inertia = energy_names(causal), inertias(causal)
    wrong = []
    for state, value in zip(equations.states, derivatives, strict=True):
        name = state.symbol.name
        expected = solution.rates[names.get(name, name)] / inertia.get(name, 1.0)
        if not close(value, expected, tolerance):
            wrong.append(f"d({name})/dt is {value}, not {expected}")
    for label, found, expected in (("effort", efforts, solution.efforts), ("flow", flows, solution.flows)):
        for index, (a, b) in enumerate(zip(found, expected, strict=True)):
            if not close(a, b, tolerance):
                wrong.append(f"{label} of {causal.graph.bonds[index]} is {a}, not {b}")
    return "; ".join(wrong)


def close(a: float, b: float, tolerance: float) -> bool:
    return bool(abs(a - b) <= tolerance * (1 + abs(b)))
