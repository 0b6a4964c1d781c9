"""What a filter assumes: the model, its noises, the initial uncertainty, and parameters it follows as states."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bondgraph.errors import FilterError, suggest
from bondgraph.filter.follows import Follow
from bondgraph.filter.plan import StepPlan
from bondgraph.filter.sigma_points import MerweScaled
from bondgraph.simulate.arrays import FloatArray, IntArray
from bondgraph.simulate.model import Model
from bondgraph.simulate.rosenbrock import TABLEAUS
from bondgraph.simulate.task import refuse_modes

#: Integration methods; see :mod:`bondgraph.simulate.stiff` for the stiff ones.
METHODS = ("rk4", *TABLEAUS, "auto")


@dataclass(frozen=True)
class FilterModel:
    """A model with the uncertainties an unscented Kalman filter needs.

    The state of the filter is the state of the model followed by the ``appended`` parameters.

    Parameters
    ----------
    model
        The model.
    process_noise
        Standard deviation per sqrt(s) of the noise that drives each state: over a time step dt its variance is
        std^2 dt, added once at the end of the step. States not named have none.
    measurement_noise
        Standard deviation of each measured output, in its unit. Outputs not named are not used.
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
        Parameters that are followed as states, with the standard deviation per sqrt(s) of their random walk; zero for a
        constant that is learnt. Their start value is the one in ``theta``, its uncertainty stands in ``initial_std``.
    plan
        Steps of every interval of some logs in place of ``substeps`` and ``grading``, for the method it was made for,
        see :func:`bondgraph.filter.planning.plan_steps`.
    follows
        States that start where others stand, where a problem takes starts from measurements, see
        :class:`bondgraph.filter.follows.Follow`; names that the model does not have mean nothing.

    Raises
    ------
    FilterError
        If a name is unknown, a number is negative or not finite, or no output is measured.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> FilterModel(
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
    follows: Mapping[str, Follow] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("process_noise", "measurement_noise", "initial_std", "appended"):
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
        MerweScaled(len(self.state_names), self.alpha, self.beta, self.kappa)  # raises for a bad spread

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

    def with_halved_steps(self) -> FilterModel:
        """The same filter with every integration step cut in two; the lengths stay graded along the interval."""
        plan = None if self.plan is None else self.plan.halved()
        return replace(self, substeps=2 * self.substeps, grading=math.sqrt(self.grading), plan=plan)

    @functools.cached_property
    def points(self) -> MerweScaled:
        """The sigma points of the filter's state."""
        return MerweScaled(len(self.state_names), self.alpha, self.beta, self.kappa)

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
        if self.method not in METHODS:
            raise FilterError(
                f"{self.model.name}: filter method {self.method!r} is not known - use {', '.join(METHODS)}",
                where=(self.model.name, "method"),
            )
        if not 0.1 <= self.grading <= 10.0:
            raise FilterError(
                f"{self.model.name}: grading={self.grading!r} - give a number from 0.1 to 10",
                where=(self.model.name, "grading"),
            )
        if self.substeps < 1:
            raise FilterError(
                f"{self.model.name}: substeps={self.substeps} - at least one step is needed between two samples",
                where=(self.model.name, "substeps"),
            )
