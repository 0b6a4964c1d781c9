"""Compiled equations of a model for several members or sigma points at once."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bondgraph.simulate.arrays import FloatArray
from bondgraph.simulate.compile import HEADER, load_compiled
from bondgraph.simulate.model import Model
from bondgraph.simulate.program.lane_model import lane_text
from bondgraph.simulate.program.lane_tangent import TangentText, tangent_text
from bondgraph.simulate.program.lane_text import LANES

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

_LANE = """
_lane = njit(forceinline=True, error_model="numpy", fastmath={"contract"})
"""

_CALLBACKS = """
_V = "float64[::1]"
prepare_lanes = CompiledFunction(cfunc(f"void({_V}, int64)", **_options)(prepare))
advance_lanes = CompiledFunction(
    cfunc(f"void(float64, float64, int64, float64, {_V}, {_V}, {_V}, {_V}, {_V}, {_V}, int64)", **_options)(advance)
)
measure_lanes = CompiledFunction(cfunc(f"void({_V}, {_V}, {_V}, int64)", **_options)(measure))
"""


@dataclass(frozen=True)
class LaneModel:
    """Compiled functions of one model over a work buffer of ``rows`` rows, see ``lane_model``.

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
        return np.zeros(self.rows * LANES)


_TANGENT_CALLBACKS = """
_V, _M = "float64[::1]", "float64[:, ::1]"
prepare_lanes = CompiledFunction(cfunc(f"void({_V}, int64)", **_options)(prepare))
advance_lanes = CompiledFunction(
    cfunc(
        f"void(float64, float64, int64, float64, {_V}, {_V}, {_V}, {_V}, {_V}, {_M}, {_M}, {_V}, int64)", **_options
    )(advance_tangents)
)
measure_lanes = CompiledFunction(cfunc(f"void({_V}, {_V}, {_V}, int64)", **_options)(measure_slopes))
push_lanes = CompiledFunction(cfunc(f"void({_V}, {_V}, int64)", **_options)(push_output))
"""


@dataclass(frozen=True)
class TangentLanes:
    """Compiled tangent functions of one model, see ``lane_tangent``: ``push`` is the one of the outputs."""

    prepare: Prepare
    advance: Callable[..., None]
    measure: Measure
    push: Callable[[FloatArray, FloatArray, int], None]
    layout: TangentText
    text: str = field(repr=False)

    def buffer(self) -> FloatArray:
        """A new work buffer."""
        return np.zeros(self.layout.rows * LANES)


@functools.lru_cache(maxsize=64)
def load_tangents(model: Model, parameters: tuple[int, ...], stiff: bool) -> TangentLanes:
    """The tangent functions of a model, explicit or stiff, for derivatives by the parameters at these positions."""
    layout = tangent_text(model.program, parameters, stiff)
    title = f"{'Stiff' if stiff else 'Explicit'} tangents of the generated module {model.name!r}"
    source = "\n\n".join([HEADER.format(title=title) + _LANE, layout.source]) + "\n" + _TANGENT_CALLBACKS
    module = load_compiled(source)
    return TangentLanes(
        module.prepare_lanes, module.advance_lanes, module.measure_lanes, module.push_lanes, layout, source
    )


@functools.lru_cache(maxsize=256)
def load_lanes(model: Model, stiff: bool) -> LaneModel:
    """The lane functions of a model, compiled or from the cache; ``stiff`` for Rosenbrock methods instead of RK4."""
    text = lane_text(model.program, stiff)
    title = f"{'Stiff' if stiff else 'Explicit'} lane functions of the generated module {model.name!r}"
    source = "\n\n".join([HEADER.format(title=title) + _LANE, text.source]) + "\n" + _CALLBACKS
    module = load_compiled(source)
    return LaneModel(
        module.prepare_lanes, module.advance_lanes, module.measure_lanes, text.theta, text.x, text.y, text.rows, source
    )
