"""An independent oracle: all bond equations of a causality-free graph as one system, solved numerically.

Nothing of the derivation is used: no causality, no merging of variables, no elimination. Unknowns are the effort and
flow of every bond, the energy variables of dependent storages, named signals, and the time derivatives of all of them
(a dependent storage's effort or flow follows only from its differentiated law). Equations: every junction, two-port and
element as it is written in textbooks, the same equations differentiated once, and that an energy variable's rate is
the flow (effort) at its port.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import sympy
from scipy.interpolate import PchipInterpolator
from sympy import Expr, Symbol

from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import signal_name
from bondgraph.declare.functions import TableFunction
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol

STORED = {"C": "displacement", "I": "momentum"}


@dataclass(frozen=True)
class Solution:
    """What the bond equations say at one point."""

    efforts: np.ndarray
    flows: np.ndarray
    stored: dict[str, float]
    rates: dict[str, float]
    residual: float
    uncertain: tuple[str, ...]


class Oracle:
    """The bond equations of one flat graph."""

    def __init__(self, graph: BondGraph) -> None:
        self.graph = graph = graph.flatten()
        self.ends: dict[str, list[tuple[int, int]]] = {name: [] for name in graph.nodes}
        for index, bond in enumerate(graph.bonds):
            self.ends[bond.source].append((index, -1))
            self.ends[bond.target].append((index, 1))
        self.e = [symbol(f"e_{i}") for i in range(len(graph.bonds))]
        self.f = [symbol(f"f_{i}") for i in range(len(graph.bonds))]
        self.stored: dict[str, Symbol] = {}
        self.rates: dict[str, Expr] = {}
        for node in graph.nodes.values():
            self._store(node)
        self.signals = {s.symbol if hasattr(s, "symbol") else symbol(s.name): s.expression for s in graph.signals}
        for integral in graph.integrals:
            self.stored[integral.name] = symbol(integral.name)
        self.equations: list[Expr] = [used - self._outside(rule) for used, rule in self.signals.items()]
        for node in graph.nodes.values():
            self.equations += self._node(node)
        for integral in graph.integrals:
            self.rates[integral.name] = self._outside(integral.of)

    # ------------------------------------------------------------------ equations

    def _store(self, node: Node) -> None:
        if node.kind not in STORED:
            return
        for port, (bond, sign) in enumerate(self.ends[node.name], start=1):
            number = port if node.ports > 1 else ""
            name = f"{STORED[node.kind]}{number}({node.name})"
            self.stored[name] = symbol(f"s_{len(self.stored)}")
            self.rates[name] = sign * self.f[bond] if node.kind == "C" else self.e[bond]

    def _local(self, node: Node) -> dict[Symbol, Expr]:
        """The element's own variables in terms of its bonds': a flow counts positive into the element."""
        found = {}
        for port, (bond, sign) in enumerate(self.ends[node.name], start=1):
            number = port if node.ports > 1 or node.kind == "X" else ""
            found[symbol(f"effort{number}")] = self.e[bond]
            found[symbol(f"flow{number}")] = sign * self.f[bond]
            if node.kind in STORED:
                name = f"{STORED[node.kind]}{number}"
                found[symbol(name)] = self.stored[f"{name}({node.name})"]
        return found

    def _outside(self, expression: Expr) -> Expr:
        """Signals in terms of bond variables."""
        replace = {}
        for used in expression.free_symbols:
            read = signal_name(used)
            if read is None:
                continue
            node = self.graph.nodes[read.node]
            if read.variable in STORED.values():
                replace[used] = self.stored[used.name]
                continue
            bond, sign = self.ends[node.name][max(read.port, 1) - 1]
            sign = 1 if node.kind in ("0", "1", "Se", "Sf") else sign
            replace[used] = self.e[bond] if read.variable == "effort" else sign * self.f[bond]
        return expression.xreplace(replace)

    def _law(self, node: Node, given: str) -> Expr:
        law = node.law(given)
        assert law is not None
        return self._outside(law.xreplace(self._local(node)))

    def _node(self, node: Node) -> list[Expr]:
        ends = self.ends[node.name]
        e, f = self.e, self.f
        if node.kind == "0":
            same = [e[bond] - e[ends[0][0]] for bond, _ in ends[1:]]
            return [*same, sympy.Add(*(sign * f[bond] for bond, sign in ends))]
        if node.kind == "1":
            same = [f[bond] - f[ends[0][0]] for bond, _ in ends[1:]]
            return [*same, sympy.Add(*(sign * e[bond] for bond, sign in ends))]
        if node.kind in ("TF", "GY"):
            (a, sign), (b, _) = ends
            a, b = (a, b) if sign > 0 else (b, a)
            m = self._law(node, "modulus")
            return [e[a] - m * e[b], f[b] - m * f[a]] if node.kind == "TF" else [e[a] - m * f[b], e[b] - m * f[a]]
        if node.kind == "Se":
            return [e[ends[0][0]] - self._law(node, "effort")]
        if node.kind == "Sf":
            return [f[ends[0][0]] - self._law(node, "flow")]
        return self._element(node)

    def _element(self, node: Node) -> list[Expr]:
        local = self._local(node)
        given = dict(node.laws)
        if "energy" in given:
            power = "effort" if node.kind == "C" else "flow"
            numbers = [port if node.ports > 1 else "" for port in range(1, node.ports + 1)]
            own = [symbol(f"{STORED[node.kind]}{number}") for number in numbers]
            slopes = [self._outside(sympy.diff(given["energy"], q).xreplace(local)) for q in own]
            return [local[symbol(f"{power}{number}")] - slope for number, slope in zip(numbers, slopes, strict=True)]
        if node.kind in STORED and node.ports == 1 and len(given) == 2:
            given = {key: law for key, law in given.items() if key in ("effort", "flow")}
        if node.kind == "R" and node.ports == 1 and len(given) == 2:
            given.pop("flow")
        if node.kind == "X":
            first = min(key.partition(".")[0] for key in given)
            given = {key.partition(".")[2]: law for key, law in given.items() if key.startswith(f"{first}.")}
        equations = []
        for key, law in given.items():
            law = self._outside(law.xreplace(local))
            equations.append(law if key.startswith("residual") else local[symbol(key)] - law)
        return equations

    # ------------------------------------------------------------------ numbers

    def functions(self) -> dict[str, Any]:
        """Numeric forms of the functions of laws; tables by scipy's interpolant, held at the ends."""
        found: dict[str, Any] = {
            "minimum": np.minimum,
            "maximum": np.maximum,
            "switch": lambda value, width: (1 + np.tanh(value / width)) / 2,
        }
        for table in self.graph.tables:
            if table.y:
                continue
            curve = PchipInterpolator(table.x, table.values)
            ends = (table.x[0], table.x[-1])

            def held(x: float, order: int = 0, curve: Any = curve, ends: tuple[float, float] = ends) -> float:
                if not ends[0] <= x <= ends[1]:
                    return 0.0 if order else float(curve(np.clip(x, *ends)))
                return float(curve(x, order))

            part, _, name = table.name.rpartition(".")
            place = vars(found.setdefault(part, SimpleNamespace())) if part else found
            place[name] = held
            place[name + "_d1"] = lambda x, held=held: held(x, 1)
            place[name + "_d11"] = lambda x, held=held: held(x, 2)
        return found

    def solve(
        self,
        states: Mapping[str, float],
        parameters: Mapping[str, float],
        inputs: Mapping[str, float],
        input_rates: Mapping[str, float] | None = None,
        start: Mapping[str, float] | None = None,
        t: float = 0.0,
    ) -> Solution:
        """Solve by Gauss-Newton steps from ``start`` (zero where a name is missing).

        ``states`` gives the known energy variables; ``start`` uses the names ``e_0``, ``f_0`` .. and those of energy
        variables.
        """
        names = {**{s.name: s for s in self.stored.values()}}
        known = {self.stored[name]: value for name, value in states.items()}
        numbers: dict[Symbol, float] = {symbol(name): value for name, value in (*parameters.items(), *inputs.items())}
        numbers[symbol("t")] = t
        given_rates = {symbol(name): value for name, value in (input_rates or {}).items()} | {symbol("t"): 1.0}
        z = [*self.e, *self.f, *names.values(), *self.signals]
        dz = {v: symbol(f"d__{v.name}") for v in z}
        system = list(self.equations)
        for equation in self.equations:
            slopes = [equation.diff(v) * dz[v] for v in z if v in equation.free_symbols]
            slopes += [equation.diff(v) * rate for v, rate in given_rates.items() if v in equation.free_symbols]
            system.append(sympy.Add(*slopes))
        system += [dz[self.stored[name]] - rate for name, rate in self.rates.items()]
        system += [v - value for v, value in known.items()]
        unknowns = [*z, *dz.values()]
        system = [
            _without_pulses(equation.xreplace({k: sympy.Float(v, 17) for k, v in numbers.items()}))
            for equation in system
        ]
        value, slopes = _lambdified(system, unknowns, self.functions())
        by_stored = {self.stored[name]: name for name in self.stored}
        x = np.zeros(len(unknowns))
        for index, unknown in enumerate(unknowns):
            x[index] = (start or {}).get(by_stored.get(unknown, unknown.name), 0.0)
            x[index] = known.get(unknown, x[index])
        for _ in range(60):
            residual = value(x)
            matrix = slopes(x)
            rows, columns = _equilibrated(matrix)
            step = columns * np.linalg.lstsq(rows[:, None] * matrix * columns, -rows * residual, rcond=1e-13)[0]
            x = x + step
            if np.all(np.abs(step) <= 1e-13 * (columns + np.abs(x))):
                break
        matrix = slopes(x)
        rows, columns = _equilibrated(matrix)
        residual_size = float(np.max(np.abs(value(x)) / (1.0 / rows + np.abs(matrix) @ np.abs(x))))
        uncertain = _undetermined(rows[:, None] * matrix * columns, unknowns)
        count = len(self.graph.bonds)
        position = {unknown: index for index, unknown in enumerate(unknowns)}
        return Solution(
            x[:count],
            x[count : 2 * count],
            {name: float(x[position[s]]) for name, s in self.stored.items()},
            {name: float(x[position[dz[s]]]) for name, s in self.stored.items()},
            residual_size,
            tuple(name for name in uncertain if name in _wanted(self, dz)),
        )


def _wanted(oracle: Oracle, dz: Mapping[Symbol, Symbol]) -> set[str]:
    names = {v.name for v in (*oracle.e, *oracle.f)}
    return names | {dz[s].name for s in oracle.stored.values()} | {s.name for s in oracle.stored.values()}


def _without_pulses(expression: Expr) -> Expr:
    """Slopes of kinks and steps as numbers: a step has slope zero."""
    if not expression.has(sympy.DiracDelta, sympy.Derivative):
        return expression
    return expression.replace(sympy.DiracDelta, lambda *_: sympy.S.Zero).doit()


def _lambdified(system: list[Expr], unknowns: list[Symbol], functions: dict[str, Any]) -> tuple[Any, Any]:
    position = {unknown: index for index, unknown in enumerate(unknowns)}
    entries = [
        (row, position[used], _without_pulses(equation.diff(used)))
        for row, equation in enumerate(system)
        for used in sorted(equation.free_symbols & set(position), key=str)
    ]
    modules = [functions, "numpy"]
    value = sympy.lambdify([unknowns], system, modules=modules)
    slopes = sympy.lambdify([unknowns], [entry for _, _, entry in entries], modules=modules)
    rows = np.array([row for row, _, _ in entries], dtype=int)
    columns = np.array([column for _, column, _ in entries], dtype=int)

    def matrix(x: np.ndarray) -> np.ndarray:
        found = np.zeros((len(system), len(unknowns)))
        found[rows, columns] = slopes(x)
        return found

    return lambda x: np.array(value(x), dtype=float), matrix


def _equilibrated(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scales of rows and columns that bring the largest entry of each near one (Ruiz 2001, RAL-TR-2001-034)."""
    rows, columns = np.ones(len(matrix)), np.ones(matrix.shape[1])
    for _ in range(8):
        sizes = np.abs(rows[:, None] * matrix * columns)
        tall, wide = sizes.max(axis=1), sizes.max(axis=0)
        rows /= np.sqrt(np.where(tall > 0, tall, 1.0))
        columns /= np.sqrt(np.where(wide > 0, wide, 1.0))
    return rows, columns


def _undetermined(matrix: np.ndarray, unknowns: list[Symbol]) -> list[str]:
    """Unknowns that the linearised system leaves free."""
    _, singular, right = np.linalg.svd(matrix, full_matrices=True)
    rank = int((singular > 1e-10 * singular[0]).sum())
    free = np.abs(right[rank:]).max(axis=0) if rank < len(unknowns) else np.zeros(len(unknowns))
    return [unknown.name for unknown, size in zip(unknowns, free, strict=True) if size > 1e-7]


def table_functions_in(expression: Expr) -> list[str]:
    """Names of tables an expression uses."""
    return sorted({used.table_name for used in expression.atoms(TableFunction)})


def is_well_posed(graph: BondGraph) -> bool:
    """Whether the bond equations of a linear graph determine every effort, flow and energy variable over time.

    True where the matrix pencil ``s E - A`` of the whole system is regular, decided by its rank at a random ``s``:
    independent of any choice of causality, and true for storages of any degree of dependence.
    """
    oracle = Oracle(graph)
    unknowns = [*oracle.e, *oracle.f, *oracle.stored.values(), *oracle.signals]
    rng = np.random.default_rng(7)
    s = complex(rng.uniform(0.5, 2.0), rng.uniform(0.5, 2.0))
    system = [*oracle.equations, *(s * oracle.stored[name] - rate for name, rate in oracle.rates.items())]
    values = {q.symbol: q.value for q in graph.parameters}
    matrix = np.zeros((len(system), len(unknowns)), dtype=complex)
    for row, equation in enumerate(system):
        for column, unknown in enumerate(unknowns):
            if unknown in equation.free_symbols:
                matrix[row, column] = complex(sympy.expand(equation).coeff(unknown).xreplace(values))
    matrix /= np.abs(matrix).max(axis=1, keepdims=True)
    singular = np.linalg.svd(matrix, compute_uv=False)
    return bool(singular[-1] > 1e-9 * singular[0])
