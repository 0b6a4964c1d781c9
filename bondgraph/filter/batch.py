"""Run the filter kernel over logs and members: blocks of members in threads, the same numbers for any thread count."""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import BoolArray, FloatArray
from bondgraph.compile.machine_code import has_numba
from bondgraph.execute.threads import in_threads, thread_count
from bondgraph.filter.compiled import CompiledFilter, log_rows, whole_log
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun, NodeRecord
from bondgraph.filter.kernel_record import Record
from bondgraph.filter.kernel_types import Verdicts
from bondgraph.filter.members import MemberBatch
from bondgraph.filter.samples import Samples
from bondgraph.filter.ukf import reference_run
from bondgraph.simulate.outcome import OUTCOMES, Outcome


@dataclass(frozen=True)
class BatchRun:
    """All members over one log: what the kernel decided and, as deep as asked for, what it recorded.

    ``refined`` (members,) tells which members were repeated with twice the integration steps because they diverged.
    """

    samples: Samples
    batch: MemberBatch
    verdicts: Verdicts
    record: Record
    refined: BoolArray

    def outcome(self, m: int) -> Outcome:
        """How member ``m`` ended."""
        return OUTCOMES[self.verdicts.outcome[m]]

    def note(self, m: int, run: FilterRun) -> None:
        """Note what the numpy filter found about member ``m``, in the form the kernel gives."""
        note_verdict(self.verdicts, m, run)
        for level, names in ((1, Record._fields[1:3]), (2, Record._fields[3:])):
            for name in names if self.record.depth >= level else ():
                getattr(self.record, name)[..., m] = getattr(run, name)

    def filter_run(self, filter_model: FilterModel, m: int) -> FilterRun:
        """The full record of member ``m`` on the samples of the log; needs depth 2."""
        run = self.node_run(filter_model, m)
        return NodeRecord(run, self.samples, self.batch.member(m).process_cov).at_samples()

    def node_run(self, filter_model: FilterModel, m: int) -> FilterRun:
        """The full record of member ``m`` on the nodes of the process noise; needs depth 2."""
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
            cause="",
            **arrays,  # type: ignore[arg-type]
        )


def run_batches(
    filter_model: FilterModel,
    logs: Sequence[Samples],
    batches: Sequence[MemberBatch],
    depth: int,
    threads: int | None,
    compiled: bool,
    *,
    refine: bool = True,
) -> tuple[BatchRun, ...]:
    """Filter every member over every log.

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
    refine
        Try a member that diverges once more, with twice the steps.
    """
    runs = tuple(empty_run(filter_model, samples, batch, depth) for samples, batch in zip(logs, batches, strict=True))
    if compiled and has_numba():
        workers = thread_count(threads)
        in_threads(workers, operator.call, _block_runs(runs, filter_model, workers))
    else:
        for run in runs:
            for m in range(run.batch.size):
                run.note(m, reference_run(filter_model, run.samples, run.batch.member(m)))
    for run, batch in zip(runs, batches, strict=True):
        diverged = np.flatnonzero(run.verdicts.outcome == OUTCOMES.index(Outcome.DIVERGED))
        if refine and diverged.size:
            finer, some = replace(run.samples, substeps=2 * run.samples.substeps), batch.chosen(diverged)
            (again,) = run_batches(filter_model, [finer], [some], depth, threads, compiled, refine=False)
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


def _block_runs(runs: Sequence[BatchRun], filter_model: FilterModel, workers: int) -> list[Callable[[], None]]:
    """Calls of the compiled filter that fill the runs, one for each block of members, for threads to share."""
    compiled_filter = CompiledFilter.of(filter_model)
    for_each = math.ceil(workers / len(runs))  # several logs share them
    calls: list[Callable[[], None]] = []
    for run in runs:
        own = (log_rows(run.samples), whole_log(run.samples), run.batch, run.verdicts, run.record)
        blocks = compiled_filter.blocks(run.batch.size, run.samples, for_each)
        calls += [functools.partial(compiled_filter.run, *own, block) for block in blocks]
    return calls


def empty_run(filter_model: FilterModel, samples: Samples, batch: MemberBatch, depth: int) -> BatchRun:
    """Room for what members give on a log."""
    integers = (np.zeros(batch.size, dtype=np.int64) for _ in range(3))
    verdicts = Verdicts(np.full(batch.size, np.inf), *integers)
    record = empty_record(filter_model, samples.time.size, batch.size, depth)
    return BatchRun(samples, batch, verdicts, record, np.zeros(batch.size, dtype=np.bool_))


def empty_record(filter_model: FilterModel, n: int, members: int, depth: int) -> Record:
    """Room for what is kept of members at ``n`` nodes."""
    n_s, n_y = len(filter_model.state_names), len(filter_model.model.outputs)

    def kept(level: int, *rows: int) -> FloatArray:
        return np.full((*rows, n, members) if depth >= level else (0,) * (len(rows) + 2), np.nan)

    return Record(
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


def note_verdict(verdicts: Verdicts, m: int, run: FilterRun) -> None:
    """What the numpy filter found about member ``m``."""
    verdicts.nll[m] = run.nll
    verdicts.outcome[m] = OUTCOMES.index(run.outcome)
    verdicts.last[m] = np.count_nonzero(~np.isnan(run.whitened[0])) - 1
    verdicts.floored[m] = run.floored_pivots
