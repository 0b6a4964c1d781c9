"""Estimation problems: which quantities are free, what is known of them, and which logs speak about them.

A problem is an ``Objective``: its coordinates are the free parameters (or their logarithms) in order, its value the
negative log-likelihood of all logs plus the priors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bondgraph.data.given import GivenLog, all_matched
from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError, suggest
from bondgraph.estimate.free import FreeParameter, declared_free, parse_target, require_known
from bondgraph.estimate.initial import Initial, initial_states, measured_at_start
from bondgraph.estimate.likelihoods import Batch, CeilingLikelihood, FilterLikelihood, LikelihoodFunction
from bondgraph.estimate.objective import Below, BoolArray, FloatArray, Terms
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.follows import with_followers
from bondgraph.text import count, few

#: What an estimation maximises unless another likelihood is asked for.
_FILTER = FilterLikelihood()


@dataclass(frozen=True, repr=False)
class EstimationProblem:
    """Free parameters of a filter model and the logs that speak about them; build one with :func:`pose`.

    Parameters
    ----------
    filter_model
        Model and noises; what is not free keeps its value.
    logs
        Matched logs. A parameter that a log knows (``theta_overrides``) has that value there, free or not.
    free
        What to estimate, in this order.
    initial
        Where initial states that are not free come from, see :func:`bondgraph.estimate.initial.initial_states`.
    likelihood
        How likely logs are.

    Raises
    ------
    EstimationError
        If a free parameter does not exist, is named twice, or no log speaks about it.
    """

    filter_model: FilterModel
    logs: tuple[MatchedLog, ...]
    free: tuple[FreeParameter, ...]
    initial: Initial = "measured"
    likelihood: LikelihoodFunction = _FILTER

    def __post_init__(self) -> None:
        _check_logs(self)
        object.__setattr__(self, "filter_model", _with_driven(self.filter_model, self.free))
        names: set[str] = set()
        for parameter in self.free:
            require_known(parameter.target, parameter.name, self.filter_model)
            if parameter.name in names:
                raise EstimationError(f"free parameter {parameter.name!r} is named twice", where=(parameter.name,))
            names.add(parameter.name)
            _check_spoken_of(self, parameter)

    def __repr__(self) -> str:
        samples = sum(log.time.size for log in self.logs)
        data = f"{count(len(self.logs), 'log')}, {count(samples, 'sample')}"
        return f"<EstimationProblem {self.filter_model.model.name}: free {few(self.names)}; {data}>"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, in the order of the coordinates."""
        return tuple(parameter.name for parameter in self.free)

    @cached_property
    def lower(self) -> FloatArray:
        """Lower bounds of the coordinates, shape (n,)."""
        return np.array([parameter.coordinate(parameter.lower) for parameter in self.free])

    @cached_property
    def upper(self) -> FloatArray:
        """Upper bounds of the coordinates, shape (n,)."""
        return np.array([parameter.coordinate(parameter.upper) for parameter in self.free])

    @cached_property
    def start(self) -> FloatArray:
        """Coordinates at which searches start, shape (n,)."""
        return np.array([parameter.coordinate(parameter.start) for parameter in self.free])

    @cached_property
    def noise_levels(self) -> BoolArray:
        """Which coordinates are logarithms of the standard deviations of noises, shape (n,)."""
        return np.array([p.scale == "log" and p.target.kind in ("std", "process") for p in self.free], dtype=np.bool_)

    @cached_property
    def initial_states(self) -> list[FloatArray]:
        """Initial state of each log, shape (n_x,), where it is not free."""
        starts = {
            parameter.target.name: parameter.start for parameter in self.free if parameter.target.kind == "parameter"
        }
        model = self.filter_model.model
        theta = model.theta(**starts)
        found = initial_states(model, self.logs, theta, self.initial)
        follows = self.filter_model.follows
        if not follows or self.initial != "measured":
            return found
        names = model.names("state")
        return [
            with_followers(model, x0, log.u[:, 0], {
                name: follow for name, follow in follows.items()
                if name in names and names.index(name) not in measured_at_start(model, log, theta)
            })
            for x0, log in zip(found, self.logs, strict=True)
        ]  # fmt: skip

    def values(self, points: FloatArray) -> FloatArray:
        """Values of the free parameters at coordinates (n, *batch), in the units of the model."""
        rows = [parameter.values(row) for parameter, row in zip(self.free, points, strict=True)]
        return np.array(rows).reshape(points.shape)

    def batch(self, points: FloatArray) -> Batch:
        """All numbers that the members at coordinates (n, members) need."""
        members, model = points.shape[1], self.filter_model.model

        def spread(vector: FloatArray) -> FloatArray:
            return np.repeat(vector[..., np.newaxis], members, axis=-1)

        theta, x0 = spread(model.theta()), tuple(spread(start) for start in self.initial_states)
        own = self.filter_model
        levels = {
            "std": spread(own.noise_std), "process": spread(own.process_std), "x0_std": spread(own.start_std),
        }  # fmt: skip
        pairs = {
            "corr": spread(own.noise_correlations), "process_corr": spread(own.process_correlations),
            "x0_corr": spread(own.start_correlations),
        }  # fmt: skip
        # Initial states of one log come after those shared by all, so that the more specific one counts.
        order = sorted(range(len(self.free)), key=lambda k: self.free[k].target.log is not None)
        values = self.values(points)
        for target, row in ((self.free[k].target, values[k]) for k in order):
            if target.kind == "parameter":
                theta[model.index("parameter", target.name)] = row
            elif target.kind in levels:
                names = model.names("output") if target.kind == "std" else own.state_names
                levels[target.kind][names.index(target.name)] = row
            elif target.other is not None:
                names = model.names("output") if target.kind == "corr" else own.state_names
                i, j = names.index(target.name), names.index(target.other)
                pairs[target.kind][i, j] = pairs[target.kind][j, i] = row
            else:
                for log, start in zip(self.logs, x0, strict=True):
                    if target.log in (None, log.name):
                        start[model.index("state", target.name)] = row
        return Batch(theta, levels["std"], levels["process"], x0, levels["x0_std"], *pairs.values())

    def nll(self, points: FloatArray) -> FloatArray:
        """Negative log-likelihood plus priors at coordinates (n, members), shape (members,)."""
        values = self.likelihood.nll(self.filter_model, self.logs, self.batch(points))
        return values + self._prior_values(points)

    def nll_below(self, points: FloatArray, ceilings: FloatArray) -> Below:
        """Values as :meth:`nll` as far as they are below ceilings (members,); above, members may be given up."""
        if not isinstance(self.likelihood, CeilingLikelihood):
            return Below.whole(self.nll(points))
        priors = self._prior_values(points)
        found = self.likelihood.nll_below(self.filter_model, self.logs, self.batch(points), ceilings - priors)
        return replace(found, nll=found.nll + priors)

    def terms(self, points: FloatArray) -> Terms:
        """Scalar terms at coordinates (n, members): innovations by log, output and sample, then priors."""
        terms = self.likelihood.terms(self.filter_model, self.logs, self.batch(points))
        priors = self._prior_terms(points)
        return Terms(
            np.concatenate([terms.innovations, priors]),
            np.concatenate([terms.log_scales, np.zeros(priors.shape)]),
        )

    def _prior_values(self, points: FloatArray) -> FloatArray:
        """What the priors add to the value, shape (members,)."""
        values: FloatArray = 0.5 * np.sum(self._prior_terms(points) ** 2, axis=0)
        return values

    def _prior_terms(self, points: FloatArray) -> FloatArray:
        rows = [
            (row - parameter.prior_mean) / parameter.prior_std
            for parameter, row in zip(self.free, self.values(points), strict=True)
            if parameter.prior_mean is not None and parameter.prior_std is not None
        ]
        return np.array(rows).reshape(len(rows), points.shape[1])


def pose(
    filter_model: FilterModel,
    logs: GivenLog | Sequence[GivenLog],
    free: Sequence[str | FreeParameter],
    initial: Initial = "measured",
    likelihood: LikelihoodFunction | None = None,
) -> EstimationProblem:
    """Pose an estimation problem.

    Parameters
    ----------
    filter_model
        Model and noises.
    logs
        One or several logs: as read, matched, or files.
    free
        Names, which take the bounds that the model declares, or ``FreeParameter`` values with their own.
    initial
        Where initial states that are not free come from.
    likelihood
        How likely logs are; by default the unscented Kalman filter on all cores.

    Returns
    -------
    EstimationProblem
        Checked.

    Raises
    ------
    EstimationError
        If a name is unknown, has no bounds, is named twice, or no log speaks about it.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1})
    >>> time = np.arange(40) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> bg.pose(swing, log, ["length", "std(deflection)"]).values(np.array([0.0, 0.0])).tolist()
    [1.0, 1.0]
    """
    listed = tuple(all_matched(logs, filter_model.model))
    starts = initial_states(filter_model.model, listed, filter_model.model.theta(), initial)
    chosen = tuple(
        item
        if isinstance(item, FreeParameter)
        else declared_free(item, filter_model, _start(item, filter_model, listed, starts), listed)
        for item in free
    )
    return EstimationProblem(filter_model, listed, chosen, initial, likelihood or _FILTER)


def _start(
    name: str, filter_model: FilterModel, logs: Sequence[MatchedLog], starts: Sequence[FloatArray]
) -> float | None:
    """Where an initial state starts: where its log does, or the mean over logs that share it."""
    target, states = parse_target(name), filter_model.model.names("state")
    if target.kind != "x0" or target.name not in states:
        return None
    row = states.index(target.name)
    values = [float(x0[row]) for log, x0 in zip(logs, starts, strict=True) if target.log in (None, log.name)]
    return sum(values) / len(values) if values else None


def _with_driven(filter_model: FilterModel, free: Sequence[FreeParameter]) -> FilterModel:
    """The filter model that knows of every state whose noise is free, so that noise has its nodes in the logs."""
    states = filter_model.model.names("state")
    found = {p.target.name: 0.0 for p in free if p.target.kind == "process" and p.target.name in states}
    missing = {name: level for name, level in found.items() if name not in filter_model.process_noise}
    return replace(filter_model, process_noise={**filter_model.process_noise, **missing}) if missing else filter_model


def _check_logs(problem: EstimationProblem) -> None:
    if not problem.logs or not problem.free:
        missing = "log" if not problem.logs else "free parameter"
        raise EstimationError(f"{problem.filter_model.model.name}: an estimation needs at least one {missing}")
    names = [log.name for log in problem.logs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise EstimationError(f"two logs are called {twice!r} - rename one, so that results can tell them apart")


def _check_spoken_of(problem: EstimationProblem, parameter: FreeParameter) -> None:
    """Some log must depend on a free parameter."""
    target, model = parameter.target, problem.filter_model.model
    names = [log.name for log in problem.logs]
    if target.log is not None and target.log not in names:
        raise EstimationError(
            f"free parameter {parameter.name!r}: no log is called {target.log!r}{suggest(target.log, names)}"
            f" - the logs are {', '.join(names)}",
            where=(parameter.name,),
        )
    if target.kind == "parameter" and all(target.name in log.theta_overrides for log in problem.logs):
        raise EstimationError(
            f"free parameter {parameter.name!r}: every log states its value, so there is nothing to estimate"
            " - drop it from the free parameters, or its column from a log",
            where=(parameter.name,),
        )
    if target.kind == "parameter" and target.name in problem.filter_model.appended:
        raise EstimationError(
            f"free parameter {parameter.name!r}: the filter already follows it as a state - choose one of the two",
            where=(parameter.name,),
        )
    if target.kind == "std":
        row = model.index("output", target.name)
        if all(np.isnan(log.y[row]).all() for log in problem.logs):
            raise EstimationError(
                f"free parameter {parameter.name!r}: no log measures {target.name!r} - drop it, or map its column",
                where=(parameter.name,),
            )
