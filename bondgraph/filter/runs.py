"""Runs of the filter over logs: of many members for what a likelihood needs, of one with everything kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Unpack

import numpy.typing as npt

from bondgraph.compile.machine_code import has_numba
from bondgraph.errors import FilterError
from bondgraph.filter.bands import Beliefs, FilterBands, filter_bands
from bondgraph.filter.batch import run_batches
from bondgraph.filter.causes import cause
from bondgraph.filter.choice import choose_method
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.members import MemberBatch, MemberValues, member_batches
from bondgraph.filter.samples import MeasuredLog, Samples
from bondgraph.filter.smoother import smooth
from bondgraph.filter.smoother_bands import SmootherBands, smoother_bands
from bondgraph.simulate.outcome import Outcome


def run(
    filter_model: FilterModel,
    log: MeasuredLog,
    theta: npt.ArrayLike | None = None,
    *,
    compiled: bool = True,
    **values: Unpack[MemberValues],
) -> FilterRun:
    """Filter one log with one set of numbers and keep everything.

    Arguments as for :func:`bondgraph.filter.likelihood.likelihood`, of a single member.

    Raises
    ------
    FilterError, ModelError
        If log or shapes do not fit the model, or there are several members.

    Examples
    --------
    >>> import numpy as np
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> run(swing, log, compiled=False).mean("angle").shape
    (40,)
    """
    used, samples, (members,) = prepared(filter_model, log, theta, values, compiled)
    (batch,) = run_batches(used, samples, [members], 2, 1, compiled)
    if batch.verdicts.nll.size != 1:
        raise FilterError(f"{log.name}: run takes one member, not {batch.verdicts.nll.size} - use likelihood for many")
    found = batch.filter_run(used, 0)
    if found.outcome is not Outcome.DIVERGED:
        return found
    last = int(batch.verdicts.last[0])
    nodes = batch.node_run(used, 0)
    mean, cov = nodes.filtered_mean[:, last], nodes.filtered_cov[:, :, last]
    return replace(found, cause=cause(used, batch.samples, members.member(0), last, mean, cov))


def run_bands(
    filter_model: FilterModel,
    log: MeasuredLog,
    theta: npt.ArrayLike | None = None,
    *,
    compiled: bool = True,
    told: Beliefs | None = None,
    **values: Unpack[MemberValues],
) -> FilterBands:
    """Filter one log with one set of numbers and keep means, variances and innovations.

    For long logs: memory grows with the states, not with their square. What is kept has the bits that :func:`run`
    gives.

    Parameters
    ----------
    filter_model, log, theta, compiled, **values
        As for :func:`run`.
    told
        Called with every part of the log: the samples it holds, their filtered means (n_s, k) and covariances
        (n_s, n_s, k), which are not kept. It is called for a part once more where a run is repeated with finer steps.

    Raises
    ------
    FilterError, ModelError
        If log or shapes do not fit the model, or there are several members.

    Examples
    --------
    >>> import numpy as np
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> bands, whole = run_bands(swing, log, compiled=False), run(swing, log, compiled=False)
    >>> bool((bands.std("angle") == whole.std("angle")).all()), bands.nll == whole.nll
    (True, True)
    """
    used, samples, members = _one_member(filter_model, log, theta, values, compiled)
    return filter_bands(used, samples, members, compiled, told)


def run_smoothed(
    filter_model: FilterModel,
    log: MeasuredLog,
    theta: npt.ArrayLike | None = None,
    *,
    compiled: bool = True,
    told: Beliefs | None = None,
    **values: Unpack[MemberValues],
) -> SmootherBands:
    """Filter and smooth one log with one set of numbers and keep means, variances and innovations.

    For long logs: as :func:`run_bands`, and smoothed with the bits of :func:`bondgraph.filter.smoother.smooth`. The
    filter runs twice.

    Parameters
    ----------
    filter_model, log, theta, compiled, **values
        As for :func:`run`.
    told
        Called with every part of the log, the last one first: the samples it holds, their smoothed means (n_s, k) and
        covariances (n_s, n_s, k), which are not kept.

    Raises
    ------
    FilterError, ModelError
        If log or shapes do not fit the model, there are several members, or the filter did not reach the end of the
        log.

    Examples
    --------
    >>> import numpy as np
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.filter.smoother import smooth
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> bands, whole = run_smoothed(swing, log, compiled=False), smooth(run(swing, log, compiled=False))
    >>> bool((bands.std("angle") == whole.std("angle")).all())
    True
    """
    if compiled and has_numba():
        return smoother_bands(*_one_member(filter_model, log, theta, values, compiled), told)
    whole = run(filter_model, log, theta, compiled=False, **values)
    smoothed = smooth(whole)
    if told is not None:
        told(slice(0, whole.time.size), smoothed.smoothed_mean, smoothed.smoothed_cov)
    return SmootherBands(
        whole.filter_model, log.name, whole.time, smoothed.smoothed_mean, smoothed.smoothed_var, FilterBands.of(whole)
    )


def _one_member(
    filter_model: FilterModel, log: MeasuredLog, theta: npt.ArrayLike | None, values: MemberValues, compiled: bool
) -> tuple[FilterModel, Samples, MemberBatch]:
    """The filter model with its method decided, the log on its nodes, and the one member."""
    used, (samples,), (members,) = prepared(filter_model, log, theta, values, compiled)
    if members.size != 1:
        raise FilterError(f"{log.name}: run takes one member, not {members.size} - use likelihood for many")
    return used, samples, members


def prepared(
    filter_model: FilterModel,
    logs: MeasuredLog | Sequence[MeasuredLog],
    theta: npt.ArrayLike | None,
    values: MemberValues,
    compiled: bool,
) -> tuple[FilterModel, list[Samples], tuple[MemberBatch, ...]]:
    """Inputs of a run: the filter model with its method decided, and for each log its samples and its members.

    Parameters
    ----------
    filter_model, logs, theta, compiled
        As for :func:`bondgraph.filter.likelihood.likelihood`.
    values
        Numbers of the members.

    Raises
    ------
    FilterError, ModelError
        If there is no log, or logs or shapes do not fit the model.
    """
    listed = logs if isinstance(logs, Sequence) else (logs,)
    if not listed:
        raise FilterError(f"{filter_model.model.name}: there is no log to filter - give at least one")
    filter_model = choose_method(filter_model, listed, compiled=compiled)
    samples = [Samples.of(filter_model, log) for log in listed]
    return filter_model, samples, member_batches(filter_model, samples, theta, values)
