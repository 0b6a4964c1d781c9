"""The verbs of the front door that take models and logs as a user holds them.

Logs are given as read (:func:`bondgraph.data.read.read_log`), as files, or already matched to the model. Where a model
is given and no filter, noises and integration steps are taken from the logs, as the commands do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, overload

import numpy as np

from bondgraph.data.given import GivenLog, all_matched, matched
from bondgraph.errors import OptionError, require_kind
from bondgraph.estimate.declared import declared_problem
from bondgraph.estimate.estimation import Settings
from bondgraph.estimate.estimation import estimate as estimate_problem
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.initial import Initial, initial_states
from bondgraph.estimate.inputs_before import with_inputs_before
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.likelihoods import LikelihoodFunction
from bondgraph.estimate.objective import Progress, silent
from bondgraph.estimate.otherwise import with_inputs_compared
from bondgraph.estimate.priors import Prior, read_priors
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.problem import pose as pose_problem
from bondgraph.estimate.result import Estimate
from bondgraph.estimate.setup import filter_setup
from bondgraph.estimate.ties import Tie, read_ties
from bondgraph.execute.executors import open_executor
from bondgraph.filter.bands import FilterBands
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.robust import Robust, read_robust
from bondgraph.filter.runs import run, run_bands, run_smoothed
from bondgraph.filter.smoother_bands import SmootherBands
from bondgraph.simulate.model import Model

if TYPE_CHECKING:
    from bondgraph.simulate.task import Vector


@overload
def filter_log(
    model: Model | FilterModel,
    log: GivenLog,
    theta: Vector = None,
    x0: Mapping[str, float] | None = None,
    *,
    initial: Initial = "measured",
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    robust: Robust | str | None = None,
    compiled: bool = True,
    keep: Literal["all"] = "all",
) -> FilterRun: ...


@overload
def filter_log(
    model: Model | FilterModel,
    log: GivenLog,
    theta: Vector = None,
    x0: Mapping[str, float] | None = None,
    *,
    initial: Initial = "measured",
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    robust: Robust | str | None = None,
    compiled: bool = True,
    keep: Literal["bands"],
) -> FilterBands: ...


@overload
def filter_log(
    model: Model | FilterModel,
    log: GivenLog,
    theta: Vector = None,
    x0: Mapping[str, float] | None = None,
    *,
    initial: Initial = "measured",
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    robust: Robust | str | None = None,
    compiled: bool = True,
    keep: Literal["smoothed"],
) -> SmootherBands: ...


def filter_log(
    model: Model | FilterModel,
    log: GivenLog,
    theta: Vector = None,
    x0: Mapping[str, float] | None = None,
    *,
    initial: Initial = "measured",
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    robust: Robust | str | None = None,
    compiled: bool = True,
    keep: Literal["all", "bands", "smoothed"] = "all",
) -> FilterRun | FilterBands | SmootherBands:
    """Filter a log: states with their uncertainty, and what each measurement said.

    Parameters
    ----------
    model
        A filter model, or a model whose noises are taken from the log.
    log
        As read, matched, a file, or a data frame.
    theta
        Parameters by name or as a vector (n_theta,); None: declared values.
    x0
        Initial states by name; None: by the rule of ``initial``.
    initial
        Where initial states come from, see :func:`bondgraph.estimate.initial.initial_states`.
    columns
        Name of a column -> name in the model, where they differ.
    constants
        Values (or letters) of inputs that a log lacks.
    robust
        Loss of innovations where sensors have outliers: ``"student"``, ``"huber"`` or ``"gate"``, see
        :class:`bondgraph.filter.robust.Robust`; None: that of the filter model.
    compiled
        Use compiled equations; for short logs interpreted ones are ready sooner.
    keep
        ``"all"``: with every covariance, which smoothing needs. ``"bands"``: means, variances and innovations, the same
        numbers in a fraction of the memory, for logs of hours and days. ``"smoothed"``: these, and means and variances
        given the whole log, with the numbers of :func:`bondgraph.filter.smoother.smooth`. Of whom the likelihood is
        enough calls :func:`bondgraph.filter.likelihood.likelihood`, which keeps nothing of the samples.

    Raises
    ------
    BondGraphError
        If the log does not fit the model, or a name or shape is wrong. A run that diverges says so in its outcome;
        one that is to be smoothed raises.

    Examples
    --------
    >>> import bondgraph as bg, numpy as np
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1})
    >>> time = np.arange(40) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> bg.filter_log(swing, log, compiled=False).mean("angle").shape
    (40,)
    """
    require_kind("filter_log", model, (Model, FilterModel), "model")
    own = model.model if isinstance(model, FilterModel) else model
    fitting = matched(log, own, columns, constants)
    filter_model = model if isinstance(model, FilterModel) else filter_setup(own, own.driven, [fitting]).filter_model
    filter_model = _judging(filter_model, read_robust(robust))
    values = own.theta(**theta) if isinstance(theta, Mapping) else own.theta() if theta is None else np.asarray(theta)
    rule = initial if x0 is None else (x0,)
    (fitting,) = with_inputs_before(own, [fitting], values, rule)
    start = initial_states(own, [fitting], values, rule)[0]
    kept = {"all": run, "bands": run_bands, "smoothed": run_smoothed}.get(keep)
    if kept is None:
        raise OptionError(
            f"filter_log: keep {keep!r} is not known - choose all, bands or smoothed", where=("keep", keep)
        )
    return kept(filter_model, fitting, values, x0=start, compiled=compiled)  # type: ignore[operator, no-any-return]


def estimate(
    model: Model | FilterModel | Problem,
    logs: GivenLog | Sequence[GivenLog] = (),
    free: str | Sequence[str | FreeParameter] = (),
    settings: Settings | None = None,
    *,
    process_noise: str = "free",
    initial: Initial = "measured",
    ties: Mapping[str, str] | Tie | Sequence[Tie] = (),
    priors: Prior | Sequence[Prior] = (),
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    robust: Robust | str | None = None,
    progress: Progress = silent,
    folder: str | Path | None = None,
    resume: bool = False,
    executor: str | Executor | None = "serial",
) -> Estimate:
    """Estimate parameters from logs by the likelihood of an unscented Kalman filter.

    Parameters
    ----------
    model
        A model, whose noise levels are estimated too; a filter model, whose noises are known; or a posed problem.
    logs
        One or several logs, as read, matched, files or data frames; none with a problem, which has its own.
    free
        Names of what to estimate, see :mod:`bondgraph.estimate.free`; empty: all parameters that declare bounds.
    settings
        Method, seed and stop rules.
    process_noise
        Of a model without a filter: ``"free"``, or ``"none"`` to take its equations as exact.
    initial
        Where initial states that are not free come from.
    ties
        Quantities that follow from free parameters, in coherent SI: ``{"k_r": "1.2*k_f"}``.
    priors
        What is known from elsewhere: a data sheet, ``Normal("mass", 1200.0, 50.0)`` of ``bondgraph.estimate``, an
        estimate before, ``fit.as_prior()``, or several of them.
    columns
        Name of a column -> name in the model, where they differ.
    constants
        Values (or letters) of inputs that a log lacks.
    robust
        Loss of innovations where sensors have outliers: ``"student"``, ``"huber"`` or ``"gate"``, see
        :class:`bondgraph.filter.robust.Robust`; None: that of the filter model.
    progress, folder, resume
        As for :func:`bondgraph.estimate.estimation.estimate`.
    executor
        Who evaluates members and starts, ``"processes:4"`` or ``"dask://host:8786"``, see
        :func:`bondgraph.execute.executors.open_executor`; it changes no number.

    Returns
    -------
    Estimate
        With its outcome; a search that fails is a value, not an exception. Its ``inputs_otherwise`` tells inputs that
        are likelier another way between samples than declared.

    Raises
    ------
    BondGraphError
        If a log does not fit the model, or a name is unknown, has no bounds or no log speaks about it.

    Examples
    --------
    >>> import bondgraph as bg, numpy as np
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(100) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> fit = bg.estimate(swing, log, ["length"], bg.Settings(method="gradient", starts=1))
    >>> fit.outcome.name, round(fit.values["length"], 1)
    ('CONVERGED', 1.0)

    The next log, with what the first one said as a prior:

    >>> again = bg.estimate(swing, log, ["length"], bg.Settings(method="gradient", starts=1), priors=[fit.as_prior()])
    >>> again.std["length"] < fit.std["length"]
    True
    """
    if isinstance(model, Problem):
        if logs or free or ties or priors or robust:
            raise OptionError(
                "estimate: a posed problem has its own logs, free parameters, ties, priors and loss - give it alone"
            )
        problem = model
    else:
        require_kind("estimate", model, (Model, FilterModel), "model")
        problem = pose(
            model, logs, free, initial, None, ties, priors, process_noise=process_noise, columns=columns,
            constants=constants, robust=robust,
        )  # fmt: skip
    place = None if folder is None else Path(folder)
    with open_executor(executor) as workers:
        found = estimate_problem(problem, settings, progress=progress, folder=place, resume=resume, executor=workers)
    return with_inputs_compared(found, progress)


def pose(
    model: Model | FilterModel,
    logs: GivenLog | Sequence[GivenLog],
    free: str | Sequence[str | FreeParameter] = (),
    initial: Initial = "measured",
    likelihood: LikelihoodFunction | None = None,
    ties: Mapping[str, str] | Tie | Sequence[Tie] = (),
    priors: Prior | Sequence[Prior] = (),
    *,
    process_noise: str = "free",
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    robust: Robust | str | None = None,
) -> EstimationProblem:
    """Pose an estimation problem: for :func:`estimate`, for sensitivities before it, or as a part of a joint problem.

    Parameters
    ----------
    model
        A model, whose noise levels are free too; or a filter model, whose noises are known.
    logs
        One or several logs: as read, matched, files or data frames.
    free
        Names, which take the bounds that the model declares, or ``FreeParameter`` values with their own; empty: all
        parameters that declare bounds and are not tied.
    initial
        Where initial states that are not free come from.
    likelihood
        How likely logs are; by default the unscented Kalman filter on all cores.
    ties
        Quantities that follow from free parameters, in coherent SI: name and expression, ``{"k_r": "1.2*k_f"}``.
    priors
        What is known of free and tied values from elsewhere, see :mod:`bondgraph.estimate.priors`.
    process_noise
        Of a model without a filter: ``"free"``, or ``"none"`` to take its equations as exact.
    columns
        Name of a column -> name in the model, where they differ.
    constants
        Values (or letters) of inputs that a log lacks.
    robust
        Loss of innovations where sensors have outliers; None: that of the filter model.

    Returns
    -------
    EstimationProblem
        Checked.

    Raises
    ------
    BondGraphError
        If a log does not fit the model, or a name is unknown, has no bounds, is named twice, or no log speaks about it.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> time = np.arange(40) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> bg.pose(pendulum(), log, ["length"]).names
    ('length', 'std(deflection)', 'process(angle)', 'process(rate)')
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1})
    >>> bg.pose(swing, log, ["length", "std(deflection)"]).values(np.array([0.0, 0.0])).tolist()
    [1.0, 1.0]
    """
    require_kind("pose", model, (Model, FilterModel), "model")
    own, tied, known = model.model if isinstance(model, FilterModel) else model, read_ties(ties), read_priors(priors)
    names = [free] if isinstance(free, str) else list(free)
    if not names and (tied or isinstance(model, FilterModel)):
        names = [name for name in bounded(own) if name not in {tie.name for tie in tied}]
    fitting = all_matched(logs, own, columns, constants)
    loss = read_robust(robust)
    if isinstance(model, FilterModel):
        return pose_problem(_judging(model, loss), fitting, names, initial, likelihood, tied, known)
    if not fitting:
        raise OptionError(f"estimate: {own.name} needs at least one log - give logs", where=("logs",))
    found = declared_problem(own, own.driven, fitting, names, process_noise, initial)
    found = replace(found, filter_model=_judging(found.filter_model, loss))
    found = replace(found, ties=tied, priors=known) if tied or known else found
    return found if likelihood is None else replace(found, likelihood=likelihood)


def _judging(filter_model: FilterModel, loss: Robust | None) -> FilterModel:
    """The filter with a loss, where one is asked for."""
    return filter_model if loss is None else replace(filter_model, robust=loss)


def bounded(model: Model) -> tuple[str, ...]:
    """Names of the parameters that declare bounds: those that may be estimated."""
    return tuple(info.name for info in model.parameters if info.lower is not None)
