"""The likelihood of measured logs under a filter model, for many members at once: what an estimation evaluates.

    nll = sum over samples of  (z' z + m log 2 pi)/2 + log det L,      S = L L',   z = L^-1 (measured - expected)

with the innovation covariance S of the m channels measured at a sample.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Unpack

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import BoolArray, FloatArray, IntArray
from bondgraph.errors import FilterError
from bondgraph.filter.batch import BatchRun, run_batches
from bondgraph.filter.ceiling import run_below
from bondgraph.filter.conditioning import Conditioning, conditioning
from bondgraph.filter.discretisation import DiscretisationError, discretisation_error
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.members import MemberValues
from bondgraph.filter.runs import prepared
from bondgraph.filter.samples import MeasuredLog
from bondgraph.simulate.outcome import Outcome


@dataclass(frozen=True)
class Likelihood:
    """Negative log-likelihoods of a batch.

    ``nll`` (members,) is the sum over logs of ``nll_per_log`` (n_logs, members), infinite where a member failed;
    ``outcomes`` says how each member ended (its first failure), ``floored_pivots`` (members,) how many directions of a
    covariance were lost to rounding, ``refined`` (members,) who diverged somewhere and was repeated there with twice
    the integration steps. ``method`` and ``substeps`` (on average, where they are planned) are what else was used.
    ``abandoned`` (members,) tells who was given up since it could no longer come below its ceiling; its value is
    infinite too, and its outcome ``ABANDONED``. ``share`` (members,) is the part of the samples a member went through.
    """

    nll: FloatArray
    outcomes: tuple[Outcome, ...]
    nll_per_log: FloatArray
    floored_pivots: IntArray
    refined: BoolArray
    abandoned: BoolArray
    share: FloatArray
    method: str
    substeps: int
    _error: Callable[[], DiscretisationError] = field(repr=False, compare=False)
    _conditioning: Callable[[], Conditioning] = field(repr=False, compare=False)

    @functools.cached_property
    def discretisation(self) -> DiscretisationError:
        """How much the integration steps disturb the value of the best member, in nats; filtered anew when asked."""
        return self._error()

    @functools.cached_property
    def conditioning(self) -> Conditioning:
        """How much rounding moves the value of the best member, in nats; filtered anew when asked."""
        return self._conditioning()


@dataclass(frozen=True)
class WhitenedInnovations:
    """Innovations of one log made independent with unit variance, for scoring and residual tests.

    ``values`` and ``log_scales`` (n_y, n, members): each innovation given those before it, divided by its standard
    deviation, and the logarithm of that standard deviation; zero where nothing was measured, NaN throughout for a
    member that failed. ``measured`` (n_y, n).
    """

    log_name: str
    values: FloatArray
    log_scales: FloatArray
    measured: BoolArray
    outcomes: tuple[Outcome, ...]


def likelihood(
    filter_model: FilterModel,
    logs: MeasuredLog | Sequence[MeasuredLog],
    theta: npt.ArrayLike | None = None,
    *,
    ceilings: npt.ArrayLike | None = None,
    threads: int | None = None,
    compiled: bool = True,
    **values: Unpack[MemberValues],
) -> Likelihood:
    """Negative log-likelihood of logs, for every member of a batch.

    Parameters
    ----------
    filter_model
        Model and noises.
    logs
        One or several logs; their likelihoods multiply.
    theta
        Parameters (n_theta,) or (n_theta, members); None: declared values. What a log knows is taken from the log.
    ceilings
        Shape (members,) or one for all: a member is given up as soon as its value is certain to exceed its ceiling.
        Values of the others do not depend on it. See :mod:`bondgraph.filter.ceiling`.
    threads
        Threads over blocks of members; None: one per core. The result does not depend on it.
    compiled
        Use the compiled kernel (and numpy where numba is missing), or numpy.
    **values
        ``noise_std``, ``process_std``, ``initial_std``, ``x0``, see :class:`bondgraph.filter.members.MemberValues`.

    Returns
    -------
    Likelihood
        A diverging member is an outcome with an infinite value, never an exception.

    Raises
    ------
    FilterError, ModelError
        If logs or shapes do not fit the model.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.simulate.example import pendulum
    >>> model = pendulum()
    >>> swing = FilterModel(model, {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> lengths = np.stack([model.theta(length=length) for length in (0.5, 1.0, 2.0)], axis=1)
    >>> int(np.argmin(likelihood(swing, log, lengths).nll))
    1
    """
    used, samples, batches = prepared(filter_model, logs, theta, values, compiled)
    if ceilings is None:
        runs = run_batches(used, samples, batches, 0, threads, compiled)
    else:
        runs = run_below(used, samples, batches, _for_each(ceilings, batches[0].size), threads, compiled)
    per_log = np.array([run.verdicts.nll for run in runs])
    floored = np.sum([run.verdicts.floored for run in runs], axis=0)
    refined = np.any([run.refined for run in runs], axis=0)
    nll = per_log.sum(axis=0)
    outcomes = first_failures(runs)
    abandoned = np.array([outcome is Outcome.ABANDONED for outcome in outcomes])

    def best() -> tuple[FloatArray, MemberValues]:
        m = int(np.argmin(nll))
        return batches[0].theta[:, m], {
            "noise_std": batches[0].noise_std[:, m],
            "process_std": batches[0].process_std[:, m],
            "noise_correlation": batches[0].noise_correlation[..., m],
            "process_correlation": batches[0].process_correlation[..., m],
            "x0": [batch.x0[:, m] for batch in batches],
            "initial_std": [batch.initial_std[:, m] for batch in batches],
        }

    def error() -> DiscretisationError:
        own_theta, own = best()
        return discretisation_error(used, logs, own_theta, compiled=compiled, **own)

    def moved() -> Conditioning:
        own_theta, own = best()
        return conditioning(used, logs, own_theta, compiled=compiled, **own)

    steps = (used.method, used.typical_substeps)
    return Likelihood(nll, outcomes, per_log, floored, refined, abandoned, filtered_share(runs), *steps, error, moved)


def negative_log_likelihood(
    filter_model: FilterModel,
    logs: MeasuredLog | Sequence[MeasuredLog],
    theta: npt.ArrayLike | None = None,
    *,
    threads: int | None = None,
    compiled: bool = True,
    **values: Unpack[MemberValues],
) -> tuple[FloatArray, tuple[Outcome, ...]]:
    """Values (members,) and outcomes of :func:`likelihood`."""
    result = likelihood(filter_model, logs, theta, threads=threads, compiled=compiled, **values)
    return result.nll, result.outcomes


def innovations(
    filter_model: FilterModel,
    logs: MeasuredLog | Sequence[MeasuredLog],
    theta: npt.ArrayLike | None = None,
    *,
    threads: int | None = None,
    compiled: bool = True,
    **values: Unpack[MemberValues],
) -> tuple[WhitenedInnovations, ...]:
    """Whitened innovations of every member, one record per log; arguments as for :func:`likelihood`.

    With z and log s of a record, nll = sum(z^2/2 + log s) + log(2 pi)/2 per measured value.
    """
    used, samples, batches = prepared(filter_model, logs, theta, values, compiled)
    return tuple(whitened_innovations(run) for run in run_batches(used, samples, batches, 1, threads, compiled))


def _for_each(ceilings: npt.ArrayLike, members: int) -> FloatArray:
    """Ceilings of the members, shape (members,)."""
    highest = np.asarray(ceilings, dtype=np.float64)
    if highest.shape not in ((), (members,)):
        raise FilterError(
            f"ceilings has shape {highest.shape} for {members} members - give one for each, or one for all",
            where=("ceilings",),
        )
    return np.array(np.broadcast_to(highest, members))


def first_failures(runs: Sequence[BatchRun]) -> tuple[Outcome, ...]:
    """The first failure of each member over the logs, ``OK`` of those that have none."""
    members = range(runs[0].verdicts.nll.size)
    ends = ([run.outcome(m) for run in runs] for m in members)
    return tuple(next((end for end in each if end is not Outcome.OK), Outcome.OK) for each in ends)


def filtered_share(runs: Sequence[BatchRun]) -> FloatArray:
    """The part of the samples of all logs that each member went through, shape (members,)."""
    share: FloatArray = np.sum([run.verdicts.last + 1 for run in runs], axis=0)
    return share / sum(run.samples.time.size for run in runs)


def whitened_innovations(run: BatchRun) -> WhitenedInnovations:
    """The whitened innovations of all members over one log, of a run that recorded at least depth 1."""
    failed = run.verdicts.outcome != 0
    sample = run.samples.sample
    values, log_scales = run.record.whitened[:, sample], run.record.log_scales[:, sample]
    values[..., failed] = np.nan
    log_scales[..., failed] = np.nan
    outcomes = first_failures((run,))
    return WhitenedInnovations(run.samples.name, values, log_scales, ~np.isnan(run.samples.y[:, sample]), outcomes)
