"""The text that is compiled for one model: its equations in lanes, and how they are integrated.

The work buffer ``w`` holds, for up to 16 lanes, one row per number:

    THETA  parameters                          set by the caller, then prepare(w, n)
    HOISTED  what depends on them only         written by prepare
    X  state                                   set by the caller, moved by advance
    Y  outputs at X                            written by measure
    STAGE SLOPE TOTAL TREND STAGES FACTORS     used by advance, see ``step_kernel``
"""

from __future__ import annotations

import ast
import functools
import inspect
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bondgraph.compile.front.model_program import ModelProgram
from bondgraph.compile.ir.tape import Program, Tape
from bondgraph.compile.lanes import math as lane_math
from bondgraph.compile.lanes import step_kernel
from bondgraph.compile.lanes.stages import MOST_STAGES, rosenbrock_text, runge_kutta_text
from bondgraph.compile.lanes.text import LANES, Place, lane_function
from bondgraph.compile.passes.hoist import Hoister
from bondgraph.compile.passes.quick import LoopCalls
from bondgraph.compile.passes.sparse_lu import SparseFactors, factorise, substitute
from bondgraph.syntax import parsed

if TYPE_CHECKING:
    from types import ModuleType


@dataclass(frozen=True)
class LaneText:
    """Source of the lane functions of a model, first rows of its vectors, and rows of the work buffer in all."""

    source: str
    theta: int
    x: int
    y: int
    rows: int


def lane_text(equations: ModelProgram, stiff: bool) -> LaneText:
    """Text of ``prepare``, ``advance`` and ``measure`` of a model, explicit or stiff.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> text = lane_text(pendulum().program, stiff=False)
    >>> print(text.source.partition("def rates")[2].partition("def measure")[0].strip())
    (clock, inputs, w, n):
        inputs_0 = inputs[0]
        for l in range(n):
            v_4 = _lane_sin(w[80 + l])
            dx1_9 = (inputs_0 - (w[96 + l] * w[16 + l])) - (v_4 * w[208 + l])
            w[112 + l] = w[96 + l]
            w[128 + l] = dx1_9
    """
    return Writer(equations, stiff).text()


class Writer:
    """Lays out the work buffer and prints one function after another."""

    def __init__(self, equations: ModelProgram, stiff: bool) -> None:
        self._equations = equations
        self._stiff = stiff
        self._tape: Tape = equations.tape
        self._calls = LoopCalls(equations.reader)
        self._hoister = Hoister(self._tape, self._calls)
        self._rows: dict[str, int] = {}
        self._next = 0

    def text(self) -> LaneText:
        """All of the text."""
        n_x, n_u = self._equations.sizes["x"], self._equations.sizes["u"]
        programs = self._programs()
        hoisted = self._tape.program(self._hoister.nodes)
        for name, size in (
            ("theta", self._equations.sizes["theta"]), ("x", n_x), ("stage", n_x), ("slope", n_x), ("total", n_x),
            ("trend", n_x), ("hoisted", len(self._hoister.nodes)), ("y", len(self._equations.rows["output"])),
            ("factors", self._n_factors if self._stiff else 0), ("stages", MOST_STAGES * n_x if self._stiff else 0),
        ):  # fmt: skip
            self._rows[name] = self._next
            self._next += size
        common = {"theta": Place(self._rows["theta"]), "hoisted": Place(self._rows["hoisted"])}
        timed = {
            "t": Place(0, "clock"), "step": Place(1, "clock"), "u": Place(0, "inputs"), "du": Place(n_u, "inputs"),
            "factors": Place(self._rows["factors"]), "right": Place(self._rows["total"]),
        }  # fmt: skip
        at_x = {**common, **timed, "x": Place(self._rows["x"])}
        at_stage = {**at_x, "x": Place(self._rows["stage"])}
        parts = [
            self._function("prepare", "w, n", hoisted, common, ["hoisted"]),
            self._function("rates", "clock, inputs, w, n", programs["rates"], at_stage, ["slope"]),
            self._function("measure", "clock, inputs, w, n", programs["measure"], at_x, ["y"]),
        ]
        if self._stiff:
            at_start = ["trend", "factors", "slope"]
            parts.append(self._function("factor", "clock, inputs, w, n", programs["factor"], at_x, at_start))
            parts.append(self._function("substitute", "w, n", programs["substitute"], at_x, ["total"]))
        parts += (rosenbrock_text if self._stiff else runge_kutta_text)(self._rows, n_x)
        source = "\n\n\n".join([self._preamble(), *parts, *self._kernel()])
        return LaneText(source, self._rows["theta"], self._rows["x"], self._rows["y"], self._next + self._spare)

    _spare = 0
    _n_factors = 0

    def _programs(self) -> dict[str, Program]:
        equations, tape = self._equations, self._tape
        rewrite, rows = self._hoister.rewrite, equations.rows
        programs = {
            "rates": tape.program(rewrite(rows["rhs"])),
            "measure": tape.program(rewrite(rows["output"])),
        }
        if self._stiff:
            nodes, factors = self._solver_nodes()
            programs["substitute"] = self._solution(factors)
            programs["factor"] = tape.program([*nodes, *rewrite(rows["rhs"])])
        return programs

    def _solver_nodes(self) -> tuple[list[int], SparseFactors]:
        """Nodes of df/dt and of the factors of 1/(gamma h) I - J, and the factors as other functions read them."""
        equations, tape = self._equations, self._tape
        n_x = equations.sizes["x"]
        factors = factorise(tape, n_x, equations.jacobian_nodes("rhs", "x"), tape.leaf("step", 0))
        nodes = [*factors.entries.values(), *factors.inverse_pivots.values()]
        new = dict(zip(nodes, self._hoister.rewrite(nodes), strict=True))
        stored: dict[int, int] = {}

        def known(node: int) -> int:
            return self._stored(node, stored, "factors")

        kept = SparseFactors(
            factors.order,
            {place: known(new[node]) for place, node in factors.entries.items()},
            {k: known(new[node]) for k, node in factors.inverse_pivots.items()},
        )
        self._n_factors = len(stored)
        return [*self._hoister.rewrite(equations.trend_nodes()), *stored], kept

    def _solution(self, factors: SparseFactors) -> Program:
        """The solution for a right-hand side."""
        right = [self._tape.leaf("right", i) for i in range(self._equations.sizes["x"])]
        return self._tape.program(substitute(self._tape, factors, right))

    def _stored(self, node: int, stored: dict[int, int], vector: str) -> int:
        """How another function reads a node: directly where it is fixed, else from a vector in which it is kept."""
        operation = self._tape.operations[node]
        if operation.kind == "constant" or (operation.kind == "leaf" and operation.value[0] in ("theta", "hoisted")):
            return node
        return self._tape.leaf(vector, stored.setdefault(node, len(stored)))

    def _sizes(self) -> dict[str, int]:
        """Results that go into one vector where others of the same function go elsewhere."""
        return {"trend": self._equations.sizes["x"], "factors": self._n_factors}

    def _function(
        self, name: str, arguments: str, program: Program, places: dict[str, Place], targets: list[str]
    ) -> str:
        sizes = self._sizes()
        rows: list[int] = []
        for target in targets:
            count = sizes.get(target, len(program.results) - len(rows))
            rows += [self._rows[target] + i for i in range(count)]
        used = dict.fromkeys(op.value[0] for op in program.operations if op.kind == "solve")
        text, spare = lane_function(
            name, arguments, program, places, rows, self._next, {name: self._calls.programs[name] for name in used}
        )
        self._spare = max(self._spare, spare)
        return text

    def _preamble(self) -> str:
        """Numbers of rows, tables, functions of lanes and solvers of loops."""
        lines = [f"LANES = {LANES}", f"ROWS = {self._next + self._spare}", f"N_X = {self._equations.sizes['x']}"]
        names = ("x", "stage", "slope", "total", "trend", "stages")
        lines += [f"{name.upper()} = {self._rows[name]}" for name in names]
        for key, values in self._tape.arrays.items():
            numbers = np.array2string(values, separator=", ", threshold=values.size + 1, floatmode="unique")
            lines.append(f"{key} = np.array({numbers})")
        return "\n\n\n".join(["\n".join(lines), *module_functions(lane_math)])

    def _kernel(self) -> list[str]:
        unused = "_rk4_step" if self._stiff else "_rosenbrock_step"
        used = "_rosenbrock_step" if self._stiff else "_rk4_step"
        parts = module_functions(step_kernel)
        return [part.replace("one_step", used) for part in parts if f"def {unused}" not in part]


@functools.cache
def module_functions(kernel: ModuleType) -> tuple[str, ...]:
    """Texts of the functions of a kernel module; every model that is compiled asks for them."""
    text = inspect.getsource(kernel)
    nodes = [node for node in parsed(text).body if isinstance(node, ast.FunctionDef)]
    return tuple(ast.get_source_segment(text, node) or "" for node in nodes)
