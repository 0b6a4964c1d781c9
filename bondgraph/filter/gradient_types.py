"""What the filter with derivatives reads, writes and works on."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.filter.kernel_types import Robustness


class TangentEquations(NamedTuple):
    """Compiled functions, see :class:`bondgraph.compile.lanes.load.TangentLanes`."""

    prepare: Callable[..., None]
    advance: Callable[..., None]
    measure: Callable[..., None]
    push: Callable[..., None]


class TangentRules(NamedTuple):
    """Numbers of the sigma points and of the method, and first rows of vectors in the buffer of ``lanes`` lanes."""

    spread: float
    weight: float
    correction: float
    pivot_floor: float
    tableau: FloatArray
    lanes: int
    theta: int
    x: int
    y: int
    din: int
    dy: int
    robust: Robustness


class Prior(NamedTuple):
    """Numbers of the member as in :class:`bondgraph.filter.kernel_types.Members`, each with its derivatives.

    ``seeds`` (D, parameters) are the derivatives of those parameters that move; D is the last axis of the others.
    """

    theta: FloatArray
    x0: FloatArray
    initial_lower: FloatArray
    process_cov: FloatArray
    noise_cov: FloatArray
    seeds: FloatArray
    d_x0: FloatArray
    d_initial_lower: FloatArray
    d_process_cov: FloatArray
    d_noise_cov: FloatArray


class Found(NamedTuple):
    """Whitened innovations and log scales (n_y, n), and their derivatives (n_y, n, D)."""

    whitened: FloatArray
    log_scales: FloatArray
    d_whitened: FloatArray
    d_log_scales: FloatArray


class Scratch(NamedTuple):
    """Values, and their derivatives with D as the last axis; the model's buffers."""

    mean: FloatArray
    lower: FloatArray
    points: FloatArray
    outputs: FloatArray
    shift: FloatArray
    slopes: FloatArray
    output_mean: FloatArray
    output_cov: FloatArray
    joint: FloatArray
    known: FloatArray
    d_mean: FloatArray
    d_lower: FloatArray
    d_points: FloatArray
    d_outputs: FloatArray
    d_shift: FloatArray
    d_slopes: FloatArray
    d_output_mean: FloatArray
    d_output_cov: FloatArray
    d_joint: FloatArray
    d_known: FloatArray
    d_pivot: FloatArray
    channels: IntArray
    buffer: FloatArray
    directions: FloatArray
    clock: FloatArray
    inputs: FloatArray
