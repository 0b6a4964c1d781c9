"""What shifts of the rates inside the intervals of a log leave at their ends, where a model is stiff.

A point's Jacobian says little about an interval over which a stiff model relaxes: a belt that grips, a tyre at rest.
So the model itself is integrated: from two points inside each interval on, with every state kicked by a little, and
what remains of the kicks at the end is the transition from there. A shift of the rates is a row of kicks, taken at
these points by a quadrature; what relaxes faster than the quadrature sees leaves next to nothing at the end.

The transition over a whole interval is that of the filter: its covariance between the states at both ends over that at
the first, which averages over what the filter does not know. Reference: Lefebvre, Bruyninckx, De Schutter (2002), IEEE
Trans. Automatic Control 47(8), for the unscented filter as a statistical linearisation.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import IntArray
from bondgraph.compile.lanes.load import LaneModel, load_lanes
from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.machine_code import load_translated
from bondgraph.compile.rosenbrock import TABLEAUS
from bondgraph.data.log import FloatArray
from bondgraph.execute.threads import available_cores, in_threads
from bondgraph.filter.compiled import log_rows
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.linear import interval_kernel
from bondgraph.filter.samples import Samples, interval_substeps
from bondgraph.simulate.stiff import Rosenbrock

#: Points of the quadrature as shares of an interval, of equal weight: what is fast has relaxed from the sample before,
#: and relaxes until the next.
NODES = (0.25, 0.75)
#: States are kicked by this share of their largest value.
_KICK = 1e-5
#: A kick must relax as it does in truth, which takes a method that is L-stable; and where a belt grips steps must be
#: short, or two kicks that differ by which side of a kink they fall on grow apart. So many cheap steps do better than
#: few of a higher order: on a vehicle the gradient is within 0.03 standard deviations of that of fine steps, where
#: eleven of RODAS4, at the same cost, are wild in a tenth of the intervals. Each is longer than the last.
_METHOD, _STEPS, _GRADING = "ros2", 40, 1.2
#: Standard deviations below this share of a state's largest value count as none.
_KNOWN = 1e-12
#: Directions of a covariance (as correlations) with less variance than this are rounding.
_SINGULAR = 1e-9


@dataclass(frozen=True)
class Kicks:
    """States at the nodes ``reached`` (n - 1, nodes, n_x); and to the end ``moved`` (n - 1, nodes, n_x, n_x)."""

    reached: FloatArray
    moved: FloatArray


def kicks(
    filter_model: FilterModel,
    samples: Samples,
    start: FloatArray,
    theta: FloatArray,
    nodes: Sequence[float] = NODES,
) -> Kicks:
    """Kick the states inside each interval of a log.

    Parameters
    ----------
    filter_model, samples
        The model with its stiff method, and the log.
    start
        States where the intervals begin, shape (n_x, n - 1).
    theta
        Parameters (n_theta,) of this log.
    nodes
        Where in the intervals, as increasing shares of them.
    """
    size, count = start.shape
    lanes = load_lanes(filter_model.model, filter_model.is_stiff)
    rows = log_rows(samples)
    every = interval_kernel.Intervals(
        rows.time[:-1], np.diff(rows.time), rows.u_left, rows.u_right, _steps(filter_model, samples), _GRADING,
        TABLEAUS[_METHOD].numbers,
    )  # fmt: skip
    reached, moved = np.empty((count, len(nodes), size)), np.empty((count, len(nodes), size, size))
    largest = np.maximum(np.abs(start).max(axis=1, initial=0.0), 1e-3)
    equations = interval_kernel.Equations(lanes.prepare, lanes.advance)
    kicked = load_translated("kicked", interval_kernel)
    begin, parameters, places = np.ascontiguousarray(start.T), np.ascontiguousarray(theta), np.array(nodes)

    def some(own: slice) -> None:
        kicked(
            equations, _some(every, own), parameters, begin[own], _KICK * largest, places, reached[own], moved[own],
            _scratch(lanes, rows.u.shape[1], size),
        )  # fmt: skip

    in_threads(available_cores(), some, _shares(count))
    return Kicks(reached, moved)


def _shares(count: int) -> list[slice]:
    """Intervals in as many parts as there are cores."""
    edges = np.linspace(0, count, available_cores() + 1).astype(int)
    return [slice(first, end) for first, end in itertools.pairwise(edges)]


def _some(every: interval_kernel.Intervals, own: slice) -> interval_kernel.Intervals:
    """Neighbouring ones of all intervals."""
    return every._replace(
        start=every.start[own], length=every.length[own], u_left=every.u_left[own], u_right=every.u_right[own],
        substeps=every.substeps[own],
    )  # fmt: skip


def _scratch(lanes: LaneModel, inputs: int, size: int) -> interval_kernel.Scratch:
    left, right, whole = np.zeros(inputs), np.zeros(inputs), np.zeros((size, size))
    return interval_kernel.Scratch(
        lanes.buffer(), np.zeros(2), np.zeros(2 * inputs), left, right, whole, LANES, lanes.theta, lanes.x
    )


def _steps(filter_model: FilterModel, samples: Samples) -> IntArray:
    """Integration steps of each interval; longer ones take more, whatever steps were planned for the filter's own."""
    if filter_model.plan is not None:
        return interval_substeps(samples.time, _STEPS)
    found: IntArray = _STEPS * samples.substeps // max(int(np.min(samples.substeps)), 1)
    return found


def integrator(filter_model: FilterModel) -> str | Rosenbrock:
    """The method by which free simulations of a filter's model are integrated, twice as fine as in the filter."""
    if not filter_model.is_stiff:
        return "rk4"
    return Rosenbrock(filter_model.method, 2 * filter_model.substeps, math.sqrt(filter_model.grading))


def simulation_steps(filter_model: FilterModel, time: FloatArray) -> int:
    """Integration steps between neighbouring times (n,) of a free simulation, enough for the longest interval.

    An explicit step that is stable over a median interval is not over a gap of several.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {}, {"deflection": 0.05}, {}, substeps=3)
    >>> simulation_steps(swing, np.array([0.0, 0.1, 0.2, 0.6])), simulation_steps(swing, np.array([0.0, 0.1, 0.2]))
    (24, 6)
    """
    lengths = np.diff(time)
    longest = float(np.max(lengths) / np.median(lengths)) if lengths.size and not filter_model.is_stiff else 1.0
    return 2 * filter_model.substeps * max(1, math.ceil(longest - 0.5))


def filter_transitions(run: FilterRun) -> FloatArray:
    """Transitions (n - 1, n_x, n_x) of the filter from one sample to the next, in what it does not know for certain."""
    size = len(run.filter_model.model.states)
    before = np.moveaxis(run.filtered_cov[:size, :size, :-1], -1, 0)
    cross = np.moveaxis(run.cross_cov[:size, :size, 1:], -1, 0)
    known = _KNOWN * np.maximum(np.abs(run.filtered_mean[:size]).max(axis=1), 1e-3)
    std = np.maximum(np.sqrt(np.maximum(np.einsum("kii->ki", before), 0.0)), known)
    found = np.empty(before.shape)

    def some(own: slice) -> None:
        scale = std[own]
        values, vectors = np.linalg.eigh(before[own] / (scale[:, :, np.newaxis] * scale[:, np.newaxis]))
        inverse = np.where(values > _SINGULAR, 1.0 / np.where(values > _SINGULAR, values, 1.0), 0.0)
        solved = np.swapaxes(cross[own] / scale[:, :, np.newaxis], 1, 2) @ (vectors * inverse[:, np.newaxis])
        found[own] = (solved @ np.swapaxes(vectors, 1, 2)) / scale[:, np.newaxis]

    in_threads(available_cores(), some, _shares(before.shape[0]))
    return found
