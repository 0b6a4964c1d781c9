"""Compiled equations of a model for several members or sigma points at once."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from bondgraph.arrays import FloatArray, aligned_zeros
from bondgraph.compile.front.model_program import ModelProgram
from bondgraph.compile.lanes.tangent_writer import TangentText, tangent_text
from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.lanes.writer import lane_text
from bondgraph.compile.machine_code import HEADER, load_compiled
from bondgraph.compile.rosenbrock import TABLEAUS


class Compilable(Protocol):
    """A model that can be compiled: equal models share their machine code, so it must be hashable by its text."""

    @property
    def name(self) -> str:
        """Name of the model, for titles."""
        ...

    @property
    def program(self) -> ModelProgram:
        """Its equations on a tape."""
        ...


#: ``prepare(w, n)``
Prepare = Callable[[FloatArray, int], None]

#: ``advance(start, length, substeps, grading, tableau, u_left, u_right, clock, inputs, w, n)``
Advance = Callable[
    [
        float, float, int, float, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, int
    ],
    None,
]  # fmt: skip

#: ``measure(clock, inputs, w, n)``
Measure = Callable[[FloatArray, FloatArray, FloatArray, int], None]

# Machine code is kept by the text of its module: so the text names the compiler by a digest of its own.
_COMPILER = Path(__file__).with_name("compiler.py").read_bytes()
_LANE = f"""
from bondgraph.compile.lanes.compiler import lane_loops  # {hashlib.sha256(_COMPILER).hexdigest()[:16]}
"""


def _callbacks(**arguments: str) -> str:
    """Text of C callbacks ``..._lanes`` of printed functions with these arguments."""
    parts = []
    for name, given in arguments.items():
        kinds = ", ".join("int64" if argument == "n" else "float64[::1]" for argument in given.split(", "))
        parts += [
            f"def call_{name}({given}):\n    {name}({given})",
            f'{name}_lanes = CompiledFunction(_callback("void({kinds})")(call_{name}))',
        ]
    return "\n\n\n".join(parts)


_CALLBACKS = (
    _callbacks(prepare="w, n", measure="clock, inputs, w, n")
    + """

_V = "float64[::1]"
advance_lanes = CompiledFunction(
    _callback(f"void(float64, float64, int64, float64, {_V}, {_V}, {_V}, {_V}, {_V}, {_V}, int64)")(advance)
)
"""
)


@dataclass(frozen=True)
class LaneModel:
    """Compiled functions of one model over a work buffer of ``rows`` rows, see ``writer``.

    ``theta``, ``x`` and ``y`` are the first rows of the parameters, states and outputs. ``text`` is the source, to be
    read by people.
    """

    prepare: Prepare
    advance: Advance
    measure: Measure
    theta: int
    x: int
    y: int
    rows: int
    text: str = field(repr=False)

    def buffer(self) -> FloatArray:
        """A new work buffer."""
        return aligned_zeros(self.rows * LANES)


_TANGENT_CALLBACKS = (
    _callbacks(prepare="w, n", measure_slopes="clock, inputs, w, n", push_output="seed, w, n")
    + """

_V, _M = "float64[::1]", "float64[:, ::1]"
advance_lanes = CompiledFunction(
    _callback(f"void(float64, float64, int64, float64, {_V}, {_V}, {_V}, {_V}, {_V}, {_M}, {_M}, {_V}, int64)")(
        advance_tangents
    )
)
"""
)


@dataclass(frozen=True)
class TangentLanes:
    """Compiled tangent functions of one model, see ``tangent_writer``: ``push`` is the one of the outputs."""

    prepare: Prepare
    advance: Callable[..., None]
    measure: Measure
    push: Callable[[FloatArray, FloatArray, int], None]
    layout: TangentText
    text: str = field(repr=False)

    def buffer(self) -> FloatArray:
        """A new work buffer."""
        return aligned_zeros(self.layout.rows * LANES)


@functools.lru_cache(maxsize=64)
def load_tangents(model: Compilable, parameters: tuple[int, ...], method: str) -> TangentLanes:
    """The tangent functions of a model with a method, for derivatives by the parameters at these positions."""
    layout = tangent_text(model.program.anew(), parameters, TABLEAUS.get(method))
    title = f"Tangents of {method} steps of the generated module {model.name!r}"
    source = "\n\n".join([HEADER.format(title=title) + _LANE, layout.source]) + "\n" + _TANGENT_CALLBACKS
    module = load_compiled(source)
    return TangentLanes(
        module.prepare_lanes,
        module.advance_lanes,
        module.measure_slopes_lanes,
        module.push_output_lanes,
        layout,
        source,
    )


@functools.lru_cache(maxsize=256)
def load_lanes(model: Compilable, stiff: bool) -> LaneModel:
    """The lane functions of a model, compiled or from the cache; ``stiff`` for Rosenbrock methods instead of RK4."""
    text = lane_text(model.program.anew(), stiff)
    title = f"{'Stiff' if stiff else 'Explicit'} lane functions of the generated module {model.name!r}"
    source = "\n\n".join([HEADER.format(title=title) + _LANE, text.source]) + "\n" + _CALLBACKS
    module = load_compiled(source)
    return LaneModel(
        module.prepare_lanes, module.advance_lanes, module.measure_lanes, text.theta, text.x, text.y, text.rows, source
    )
