"""The compiled filter of a model: its kernel, what the kernel reads and works on, and blocks of members in threads."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bondgraph.arrays import LINE, FloatArray, IntArray, aligned_zeros
from bondgraph.compile.lanes.load import LaneModel, load_lanes
from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.machine_code import load_translated
from bondgraph.compile.rosenbrock import TABLEAUS
from bondgraph.filter import kernel, kernel_algebra, kernel_alone, kernel_channels, kernel_record, kernel_robust
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.kernel_record import Record
from bondgraph.filter.kernel_types import Alone, Log, Part, Rules, Verdicts, Work
from bondgraph.filter.members import MemberBatch
from bondgraph.filter.samples import Samples
from bondgraph.filter.sigma_points import PIVOT_FLOOR

#: A call of the functions of a model for a block of eight costs this share of one for the points of a member alone,
#: which may fill sixteen lanes.
_SHARE = 0.6
#: What the filter itself costs per node, by itself and by states, in rows of a model's work buffer, each of which costs
#: about as much for a step: from times of machines of 2 and 11 states with 1 to 32 steps.
_OWN, _OWN_BY_STATE = 2250.0, 375.0
#: Cost of a call of the kernel before and after its work, in the same unit. A call took 0.5 to 1 ms and a unit 0.5 to
#: 7 ns, on machines of one, two and four states: so many units take the kernel 0.4 to 3 times as long as its call.
_CALL = 4e5


def blocks(members: int, alone: float, threads: int) -> list[tuple[int, int]]:
    """Blocks of members that are filtered side by side, so that threads end together.

    As many whole blocks, of as many members as there are lanes, as all threads have work with. Of the rest as many as
    ``alone`` take as long one by one as a block; more are filtered in equal blocks.

    Examples
    --------
    >>> blocks(18, alone=5.4, threads=1), blocks(22, alone=5.4, threads=1)
    ([(0, 16), (16, 17), (17, 18)], [(0, 16), (16, 22)])
    >>> blocks(48, alone=5.4, threads=2)
    [(0, 16), (16, 32), (32, 40), (40, 48)]
    """
    whole = members // (LANES * threads) * LANES * threads
    blocks = [(first, first + LANES) for first in range(0, whole, LANES)]
    rest = members - whole
    if rest == 1 or rest < threads * alone:
        return blocks + [(m, m + 1) for m in range(whole, members)]
    count = min(threads, math.ceil(rest / (LANES // 2)))
    edges = [whole + rest * k // count for k in range(count + 1)]
    return blocks + list(itertools.pairwise(edges))


def as_long_as_a_block(states: int, rows: int, substeps: float) -> float:
    """How many members take as long one by one as a block of them.

    A block takes a call of the model's functions for each of its sigma points, a member by itself one for as many
    points as there are lanes; what the filter itself does costs a block about as much as one member.

    Parameters
    ----------
    states
        Of the filter.
    rows
        Of the model's work buffer: what one step of it costs.
    substeps
        Steps from node to node.

    Examples
    --------
    >>> round(as_long_as_a_block(2, 16, 1.0), 1), round(as_long_as_a_block(11, 353, 12.0), 1)
    (1.0, 4.4)
    """
    own, steps = _OWN + _OWN_BY_STATE * states, rows * substeps
    return cost_of_a_block(states, rows, substeps) / (own + steps * math.ceil((2 * states + 1) / LANES))


def cost_of_a_block(states: int, rows: int, substeps: float) -> float:
    """Cost of a block of members from node to node, in rows of a model's work buffer; arguments as above."""
    return _OWN + _OWN_BY_STATE * states + _SHARE * rows * substeps * (2 * states + 1)


@dataclass(frozen=True)
class CompiledFilter:
    """The compiled kernel and the compiled functions of a model; make one before threads start.

    Compiling parses Python text, which CPython 3.11 cannot do in two threads at once.
    """

    filter_model: FilterModel
    filter_members: Any
    lanes: LaneModel

    @classmethod
    def of(cls, filter_model: FilterModel) -> CompiledFilter:
        """Compiled, or from the cache."""
        modules = (kernel, kernel_algebra, kernel_alone, kernel_channels, kernel_record, kernel_robust)
        filter_members = load_translated("filter_members", *modules)
        return cls(filter_model, filter_members, load_lanes(filter_model.model, filter_model.is_stiff))

    def nodes_of_a_call(self, samples: Samples) -> int:
        """Number of samples that take the kernel about as long as a call of it takes, at least one."""
        cost = cost_of_a_block(self.filter_model.points.n, self.lanes.rows, _mean_substeps(samples))
        return math.ceil(_CALL / cost)

    def blocks(self, members: int, samples: Samples, threads: int) -> list[tuple[int, int]]:
        """Blocks of members that are filtered side by side over a log, for as many threads."""
        alone = as_long_as_a_block(self.filter_model.points.n, self.lanes.rows, _mean_substeps(samples))
        return blocks(members, alone, threads)

    def run(
        self, log: Log, part: Part, batch: MemberBatch, verdicts: Verdicts, record: Record, block: tuple[int, int]
    ) -> None:
        """Filter a block of members, the first and the one after the last, over a part of a log."""
        first, end = block
        side_by_side = 1 if end - first == 1 else (end - first + 7) // 8 * 8
        self.filter_members(
            kernel.Equations(self.lanes.prepare, self.lanes.advance, self.lanes.measure),
            log,
            filter_rules(self.filter_model, self.lanes),
            batch.for_kernels,
            first,
            end,
            part,
            verdicts,
            record,
            scratch(self.filter_model, self.lanes, side_by_side),
        )


def _mean_substeps(samples: Samples) -> float:
    return float(np.mean(samples.substeps)) if samples.substeps.size else 1.0


def filter_rules(filter_model: FilterModel, lanes: LaneModel) -> Rules:
    """Numbers of the sigma points and of the method, as kernels read them."""
    points = filter_model.points
    return Rules(
        spread=points.spread,
        weight=points.weight,
        correction=points.correction,
        pivot_floor=PIVOT_FLOOR,
        appended=filter_model.appended_index,
        tableau=TABLEAUS[filter_model.method].numbers if filter_model.is_stiff else np.empty(0),
        lanes=LANES,
        n_x=len(filter_model.model.states),
        theta=lanes.theta,
        x=lanes.x,
        y=lanes.y,
        robust=filter_model.robustness,
    )


def log_rows(samples: Samples) -> Log:
    """Samples as contiguous rows in time."""

    def rows(array: FloatArray) -> FloatArray:
        return np.array(array.T, order="C", dtype=np.float64)

    u, u_left, u_right, y = map(rows, (samples.u, samples.u_left, samples.u_right, samples.y))
    time = np.array(samples.time, dtype=np.float64)
    start, end = np.ascontiguousarray(samples.noise_start), np.ascontiguousarray(samples.noise_end)
    substeps = np.ascontiguousarray(samples.substeps, dtype=np.int64)
    return Log(time, u, u_left, u_right, y, substeps, np.ascontiguousarray(samples.grading), start, end)


def whole_log(samples: Samples) -> Part:
    """A log in one part."""
    return Part(0, samples.time.size, np.empty((0, 0)), np.empty((0, 0, 0)))


def scratch(filter_model: FilterModel, lanes: LaneModel, width: int) -> Work:
    """Scratch for ``width`` members side by side."""
    model = filter_model.model
    n_s, n_y = len(filter_model.state_names), len(model.outputs)
    shapes: dict[str, tuple[int, ...]] = {
        "mean": (n_s,),
        "cov": (n_s, n_s),
        "lower": (n_s, n_s),
        "points": (2 * n_s + 1, n_s),
        "outputs": (2 * n_s + 1, n_y),
        "shift": (max(n_s, n_y),),
        "slopes": (n_s,),
        "output_mean": (n_y,),
        "output_cov": (n_y, n_y),
        "joint": (n_y + n_s, n_y + n_s),
        "innovation": (n_y,),
        "residual": (n_y,),
        "log_scale": (n_y,),
        "nll": (),
        "pivot": (),
    }
    arrays = _arrays({name: (*shape, width) for name, shape in shapes.items()})
    whole = (np.zeros(size, dtype=np.int64) for size in (width, width, width, n_y))
    floored, code, who, channels = whole
    own = {"buffer": lanes.buffer(), "clock": np.zeros(2), "inputs": np.zeros(2 * len(model.inputs))}
    alone = _alone(arrays, channels)
    return Work(floored=floored, code=code, who=who, channels=channels, alone=alone, **arrays, **own)


def _arrays(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, FloatArray]:
    """Arrays of zeros that share one piece of memory, each from a cache line on: a piece for each takes longer."""
    lines = [-(-math.prod(shape) // LINE) for shape in shapes.values()]
    rows, first = aligned_zeros(sum(lines) * LINE), 0
    found = {}
    for (name, shape), count in zip(shapes.items(), lines, strict=True):
        found[name] = rows[first : first + math.prod(shape)].reshape(shape)
        first += count * LINE
    return found


def _alone(arrays: dict[str, FloatArray], channels: IntArray) -> Alone:
    """The scratch of one member without the axis of members; where there are several, nothing."""
    width = arrays["nll"].size
    names = [name for name in Alone._fields if name in arrays]
    own = {name: arrays[name][..., 0] if width == 1 else np.empty((0,) * (arrays[name].ndim - 1)) for name in names}
    rows = arrays["joint"].shape[0] if width == 1 else 0
    return Alone(channels=channels, upper=np.zeros((rows, rows)), **own)
