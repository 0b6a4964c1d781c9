"""Profiles of an estimate in the units of its parameters, and likelihood ratios of given values.

Twice the difference of two log-likelihoods, of which one has m values held, follows a chi-square law with m degrees of
freedom. Reference: Wilks (1938), The large-sample distribution of the likelihood ratio for testing composite
hypotheses, Annals of Mathematical Statistics 9(1).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import gammaincc

from bondgraph.errors import EstimationError, require_kind, suggest
from bondgraph.estimate.checkpoint import problem_digest
from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.estimated import normal_interval
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.objective import FloatArray
from bondgraph.estimate.pinned import constrained_minimum
from bondgraph.estimate.profile import ProfileInterval, profile_curve, profile_interval
from bondgraph.estimate.quantities import quantity_of, unit_of
from bondgraph.estimate.result import Estimate
from bondgraph.execute.executors import open_executor
from bondgraph.execute.threads import in_threads
from bondgraph.frames import frame
from bondgraph.shown import own_axes
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table, number

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: A profile whose root is this much bent over its interval, as a share, has another interval than its covariance.
_BENT = 0.1
#: The first step of the profile of what the covariance does not know, as a share of the width of its bounds:
#: an end is looked for from there, and does not depend on it.
_FIRST_STEP = 0.25
#: A profile this far below its estimate, in nats, has found a better optimum: it lies a third of a standard deviation
#: away, sqrt(2 * 0.05), and what is nearer no interval shows.
_BETTER = 0.05

#: Called with the number of finished profiles and of all.
ProfileProgress = Callable[[int, int], None]


def _silent(_done: int, _total: int) -> None:
    """No words on progress."""


@dataclass(frozen=True, repr=False)
class LikelihoodProfile(Kept):
    """Profile of one parameter of an estimate, in the unit of the model.

    Parameters
    ----------
    name, unit, level
        The parameter, the unit in which it is shown, and the coverage of the interval.
    value, std
        The estimate and its standard deviation from the covariance; NaN where the data do not tell the parameter.
    interval
        Ends where twice the rise of the negative log-likelihood reaches the quantile, or bounds.
    values, deviance
        Curve, both (k,): twice the rise with all others at their best.
    bounded
        Whether each end is a bound that the likelihood did not forbid.
    shown
        Factor and offset of the unit in which it is shown.
    evaluations
        Evaluations that it took.
    parameter
        The free parameter: its bounds, and the scale on which it was searched.
    """

    name: str
    unit: str
    level: float
    value: float
    std: float
    interval: tuple[float, float]
    values: FloatArray
    deviance: FloatArray
    bounded: tuple[bool, bool]
    shown: tuple[float, float]
    evaluations: int
    parameter: FreeParameter

    def __repr__(self) -> str:
        lower, upper = (number(self.show(end)) for end in self.interval)
        return f"<LikelihoodProfile {self.name}: {self.level:.0%} between {lower} and {upper} {self.unit}>"

    def show(self, value: float) -> float:
        """A value in the unit in which the parameter is shown."""
        return self.shown[0] * value + self.shown[1]

    @property
    def reach(self) -> float:
        """Standard deviations from the estimate to each end of a normal interval of this level."""
        return NormalDist().inv_cdf(0.5 + 0.5 * self.level)

    @property
    def curvature(self) -> tuple[float, float]:
        """Interval by the covariance, normal on the scale that was searched, within the bounds: that of estimates."""
        return normal_interval(self.parameter, self.value, self.std, self.reach)

    @property
    def differs(self) -> tuple[bool, bool]:
        """True for each end that is no bound and lies elsewhere than the covariance says, by a tenth of its reach."""
        half = 0.5 * (self.curvature[1] - self.curvature[0])
        ends = zip(self.interval, self.curvature, strict=True)
        off = [bool(abs(one - other) > _BENT * half) for one, other in ends]
        return off[0] and not self.bounded[0], off[1] and not self.bounded[1]

    @property
    def better(self) -> float:
        """Nats by which the best point of the profile is better than the estimate; 0 where the estimate is best."""
        gain = -0.5 * float(np.nanmin(self.deviance))
        return gain if gain > _BETTER else 0.0

    @property
    def verdict(self) -> str:
        """What the profile says that the covariance does not: ``skewed``, ``open`` at a bound, or nothing."""
        return "open at a bound" if any(self.bounded) else "skewed" if any(self.differs) else ""

    def plot(self, ax: Axes | None = None) -> Axes:
        """The curve beside the parabola of the covariance, with the quantile and the interval."""
        axes = own_axes(ax)
        axes.plot([self.show(v) for v in self.values], self.deviance, "o-", markersize=3.5, label="profile")
        if math.isfinite(self.std):
            fine = np.linspace(self.values[0], self.values[-1], 101)
            axes.plot([self.show(v) for v in fine], self._parabola(fine), "--", color="0.5", label="covariance")
        quantile = self.reach**2
        axes.axhline(quantile, color="0.75", linewidth=0.8)
        axes.axvspan(self.show(self.interval[0]), self.show(self.interval[1]), alpha=0.12, linewidth=0.0)
        axes.set_ylim(0.0, max(2.2 * quantile, 1.05 * float(self.deviance.max())))
        axes.set_xlabel(f"{self.name} [{self.unit}]")
        axes.set_ylabel("twice the rise of the NLL")
        return axes

    def _parabola(self, values: FloatArray) -> FloatArray:
        """Twice the rise by the covariance at values (k,): a parabola on the scale that was searched."""
        std = self.std / self.parameter.slope(self.value)
        centre = self.parameter.coordinate(self.value)
        return np.array([((self.parameter.coordinate(float(v)) - centre) / std) ** 2 for v in values])


def profile_likelihood(
    estimate: Estimate,
    names: str | Sequence[str] = (),
    level: float = 0.95,
    executor: str | Executor | None = "serial",
    *,
    progress: ProfileProgress = _silent,
    journal: Journal | None = None,
) -> tuple[LikelihoodProfile, ...]:
    """Profiles of parameters of an estimate, by the exact gradient wherever a search by it repays.

    Parameters
    ----------
    estimate
        A finished estimate.
    names
        Free parameters, of which one that the data do not tell has an open profile; none: all that are identifiable.
    level
        Coverage of the intervals.
    executor
        Who computes ends and points, see :func:`bondgraph.execute.executors.open_executor`; it changes no number.
    progress
        Called with the number of finished profiles and of all, at first with 0.
    journal
        Where finished profiles are noted, and taken from if they were noted before; None notes nothing.

    Raises
    ------
    EstimationError
        If a name is not free, or the estimate has no finite likelihood.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(100) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> fit = bg.estimate(swing, log, ["length"], bg.Settings(method="gradient", starts=1))
    >>> (profile,) = profile_likelihood(fit, "length")
    >>> profile.interval[0] < fit.values["length"] < profile.interval[1]
    True
    """
    require_kind("profile", estimate, Estimate, "finished estimate")
    asked = (names,) if isinstance(names, str) else tuple(dict.fromkeys(names))
    chosen = asked or tuple(name for name, std in estimate.std.items() if np.isfinite(std))
    check_profiled(estimate, chosen)
    done: list[str] = []
    with open_executor(executor) as workers:
        work = _Work(estimate, level, workers, journal or Journal())

        def found(name: str) -> LikelihoodProfile:
            profile = work.profile(name)
            done.append(name)
            progress(len(done), len(chosen))
            return profile

        progress(0, len(chosen))
        # Each name waits in a thread of its own for what workers find.
        return tuple(in_threads(len(chosen) if workers else 1, found, chosen))


def check_profiled(estimate: Estimate, names: Sequence[str]) -> None:
    """Raise EstimationError if a name is not free in an estimate, or its likelihood is not finite."""
    free = estimate.problem.names
    for name in names:
        if name not in free:
            raise EstimationError(
                f"profile: {name!r} is not free in this estimate{suggest(name, free)} - free are {', '.join(free)}",
                where=(name,),
            )
    if not math.isfinite(estimate.nll):
        raise EstimationError(f"profile: the estimate has no likelihood - {estimate.end}", where=tuple(names))


@dataclass(frozen=True)
class _Work:
    """Estimate, journal and workers that its profiles share."""

    estimate: Estimate
    level: float
    workers: Executor | None
    journal: Journal = field(default_factory=Journal)

    def profile(self, name: str) -> LikelihoodProfile:
        """The profile of a free parameter, as it was noted if it was."""
        estimate, problem = self.estimate, self.estimate.problem
        point = estimate.point.tolist()
        key = problem_digest(problem, {"profile": name, "level": self.level, "point": point, "std": estimate.std[name]})
        entry = self.journal.entry(key)
        if entry is None:
            entry = self._entry(problem.names.index(name), name)
            self.journal.enter(key, entry)
        parameter = problem.free[problem.names.index(name)]
        show = quantity_of(problem, parameter).shown
        return LikelihoodProfile(
            name=name,
            unit=unit_of(problem, parameter),
            level=self.level,
            value=estimate.values[name],
            std=estimate.std[name],
            interval=(entry["interval"][0], entry["interval"][1]),
            values=np.array(entry["values"]),
            deviance=np.array(entry["deviance"]),
            bounded=(entry["bounded"][0], entry["bounded"][1]),
            shown=(show(1.0) - show(0.0), show(0.0)),
            evaluations=entry["evaluations"],
            parameter=parameter,
        )

    def _entry(self, index: int, name: str) -> dict[str, Any]:
        """Ends and curve of a profile in words of JSON."""
        problem, interval = self.estimate.problem, self._interval(index, name)
        parameter = problem.free[index]
        curve = profile_curve(problem, self.estimate.point, index, interval, derivatives, self.workers)
        return {
            "interval": parameter.values(np.array([interval.lower, interval.upper])).tolist(),
            "values": parameter.values(curve.coordinates).tolist(),
            "deviance": curve.deviance.tolist(),
            "bounded": [bool(interval.lower <= problem.lower[index]), bool(interval.upper >= problem.upper[index])],
            "evaluations": curve.evaluations,
        }

    def _interval(self, index: int, name: str) -> ProfileInterval:
        """Interval of a coordinate; one that the covariance does not know begins with a share of its bounds."""
        if math.isfinite(self.estimate.std[name]):
            return self.estimate.profile_interval(name, self.level, self.workers)
        problem = self.estimate.problem
        reach = NormalDist().inv_cdf(0.5 + 0.5 * self.level)
        step = _FIRST_STEP * float(problem.upper[index] - problem.lower[index]) / reach
        return profile_interval(
            problem, self.estimate.point, index, step, self.level, jacobian=derivatives, executor=self.workers
        )


def profile_table(profiles: Sequence[LikelihoodProfile]) -> Table:
    """Header, and a row for each profile: estimate, interval by the covariance and by the profile, what differs."""
    rows = []
    for one in profiles:
        value, lower, upper = (number(one.show(end)) for end in (one.value, *one.interval))
        curved = [number(one.show(end)) if math.isfinite(one.std) else "-" for end in one.curvature]
        rows.append([one.name, one.unit, value, *curved, lower, upper, one.verdict])
    header = ("parameter", "unit", "value", "covariance from", "to", "profile from", "to", "")
    return header, rows


def profile_frame(profiles: Sequence[LikelihoodProfile]) -> pandas.DataFrame:
    """The curves as a long data frame with the columns ``parameter``, ``value`` and ``deviance``, in declared units.

    Raises
    ------
    DataError
        If pandas is not installed.
    """
    names = [one.name for one in profiles for _ in one.values]
    values = [one.show(float(value)) for one in profiles for value in one.values]
    deviance = [float(value) for one in profiles for value in one.deviance]
    return frame({"parameter": names, "value": values, "deviance": deviance})


@dataclass(frozen=True)
class LikelihoodRatio:
    """Test of given values against an estimate: twice the rise in nats, its degrees of freedom and p-value.

    ``values`` by name are all free parameters at the best point with the given ones held.
    """

    statistic: float
    degrees: int
    p_value: float
    values: Mapping[str, float]
    evaluations: int


def likelihood_ratio(estimate: Estimate, given: Mapping[str, float]) -> LikelihoodRatio:
    """Likelihood ratio of given values of some parameters, with all other free ones estimated anew.

    Parameters
    ----------
    estimate
        A finished estimate.
    given
        Values by name, in the units of the model.

    Raises
    ------
    EstimationError
        If a name is not free, a value lies outside its bounds, or nothing is given.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(100) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> fit = bg.estimate(swing, log, ["length", "damping"], bg.Settings(method="gradient", starts=1))
    >>> likelihood_ratio(fit, {"length": 2.0}).p_value < 1e-6
    True
    """
    require_kind("likelihood ratio", estimate, Estimate, "finished estimate")
    problem = estimate.problem
    if not given:
        raise EstimationError("likelihood ratio: no values are given - give some by name")
    held = {}
    for name, value in given.items():
        if name not in problem.names:
            raise EstimationError(
                f"likelihood ratio: {name!r} is not free in this estimate{suggest(name, problem.names)}"
                f" - free are {', '.join(problem.names)}",
                where=(name,),
            )
        parameter = problem.free[problem.names.index(name)]
        if not parameter.lower <= value <= parameter.upper:
            raise EstimationError(
                f"likelihood ratio: {name} = {value:g} lies outside its bounds {parameter.lower:g} to"
                f" {parameter.upper:g} - give a value inside, or estimate with wider bounds",
                where=(name,),
            )
        held[problem.names.index(name)] = parameter.coordinate(value)
    found = constrained_minimum(problem, _shifted(estimate, held), held, derivatives)
    statistic = max(2.0 * (found.value - estimate.nll), 0.0)
    values = dict(zip(problem.names, map(float, problem.values(found.point)), strict=True))
    p_value = float(gammaincc(0.5 * len(held), 0.5 * statistic))
    return LikelihoodRatio(statistic, len(held), p_value, values, found.evaluations)


def _shifted(estimate: Estimate, held: Mapping[int, float]) -> FloatArray:
    """Where the others are expected by the covariance, given the held coordinates; shape (n,)."""
    rows = list(held)
    covariance = np.nan_to_num(estimate.coordinate_covariance)
    move = np.array([held[row] for row in rows]) - estimate.point[rows]
    gain = np.linalg.lstsq(covariance[np.ix_(rows, rows)], move)[0]
    shifted: FloatArray = np.clip(
        estimate.point + covariance[:, rows] @ gain, estimate.problem.lower, estimate.problem.upper
    )
    return shifted
