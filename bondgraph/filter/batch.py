"""Run the filter kernel over logs and members: blocks of members in threads, the same numbers for any thread count."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from bondgraph.filter import kernel
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.members import MemberBatch
from bondgraph.filter.samples import Samples
from bondgraph.filter.sigma_points import PIVOT_FLOOR
from bondgraph.filter.ukf import reference_run
from bondgraph.simulate.arrays import FloatArray
from bondgraph.simulate.compile import CompiledModel, has_numba, load_kernel
from bondgraph.simulate.outcome import OUTCOMES, Outcome


@dataclass(frozen=True)
class BatchRun:
    """All members over one log: what the kernel decided and, as deep as asked for, what it recorded."""

    samples: Samples
    verdicts: kernel.Verdicts
    record: kernel.Record

    def outcome(self, m: int) -> Outcome:
        """How member ``m`` ended."""
        return OUTCOMES[self.verdicts.outcome[m]]

    def filter_run(self, filter_model: FilterModel, m: int) -> FilterRun:
        """The full record of member ``m``; needs depth 2."""
        record = self.record
        last = int(self.verdicts.last[m])
        names = kernel.Record._fields[1:]
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
    """Filter every member over every log.

    Parameters
    ----------
    filter_model, logs, batches
        The filter, the logs, and the members of each log.
    depth
        How much is recorded, see :class:`bondgraph.filter.kernel.Record`.
    threads
        Threads to use; None: one per available core.
    compiled
        Use the compiled kernel; without numba, or with False, the numpy filter does the same one by one.
    """
    if not (compiled and has_numba()):
        return tuple(
            _in_numpy(filter_model, samples, batch, depth) for samples, batch in zip(logs, batches, strict=True)
        )
    runs = tuple(
        _empty_run(filter_model, samples, batch.size, depth) for samples, batch in zip(logs, batches, strict=True)
    )
    workers = available_cores() if threads is None else max(1, threads)
    tasks = [
        (run, batch, first, end)
        for run, batch in zip(runs, batches, strict=True)
        for first, end in _blocks(batch.size, workers)
    ]

    # Compiled before threads start: both parse Python text, which CPython 3.11 cannot do in two threads at once.
    filter_members, functions = load_kernel(kernel).filter_members, filter_model.model.compiled

    def work_on(task: tuple[BatchRun, MemberBatch, int, int]) -> None:
        _in_kernel(filter_model, filter_members, functions, *task)

    if workers == 1 or len(tasks) == 1:
        for task in tasks:
            work_on(task)
    else:
        with ThreadPoolExecutor(workers) as executor:
            list(executor.map(work_on, tasks))
    return runs


def available_cores() -> int:
    """Cores this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not every system lets a process be pinned
        return os.cpu_count() or 1


def _blocks(members: int, workers: int) -> list[tuple[int, int]]:
    """Even blocks of members, at most one per worker."""
    edges = np.linspace(0, members, min(members, workers) + 1).astype(int)
    return [(int(first), int(end)) for first, end in itertools.pairwise(edges)]


def _in_kernel(
    filter_model: FilterModel,
    filter_members: Callable[..., None],
    functions: CompiledModel,
    run: BatchRun,
    batch: MemberBatch,
    first: int,
    end: int,
) -> None:
    points = filter_model.points
    rules = kernel.Rules(points.spread, points.weight, points.correction, PIVOT_FLOOR, filter_model.appended_index)
    members = kernel.Members(batch.theta, batch.x0, batch.initial_std, batch.process_std, batch.noise_std)
    work = _work(filter_model)
    filter_members(
        functions.advance,
        functions.measure,
        _log(run.samples),
        rules,
        members,
        first,
        end,
        run.verdicts,
        run.record,
        work,
    )


def _log(samples: Samples) -> kernel.Log:
    """Samples as contiguous rows in time."""

    def rows(array: FloatArray) -> FloatArray:
        return np.array(array.T, order="C", dtype=np.float64)

    u, u_left, u_right, y = map(rows, (samples.u, samples.u_left, samples.u_right, samples.y))
    return kernel.Log(np.array(samples.time, dtype=np.float64), u, u_left, u_right, y, samples.substeps)


def _work(filter_model: FilterModel) -> kernel.Work:
    model = filter_model.model
    n_x, n_s, n_y = len(model.states), len(filter_model.state_names), len(model.outputs)
    shapes: dict[str, tuple[int, ...]] = {
        "mean": (n_s,),
        "cov": (n_s, n_s),
        "lower": (n_s, n_s),
        "points": (2 * n_s + 1, n_s),
        "outputs": (2 * n_s + 1, n_y),
        "shift": (n_s,),
        "slopes": (max(n_s, n_y),),
        "output_mean": (n_y,),
        "output_cov": (n_y, n_y),
        "joint": (n_y + n_s, n_y + n_s),
        "innovation": (n_y,),
        "theta": (len(model.parameters),),
        "x": (n_x,),
        "u": (len(model.inputs),),
        "y": (n_y,),
        "stages": (3, n_x),
    }
    arrays = {name: np.zeros(shape) for name, shape in shapes.items()}
    return kernel.Work(channels=np.zeros(n_y, dtype=np.int64), **arrays)


def _empty_run(filter_model: FilterModel, samples: Samples, members: int, depth: int) -> BatchRun:
    n_s, n_y, n = len(filter_model.state_names), len(filter_model.model.outputs), samples.time.size
    integers = (np.zeros(members, dtype=np.int64) for _ in range(3))
    verdicts = kernel.Verdicts(np.full(members, np.inf), *integers)

    def kept(level: int, *rows: int) -> FloatArray:
        return np.full((*rows, n, members) if depth >= level else (0,) * (len(rows) + 2), np.nan)

    record = kernel.Record(
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
    return BatchRun(samples, verdicts, record)


def _in_numpy(filter_model: FilterModel, samples: Samples, batch: MemberBatch, depth: int) -> BatchRun:
    """The numpy filter member by member, in the form the kernel gives."""
    run = _empty_run(filter_model, samples, batch.size, depth)
    for m in range(batch.size):
        one = reference_run(filter_model, samples, batch.member(m))
        run.verdicts.nll[m] = one.nll
        run.verdicts.outcome[m] = OUTCOMES.index(one.outcome)
        run.verdicts.last[m] = np.count_nonzero(~np.isnan(one.whitened[0])) - 1
        run.verdicts.floored[m] = one.floored_pivots
        for level, names in ((1, kernel.Record._fields[1:3]), (2, kernel.Record._fields[3:])):
            for name in names if depth >= level else ():
                getattr(run.record, name)[..., m] = getattr(one, name)
    return run
