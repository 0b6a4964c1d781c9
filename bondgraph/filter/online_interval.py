"""One interval of a stream: its nodes, inputs and integration steps, as in a log that is filtered as a whole.

What a whole log has a median interval for, a stream has a declared one: it decides how many nodes of process noise and
integration steps an interval takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from bondgraph.arrays import BoolArray, FloatArray, IntArray
from bondgraph.compile.machine_code import load_kernel
from bondgraph.filter import online_kernel
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.kernel_types import Log
from bondgraph.filter.noise_nodes import interval_nodes
from bondgraph.filter.samples import Samples, uniform_steps
from bondgraph.simulate.inputs import hold_flags, rate_rows


class _Shape(NamedTuple):
    """Room for an interval: its nodes as shares of it, and the process noise before and after each step."""

    log: Log
    offset: FloatArray
    noise: FloatArray


@dataclass(frozen=True)
class Intervals:
    """Brings single intervals into the form that kernels read; ``interval`` is the declared sampling interval, s.

    What it gives is overwritten by the next call.
    """

    filter_model: FilterModel
    interval: float
    hold: BoolArray
    rates: IntArray
    fill: Callable[..., None]
    _shapes: dict[tuple[int, int], _Shape] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, filter_model: FilterModel, interval: float, compiled: bool) -> Intervals:
        """For a filter model with a method that is decided; ``compiled`` with numba."""
        model = filter_model.model
        rates = [(row, model.index("input", model.inputs[row].rate_of)) for row in rate_rows(model)]
        fill = load_kernel(online_kernel, fused=False).fill_interval if compiled else online_kernel.fill_interval
        return cls(filter_model, interval, hold_flags(model), np.array(rates, dtype=np.int64).reshape(-1, 2), fill)

    def first(self, time: float, u: FloatArray, y: FloatArray) -> Log:
        """The first sample, which has no interval before it."""
        log = self._room(1)
        log.time[0], log.u[0], log.y[0] = time, u, y
        return log

    def between(
        self, before: float, u_before: FloatArray, time: float, u: FloatArray, y: FloatArray, finer: int = 1
    ) -> Log:
        """The interval that ends with the sample y (n_y,) at ``time``; ``finer`` times as many integration steps.

        ``u_before`` and ``u`` (n_u,) are the inputs at both ends. An input that is the rate of another is its slope
        over the interval. Where both times are the same there is nothing between them.
        """
        length = time - before
        log, offset, noise = self._shape(max(1, round(length / self.interval)) if length > 0.0 else 0, finer)
        self.fill(log, offset, noise, self.hold, self.rates, before, u_before, time, u, y)
        return log

    def _shape(self, multiple: int, finer: int) -> _Shape:
        """Nodes of an interval of so many declared ones; zero: of no length."""
        if (multiple, finer) not in self._shapes:
            scheme, inside, reach = self.filter_model.noise_rule
            offset, start, end = np.array([0.0, 1.0]), np.zeros(1), np.ones(1)
            share = np.array([float(max(multiple, 1))])
            if scheme != "sampled" and multiple > 0:
                offset, start, end = interval_nodes(multiple, inside, reach)
                share = np.diff(offset) * multiple
            steps, log = uniform_steps(self.filter_model, share), self._room(offset.size)
            log.substeps[:], log.grading[:] = finer * steps.substeps, steps.grading
            self._shapes[multiple, finer] = _Shape(log, offset, np.array([start, end]))
        return self._shapes[multiple, finer]

    def _room(self, nodes: int) -> Log:
        """Arrays for an interval; a time follows the last node, since a part of a log leaves its belief to the next."""
        n_u, n_y, steps = len(self.filter_model.model.inputs), len(self.filter_model.model.outputs), nodes - 1
        time = np.full(nodes + 1, np.inf)
        return Log(
            time, np.zeros((nodes, n_u)), np.zeros((steps, n_u)), np.zeros((steps, n_u)), np.full((nodes, n_y), np.nan),
            np.zeros(steps, dtype=np.int64), np.ones(steps), np.zeros(steps), np.zeros(steps),
        )  # fmt: skip


def as_samples(log: Log) -> Samples:
    """An interval in the form that the numpy filter reads."""
    return Samples(
        "stream", log.time[:-1], log.u.T, log.u_left.T, log.u_right.T, log.y.T, log.substeps, log.grading,
        log.noise_start, log.noise_end, np.array([0, log.time.size - 2]), {}, "",
    )  # fmt: skip
