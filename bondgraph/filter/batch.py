"""Run the filter kernel over logs and members: blocks of members in threads, the same numbers for any thread count."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bondgraph.filter import kernel, kernel_algebra, kernel_channels, kernel_record
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.kernel_record import Record
from bondgraph.filter.kernel_types import Log, Members, Rules, Verdicts, Work
from bondgraph.filter.members import MemberBatch
from bondgraph.filter.samples import Samples
from bondgraph.filter.sigma_points import PIVOT_FLOOR
from bondgraph.filter.ukf import reference_run
from bondgraph.simulate.arrays import BoolArray, FloatArray
from bondgraph.simulate.compile import has_numba, load_kernel
from bondgraph.simulate.outcome import OUTCOMES, Outcome
from bondgraph.simulate.program.lane_text import LANES
from bondgraph.simulate.program.lanes import LaneModel, load_lanes
from bondgraph.simulate.rosenbrock import TABLEAUS

#: Fewer members than this are filtered one by one, with their sigma points side by side.
_FEW = 5


@dataclass(frozen=True)
class BatchRun:
    """All members over one log: what the kernel decided and, as deep as asked for, what it recorded.

    ``refined`` (members,) tells which members were repeated with twice the integration steps because they diverged.
    """

    samples: Samples
    verdicts: Verdicts
    record: Record
    refined: BoolArray

    def outcome(self, m: int) -> Outcome:
        """How member ``m`` ended."""
        return OUTCOMES[self.verdicts.outcome[m]]

    def filter_run(self, filter_model: FilterModel, m: int) -> FilterRun:
        """The full record of member ``m``; needs depth 2."""
        record = self.record
        last = int(self.verdicts.last[m])
        names = Record._fields[1:]
        arrays = {name: np.ascontiguousarray(getattr(record, name)[..., m]) for name in names}
        for array in arrays.values():
            array[..., last + 1 :] = np.nan
        return FilterRun(
            filter_model=filter_model,
            log_name=self.samples.name,
            time=self.samples.time,
            y=self.samples.y,
            floored_pivots=int(self.verdicts.floored[m]),
            outcome=self.outcome(m),
            ended_at=float(self.samples.time[max(last, 0)]),
            **arrays,
        )


def run_batches(
    filter_model: FilterModel,
    logs: Sequence[Samples],
    batches: Sequence[MemberBatch],
    depth: int,
    threads: int | None,
    compiled: bool,
) -> tuple[BatchRun, ...]:
    """Filter every member over every log; a member that diverges is tried once more with twice the steps.

    Parameters
    ----------
    filter_model, logs, batches
        The filter, the logs, and the members of each log.
    depth
        How much is recorded, see :class:`bondgraph.filter.kernel_record.Record`.
    threads
        Threads to use; None: one per available core.
    compiled
        Use the compiled kernel; without numba, or with False, the numpy filter does the same one by one.
    """
    filter_all = _all_in_kernel if compiled and has_numba() else _all_in_numpy
    runs = filter_all(filter_model, logs, batches, depth, threads)
    for run, batch in zip(runs, batches, strict=True):
        diverged = np.flatnonzero(run.verdicts.outcome == OUTCOMES.index(Outcome.DIVERGED))
        if diverged.size:
            finer = replace(run.samples, substeps=2 * run.samples.substeps)
            (again,) = filter_all(filter_model, [finer], [batch.chosen(diverged)], depth, threads)
            _replace_members(run, again, diverged)
    return runs


def _replace_members(run: BatchRun, again: BatchRun, members: npt.NDArray[np.intp]) -> None:
    """Put the members of another run in the place of these."""
    for kept, found in zip(run.verdicts, again.verdicts, strict=True):
        kept[members] = found
    for level, names in ((1, Record._fields[1:3]), (2, Record._fields[3:])):
        for name in names if run.record.depth >= level else ():
            getattr(run.record, name)[..., members] = getattr(again.record, name)
    run.refined[members] = True


def _all_in_numpy(
    filter_model: FilterModel, logs: Sequence[Samples], batches: Sequence[MemberBatch], depth: int, threads: int | None
) -> tuple[BatchRun, ...]:
    return tuple(_in_numpy(filter_model, samples, batch, depth) for samples, batch in zip(logs, batches, strict=True))


def _all_in_kernel(
    filter_model: FilterModel, logs: Sequence[Samples], batches: Sequence[MemberBatch], depth: int, threads: int | None
) -> tuple[BatchRun, ...]:
    runs = tuple(
        _empty_run(filter_model, samples, batch.size, depth) for samples, batch in zip(logs, batches, strict=True)
    )
    # Compiled before threads start: both parse Python text, which CPython 3.11 cannot do in two threads at once.
    compiled_filter = _CompiledFilter.of(filter_model)
    tasks = [
        (run, batch, first, end) for run, batch in zip(runs, batches, strict=True) for first, end in _blocks(batch.size)
    ]
    workers = available_cores() if threads is None else max(1, threads)
    if workers == 1 or len(tasks) == 1:
        for task in tasks:
            compiled_filter.run(*task)
    else:
        with ThreadPoolExecutor(workers) as executor:
            list(executor.map(lambda task: compiled_filter.run(*task), tasks))
    return runs


def available_cores() -> int:
    """Cores this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not every system lets a process be pinned
        return os.cpu_count() or 1


def _blocks(members: int) -> list[tuple[int, int]]:
    """Blocks of members that are filtered side by side: as many as there are lanes; a small rest one by one.

    The last of an odd number of whole blocks is halved, so that two threads end together.

    Examples
    --------
    >>> _blocks(18), _blocks(21)
    ([(0, 16), (16, 17), (17, 18)], [(0, 16), (16, 21)])
    >>> _blocks(48)
    [(0, 16), (16, 32), (32, 40), (40, 48)]
    """
    whole = members // LANES * LANES
    blocks = [(first, first + LANES) for first in range(0, whole, LANES)]
    if len(blocks) > 1 and len(blocks) % 2:
        first, end = blocks.pop()
        blocks += [(first, first + LANES // 2), (first + LANES // 2, end)]
    if members - whole < _FEW:
        return blocks + [(m, m + 1) for m in range(whole, members)]
    return [*blocks, (whole, members)]


@dataclass(frozen=True)
class _CompiledFilter:
    """The compiled kernel and the compiled functions of a model."""

    filter_model: FilterModel
    filter_members: Callable[..., None]
    lanes: LaneModel

    @classmethod
    def of(cls, filter_model: FilterModel) -> _CompiledFilter:
        functions = load_kernel(kernel, kernel_algebra, kernel_channels, kernel_record)
        return cls(filter_model, functions.filter_members, load_lanes(filter_model.model, filter_model.is_stiff))

    def run(self, run: BatchRun, batch: MemberBatch, first: int, end: int) -> None:
        """Filter a block of members over a log."""
        lanes = self.lanes
        equations = kernel.Equations(lanes.prepare, lanes.advance, lanes.measure)
        members = Members(batch.theta, batch.x0, batch.initial_std, batch.process_std, batch.noise_std)
        side_by_side = 1 if end - first == 1 else (end - first + 7) // 8 * 8
        work = _work(self.filter_model, lanes, side_by_side)
        self.filter_members(
            equations,
            log_rows(run.samples),
            filter_rules(self.filter_model, lanes),
            members,
            first,
            end,
            run.verdicts,
            run.record,
            work,
        )


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
    )


def log_rows(samples: Samples) -> Log:
    """Samples as contiguous rows in time."""

    def rows(array: FloatArray) -> FloatArray:
        return np.array(array.T, order="C", dtype=np.float64)

    u, u_left, u_right, y = map(rows, (samples.u, samples.u_left, samples.u_right, samples.y))
    return Log(np.array(samples.time, dtype=np.float64), u, u_left, u_right, y, samples.substeps, samples.grading)


def _work(filter_model: FilterModel, lanes: LaneModel, width: int) -> Work:
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
        "nll": (),
        "pivot": (),
    }
    arrays = {name: np.zeros((*shape, width)) for name, shape in shapes.items()}
    whole = (np.zeros(size, dtype=np.int64) for size in (width, width, width, n_y))
    floored, code, who, channels = whole
    own = {"buffer": lanes.buffer(), "clock": np.zeros(2), "inputs": np.zeros(2 * len(model.inputs))}
    return Work(floored=floored, code=code, who=who, channels=channels, **arrays, **own)


def _empty_run(filter_model: FilterModel, samples: Samples, members: int, depth: int) -> BatchRun:
    n_s, n_y, n = len(filter_model.state_names), len(filter_model.model.outputs), samples.time.size
    integers = (np.zeros(members, dtype=np.int64) for _ in range(3))
    verdicts = Verdicts(np.full(members, np.inf), *integers)

    def kept(level: int, *rows: int) -> FloatArray:
        return np.full((*rows, n, members) if depth >= level else (0,) * (len(rows) + 2), np.nan)

    record = Record(
        depth=depth,
        whitened=kept(1, n_y),
        log_scales=kept(1, n_y),
        predicted_mean=kept(2, n_s),
        predicted_cov=kept(2, n_s, n_s),
        filtered_mean=kept(2, n_s),
        filtered_cov=kept(2, n_s, n_s),
        cross_cov=kept(2, n_s, n_s),
        output_mean=kept(2, n_y),
        output_cov=kept(2, n_y, n_y),
    )
    return BatchRun(samples, verdicts, record, np.zeros(members, dtype=np.bool_))


def _in_numpy(filter_model: FilterModel, samples: Samples, batch: MemberBatch, depth: int) -> BatchRun:
    """The numpy filter member by member, in the form the kernel gives."""
    run = _empty_run(filter_model, samples, batch.size, depth)
    for m in range(batch.size):
        one = reference_run(filter_model, samples, batch.member(m))
        run.verdicts.nll[m] = one.nll
        run.verdicts.outcome[m] = OUTCOMES.index(one.outcome)
        run.verdicts.last[m] = np.count_nonzero(~np.isnan(one.whitened[0])) - 1
        run.verdicts.floored[m] = one.floored_pivots
        for level, names in ((1, Record._fields[1:3]), (2, Record._fields[3:])):
            for name in names if depth >= level else ():
                getattr(run.record, name)[..., m] = getattr(one, name)
    return run
