"""A filter over a long log of which only bands are kept: means and standard deviations, and what measurements said.

Covariances between states, before and after every measurement, take as many numbers as the square of the states: of a
day of a vehicle at 40 samples per second twelve gigabytes. Few ask for them. So the log is filtered part after part,
each from the belief in which the one before left off, everything is recorded of one part at a time, and what is kept of
it is the same in every bit as from a filter that keeps all.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.compile.machine_code import has_numba
from bondgraph.filter.abstract_run import AbstractRun
from bondgraph.filter.batch import empty_record
from bondgraph.filter.causes import cause
from bondgraph.filter.compiled import CompiledFilter, log_rows
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.kernel_record import Record
from bondgraph.filter.kernel_types import Part, Verdicts
from bondgraph.filter.members import MemberBatch
from bondgraph.filter.samples import Samples
from bondgraph.filter.ukf import reference_run
from bondgraph.simulate.outcome import OUTCOMES, Outcome

#: Nodes of which everything is recorded at a time: about a hundred megabytes of a machine with a dozen states.
PART = 20_000

#: Told of every part: the samples it holds, their filtered means (n_s, k) and covariances (n_s, n_s, k).
Beliefs = Callable[[slice, FloatArray, FloatArray], None]


@dataclass(frozen=True, repr=False)
class FilterBands(AbstractRun):
    """Record of a filter over a long log, without covariances.

    Shapes: time (n,); ``filtered_mean`` and ``filtered_var`` (n_s, n), means and variances of the filter's state after
    the measurement of a sample; ``output_mean`` and ``output_var`` (n_y, n) expected of all channels before it, noise
    included; ``whitened`` and ``log_scales`` (n_y, n). All as in :class:`bondgraph.filter.filter_run.FilterRun`, which
    has the covariances too, for who smooths or linearises.
    """

    filter_model: FilterModel
    log_name: str
    time: FloatArray
    y: FloatArray
    filtered_mean: FloatArray
    filtered_var: FloatArray
    output_mean: FloatArray
    output_var: FloatArray
    whitened: FloatArray
    log_scales: FloatArray
    floored_pivots: int
    outcome: Outcome
    ended_at: float
    cause: str = ""

    @classmethod
    def of(cls, run: FilterRun) -> FilterBands:
        """Bands of a record that has everything."""
        names = (one.name for one in fields(cls))
        return cls(**{name: getattr(run, name) for name in names})

    @property
    def nbytes(self) -> int:
        """Memory of what is kept, bytes."""
        arrays = (self.filtered_mean, self.filtered_var, self.output_mean, self.output_var)
        return sum(one.nbytes for one in (*arrays, self.whitened, self.log_scales, self.time, self.y))


def filter_bands(
    filter_model: FilterModel, samples: Samples, batch: MemberBatch, compiled: bool, told: Beliefs | None = None
) -> FilterBands:
    """Bands of a filter over the samples of a log, with the single member of a batch.

    Where it diverges it is filtered anew with twice the integration steps, as
    :func:`bondgraph.filter.batch.run_batches` does, and parts are then told anew.
    """
    in_parts = _in_kernel if compiled and has_numba() else _in_numpy
    return gathered(BandRecorder(filter_model, samples, batch, told), in_parts)[1]


def gathered(recorder: BandRecorder, in_parts: Callable[[BandRecorder], None]) -> tuple[BandRecorder, FilterBands]:
    """The recorder of a filter that took a log in parts, and its bands; with finer steps where it diverged."""
    filter_model, samples, batch = recorder.filter_model, recorder.samples, recorder.batch
    in_parts(recorder)
    if recorder.outcome is Outcome.DIVERGED:
        recorder = recorder.finer()
        in_parts(recorder)
    found = recorder.bands()
    if found.outcome is not Outcome.DIVERGED:
        return recorder, found
    return recorder, replace(found, cause=cause(filter_model, samples, batch.member(0), recorder.last, *recorder.ended))


class BandRecorder:
    """Record kept so far of the parts of a log, and the belief in which the last part left off.

    Parameters
    ----------
    filter_model, samples, batch, told
        As for :func:`filter_bands`.
    """

    def __init__(self, filter_model: FilterModel, samples: Samples, batch: MemberBatch, told: Beliefs | None) -> None:
        n_s, n_y, n = len(filter_model.state_names), samples.y.shape[0], samples.sample.size
        self.filter_model, self.samples, self.batch, self._told = filter_model, samples, batch, told
        rows = {"filtered_mean": n_s, "filtered_var": n_s, "output_mean": n_y, "output_var": n_y}
        rows |= {"whitened": n_y, "log_scales": n_y}
        self._arrays = {name: np.full((count, n), np.nan) for name, count in rows.items()}
        self.last, self.ended = -1, (np.full(n_s, np.nan), np.full((n_s, n_s), np.nan))
        self.outcome, self.floored = Outcome.OK, 0

    def finer(self) -> BandRecorder:
        """An empty one for the same log with twice the integration steps."""
        samples = replace(self.samples, substeps=2 * self.samples.substeps)
        return BandRecorder(self.filter_model, samples, self.batch, self._told)

    def add(self, record: Record, first: int, begin: int, last: int) -> None:
        """Keep the nodes ``begin <= k <= last`` of a record whose first node is ``first``."""
        if last < begin:
            return
        edges = np.searchsorted(self.samples.sample, [begin, last + 1])
        own, rows = slice(*map(int, edges)), self.samples.sample[slice(*edges)] - first
        means, covs = record.filtered_mean[:, rows, 0], record.filtered_cov[:, :, rows, 0]
        found = {
            "filtered_mean": means, "filtered_var": np.einsum("iik->ik", covs),
            "output_mean": record.output_mean[:, rows, 0],
            "output_var": np.einsum("iik->ik", record.output_cov[:, :, rows, 0]),
            "whitened": record.whitened[:, rows, 0], "log_scales": record.log_scales[:, rows, 0],
        }  # fmt: skip
        for name, values in found.items():
            self._arrays[name][:, own] = values
        self.last = last
        at = last - first
        self.ended = record.filtered_mean[:, at, 0].copy(), record.filtered_cov[:, :, at, 0].copy()
        if self._told is not None:
            self._told(own, means, covs)

    def bands(self) -> FilterBands:
        """The record of all parts."""
        samples = self.samples
        time = samples.time[samples.sample]
        finished = max(int(np.searchsorted(time, samples.time[max(self.last, 0)], side="right")) - 1, 0)
        return FilterBands(
            self.filter_model, samples.name, time, samples.y[:, samples.sample], **self._arrays,  # type: ignore[arg-type]
            floored_pivots=self.floored, outcome=self.outcome, ended_at=float(time[finished]),
        )  # fmt: skip


def _in_kernel(recorder: BandRecorder) -> None:
    """Part after part, each over its own stretch of the log."""
    filter_in_parts(recorder, PartFilter(recorder.filter_model, recorder.batch), PART)


class PartFilter:
    """The compiled filter of one member over parts of a log.

    ``belief`` is where the last part left off: mean (n_s, 1) and factor (n_s, n_s, 1) of the covariance.
    """

    def __init__(self, filter_model: FilterModel, batch: MemberBatch) -> None:
        n_s = len(filter_model.state_names)
        self._filter_model, self._batch = filter_model, batch
        self._compiled = CompiledFilter.of(filter_model)
        self.belief = np.zeros((n_s, 1)), np.zeros((n_s, n_s, 1))
        self.verdicts = Verdicts(np.zeros(1), *(np.zeros(1, dtype=np.int64) for _ in range(3)))

    def room(self, nodes: int) -> Record:
        """Room for everything about so many nodes."""
        return empty_record(self._filter_model, nodes, 1, depth=2)

    def run(self, samples: Samples, begin: int, end: int, record: Record) -> int:
        """Filter the nodes ``begin <= k < end`` from the belief; the node that comes first in the record.

        A step needs the node before it, and a part leaves its belief where the log goes on.
        """
        first, beyond = max(begin - 1, 0), min(end + 1, samples.time.size)
        self.verdicts.last[0] = -1
        part = Part(begin - first, end - first, *self.belief)
        rows = log_rows(stretch(samples, first, beyond))
        self._compiled.run(rows, part, self._batch, self.verdicts, record, (0, 1))
        return first


def filter_in_parts(
    recorder: BandRecorder, filter_part: PartFilter, longest: int, began: Callable[[int, int], None] | None = None
) -> None:
    """Filter a log in parts of at most so many nodes; ``began`` is told of each part, before it, its nodes."""
    edges = part_edges(recorder.samples, longest)
    record, verdicts = filter_part.room(int(np.diff(edges).max()) + 2), filter_part.verdicts
    for begin, end in itertools.pairwise(map(int, edges)):
        if began is not None:
            began(begin, end)
        first = filter_part.run(recorder.samples, begin, end, record)
        recorder.add(record, first, begin, first + int(verdicts.last[0]))
        if verdicts.outcome[0] != 0:
            break
    recorder.outcome, recorder.floored = OUTCOMES[verdicts.outcome[0]], int(verdicts.floored[0])


def part_edges(samples: Samples, longest: int) -> IntArray:
    """First node of each part of a log, and the end of the last; every part ends with a sample.

    Parts have at most ``longest`` nodes, or those of one interval where it has more.
    """
    ends, edges = samples.sample + 1, [0]
    while edges[-1] < ends[-1]:
        own = np.searchsorted(ends, [edges[-1], edges[-1] + longest], side="right")
        edges.append(int(ends[max(int(own[1]) - 1, int(own[0]))]))
    return np.array(edges)


def _in_numpy(recorder: BandRecorder) -> None:
    """All at once by the filter in numpy, which is for short logs."""
    run = reference_run(recorder.filter_model, recorder.samples, recorder.batch.member(0))
    record = Record(2, *(getattr(run, name)[..., np.newaxis] for name in Record._fields[1:]))
    recorder.outcome, recorder.floored = run.outcome, run.floored_pivots
    recorder.add(record, 0, 0, int(np.count_nonzero(~np.isnan(run.whitened[0]))) - 1)


def stretch(samples: Samples, first: int, end: int) -> Samples:
    """The nodes ``first <= k < end`` of a log; positions of samples stay those in the whole."""
    nodes, steps = slice(first, end), slice(first, end - 1)
    return replace(
        samples, time=samples.time[nodes], u=samples.u[:, nodes], y=samples.y[:, nodes],
        u_left=samples.u_left[:, steps], u_right=samples.u_right[:, steps], substeps=samples.substeps[steps],
        grading=samples.grading[steps], noise_start=samples.noise_start[steps], noise_end=samples.noise_end[steps],
    )  # fmt: skip
