"""The text that is compiled for derivatives of one model's trajectories: values and tangents in lanes.

For chosen parameters the equations are printed with their Jacobians J = df/dx and df/dtheta. At every stage

    slopes(clock, inputs, w, n)     f, J and df/dtheta of all lanes
    push(seed, w, n)                J d + (df/dtheta) seed, for one direction d of all lanes

are called: what is expensive (functions, tables, loops) is computed once for all directions. In the step of a stiff
method J itself moves with the state at which the step starts, and so does the trend df/dt. For a stage U

    curve(clock, inputs, w, n)      d(J U)/dx and d(J U)/dtheta at the start of the step
    bend(seed, w, n)                their product with a direction
    sway(seed, w, n)                the product of the derivatives of the trend with a direction

so that the tangent is that of the steps themselves, and exact for the likelihood that is computed with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bondgraph.simulate.program import stiff_tangent_kernel, tangent_kernel
from bondgraph.simulate.program.lane_model import Writer, kernel_functions
from bondgraph.simulate.program.lane_text import Place
from bondgraph.simulate.program.model_program import ModelProgram
from bondgraph.simulate.program.tangent import tangents
from bondgraph.simulate.program.tape import Program


@dataclass(frozen=True)
class TangentText:
    """Source of the tangent functions, first rows of vectors, and rows of the work buffer in all.

    ``x`` and ``theta`` as in :class:`bondgraph.simulate.program.lane_model.LaneText`; ``y`` the outputs, ``din`` where
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


def tangent_text(equations: ModelProgram, parameters: Sequence[int], stiff: bool) -> TangentText:
    """Text of the tangent functions, explicit or stiff, for derivatives by the parameters at these positions.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> text = tangent_text(pendulum().program, [0], stiff=False)
    >>> [name for name in ("slopes", "push", "advance_tangents") if f"def {name}(" in text.source]
    ['slopes', 'push', 'advance_tangents']
    """
    return _TangentWriter(equations, parameters, stiff).tangent_text()


class _TangentWriter(Writer):
    def __init__(self, equations: ModelProgram, parameters: Sequence[int], stiff: bool) -> None:
        super().__init__(equations, stiff)
        self._parameters = list(parameters)
        self._kept: dict[str, dict[int, int]] = {"jac": {}, "yjac": {}, "bend": {}, "sway": {}}

    def tangent_text(self) -> TangentText:
        programs = self._tangent_programs()
        hoisted = self._tape.program(self._hoister.nodes)
        self._lay_out()
        n_u, rows = self._equations.sizes["u"], self._rows
        at_x = {name: Place(rows[name]) for name in ("theta", "hoisted", "x", "din", "factors", *self._kept)} | {
            "seed": Place(0, "seed"), "t": Place(0, "clock"), "step": Place(1, "clock"), "u": Place(0, "inputs"),
            "du": Place(n_u, "inputs"), "right": Place(rows["total"]), "v": Place(rows["total"]),
        }  # fmt: skip
        at_stage = {**at_x, "x": Place(rows["stage"])}
        timed, seeded = "clock, inputs, w, n", "seed, w, n"
        parts = [
            self._function("prepare", "w, n", hoisted, at_x, ["hoisted"]),
            self._function("slopes", timed, programs["slopes"], at_stage, ["slope", "jac"]),
            self._function("push", seeded, programs["push"], at_x, ["dout"]),
            self._function("measure_slopes", timed, programs["measure"], at_x, ["y", "yjac"]),
            self._function("push_output", seeded, programs["push_output"], at_x, ["dy"]),
        ]
        if self._stiff:
            parts += [
                self._function("factor", timed, programs["factor"], at_x, ["trend", "factors", "sway"]),
                self._function("substitute", "w, n", programs["substitute"], at_x, ["total"]),
                self._function("curve", timed, programs["curve"], at_x, ["bend"]),
                self._function("bend", seeded, programs["bend"], at_x, ["dout"]),
                self._function("sway", seeded, programs["sway"], at_x, ["dout"]),
            ]
        kernel = stiff_tangent_kernel if self._stiff else tangent_kernel
        functions = [f"@lane_loops\n{part}" for part in parts]
        lines = "\n".join([f"DIN = {rows['din']}", f"DOUT = {rows['dout']}"])
        calls = kernel_functions(kernel, "@_inner", callback="advance_tangents")
        source = "\n\n\n".join([self._preamble(), lines, *functions, *calls])
        total, vectors = self._next + self._spare, 9 if self._stiff else 3
        return TangentText(source, rows["theta"], rows["x"], rows["y"], rows["din"], rows["dy"], total, vectors)

    def _lay_out(self) -> None:
        n_x, n_y = self._equations.sizes["x"], len(self._equations.rows["output"])
        kept = {name: len(stored) for name, stored in self._kept.items()}
        stiff = {"factors": self._n_factors, "stages": 6 * n_x} if self._stiff else {"factors": 0, "stages": 0}
        for name, size in {
            "theta": self._equations.sizes["theta"], "x": n_x, "stage": n_x, "slope": n_x, "total": n_x, "trend": n_x,
            "hoisted": len(self._hoister.nodes), "y": n_y, "din": n_x, "dout": n_x, "dy": n_y, **kept, **stiff,
        }.items():  # fmt: skip
            self._rows[name] = self._next
            self._next += size

    def _sizes(self) -> dict[str, int]:
        n_x = self._equations.sizes["x"]
        sizes = {"slope": n_x, "y": len(self._equations.rows["output"]), "trend": n_x}
        return {**sizes, "factors": self._n_factors} if self._stiff else sizes

    def _tangent_programs(self) -> dict[str, Program]:
        model, tape, rewrite = self._equations, self._tape, self._hoister.rewrite
        push = self._products(model.rows["rhs"], "jac")
        push_output = self._products(model.rows["output"], "yjac")
        programs = {
            "slopes": tape.program([*rewrite(model.rows["rhs"]), *self._kept["jac"]]),
            "push": push,
            "measure": tape.program([*rewrite(model.rows["output"]), *self._kept["yjac"]]),
            "push_output": push_output,
        }
        if not self._stiff:
            return programs
        along = {tape.leaf("x", k): tape.leaf("v", k) for k in range(model.sizes["x"])}
        programs["bend"] = self._products(tangents(model.reader, model.rows["rhs"], along), "bend")
        programs["curve"] = tape.program(self._kept["bend"])
        programs["sway"] = self._products(model.trend_nodes(), "sway")
        nodes, programs["substitute"] = self._solver_nodes()
        programs["factor"] = tape.program([*nodes, *self._kept["sway"]])
        return programs

    def _products(self, rows: Sequence[int], kept: str) -> Program:
        """The product of the derivatives of some rows with a direction; the derivatives are kept under a name."""
        model, tape = self._equations, self._tape
        one = tape.constant(1.0)
        columns = [("din", k, tape.leaf("x", k)) for k in range(model.sizes["x"])]
        columns += [("seed", q, tape.leaf("theta", p)) for q, p in enumerate(self._parameters)]
        pushed = [tape.constant(0.0) for _ in rows]
        for vector, position, leaf in columns:
            derivatives = self._hoister.rewrite(tangents(model.reader, rows, {leaf: one}))
            for i, node in enumerate(derivatives):
                entry = self._stored(node, self._kept[kept], kept)
                pushed[i] = tape.add(pushed[i], tape.mul(entry, tape.leaf(vector, position)))
        return tape.program(pushed)
