"""Filter members only as long as their likelihood can come below a ceiling: exact, since what is left is bounded.

A search that only asks whether a member is better than a value it knows already need not filter a bad one to the end of
its logs. The innovation covariance of the m channels measured at a sample is S = H + R, where H, the covariance of what
is expected of them, is positive semi-definite, and R is the covariance of their noises, so

    z' z / 2 + m log(2 pi)/2 + (log det S)/2   >=   m log(2 pi)/2 + (log det R)/2

whatever the sample holds. A robust loss is not negative either, and adds the constant of its norm. Summed over all
samples to come, those of later logs too, that is what the negative log-likelihood must still grow by at least. A member
is given up where what it has gathered and this together exceed its ceiling by more than rounding. So every value below
a ceiling is found, and is the same in every bit as without ceilings; it does not matter that the noises differ between
members.

H is what its sigma points make it, W sum E_i E_i' + c d d' with d = W sum E_i (see ``sigma_points``). For a negative
c = beta - alpha^2 it is still positive semi-definite where 2 n W c >= -1, by the inequality of Cauchy and Schwarz: for
all beta >= 0 if kappa = 0. Where it is not, no member is given up.

A log is filtered in parts, each long enough to be worth the call of a kernel. After each the members that are given up
leave, and the others close ranks, so that the lanes of the kernel stay full. A member that diverges is repeated with
twice the steps, as without a ceiling; one that was given up before it would have diverged is not.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.compile.machine_code import has_numba
from bondgraph.execute.threads import in_threads, thread_count
from bondgraph.filter.batch import BatchRun, empty_run, note_verdict
from bondgraph.filter.compiled import CompiledFilter, log_rows
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.kernel_types import Part, Verdicts
from bondgraph.filter.members import MemberBatch
from bondgraph.filter.samples import Samples
from bondgraph.filter.sigma_points import MerweScaled
from bondgraph.filter.ukf import reference_run
from bondgraph.simulate.outcome import OUTCOMES, Outcome

#: Parts of a log at most, and the fewest samples of one.
_PARTS, _LEAST = 64, 16

#: More than a sum of a million terms loses to rounding, as a share of the size of its terms.
_ROUNDING = 1e-9

#: In the place of a bound that there is not.
_NO_BOUND = -1e300

_ABANDONED, _DIVERGED = OUTCOMES.index(Outcome.ABANDONED), OUTCOMES.index(Outcome.DIVERGED)

#: Filters the members of a log: verdicts from the filter model, the log, the members, where parts start, the highest
#: values (parts, members) with which members may start into them, and the number of threads.
_FilterLog = Callable[[FilterModel, Samples, MemberBatch, IntArray, FloatArray, int | None], Verdicts]


def run_below(
    filter_model: FilterModel,
    logs: Sequence[Samples],
    batches: Sequence[MemberBatch],
    ceilings: FloatArray,
    threads: int | None,
    compiled: bool,
) -> tuple[BatchRun, ...]:
    """Filter every member over one log after another until it is clear that it stays above its ceiling.

    As :func:`bondgraph.filter.batch.run_batches`, which has no ceilings; nothing is recorded of the samples.

    Parameters
    ----------
    filter_model, logs, batches
        The filter, the logs, and the members of each log.
    ceilings
        Of the sum over all logs, shape (members,). A member that failed on a log or was given up is not filtered over
        later ones; there its outcome is ``ABANDONED``, and the index of its last sample -1.
    threads, compiled
        As there.
    """
    in_kernel = compiled and has_numba()
    filter_log = _in_kernel if in_kernel else _in_numpy
    least = [_least_terms(filter_model, batch) for batch in batches]
    counts = [_left_to_measure(samples) for samples in logs]
    bounds = [count @ terms for count, terms in zip(counts, least, strict=True)]
    sizes = sum((count[0] @ np.abs(terms) for count, terms in zip(counts, least, strict=True)), np.zeros(ceilings.size))
    gathered = np.zeros(ceilings.size)
    runs: list[BatchRun] = []
    for index, (samples, batch) in enumerate(zip(logs, batches, strict=True)):
        members = np.flatnonzero(np.isfinite(gathered))
        room = ceilings[members] - gathered[members]
        room += _ROUNDING * (np.abs(ceilings) + np.abs(gathered) + sizes)[members]
        rest = bounds[index] + sum((bound[0] for bound in bounds[index + 1 :]), np.zeros(ceilings.size))
        starts = _starts(samples.time.size, _fewest(filter_model, samples) if in_kernel else _LEAST)
        limits = room - rest[starts][:, members]
        run = empty_run(filter_model, samples, batch, depth=0)
        run.verdicts.outcome[:] = _ABANDONED
        run.verdicts.last[:] = -1
        _filter_members(filter_log, filter_model, run, batch, members, starts, limits, threads)
        gathered = gathered + run.verdicts.nll
        runs.append(run)
    return tuple(runs)


def _filter_members(
    filter_log: _FilterLog,
    filter_model: FilterModel,
    run: BatchRun,
    batch: MemberBatch,
    members: IntArray,
    starts: IntArray,
    limits: FloatArray,
    threads: int | None,
) -> None:
    """Filter some members over a log, those that diverge again with twice the steps, and note what came out."""
    found = filter_log(filter_model, run.samples, batch.chosen(members), starts, limits, threads)
    diverged = np.flatnonzero(found.outcome == _DIVERGED)
    if diverged.size:
        finer = replace(run.samples, substeps=2 * run.samples.substeps)
        again = batch.chosen(members[diverged])
        repeated = filter_log(filter_model, finer, again, starts, limits[:, diverged], threads)
        _put(found, diverged, repeated)
        run.refined[members[diverged]] = True
    found.nll[found.outcome != 0] = math.inf
    _put(run.verdicts, members, found)


def _fewest(filter_model: FilterModel, samples: Samples) -> int:
    """The fewest samples of a part that the compiled kernel filters."""
    return max(_LEAST, CompiledFilter.of(filter_model).nodes_of_a_call(samples))


def _starts(samples: int, fewest: int) -> IntArray:
    """Where the parts of a log start.

    Examples
    --------
    >>> _starts(50, 16).tolist(), _starts(10, 16).tolist(), _starts(6400, 16)[:3].tolist(), _starts(400, 200).tolist()
    ([0, 17, 34], [0], [0, 100, 200], [0, 200])
    """
    parts = max(1, min(_PARTS, samples // fewest))
    return np.arange(0, samples, math.ceil(samples / parts))


def _left_to_measure(samples: Samples) -> FloatArray:
    """How many values each channel still has from a sample on, shape (n, n_y)."""
    measured = ~np.isnan(samples.y.T)
    return np.cumsum(measured[::-1], axis=0)[::-1].astype(np.float64)


def _least_terms(filter_model: FilterModel, batch: MemberBatch) -> FloatArray:
    """The least that one measured value adds to the negative log-likelihood, by channel and member, (n_y, members)."""
    variances = _conditional_variances(batch)
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = 0.5 * math.log(2.0 * math.pi) + filter_model.robustness.constant + 0.5 * np.log(variances)
    bounded = np.isfinite(terms) & _keeps_sign(filter_model.points)
    return np.where(bounded, terms, _NO_BOUND)


def _conditional_variances(batch: MemberBatch) -> FloatArray:
    """Variance (n_y, members) of each sensor's noise given that of all others; NaN for those that are not used."""
    inverse = np.linalg.inv(np.moveaxis(batch.noise_correlation, 2, 0))
    conditional = 1.0 / np.einsum("mii->im", inverse)
    found: FloatArray = batch.noise_std**2 * conditional
    return found


def _keeps_sign(points: MerweScaled) -> bool:
    """Whether the covariance that sigma points give is positive semi-definite whatever they are moved to.

    Examples
    --------
    >>> _keeps_sign(MerweScaled(3)), _keeps_sign(MerweScaled(3, alpha=2.0)), _keeps_sign(MerweScaled(3, beta=-1.0))
    (True, True, False)
    """
    return 2.0 * points.n * points.weight * points.correction >= -1.0


def _in_kernel(
    filter_model: FilterModel,
    samples: Samples,
    batch: MemberBatch,
    starts: IntArray,
    limits: FloatArray,
    threads: int | None,
) -> Verdicts:
    """Part after part, with only those members side by side that go on."""
    n_s, verdicts, workers = len(filter_model.state_names), _no_verdicts(batch.size), thread_count(threads)
    record = empty_run(filter_model, samples, batch.chosen(np.zeros(0, dtype=np.int64)), depth=0).record
    compiled, log = CompiledFilter.of(filter_model), log_rows(samples)
    members, own = np.arange(batch.size), batch
    mean, lower = np.zeros((n_s, batch.size)), np.zeros((n_s, n_s, batch.size))
    ends = [*starts[1:], samples.time.size]
    for begin, end, limit in zip(starts, ends, limits, strict=True):
        going = verdicts.outcome[members] == 0
        hopeless = going & (verdicts.nll[members] > limit[members])
        verdicts.outcome[members[hopeless]] = _ABANDONED
        stay = going & ~hopeless
        if not stay.any():
            break
        if not stay.all():
            members, own = members[stay], own.chosen(np.flatnonzero(stay))
            mean, lower = np.ascontiguousarray(mean[:, stay]), np.ascontiguousarray(lower[:, :, stay])
        current = Verdicts(*(array[members] for array in verdicts))  # type: ignore[arg-type]
        part = Part(int(begin), int(end), mean, lower)
        filter_block = functools.partial(compiled.run, log, part, own, current, record)
        in_threads(workers, filter_block, compiled.blocks(members.size, samples, workers))
        _put(verdicts, members, current)
    return verdicts


def _in_numpy(
    filter_model: FilterModel,
    samples: Samples,
    batch: MemberBatch,
    starts: IntArray,
    limits: FloatArray,
    threads: int | None,
) -> Verdicts:
    """The numpy filter member by member, which asks where parts start."""
    verdicts = _no_verdicts(batch.size)
    for m in range(batch.size):
        highest = np.full(samples.time.size, math.inf)
        highest[starts] = limits[:, m]
        note_verdict(verdicts, m, reference_run(filter_model, samples, batch.member(m), highest))
    return verdicts


def _no_verdicts(members: int) -> Verdicts:
    """Of members before the first sample."""
    outcome, floored = np.zeros((2, members), dtype=np.int64)
    return Verdicts(np.zeros(members), outcome, np.full(members, -1), floored)


def _put(verdicts: Verdicts, members: IntArray, found: Verdicts) -> None:
    """Verdicts of some members in their places."""
    for kept, new in zip(verdicts, found, strict=True):
        kept[members] = new
