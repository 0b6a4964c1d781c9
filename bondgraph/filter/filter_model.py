"""What a filter assumes: the model, its noises, the initial uncertainty, and parameters it follows as states."""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.compile.rosenbrock import TABLEAUS
from bondgraph.errors import FilterError, suggest
from bondgraph.filter.decay_rule import MOST_INSIDE
from bondgraph.filter.follows import Follow
from bondgraph.filter.kernel_types import Robustness
from bondgraph.filter.plan import NoiseRule, StepPlan
from bondgraph.filter.robust import PLAIN, Robust
from bondgraph.filter.sigma_points import MerweScaled
from bondgraph.simulate.model import Model
from bondgraph.simulate.task import refuse_modes
from bondgraph.text import count, few

#: Integration methods; see :mod:`bondgraph.simulate.stiff` for the stiff ones.
METHODS = ("rk4", *TABLEAUS, "auto")

#: How process noise enters between two samples.
NOISE_SCHEMES = ("continuous", "sampled")

#: Correlations by pairs of names.
Correlations = Mapping[tuple[str, str], float]

_CORRELATIONS = ("process_correlation", "measurement_correlation", "initial_correlation")
#: Least and largest length of a step over that of the one before.
_GRADINGS = (0.1, 10.0)


@dataclass(frozen=True, repr=False)
class FilterModel:
    """A model with the uncertainties an unscented Kalman filter needs.

    The state of the filter is the state of the model followed by the ``appended`` parameters.

    Parameters
    ----------
    model
        The model.
    process_noise
        Standard deviation per sqrt(s) of the white noise that drives each state, in its unit. States not named have
        none.
    measurement_noise
        Standard deviation of each measured output, in coherent SI. Outputs not named are not used.
    initial_std
        Standard deviation of each initial state (and appended parameter); those not named are known exactly.
    substeps
        Integration steps between samples one median interval apart; longer intervals get proportionally more.
    method
        Integration method: ``"rk4"``, or for stiff models ``"ros2"``, ``"ros3p"`` or ``"rodas4"``; ``"auto"`` chooses
        between them by the rates of the model along the logs, see :func:`bondgraph.filter.choice.choose_method`.
    grading
        Length of each step between two samples over that of the one before, for the stiff methods; sigma points relax
        anew after each sample, which short first steps resolve. ``"rk4"`` takes equal steps.
    alpha, beta, kappa
        Spread of the sigma points, see :class:`bondgraph.filter.sigma_points.MerweScaled`.
    appended
        Parameters that drift and are followed as states, with the standard deviation per sqrt(s) of their random walk;
        zero for a constant that is learnt. Their start value is the one in ``theta``, its uncertainty stands in
        ``initial_std``. An estimation frees a drift as ``process(name)``.
    plan
        Steps of every interval of some logs in place of ``substeps`` and ``grading``, for the method it was made for,
        see :func:`bondgraph.filter.planning.plan_steps`.
    noise_scheme
        ``"continuous"``: process noise drives the states between samples, and the model carries it on, see
        :mod:`bondgraph.filter.noise_nodes`. ``"sampled"``: its variance over an interval dt is std^2 dt, added as a
        whole at the end, which is filterpy's scheme.
    noise_nodes, noise_reach
        Nodes of the continuous scheme inside an interval of median length, and the fastest rate that they follow times
        that interval, see :func:`bondgraph.filter.decay_rule.decay_rule`. Method ``"auto"`` chooses both.
    process_correlation, measurement_correlation, initial_correlation
        Correlations of the noises of two states, of two outputs, and of two initial states: ``{("a", "b"): 0.3}``.
        Pairs not named are independent.
    follows
        States that start where others stand, where a problem takes starts from measurements, see
        :class:`bondgraph.filter.follows.Follow`; names that the model does not have mean nothing.
    robust
        Loss of innovations where sensors have outliers, see :class:`bondgraph.filter.robust.Robust`; None: Gaussian.

    Raises
    ------
    FilterError
        If a name is unknown, a number is negative or not finite, no output is measured, the model has no state, or
        correlations contradict each other.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> bg.FilterModel(
    ...     pendulum(), process_noise={"rate": 0.1}, measurement_noise={"deflection": 0.02},
    ...     initial_std={"angle": 0.1, "rate": 0.1, "damping": 0.05}, appended={"damping": 0.0},
    ... ).state_names
    ('angle', 'rate', 'damping')
    """

    model: Model
    process_noise: Mapping[str, float]
    measurement_noise: Mapping[str, float]
    initial_std: Mapping[str, float]
    substeps: int = 1
    method: str = "rk4"
    grading: float = 1.0
    alpha: float = 0.1
    beta: float = 2.0
    kappa: float = 0.0
    appended: Mapping[str, float] = field(default_factory=dict)
    plan: StepPlan | None = None
    noise_scheme: str = "continuous"
    noise_nodes: int = 1
    noise_reach: float = 0.0
    process_correlation: Correlations = field(default_factory=dict)
    measurement_correlation: Correlations = field(default_factory=dict)
    initial_correlation: Correlations = field(default_factory=dict)
    follows: Mapping[str, Follow] = field(default_factory=dict)
    robust: Robust | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "model", self.model.model)  # a filter is run-time code and holds no graph
        for name in ("process_noise", "measurement_noise", "initial_std", "appended", *_CORRELATIONS):
            object.__setattr__(self, name, dict(getattr(self, name)))
        refuse_modes(self.model)
        if not self.state_names:
            raise FilterError(
                f"{self.model.name}: the model has no states, so there is nothing to filter or to estimate along a log"
                " - use evaluate or simulate, or declare a storage (an inertance, a compliance, an integral)",
                where=(self.model.name,),
            )
        self._check_names()
        self._check_values()
        self._check_correlations()
        MerweScaled(len(self.state_names), self.alpha, self.beta, self.kappa)  # raises for a bad spread

    def __repr__(self) -> str:
        appended = f", appended {few(tuple(self.appended))}" if self.appended else ""
        steps = f"{self.method} with {count(self.typical_substeps, 'step')}"
        robust = f", {self.robust.kind}" if self.robust else ""
        return (
            f"<FilterModel {self.model.name}: measured {few(tuple(self.measurement_noise))}{appended}, {steps}{robust}>"
        )

    @functools.cached_property
    def digest(self) -> str:
        """Digest of all that a filter run depends on, equal for equal filter models."""
        own = {one.name: getattr(self, one.name) for one in fields(self)}
        plain = [
            (name, _plain(value)) for name, value in own.items() if name not in ("model", "plan", "follows", "robust")
        ]
        starts = [(name, one.constant, one.slopes, one.rests) for name, one in self.follows.items()]
        content: tuple[object, ...] = (self.model.text, None if self.plan is None else self.plan.content, starts, plain)
        content += () if self.robust is None else ((self.robust.kind, self.robust.value),)
        return hashlib.sha256(repr(content).encode()).hexdigest()

    @functools.cached_property
    def state_names(self) -> tuple[str, ...]:
        """States of the model, then appended parameters."""
        return (*self.model.names("state"), *self.appended)

    @property
    def is_stiff(self) -> bool:
        """Whether the method is one for stiff models."""
        return self.method in TABLEAUS

    @property
    def typical_substeps(self) -> int:
        """Integration steps between samples, on average where they are planned."""
        planned = self.plan is not None and self.plan.method == self.method
        return max(1, round(self.plan.mean_substeps)) if planned and self.plan is not None else self.substeps

    @property
    def is_driven(self) -> bool:
        """Whether noise drives the model between samples: some state has a level, or an appended parameter walks."""
        return bool(self.process_noise) or any(std > 0.0 for std in self.appended.values())

    @property
    def noise_rule(self) -> NoiseRule:
        """Scheme, nodes and reach with which process noise enters; those of a model without any are all alike."""
        if self.noise_scheme == "sampled" or not self.is_driven:
            return ("sampled", 0, 0.0)
        return (self.noise_scheme, self.noise_nodes, self.noise_reach)

    def with_process(self, levels: Mapping[str, float]) -> FilterModel:
        """The same filter with other levels, per sqrt(s), of what drives states and appended parameters, by name."""
        walks = {name: level for name, level in levels.items() if name in self.appended}
        driven = {name: level for name, level in levels.items() if name not in walks}
        return replace(self, process_noise={**self.process_noise, **driven}, appended={**self.appended, **walks})

    @property
    def steps(self) -> tuple[int, float, StepPlan | None, int, float]:
        """All that decides where a log is cut: integration steps and nodes of process noise."""
        return self.substeps, self.grading, self.plan, self.noise_nodes, self.noise_reach

    def with_steps_of(self, other: FilterModel) -> FilterModel:
        """The same filter, its logs cut as another one's are; each keeps its method."""
        substeps, grading, plan, nodes, reach = other.steps
        return replace(self, substeps=substeps, grading=grading, plan=plan, noise_nodes=nodes, noise_reach=reach)

    def with_halved_steps(self) -> FilterModel:
        """The same filter with every integration step cut in two, and two more nodes of process noise.

        Lengths stay graded along the interval. Two nodes take more from an error than halved steps.
        """
        return replace(
            self, substeps=2 * self.substeps, grading=math.sqrt(self.grading),
            plan=None if self.plan is None else self.plan.halved(),
            noise_nodes=min(self.noise_nodes + 2 if self.noise_nodes else 1, MOST_INSIDE),
        )  # fmt: skip

    def with_doubled_steps(self) -> FilterModel | None:
        """The same filter with every two integration steps made one, and two nodes of process noise less.

        The inverse of :meth:`with_halved_steps`; None where there are no two, or where they would be too unequal.
        """
        low, high = _GRADINGS
        if self.substeps < 2 or self.plan is not None or not low <= self.grading**2 <= high:
            return None
        return replace(
            self, substeps=self.substeps // 2, grading=self.grading**2,
            noise_nodes=max(min(self.noise_nodes, 1), self.noise_nodes - 2),
        )  # fmt: skip

    @functools.cached_property
    def points(self) -> MerweScaled:
        """The sigma points of the filter's state."""
        return MerweScaled(len(self.state_names), self.alpha, self.beta, self.kappa)

    @property
    def robustness(self) -> Robustness:
        """The loss of innovations as kernels read it."""
        return self.robust.numbers if self.robust else PLAIN

    @functools.cached_property
    def appended_index(self) -> IntArray:
        """Positions of the appended parameters in theta, shape (n_appended,)."""
        return np.array([self.model.index("parameter", name) for name in self.appended], dtype=np.int64)

    @functools.cached_property
    def process_std(self) -> FloatArray:
        """Standard deviation per sqrt(s) of each state of the filter, shape (n,)."""
        known = {**self.process_noise, **self.appended}
        return np.array([known.get(name, 0.0) for name in self.state_names], dtype=np.float64)

    @functools.cached_property
    def process_correlations(self) -> FloatArray:
        """Correlation matrix of the noises that drive the states of the filter, shape (n, n)."""
        return correlation_matrix(self.state_names, self.process_correlation)

    @functools.cached_property
    def noise_correlations(self) -> FloatArray:
        """Correlation matrix of the noises of the outputs, shape (n_y, n_y)."""
        return correlation_matrix(self.model.names("output"), self.measurement_correlation)

    @functools.cached_property
    def start_correlations(self) -> FloatArray:
        """Correlation matrix of the states of the filter at the first sample, shape (n, n)."""
        return correlation_matrix(self.state_names, self.initial_correlation)

    @functools.cached_property
    def noise_std(self) -> FloatArray:
        """Standard deviation of each output, shape (n_y,); NaN for outputs that are not used."""
        return np.array([self.measurement_noise.get(name, np.nan) for name in self.model.names("output")])

    @functools.cached_property
    def start_std(self) -> FloatArray:
        """Standard deviation of each state of the filter at the first sample, shape (n,)."""
        return np.array([self.initial_std.get(name, 0.0) for name in self.state_names], dtype=np.float64)

    def start_mean(self, theta: FloatArray, x0: FloatArray) -> FloatArray:
        """Mean of the filter's state at the first sample, shape (n,)."""
        return np.concatenate([x0, theta[self.appended_index]])

    def _check_names(self) -> None:
        parameters, states = self.model.names("parameter"), self.model.names("state")
        self._require_known("appended", self.appended, parameters)
        self._require_known("process_noise", self.process_noise, states)
        self._require_known("measurement_noise", self.measurement_noise, self.model.names("output"))
        self._require_known("initial_std", self.initial_std, self.state_names)
        twice = [name for name in self.appended if name in states]
        if twice:
            raise FilterError(
                f"{self.model.name}: {twice[0]!r} is both a state and an appended parameter - rename one of them",
                where=(self.model.name, twice[0]),
            )
        if not self.measurement_noise:
            raise FilterError(
                f"{self.model.name}: no output is measured - give measurement_noise for at least one of"
                f" {', '.join(self.model.names('output'))}",
                where=(self.model.name, "measurement_noise"),
            )

    def _require_known(self, group: str, given: Mapping[str, float], known: Sequence[str]) -> None:
        for name in given:
            if name not in known:
                raise FilterError(
                    f"{self.model.name}: {group} names {name!r}{suggest(name, known)} - known here: {', '.join(known)}",
                    where=(self.model.name, group, name),
                )

    def _check_values(self) -> None:
        groups = (("process_noise", False), ("initial_std", False), ("appended", False), ("measurement_noise", True))
        for group, positive in groups:
            for name, value in getattr(self, group).items():
                if not math.isfinite(value) or value < 0 or (positive and value == 0):
                    raise FilterError(
                        f"{self.model.name}: {group} of {name!r} is {value!r}"
                        f" - give a finite standard deviation {'above zero' if positive else 'of zero or more'}",
                        where=(self.model.name, group, name),
                    )
        if self.noise_scheme not in NOISE_SCHEMES:
            raise FilterError(
                f"{self.model.name}: noise_scheme {self.noise_scheme!r} is not known - use {', '.join(NOISE_SCHEMES)}",
                where=(self.model.name, "noise_scheme"),
            )
        if not 0 <= self.noise_nodes <= MOST_INSIDE or not 0.0 <= self.noise_reach < math.inf:
            raise FilterError(
                f"{self.model.name}: noise_nodes={self.noise_nodes}, noise_reach={self.noise_reach!r}"
                f" - give a whole number from 0 to {MOST_INSIDE} and a finite number from 0",
                where=(self.model.name, "noise_nodes"),
            )
        if self.method not in METHODS:
            raise FilterError(
                f"{self.model.name}: filter method {self.method!r} is not known - use {', '.join(METHODS)}",
                where=(self.model.name, "method"),
            )
        if not _GRADINGS[0] <= self.grading <= _GRADINGS[1]:
            raise FilterError(
                f"{self.model.name}: grading={self.grading!r} - give a number from 0.1 to 10",
                where=(self.model.name, "grading"),
            )
        if self.substeps < 1:
            raise FilterError(
                f"{self.model.name}: substeps={self.substeps} - at least one step is needed between two samples",
                where=(self.model.name, "substeps"),
            )

    def _check_correlations(self) -> None:
        known = {
            "process_correlation": self.state_names,
            "measurement_correlation": tuple(self.measurement_noise),
            "initial_correlation": self.state_names,
        }
        for group, names in known.items():
            given: Correlations = getattr(self, group)
            for pair, value in given.items():
                self._require_known(group, dict.fromkeys(pair, 0.0), names)
                if len(set(pair)) != 2 or not -1.0 < value < 1.0:
                    raise FilterError(
                        f"{self.model.name}: {group} of {pair!r} is {value!r}"
                        " - name two different quantities and a number between -1 and 1",
                        where=(self.model.name, group, *pair),
                    )
            if given and self.robust and group == "measurement_correlation":
                raise FilterError(
                    f"{self.model.name}: {group} with robust={self.robust.kind!r} - outliers are judged channel by"
                    " channel, so sensors must be independent: leave one of both out",
                    where=(self.model.name, group, "robust"),
                )
            if given and np.linalg.eigvalsh(correlation_matrix(names, given))[0] <= 0.0:
                raise FilterError(
                    f"{self.model.name}: {group} {given} cannot hold together: the matrix of correlations has no"
                    " positive eigenvalues throughout - make some of them smaller",
                    where=(self.model.name, group),
                )


def _plain(value: Mapping[Any, float] | float | str) -> object:
    """Numbers by name as a list of pairs, all numbers as Python's own, so that equal ones are written alike."""
    if isinstance(value, Mapping):
        return [(name, float(one)) for name, one in value.items()]
    return value if isinstance(value, str) else float(value)


def correlation_matrix(names: Sequence[str], pairs: Correlations) -> FloatArray:
    """The symmetric matrix with ones on its diagonal, shape (n, n).

    Examples
    --------
    >>> correlation_matrix(("a", "b"), {("b", "a"): 0.5})
    array([[1. , 0.5],
           [0.5, 1. ]])
    """
    matrix = np.eye(len(names))
    for (first, second), value in pairs.items():
        i, j = names.index(first), names.index(second)
        matrix[i, j] = matrix[j, i] = value
    return matrix
