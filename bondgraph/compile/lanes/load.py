"""Compiled equations of a model for several members or sigma points at once."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from bondgraph.arrays import FloatArray, aligned_zeros
from bondgraph.compile.front.model_program import ModelProgram
from bondgraph.compile.lanes.tangent_writer import TangentText, tangent_text
from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.lanes.writer import lane_text
from bondgraph.compile.machine_code import has_numba
from bondgraph.compile.rosenbrock import TABLEAUS
from bondgraph.errors import ModelError


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

_VECTOR, _MATRIX = "float64[::1]", "float64[:, ::1]"
_MEASURED = f"void({_VECTOR}, {_VECTOR}, {_VECTOR}, int64)"
_STEPPED = f"float64, float64, int64, float64, {_VECTOR}, {_VECTOR}, {_VECTOR}, {_VECTOR}, {_VECTOR}"
#: Signatures of what others call of a model, and of its tangents.
_EXPORTS = {
    "prepare": f"void({_VECTOR}, int64)",
    "advance": f"void({_STEPPED}, {_VECTOR}, int64)",
    "measure": _MEASURED,
}
_TANGENT_EXPORTS = {
    "prepare": f"void({_VECTOR}, int64)",
    "advance_tangents": f"void({_STEPPED}, {_MATRIX}, {_MATRIX}, {_VECTOR}, int64)",
    "measure_slopes": _MEASURED,
    "push_output": f"void({_VECTOR}, {_VECTOR}, int64)",
}


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
    own = _functions(layout.source, _TANGENT_EXPORTS)
    return TangentLanes(
        own["prepare"], own["advance_tangents"], own["measure_slopes"], own["push_output"], layout, layout.source
    )


@functools.lru_cache(maxsize=256)
def load_lanes(model: Compilable, stiff: bool) -> LaneModel:
    """The lane functions of a model, compiled or from the cache; ``stiff`` for Rosenbrock methods instead of RK4.

    Raises
    ------
    ModelError
        If numba is not installed; ask :func:`bondgraph.compile.machine_code.has_numba` first.
    """
    text = lane_text(model.program.anew(), stiff)
    own = _functions(text.source, _EXPORTS)
    return LaneModel(own["prepare"], own["advance"], own["measure"], text.theta, text.x, text.y, text.rows, text.source)


def _functions(source: str, exports: Mapping[str, str]) -> Mapping[str, Any]:
    """Compiled functions of a printed module; what compiles them is imported where it is needed."""
    if not has_numba():
        raise ModelError("numba is not installed - install the package 'numba'")
    object_code = importlib.import_module("bondgraph.compile.lanes.object_code")
    return object_code.load_functions(source, exports)  # type: ignore[no-any-return]
