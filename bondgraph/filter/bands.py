"""A filter over a long log of which only bands are kept: means and standard deviations, and what measurements said.

Covariances between states, before and after every measurement, take as many numbers as the square of the states: of a
day of a vehicle at 40 samples per second twelve gigabytes. Few ask for them. So the log is filtered part after part,
each from the belief in which the one before left off, everything is recorded of one part at a time, and what is kept of
it is the same in every bit as from a filter that keeps all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.compile.machine_code import has_numba
from bondgraph.filter.abstract_run import AbstractRun
from bondgraph.filter.batch import empty_record
from bondgraph.filter.causes import cause
from bondgraph.filter.compiled import CompiledFilter, log_rows
from bondgraph.filter.filter_model import FilterModel
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
    kept = _Kept(filter_model, samples, batch, told)
    in_parts(kept)
    if kept.outcome is Outcome.DIVERGED:
        kept = _Kept(filter_model, replace(samples, substeps=2 * samples.substeps), batch, told)
        in_parts(kept)
    found = kept.bands()
    if found.outcome is not Outcome.DIVERGED:
        return found
    return replace(found, cause=cause(filter_model, samples, batch.member(0), kept.last, *kept.ended))


class _Kept:
    """What is kept so far, and the belief in which the last part left off."""

    def __init__(self, filter_model: FilterModel, samples: Samples, batch: MemberBatch, told: Beliefs | None) -> None:
        n_s, n_y, n = len(filter_model.state_names), samples.y.shape[0], samples.sample.size
        self.filter_model, self.samples, self.batch, self._told = filter_model, samples, batch, told
        rows = {"filtered_mean": n_s, "filtered_var": n_s, "output_mean": n_y, "output_var": n_y}
        rows |= {"whitened": n_y, "log_scales": n_y}
        self._arrays = {name: np.full((count, n), np.nan) for name, count in rows.items()}
        self.last, self.ended = -1, (np.full(n_s, np.nan), np.full((n_s, n_s), np.nan))
        self.outcome, self.floored = Outcome.OK, 0

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


def _in_kernel(kept: _Kept) -> None:
    """Part after part, each over its own stretch of the log."""
    filter_model, samples, count = kept.filter_model, kept.samples, kept.samples.time.size
    compiled, n_s = CompiledFilter.of(filter_model), len(filter_model.state_names)
    mean, lower = np.zeros((n_s, 1)), np.zeros((n_s, n_s, 1))
    verdicts = Verdicts(np.zeros(1), *(np.zeros(1, dtype=np.int64) for _ in range(3)))
    record = empty_record(filter_model, min(PART + 2, count), 1, depth=2)
    for begin in range(0, count, PART):
        end = min(begin + PART, count)
        # a step needs the node before it, and a part leaves its belief where the log goes on
        first, beyond = max(begin - 1, 0), min(end + 1, count)
        verdicts.last[0] = -1
        part = Part(begin - first, end - first, mean, lower)
        compiled.run(log_rows(stretch(samples, first, beyond)), part, kept.batch, verdicts, record, (0, 1))
        kept.add(record, first, begin, first + int(verdicts.last[0]))
        if verdicts.outcome[0] != 0:
            break
    kept.outcome, kept.floored = OUTCOMES[verdicts.outcome[0]], int(verdicts.floored[0])


def _in_numpy(kept: _Kept) -> None:
    """All at once by the filter in numpy, which is for short logs."""
    run = reference_run(kept.filter_model, kept.samples, kept.batch.member(0))
    record = Record(2, *(getattr(run, name)[..., np.newaxis] for name in Record._fields[1:]))
    kept.outcome, kept.floored = run.outcome, run.floored_pivots
    kept.add(record, 0, 0, int(np.count_nonzero(~np.isnan(run.whitened[0]))) - 1)


def stretch(samples: Samples, first: int, end: int) -> Samples:
    """The nodes ``first <= k < end`` of a log; positions of samples stay those in the whole."""
    nodes, steps = slice(first, end), slice(first, end - 1)
    return replace(
        samples, time=samples.time[nodes], u=samples.u[:, nodes], y=samples.y[:, nodes],
        u_left=samples.u_left[:, steps], u_right=samples.u_right[:, steps], substeps=samples.substeps[steps],
        grading=samples.grading[steps], noise_start=samples.noise_start[steps], noise_end=samples.noise_end[steps],
    )  # fmt: skip
