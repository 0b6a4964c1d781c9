"""The text that numba compiles for derivatives of one model's trajectories: values and tangents in lanes.

For chosen parameters the equations are printed with their Jacobians J = df/dx and df/dtheta. At every stage

    slopes(clock, inputs, w, n)     f, J and df/dtheta of all lanes
    push(seed, w, n)                J d + (df/dtheta) seed, for one direction d of all lanes

are called: what is expensive (functions, tables, loops) is computed once for all directions. The tangent is that of the
steps themselves, and so exact for the likelihood that is computed with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bondgraph.simulate.program import tangent_kernel
from bondgraph.simulate.program.lane_model import Writer, kernel_functions
from bondgraph.simulate.program.lane_text import Place
from bondgraph.simulate.program.model_program import ModelProgram
from bondgraph.simulate.program.tangent import tangents
from bondgraph.simulate.program.tape import Program


@dataclass(frozen=True)
class TangentText:
    """Source of the tangent functions, first rows of vectors, and rows of the work buffer in all.

    ``x`` and ``theta`` as in :class:`bondgraph.simulate.program.lane_model.LaneText`; ``y`` the outputs, ``din`` where
    a direction goes in, ``dy`` where the direction of the outputs comes out.
    """

    source: str
    theta: int
    x: int
    y: int
    din: int
    dy: int
    rows: int


def tangent_text(equations: ModelProgram, parameters: Sequence[int]) -> TangentText:
    """Text of the explicit tangent functions for derivatives by the parameters at these positions.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> text = tangent_text(ModelProgram(pendulum()), [0])
    >>> [name for name in ("slopes", "push", "advance_tangents") if f"def {name}(" in text.source]
    ['slopes', 'push', 'advance_tangents']
    """
    return _TangentWriter(equations, parameters).tangent_text()


class _TangentWriter(Writer):
    def __init__(self, equations: ModelProgram, parameters: Sequence[int]) -> None:
        super().__init__(equations, stiff=False)
        self._parameters = list(parameters)
        self._kept: dict[str, int] = {}

    def tangent_text(self) -> TangentText:
        equations, n_x = self._equations, self._equations.sizes["x"]
        n_y = len(equations.rows["output"])
        slopes, push = self._pair("rhs", "jac")
        measure, push_output = self._pair("output", "yjac")
        hoisted = self._tape.program(self._hoister.nodes)
        for name, size in (
            ("theta", equations.sizes["theta"]), ("x", n_x), ("stage", n_x), ("slope", n_x), ("total", n_x),
            ("trend", 0), ("stages", 0), ("hoisted", len(self._hoister.nodes)), ("y", n_y), ("din", n_x),
            ("dout", n_x), ("dy", n_y), ("jac", self._kept["jac"]), ("yjac", self._kept["yjac"]),
        ):  # fmt: skip
            self._rows[name] = self._next
            self._next += size
        common = {"theta": Place(self._rows["theta"]), "hoisted": Place(self._rows["hoisted"])}
        names = ("jac", "yjac", "din")
        common |= {name: Place(self._rows[name]) for name in names} | {"seed": Place(0, "seed")}
        timed = {**common, "t": Place(0, "clock"), "u": Place(0, "inputs")}
        at_stage, at_x = ({**timed, "x": Place(self._rows[name])} for name in ("stage", "x"))
        parts = [
            self._function("prepare", "w, n", hoisted, common, ["hoisted"]),
            self._function("slopes", "clock, inputs, w, n", slopes, at_stage, ["slope", "jac"]),
            self._function("push", "seed, w, n", push, at_stage, ["dout"]),
            self._function("measure_slopes", "clock, inputs, w, n", measure, at_x, ["y", "yjac"]),
            self._function("push_output", "seed, w, n", push_output, at_x, ["dy"]),
        ]
        plain = ("def prepare", "def measure_slopes", "def push_output")
        functions = [part if part.startswith(plain) else f"@_inner\n{part}" for part in parts]
        lines = [f"DIN = {self._rows['din']}", f"DOUT = {self._rows['dout']}"]
        kernel = kernel_functions(tangent_kernel, "@_inner", callback="advance_tangents")
        source = "\n\n\n".join([self._preamble(), "\n".join(lines), *functions, *kernel])
        rows = self._next + self._spare
        at = self._rows
        return TangentText(source, at["theta"], at["x"], at["y"], at["din"], at["dy"], rows)

    def _sizes(self) -> dict[str, int]:
        return {"slope": self._equations.sizes["x"], "y": len(self._equations.rows["output"])}

    def _pair(self, equations: str, kept: str) -> tuple[Program, Program]:
        """Values with the entries of their Jacobians, and the product of these with a direction."""
        model, tape = self._equations, self._tape
        rows = model.rows[equations]  # type: ignore[index]
        one = tape.constant(1.0)
        columns = [("din", k, tape.leaf("x", k)) for k in range(model.sizes["x"])]
        columns += [("seed", q, tape.leaf("theta", p)) for q, p in enumerate(self._parameters)]
        stored: dict[int, int] = {}
        pushed = [tape.constant(0.0) for _ in rows]
        for vector, position, leaf in columns:
            derivatives = self._hoister.rewrite(tangents(model.reader, rows, {leaf: one}))
            for i, node in enumerate(derivatives):
                entry = self._stored(node, stored, kept)
                pushed[i] = tape.add(pushed[i], tape.mul(entry, tape.leaf(vector, position)))
        self._kept[kept] = len(stored)
        return tape.program([*self._hoister.rewrite(rows), *stored]), tape.program(pushed)
