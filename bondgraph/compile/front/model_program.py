"""The equations of a model as programs, and their Jacobians with the places of what is not zero."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.compile.front.parse import Reader
from bondgraph.compile.ir.evaluate import evaluate, stack_rows
from bondgraph.compile.ir.tape import Program, Tape
from bondgraph.compile.loader import parse_module, run_module
from bondgraph.compile.passes.tangent import tangents

Equations = Literal["rhs", "output", "start"]
Variables = Literal["x", "u", "theta"]


@dataclass(frozen=True)
class SparseJacobian:
    """A Jacobian of ``shape``: entry k stands in row ``rows[k]``, column ``columns[k]``, and is result k of a program.

    Entries are sorted by row and column; what is not listed is zero by structure.
    """

    shape: tuple[int, int]
    rows: IntArray
    columns: IntArray
    program: Program = field(repr=False)

    def dense(self, values: FloatArray) -> FloatArray:
        """Entries (entries, *batch) as a full array (rows, columns, *batch)."""
        full = np.zeros((*self.shape, *values.shape[1:]))
        full[self.rows, self.columns] = values
        return full

    @property
    def pattern(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Where entries may differ from zero, shape ``shape``."""
        marks = np.zeros(self.shape, dtype=np.bool_)
        marks[self.rows, self.columns] = True
        return marks


class ModelProgram:
    """The equations of one model on a tape, and what is derived from them.

    Parameters
    ----------
    text, name
        The generated module, which is read once, and its name.
    sizes
        How many states, inputs and parameters it has.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> jacobian = pendulum().program.jacobian("rhs", "x")
    >>> jacobian.rows.tolist(), jacobian.columns.tolist()
    ([0, 1, 1], [1, 0, 1])
    """

    def __init__(self, text: str, name: str, sizes: Mapping[Variables, int]) -> None:
        self._text, self._name = text, name
        tree = parse_module(text, name)
        namespace = run_module(tree, name)
        self.tree = tree
        self.tape = Tape()
        self.reader = Reader(tree, namespace, self.tape)
        self.rows: dict[Equations, tuple[int, ...]] = {
            "rhs": self.reader.equations("rhs"),
            "output": self.reader.equations("output"),
        }
        if self.reader.has("start"):  # of states that start where parameters say
            self.rows |= {"start": self.reader.equations("start")}
        self.solvers: Mapping[str, Callable[..., Any]] = {name: namespace[name] for name in self.reader.solvers}
        self.sizes = sizes
        self._growing = threading.Lock()  # one tape, of which several threads may ask
        self._jacobians: dict[tuple[Equations, Variables], SparseJacobian] = {}

    def anew(self) -> ModelProgram:
        """The same equations on a tape of their own.

        What is printed of a tape depends on what it was asked before: operations keep the order in which they were
        first needed, so that a sum of two products rounds the one or the other. Text that is compiled is printed from a
        new tape, whatever a process, or another of its threads, did with the model before.
        """
        return ModelProgram(self._text, self._name, self.sizes)

    def derivative(self, nodes: tuple[int, ...], vector: str, position: int) -> tuple[int, ...]:
        """Derivatives of nodes with respect to one element of a vector."""
        return tangents(self.reader, nodes, {self.tape.leaf(vector, position): self.tape.constant(1.0)})

    def jacobian_nodes(self, equations: Equations, by: Variables) -> dict[tuple[int, int], int]:
        """Nodes of all entries of a Jacobian that are not zero by structure, by row and column."""
        entries: dict[tuple[int, int], int] = {}
        for column in range(self.sizes[by]):
            for row, node in enumerate(self.derivative(self.rows[equations], by, column)):
                if not self.tape.is_zero(node):
                    entries[row, column] = node
        return dict(sorted(entries.items()))

    def jacobian(self, equations: Equations, by: Variables) -> SparseJacobian:
        """Derivatives of ``rhs``, ``output`` or ``start`` with respect to the states, inputs or parameters."""
        key = (equations, by)
        with self._growing:
            if key not in self._jacobians:
                entries = self.jacobian_nodes(equations, by)
                places = np.array(list(entries), dtype=np.int64).reshape(-1, 2)
                shape = (len(self.rows[equations]), self.sizes[by])
                program = self.tape.program(entries.values())
                self._jacobians[key] = SparseJacobian(shape, places[:, 0], places[:, 1], program)
            return self._jacobians[key]

    @functools.cached_property
    def trend(self) -> Program:
        """Derivatives of ``rhs`` with respect to time while inputs change at the rates in the vector ``du``."""
        with self._growing:
            return self.tape.program(self.trend_nodes())

    def trend_nodes(self) -> tuple[int, ...]:
        """Nodes of :attr:`trend`."""
        tape = self.tape
        seeds = {tape.leaf("u", j): tape.leaf("du", j) for j in range(self.sizes["u"])}
        return tangents(self.reader, self.rows["rhs"], {**seeds, tape.leaf("t", 0): tape.constant(1.0)})

    def dense_jacobian(
        self,
        equations: Equations,
        by: Variables,
        t: float | FloatArray,
        x: FloatArray,
        u: FloatArray,
        theta: FloatArray,
    ) -> FloatArray:
        """A Jacobian at a point or a batch of points, shape (rows, columns, *batch), with its zeros."""
        jacobian = self.jacobian(equations, by)
        leaves = {"t": (t,), "x": x, "u": u, "theta": theta}
        return jacobian.dense(self.evaluate(jacobian.program, leaves, x.shape[1:]))

    def evaluate(self, program: Program, leaves: Mapping[str, Any], batch: tuple[int, ...]) -> FloatArray:
        """Results of a program of this model, shape (results, *batch)."""
        return stack_rows(evaluate(program, leaves, self.solvers), batch)
