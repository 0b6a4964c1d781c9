"""The text that is compiled for derivatives of one model's trajectories: values and tangents in lanes.

For chosen parameters the equations are printed with their Jacobians J = df/dx and df/dtheta. At every stage

    slopes(clock, inputs, w, n)     f, J and df/dtheta of all lanes
    push(seed, w, n)                J d + (df/dtheta) seed, for one direction d of all lanes

are called: what is expensive (functions, tables, loops) is computed once for all directions. In the step of a stiff
method J itself moves with the state at which the step starts, and so does the trend df/dt:

    factor(clock, inputs, w, n)     all that belongs to the start of the step: dx/dt, J, df/dtheta, the second
                                    derivatives, the trend with its own, and the factors of W = 1/(gamma h) I - J
    curve(w, n)                     d(J U)/dx and d(J U)/dtheta there, for every stage U

A stage solves W U = R, so its tangent solves W dU = dR + dJ U. With the matrices of all stages kept, the whole step of
a direction is straight-line arithmetic:

    push_step(seed, clock, w, n)    a direction at the end of a step from that at its start
    push_state(clock, w, n)         the same for a direction in which no parameter moves

so that the tangent is that of the steps themselves, and exact for the likelihood that is computed with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bondgraph.compile.front.model_program import ModelProgram
from bondgraph.compile.ir.tape import Program
from bondgraph.compile.lanes import stiff_tangent_kernel, tangent_kernel
from bondgraph.compile.lanes.stages import (
    direction_text,
    keep_slopes_text,
    rosenbrock_text,
    runge_kutta_text,
    stiff_direction_text,
)
from bondgraph.compile.lanes.text import Place
from bondgraph.compile.lanes.writer import Writer, module_functions
from bondgraph.compile.passes.sparse_lu import SparseFactors, substitute
from bondgraph.compile.passes.tangent import tangents
from bondgraph.compile.rosenbrock import Tableau

#: Nodes of the entries of a matrix, by row, vector that it is multiplied with, and position there.
Entries = dict[tuple[int, str, int], int]


@dataclass(frozen=True)
class TangentText:
    """Source of the tangent functions, first rows of vectors, and rows of the work buffer in all.

    ``x`` and ``theta`` as in :class:`bondgraph.compile.lanes.writer.LaneText`; ``y`` the outputs, ``din`` where
    a direction goes in, ``dy`` where the direction of the outputs comes out. ``vectors`` is how many vectors of states
    each direction takes.
    """

    source: str
    theta: int
    x: int
    y: int
    din: int
    dy: int
    rows: int
    vectors: int


def tangent_text(equations: ModelProgram, parameters: Sequence[int], tableau: Tableau | None = None) -> TangentText:
    """Text of the tangent functions for derivatives by the parameters at these positions.

    They are those of the stiff method with this tableau, or of the explicit one.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> text = tangent_text(pendulum().program, [0])
    >>> [name for name in ("slopes", "push", "advance_tangents") if f"def {name}(" in text.source]
    ['slopes', 'push', 'advance_tangents']
    """
    return _TangentWriter(equations, parameters, tableau).tangent_text()


#: What is kept from the start of a stiff step, in this order; the entries of J and df/dtheta come last.
_AT_START = ("trend", "factors", "sway", "hess", "slope")


class _TangentWriter(Writer):
    def __init__(self, equations: ModelProgram, parameters: Sequence[int], tableau: Tableau | None) -> None:
        super().__init__(equations, tableau is not None)
        self._parameters = list(parameters)
        self._tableau = tableau
        self._kept: dict[str, dict[int, int]] = {"jac": {}, "yjac": {}, "hess": {}, "sway": {}}
        self._n_bend = 0

    def tangent_text(self) -> TangentText:
        programs = self._tangent_programs()
        hoisted = self._tape.program(self._hoister.nodes)
        self._lay_out()
        places = self._places()
        at_stage = {**places, "x": Place(self._rows["stage"])}
        timed, seeded, stepped = "clock, inputs, w, n", "seed, w, n", "clock, w, n"
        n_x, stages = self._equations.sizes["x"], range(self._tableau.stages if self._tableau else 0)
        kept = [self._rows["jacs"] + s * len(self._kept["jac"]) for s in stages]
        parts = [
            self._function("prepare", "w, n", hoisted, places, ["hoisted"]),
            self._function("slopes", timed, programs["slopes"], at_stage, ["slope", "jac"]),
            self._function("measure_slopes", timed, programs["measure"], places, ["y", "yjac"]),
            self._function("push_output", seeded, programs["push_output"], places, ["dy"]),
        ]
        if self._stiff:
            parts += [
                self._function("factor", timed, programs["factor"], places, [*_AT_START, "jac"]),
                self._function("substitute", "w, n", programs["substitute"], places, ["total"]),
                self._function("curve", "w, n", programs["curve"], places, ["bends"]),
                self._function("push_step", f"seed, {stepped}", programs["push_step"], places, ["dout"]),
                self._function("push_state", stepped, programs["push_state"], places, ["dout"]),
                *rosenbrock_text(self._rows, n_x),
                *stiff_direction_text(self._rows, n_x),
                keep_slopes_text(self._rows["jac"], kept, len(self._kept["jac"])),
            ]
        else:
            parts.append(self._function("push", seeded, programs["push"], places, ["dout"]))
            parts += [*runge_kutta_text(self._rows, n_x), *direction_text(self._rows, n_x)]
        kernel = stiff_tangent_kernel if self._stiff else tangent_kernel
        source = "\n\n\n".join([self._preamble(), *parts, *module_functions(kernel)])
        rows, total, vectors = self._rows, self._next + self._spare, 1 if self._stiff else 3
        return TangentText(source, rows["theta"], rows["x"], rows["y"], rows["din"], rows["dy"], total, vectors)

    def _places(self) -> dict[str, Place]:
        """Where each vector of leaves is."""
        rows, n_u = self._rows, self._equations.sizes["u"]
        stages = range(self._tableau.stages if self._tableau else 0)
        return {
            **{name: Place(rows[name]) for name in ("theta", "hoisted", "x", "din", "factors", *self._kept)},
            **{f"jac{s}": Place(rows["jacs"] + s * len(self._kept["jac"])) for s in stages},
            **{f"bend{s}": Place(rows["bends"] + s * self._n_bend) for s in stages},
            "seed": Place(0, "seed"), "t": Place(0, "clock"), "step": Place(1, "clock"), "u": Place(0, "inputs"),
            "du": Place(n_u, "inputs"), "right": Place(rows["total"]), "stages": Place(rows["stages"]),
        }  # fmt: skip

    def _lay_out(self) -> None:
        n_x, n_y = self._equations.sizes["x"], len(self._equations.rows["output"])
        kept = {name: len(stored) for name, stored in self._kept.items()}
        stages = self._tableau.stages if self._tableau else 0
        stiff = {
            "factors": self._n_factors if self._stiff else 0, "stages": stages * n_x,
            "jacs": stages * kept["jac"], "bends": stages * self._n_bend,
        }  # fmt: skip
        for name, size in {
            "theta": self._equations.sizes["theta"], "x": n_x, "stage": n_x, "slope": n_x, "total": n_x, "trend": n_x,
            "hoisted": len(self._hoister.nodes), "y": n_y, "din": n_x, "dout": n_x, "dy": n_y, **kept, **stiff,
        }.items():  # fmt: skip
            self._rows[name] = self._next
            self._next += size

    def _sizes(self) -> dict[str, int]:
        n_x = self._equations.sizes["x"]
        sizes = {"slope": n_x, "y": len(self._equations.rows["output"]), "trend": n_x}
        kept = {name: len(self._kept[name]) for name in ("sway", "hess")}
        return {**sizes, **kept, "factors": self._n_factors} if self._stiff else sizes

    def _tangent_programs(self) -> dict[str, Program]:
        model, tape, rewrite = self._equations, self._tape, self._hoister.rewrite
        moving = self._moving(seeded=True)
        jac, outputs = self._entries(model.rows["rhs"], "jac"), self._entries(model.rows["output"], "yjac")
        programs = {
            "slopes": tape.program([*rewrite(model.rows["rhs"]), *self._kept["jac"]]),
            "measure": tape.program([*rewrite(model.rows["output"]), *self._kept["yjac"]]),
            "push_output": tape.program(self._product(outputs, len(model.rows["output"]), moving)),
        }
        if self._tableau is None:
            programs["push"] = tape.program(self._product(jac, model.sizes["x"], moving))
            return programs
        sway = self._entries(model.trend_nodes(), "sway")
        bend, bends = self._bends(self._tableau.stages)
        nodes, factors = self._solver_nodes()
        programs["curve"] = tape.program(bends)
        at_start = [*nodes, *self._kept["sway"], *self._kept["hess"], *rewrite(model.rows["rhs"]), *self._kept["jac"]]
        programs["factor"] = tape.program(at_start)
        programs["substitute"] = self._solution(factors)
        for name, seeded in (("push_step", True), ("push_state", False)):
            programs[name] = tape.program(self._step(self._tableau, jac, bend, sway, factors, seeded))
        return programs

    def _bends(self, stages: int) -> tuple[Entries, list[int]]:
        """The derivatives of J U, for one stage as they are read, and nodes of those of all stages U."""
        tape = self._tape
        second = self._second_derivatives()
        rows = dict.fromkeys((i, vector, position) for i, _, vector, position in second)
        self._n_bend = len(rows)
        nodes = []
        for s in range(stages):
            sums = dict.fromkeys(rows, tape.constant(0.0))
            for (i, j, vector, position), node in second.items():
                stage = tape.leaf("stages", s * self._equations.sizes["x"] + j)
                sums[i, vector, position] = tape.add(sums[i, vector, position], tape.mul(node, stage))
            nodes += list(sums.values())
        return {row: tape.leaf("bend", k) for k, row in enumerate(rows)}, nodes

    def _second_derivatives(self) -> dict[tuple[int, int, str, int], int]:
        """The derivatives of the entries (i, j) of J by states and parameters; those by two states are formed once."""
        tape, reader = self._tape, self._equations.reader
        jacobian = self._equations.jacobian_nodes("rhs", "x")
        found: dict[tuple[int, int, str, int], int] = {}
        for vector, position, leaf in self._columns():
            first = [place for place in jacobian if vector != "din" or place[1] <= position]
            derivatives = tangents(reader, [jacobian[place] for place in first], {leaf: tape.constant(1.0)})
            for (i, j), node in zip(first, self._hoister.rewrite(derivatives), strict=True):
                if not tape.is_zero(node):
                    kept = self._stored(node, self._kept["hess"], "hess")
                    found[i, j, vector, position] = kept
                    if vector == "din":
                        found[i, position, vector, j] = kept
        return found

    def _step(
        self, tableau: Tableau, jac: Entries, bend: Entries, sway: Entries, factors: SparseFactors, seeded: bool
    ) -> list[int]:
        """A direction at the end of a step of the method from that at its start, see ``rosenbrock`` for the stages."""
        tape, n_x = self._tape, self._equations.sizes["x"]
        moving = self._moving(seeded)
        start = [moving["din", k] for k in range(n_x)]
        inverse = tape.mul(tableau.gamma, tape.leaf("step", 0))  # 1/h
        trend = self._product(sway, n_x, moving)
        stages: list[list[int]] = []
        slopes: list[int] = []
        for s in range(tableau.stages):
            if tableau.is_new(s):
                at = self._sums(start, tableau.a[s], stages)
                there = moving | {("din", k): node for k, node in enumerate(at)}
                slopes = self._product(jac, n_x, there, f"jac{s}")
            turned = self._product(bend, n_x, moving, f"bend{s}")
            length = tape.div(tableau.gammas[s], inverse)
            right = [tape.add(tape.add(slopes[i], turned[i]), tape.mul(length, trend[i])) for i in range(n_x)]
            past = self._sums([tape.constant(0.0)] * n_x, tableau.c[s], stages)
            right = [tape.add(node, tape.mul(inverse, past[i])) for i, node in enumerate(right)]
            stages.append(substitute(tape, factors, right))
        return self._sums(start, tableau.m, stages)

    def _sums(self, start: Sequence[int], shares: Sequence[float], stages: Sequence[Sequence[int]]) -> list[int]:
        """A vector plus shares of the stages."""
        tape, total = self._tape, list(start)
        for share, stage in zip(shares, stages, strict=True):
            total = [tape.add(a, tape.mul(share, b)) for a, b in zip(total, stage, strict=True)]
        return total

    def _moving(self, seeded: bool) -> dict[tuple[str, int], int]:
        """A direction: derivatives of the states and, if parameters move, of the parameters."""
        names = [("din", k) for k in range(self._equations.sizes["x"])]
        names += [("seed", q) for q in range(len(self._parameters))] if seeded else []
        return {name: self._tape.leaf(*name) for name in names}

    def _columns(self) -> list[tuple[str, int, int]]:
        """What derivatives are formed by: the vector and position of a direction, and the node."""
        tape = self._tape
        columns = [("din", k, tape.leaf("x", k)) for k in range(self._equations.sizes["x"])]
        return columns + [("seed", q, tape.leaf("theta", p)) for q, p in enumerate(self._parameters)]

    def _entries(self, rows: Sequence[int], kept: str) -> Entries:
        """The derivatives of some rows by states and parameters; what is not fixed is kept under a name."""
        model, tape = self._equations, self._tape
        entries: Entries = {}
        for vector, position, leaf in self._columns():
            derivatives = self._hoister.rewrite(tangents(model.reader, rows, {leaf: tape.constant(1.0)}))
            for i, node in enumerate(derivatives):
                if not tape.is_zero(node):
                    entries[i, vector, position] = self._stored(node, self._kept[kept], kept)
        return entries

    def _product(
        self, entries: Entries, count: int, moving: Mapping[tuple[str, int], int], vector: str | None = None
    ) -> list[int]:
        """A matrix of so many rows times a direction; ``vector`` is where what is kept of it is read."""
        tape, product = self._tape, [self._tape.constant(0.0)] * count
        for (i, name, position), entry in entries.items():
            if (name, position) not in moving:
                continue
            operation = tape.operations[entry]
            if vector is not None and operation.kind == "leaf" and operation.value[0] in ("jac", "bend"):
                entry = tape.leaf(vector, operation.value[1])
            product[i] = tape.add(product[i], tape.mul(entry, moving[name, position]))
        return product
