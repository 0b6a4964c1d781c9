"""Estimation problems: which quantities are free, what is known of them, and which logs speak about them.

A problem is an ``Objective``: its coordinates are the free parameters (or their logarithms) in order, its value the
negative log-likelihood of all logs plus the priors.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from bondgraph.data.given import GivenLog, all_matched
from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError, require_kind, suggest
from bondgraph.estimate.coordinates import AbstractProblem, checked_priors
from bondgraph.estimate.free import FreeParameter, Target, declared_free, parse_target, require_known
from bondgraph.estimate.initial import Initial, initial_states, start_rule
from bondgraph.estimate.inputs_before import with_inputs_before
from bondgraph.estimate.likelihoods import Batch, CeilingLikelihood, FilterLikelihood, LikelihoodFunction
from bondgraph.estimate.objective import Below, FloatArray, Terms
from bondgraph.estimate.priors import Prior, read_priors
from bondgraph.estimate.shown_starts import Beginnings, led, shown_starts, start_shifts
from bondgraph.estimate.ties import Tie, read_ties
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.follows import Follow
from bondgraph.text import count, few

#: What an estimation maximises unless another likelihood is asked for.
_FILTER = FilterLikelihood()


@dataclass(frozen=True, repr=False)
class EstimationProblem(AbstractProblem):
    """Free parameters of a filter model and the logs that speak about them; build one with :func:`pose`.

    Parameters
    ----------
    filter_model
        Model and noises; what is not free keeps its value.
    logs
        Matched logs. A parameter that a log knows (``theta_overrides``) has that value there, free or not.
    free
        What to estimate, in this order. A name that the model lacks must be in the expression of a tie.
    initial
        Where initial states that are not free come from, see :func:`bondgraph.estimate.initial.initial_states`.
    likelihood
        How likely logs are.
    ties
        What follows from free parameters.
    priors
        What is known of free and tied values from elsewhere.

    Raises
    ------
    EstimationError
        If a free parameter does not exist, is named twice, or no log speaks about it; if a tie or a prior is about
        something else than the problem.
    """

    filter_model: FilterModel
    logs: tuple[MatchedLog, ...]
    free: tuple[FreeParameter, ...]
    initial: Initial = "measured"
    likelihood: LikelihoodFunction = _FILTER
    ties: tuple[Tie, ...] = ()
    priors: tuple[Prior, ...] = ()

    def __post_init__(self) -> None:
        check_logs(self.name, self.logs, self.free)
        object.__setattr__(self, "filter_model", _with_driven(self.filter_model, self.free))
        _check_ties(self)
        names: set[str] = set()
        for parameter in self.free:
            if parameter.name in names:
                raise EstimationError(f"free parameter {parameter.name!r} is named twice", where=(parameter.name,))
            names.add(parameter.name)
            if not self.is_auxiliary(parameter):
                require_known(parameter.target, parameter.name, self.filter_model)
                check_spoken_of(parameter.name, parameter.target, self.filter_model, self.logs)
        tied = [tie.name for tie in self.ties]
        object.__setattr__(self, "free", checked_priors(self.free, tied, self.priors))

    def __repr__(self) -> str:
        samples = sum(log.time.size for log in self.logs)
        data = f"{count(len(self.logs), 'log')}, {count(samples, 'sample')}"
        return f"<EstimationProblem {self.name}: free {few(self.names)}; {data}>"

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.filter_model.model.name

    @property
    def parts(self) -> tuple[EstimationProblem, ...]:
        """Problems with one filter model each: this one."""
        return (self,)

    @property
    def rows(self) -> tuple[npt.NDArray[np.intp], ...]:
        """Places of each part's coordinates: all."""
        return (np.arange(len(self.free)),)

    def with_filters(self, filter_models: Iterable[FilterModel]) -> EstimationProblem:
        """The same with another filter model, one per part."""
        (used,) = filter_models
        return replace(self, filter_model=used)

    def with_parts(self, parts: Iterable[EstimationProblem]) -> EstimationProblem:
        """The other part."""
        (part,) = parts
        return part

    def is_auxiliary(self, parameter: FreeParameter) -> bool:
        """Whether a free parameter acts through ties alone, since the model has none of its name."""
        known = self.filter_model.model.names("parameter")
        used = any(parameter.name in tie.variables for tie in self.ties)
        return used and parameter.target.kind == "parameter" and parameter.name not in known

    @cached_property
    def initial_states(self) -> list[FloatArray]:
        """Initial state of each log, shape (n_x,), where it is not free, with the parameters where searches start."""
        return self.states_begun_at(self._start_theta)

    def states_begun_at(self, theta: FloatArray) -> list[FloatArray]:
        """Initial state of each log, shape (n_x,), where it is not free, at parameters (n_theta,)."""
        return initial_states(self.filter_model.model, self.logs, theta, self.initial, self._follows)

    @cached_property
    def _follows(self) -> list[Mapping[str, Follow]]:
        """By log the states that begin where others lead them."""
        own, theta = self.filter_model, self._start_theta
        follows = own.follows if start_rule(self.initial).led else {}
        return [led(own.model, log, theta, follows) for log in self.logs]

    @cached_property
    def _start_theta(self) -> FloatArray:
        """Parameters (n_theta,) where searches start."""
        starts = {target.name: row for target, row in self.numbers(self.start) if target.kind == "parameter"}
        return self.filter_model.model.theta(**{name: float(value) for name, value in starts.items()})

    @cached_property
    def beginnings(self) -> Beginnings:
        """How logs begin where free parameters say what an output shows of a state."""
        own, moved = self.filter_model, [target for target, _ in self.numbers(self.start)]
        kept = (own.model.index("state", one.name) for one in moved if one.kind == "x0_std")
        rules = [self.initial] * len(self.logs) if isinstance(self.initial, str) else self.initial
        found = (
            shown_starts(own.model, log, self._start_theta, moved, follows, rule)
            for log, follows, rule in zip(self.logs, self._follows, rules, strict=True)
        )
        return Beginnings(tuple(found), tuple(kept))

    def start_shifts(self, log: MatchedLog, theta: FloatArray) -> FloatArray:
        """Shifts (n_x, n_y) of where a log begins by a unit more of each output, at parameters (n_theta,).

        None of them where states begin as declared.
        """
        model, moved = self.filter_model.model, [target for target, _ in self.numbers(self.start)]
        rule = start_rule(self.initial)
        if not rule.measured:
            return np.zeros((len(model.states), len(model.outputs)))
        follows = led(model, log, theta, self.filter_model.follows if rule.led else {})
        return start_shifts(model, log, theta, moved, follows)

    def known_values(self, values: FloatArray) -> Mapping[str, FloatArray]:
        """Free and tied quantities by name, each (members,), at values of the free ones (n, members)."""
        known: dict[str, FloatArray] = dict(zip(self.names, values, strict=True))
        fixed = self._fixed(values.shape[1:])
        return known | {tie.name: tie.values({**fixed, **known}) for tie in self.ties}

    def known_slopes(self, point: FloatArray) -> Mapping[str, FloatArray]:
        """Derivatives (n,) of free and tied quantities by the coordinates, by name, at a point (n,)."""
        values = self.values(point)
        own = dict(zip(self.names, np.diag(self.slopes(point)), strict=True))
        free = dict(zip(self.names, values, strict=True))
        known = {name: float(row) for name, row in {**self._fixed(()), **free}.items()}
        tied = {
            tie.name: sum((slope * own[name] for name, slope in tie.slopes(known).items() if name in own), self._still)
            for tie in self.ties
        }
        return own | tied

    @property
    def _still(self) -> FloatArray:
        return np.zeros(len(self.free))

    def _fixed(self, shape: tuple[int, ...]) -> dict[str, FloatArray]:
        """Parameters of the model that ties use and nothing frees."""
        model = self.filter_model.model
        used = {name for tie in self.ties for name in tie.variables} - set(self.names)
        theta = model.theta()
        return {name: np.full(shape, theta[model.index("parameter", name)]) for name in used}

    def numbers(self, points: FloatArray) -> list[tuple[Target, FloatArray]]:
        """What the problem moves, with values (*batch,) at coordinates (n, *batch), the more specific ones last."""
        return self._by_target(self.known_values(self.values(points)))

    def _by_target(self, known: Mapping[str, FloatArray]) -> list[tuple[Target, FloatArray]]:
        found = [(one.target, known[one.name]) for one in self.free if not self.is_auxiliary(one)]
        found += [(parse_target(tie.name), known[tie.name]) for tie in self.ties]
        # Initial states of one log come after those shared by all, so that the more specific one counts.
        return sorted(found, key=lambda pair: pair[0].log is not None)

    def batch(self, points: FloatArray) -> Batch:
        """All numbers that the members at coordinates (n, members) need."""
        declared = Batch.declared(self.filter_model, self.initial_states, points.shape[1])
        return self.beginnings.of(declared.written(self.filter_model, self.logs, self.numbers(points)))

    def batch_slopes(self, point: FloatArray) -> Batch:
        """Derivatives of all numbers by the coordinates at a point (n,): a batch with a member per coordinate."""
        declared = Batch.declared(self.filter_model, self.initial_states, point.size)
        turned = declared.zeros().written(self.filter_model, self.logs, self._by_target(self.known_slopes(point)))
        if not self.beginnings.move:
            return turned
        return self.beginnings.slopes(self.batch(point[:, np.newaxis]), declared.initial_std, turned)

    def nll(self, points: FloatArray) -> FloatArray:
        """Negative log-likelihood plus priors at coordinates (n, members), shape (members,)."""
        values = self.likelihood.nll(self.filter_model, self.logs, self.batch(points))
        return values + self.prior_values(points)

    def nll_below(self, points: FloatArray, ceilings: FloatArray) -> Below:
        """Values as :meth:`nll` as far as they are below ceilings (members,); above, members may be given up."""
        if not isinstance(self.likelihood, CeilingLikelihood):
            return Below.whole(self.nll(points))
        priors = self.prior_values(points)
        found = self.likelihood.nll_below(self.filter_model, self.logs, self.batch(points), ceilings - priors)
        return replace(found, nll=found.nll + priors)

    def terms(self, points: FloatArray) -> Terms:
        """Scalar terms at coordinates (n, members): innovations by log, output and sample, then priors."""
        terms = self.likelihood.terms(self.filter_model, self.logs, self.batch(points))
        priors = self.prior_terms(points)
        return Terms(
            np.concatenate([terms.innovations, priors]),
            np.concatenate([terms.log_scales, np.zeros(priors.shape)]),
        )


def pose(
    filter_model: FilterModel,
    logs: GivenLog | Sequence[GivenLog],
    free: Sequence[str | FreeParameter],
    initial: Initial = "measured",
    likelihood: LikelihoodFunction | None = None,
    ties: Mapping[str, str] | Tie | Sequence[Tie] = (),
    priors: Prior | Sequence[Prior] = (),
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
    ties
        Quantities that follow from free parameters: name and expression, ``{"k_r": "1.2*k_f"}``.
    priors
        What is known of free and tied values from elsewhere, see :mod:`bondgraph.estimate.priors`.

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
    require_kind("pose", filter_model, FilterModel, "filter model")
    model = filter_model.model
    listed = with_inputs_before(model, all_matched(logs, model), model.theta(), initial)
    starts = initial_states(model, listed, model.theta(), initial)
    chosen = tuple(
        item
        if isinstance(item, FreeParameter)
        else declared_free(item, filter_model, _start(item, filter_model, listed, starts), listed)
        for item in free
    )
    return EstimationProblem(
        filter_model, listed, chosen, initial, likelihood or _FILTER, read_ties(ties), read_priors(priors)
    )


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


def check_logs(name: str, logs: Sequence[MatchedLog], free: Sequence[FreeParameter]) -> None:
    """Refuse a problem without logs or free parameters, and logs of one name.

    Raises
    ------
    EstimationError
        Always, if it is one of these.
    """
    if not logs or not free:
        missing = "log" if not logs else "free parameter"
        raise EstimationError(f"{name}: an estimation needs at least one {missing}")
    names = [log.name for log in logs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise EstimationError(f"two logs are called {twice!r} - rename one, so that results can tell them apart")


def _check_ties(problem: EstimationProblem) -> None:
    """Ties are about quantities of the model, follow from parameters, and contradict nothing."""
    known = {*problem.names, *problem.filter_model.model.names("parameter")}
    tied = [tie.name for tie in problem.ties]
    split = {one.target.name for one in problem.free if one.target.kind == "parameter" and one.target.log}
    for tie in problem.ties:
        require_known(parse_target(tie.name), tie.name, problem.filter_model)
        check_spoken_of(tie.name, parse_target(tie.name), problem.filter_model, problem.logs)
        if tie.name in problem.names or tied.count(tie.name) > 1:
            raise EstimationError(f"{tie.name!r} is free or tied besides its tie - choose one", where=(tie.name,))
        for name in tie.variables:
            if name in tied:
                raise EstimationError(
                    f"tie of {tie.name!r}: {name!r} is tied itself - put its expression in", where=(name,)
                )
            if name not in known or name in split:
                raise EstimationError(
                    f"tie of {tie.name!r}: there is no one parameter {name!r}{suggest(name, tuple(known))} - free "
                    "it, or give a FreeParameter of that name",
                    where=(tie.name, name),
                )
        if not set(tie.variables) & set(problem.names):
            raise EstimationError(f"tie of {tie.name!r}: none of its parameters is free - free one", where=(tie.name,))


def check_spoken_of(name: str, target: Target, filter_model: FilterModel, logs: Sequence[MatchedLog]) -> None:
    """Refuse what no log depends on.

    Raises
    ------
    EstimationError
        With what to do.
    """

    def require(condition: bool, problem: str) -> None:
        if not condition:
            raise EstimationError(f"free parameter {name!r}: {problem}", where=(name,))

    names = [log.name for log in logs]
    near = suggest(target.log or "", names)
    listed = f"no log is called {target.log!r}{near} - the logs are {', '.join(names)}"
    require(target.log in (None, *names), listed)
    if target.kind == "parameter":
        require(
            not all(target.name in log.theta_overrides for log in logs),
            "every log states its value, so there is nothing to estimate"
            " - drop it from the free parameters, or its column from a log",
        )
        require(
            target.name not in filter_model.appended,
            "the filter already follows it as a state - choose one of the two",
        )
        require(target.log is None or len(logs) == 1, "it is that of one log - pose_joint takes it, by per_log")
    if target.kind == "std":
        row = filter_model.model.index("output", target.name)
        measured = not all(np.isnan(log.y[row]).all() for log in logs)
        require(measured, f"no log measures {target.name!r} - drop it, or map its column")
