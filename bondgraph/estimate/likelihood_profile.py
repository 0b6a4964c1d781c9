"""Profiles of an estimate in the units of its parameters, and likelihood ratios of given values.

Twice the difference of two log-likelihoods, of which one has m values held, follows a chi-square law with m degrees of
freedom. Reference: Wilks (1938), The large-sample distribution of the likelihood ratio for testing composite
hypotheses, Annals of Mathematical Statistics 9(1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import gammaincc

from bondgraph.errors import EstimationError, suggest
from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.objective import FloatArray
from bondgraph.estimate.pinned import constrained_minimum
from bondgraph.estimate.profile import profile_curve
from bondgraph.estimate.quantities import quantity_of, unit_of
from bondgraph.estimate.result import Estimate
from bondgraph.execute.executors import open_executor
from bondgraph.execute.threads import in_threads
from bondgraph.frames import frame
from bondgraph.shown import own_axes
from bondgraph.text import Table, number

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: A profile whose root is this much bent over its interval, as a share, has another interval than its covariance.
_BENT = 0.1


@dataclass(frozen=True, repr=False)
class LikelihoodProfile:
    """Profile of one parameter of an estimate, in the unit of the model.

    Parameters
    ----------
    name, unit, level
        The parameter, the unit in which it is shown, and the coverage of the interval.
    value, std
        The estimate and its standard deviation from the covariance.
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

    def __repr__(self) -> str:
        lower, upper = (number(self.show(end)) for end in self.interval)
        return f"<LikelihoodProfile {self.name}: {self.level:.0%} between {lower} and {upper} {self.unit}>"

    def show(self, value: float) -> float:
        """A value in the unit in which the parameter is shown."""
        return self.shown[0] * value + self.shown[1]

    @property
    def verdict(self) -> str:
        """What the profile says that the covariance does not: ``skewed``, ``open`` at a bound, or nothing."""
        if any(self.bounded):
            return "open at a bound"
        reach = NormalDist().inv_cdf(0.5 + 0.5 * self.level) * self.std
        off = max(abs(self.interval[0] - self.value + reach), abs(self.interval[1] - self.value - reach))
        return "skewed" if off > _BENT * reach else ""

    def plot(self, ax: Axes | None = None) -> Axes:
        """The curve beside the parabola of the covariance, with the quantile and the interval."""
        axes = own_axes(ax)
        axes.plot([self.show(v) for v in self.values], self.deviance, "o-", markersize=3.5, label="profile")
        fine = np.linspace(self.values[0], self.values[-1], 101)
        parabola = ((fine - self.value) / self.std) ** 2
        axes.plot([self.show(v) for v in fine], parabola, "--", color="0.5", label="covariance")
        quantile = NormalDist().inv_cdf(0.5 + 0.5 * self.level) ** 2
        axes.axhline(quantile, color="0.75", linewidth=0.8)
        axes.axvspan(self.show(self.interval[0]), self.show(self.interval[1]), alpha=0.12, linewidth=0.0)
        axes.set_ylim(0.0, max(2.2 * quantile, 1.05 * float(self.deviance.max())))
        axes.set_xlabel(f"{self.name} [{self.unit}]")
        axes.set_ylabel("twice the rise of the NLL")
        return axes


def profile_likelihood(
    estimate: Estimate,
    names: str | Sequence[str] = (),
    level: float = 0.95,
    executor: str | Executor | None = "serial",
) -> tuple[LikelihoodProfile, ...]:
    """Profiles of parameters of an estimate, by the exact gradient wherever a search by it repays.

    Parameters
    ----------
    estimate
        A finished estimate.
    names
        Free parameters; none: all that are identifiable.
    level
        Coverage of the intervals.
    executor
        Who computes ends and points, see :func:`bondgraph.execute.executors.open_executor`; it changes no number.

    Raises
    ------
    EstimationError
        If a name is not free or not identifiable.

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
    asked = (names,) if isinstance(names, str) else tuple(names)
    chosen = asked or tuple(name for name, std in estimate.std.items() if np.isfinite(std))
    with open_executor(executor) as workers:
        # Each name waits in a thread of its own for what workers find.
        every = in_threads(len(chosen) if workers else 1, lambda name: _profile(estimate, name, level, workers), chosen)
    return tuple(every)


def _profile(estimate: Estimate, name: str, level: float, workers: Executor | None) -> LikelihoodProfile:
    problem, interval = estimate.problem, estimate.profile_interval(name, level, workers)
    index = problem.names.index(name)
    parameter = problem.free[index]
    curve = profile_curve(problem, estimate.point, index, interval, derivatives, workers)
    lower, upper = parameter.values(np.array([interval.lower, interval.upper]))
    show = quantity_of(problem, parameter).shown
    return LikelihoodProfile(
        name=name,
        unit=unit_of(problem, parameter),
        level=level,
        value=estimate.values[name],
        std=estimate.std[name],
        interval=(float(lower), float(upper)),
        values=parameter.values(curve.coordinates),
        deviance=curve.deviance,
        bounded=(bool(interval.lower <= problem.lower[index]), bool(interval.upper >= problem.upper[index])),
        shown=(show(1.0) - show(0.0), show(0.0)),
        evaluations=curve.evaluations,
    )


def profile_table(profiles: Sequence[LikelihoodProfile]) -> Table:
    """Header, and a row for each profile: estimate, interval by the covariance and by the profile, what differs."""
    rows = []
    for one in profiles:
        reach = NormalDist().inv_cdf(0.5 + 0.5 * one.level) * one.std
        ends = (one.value - reach, one.value + reach, *one.interval)
        rows.append([one.name, one.unit, *(number(one.show(v)) for v in (one.value, *ends)), one.verdict])
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
