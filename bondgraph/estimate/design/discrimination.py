"""Which manoeuvre would tell rival models apart soonest.

If one of several models is true, a log of a manoeuvre raises its likelihood over that of another by the distance of
both courses in units of the noise, with the other's parameters at their best: the criterion of T-optimality. Expected
is the Kullback-Leibler divergence of every innovation given those before it,

    log(s_j/s_i) + (s_i^2/s_j^2 + z_j^2 - 1)/2,

where z_j are the innovations of the rival on what the true model would show without noise, s_i and s_j the standard
deviations that both expect. A manoeuvre is as good as for the pair that it tells apart worst. The time to a decision is
that of Wald's test at a margin of log((1 - error)/error) nats. References: Atkinson and Fedorov (1975), The design of
experiments for discriminating between two rival models, Biometrika 62(1), and Optimal design: experiments for
discriminating between several models, Biometrika 62(2); Wald (1945), Sequential tests of statistical hypotheses;
Strouwen and Micluta-Câmpeanu (2026), Experimental design for missing physics.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bondgraph.errors import EstimationError, OptionError
from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.design.manoeuvres import Manoeuvre, planned_problem
from bondgraph.estimate.estimated import estimated_filter
from bondgraph.estimate.objective import BoolArray, Expand, Expansion, FloatArray, Objective, Terms, expansion_of
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.reduced import reduced
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings, gauss_newton
from bondgraph.estimate.symmetric import scaled_eigen
from bondgraph.frames import frame
from bondgraph.shown import Tabulated, own_axes
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table, number, text_table

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: An expected ratio of fewer nats in a whole manoeuvre is none.
_NOTHING = 1e-2
#: Chance of a wrong decision between two rivals.
ERROR = 0.01
#: The rival's best is wanted to a hundredth of a nat.
_SETTINGS = GaussNewtonSettings(tolerance=1e-2, iterations=30, patience=3, least_gain=1e-2)


@dataclass(frozen=True)
class Rival:
    """A model that may be the true one: a problem with what is free in it, and its estimate (n,).

    ``known`` (n, n) is the information of logs at hand, which hold the parameters near the estimate; None lets them go
    anywhere inside their bounds.
    """

    name: str
    problem: EstimationProblem
    point: FloatArray
    known: FloatArray | None = None


@dataclass(frozen=True)
class Discrimination:
    """How well one manoeuvre tells rivals apart.

    Parameters
    ----------
    name, duration
        The manoeuvre, and its length in s.
    nats
        Expected log-likelihood ratio of each rival in its row, were it true, over that in its column, shape (m, m).
    seconds
        Time after which that is expected to reach the margin, shape (m, m); infinite where it is not reached.
    asked
        Pairs that count, shape (m, m).
    """

    name: str
    duration: float
    nats: FloatArray
    seconds: FloatArray
    asked: BoolArray

    @property
    def worst(self) -> tuple[int, int]:
        """The pair that is told apart worst: the true one and its rival."""
        i, j = np.unravel_index(int(np.argmin(np.where(self.asked, self.nats, np.inf))), self.nats.shape)
        return int(i), int(j)

    @property
    def rate(self) -> float:
        """Expected nats per second for that pair."""
        return float(self.nats[self.worst]) / self.duration

    @property
    def soonest(self) -> float:
        """Seconds until all pairs are told apart."""
        return float(self.seconds[self.asked].max())


@dataclass(frozen=True, repr=False)
class DiscriminationTable(Tabulated, Kept):
    """Manoeuvres by how soon they tell rivals apart, the best first, and the margin in nats."""

    rivals: tuple[str, ...]
    rows: tuple[Discrimination, ...]
    margin: float

    def __repr__(self) -> str:
        return f"<DiscriminationTable of {', '.join(self.rivals)}; best: {self.rows[0].name}>"

    def table(self) -> Table:
        """Header, and a row for each manoeuvre."""
        header = ("manoeuvre", "s", "nats", "nats/s", "decided after [s]", "told worst")
        rows = []
        for one in self.rows:
            decided = number(one.soonest) if math.isfinite(one.soonest) else "not"
            numbers = (one.duration, float(one.nats[one.worst]), one.rate)
            rows.append([one.name, *map(number, numbers), decided, self._pair(one)])
        return header, rows

    def summary(self) -> str:
        """A line for each manoeuvre, and the best one in words."""
        return f"{text_table(*self.table())}\n{self.advice}"

    def _pair(self, one: Discrimination) -> str:
        true, rival = one.worst
        return f"{self.rivals[true]} from {self.rivals[rival]}"

    @property
    def advice(self) -> str:
        """The manoeuvre to drive, in a sentence."""
        best = self.rows[0]
        if math.isfinite(best.soonest):
            return f"drive {best.name}: decided after {number(best.soonest)} s ({number(self.margin)} nats)"
        if best.rate * best.duration < _NOTHING:
            return "none of these manoeuvres tells the rivals apart"
        needed = number(self.margin / best.rate)
        return f"drive {best.name} again and again: decided after about {needed} s in all"

    def to_dataframe(self) -> pandas.DataFrame:
        """The table as a data frame with a row for each manoeuvre.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        columns: dict[str, Any] = {
            "duration": [one.duration for one in self.rows],
            "nats": [float(one.nats[one.worst]) for one in self.rows],
            "rate": [one.rate for one in self.rows],
            "seconds": [one.soonest for one in self.rows],
        }
        return frame(columns, [one.name for one in self.rows], "manoeuvre")

    def to_dict(self) -> dict[str, Any]:
        """The table as JSON holds it; a time that is never reached is null."""
        rows = [
            {
                "manoeuvre": one.name, "duration": one.duration, "rate": one.rate, "nats": one.nats.tolist(),
                "seconds": one.soonest if math.isfinite(one.soonest) else None,
            }
            for one in self.rows
        ]  # fmt: skip
        return {"rivals": list(self.rivals), "margin": self.margin, "manoeuvres": rows, "advice": self.advice}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Expected nats per second of every manoeuvre, for the pair that it tells apart worst."""
        axes = own_axes(ax, 6.4, 1.0 + 0.34 * len(self.rows))
        rows = self.rows[::-1]
        axes.barh(range(len(rows)), [one.rate for one in rows], 0.6)
        axes.set_yticks(range(len(rows)), [one.name for one in rows])
        axes.set_xlabel("expected log-likelihood ratio [nats/s]")
        return axes


def discriminate(
    rivals: Sequence[Rival], manoeuvres: Sequence[Manoeuvre], error: float = ERROR, jacobian: Expand = derivatives
) -> DiscriminationTable:
    """Manoeuvres by how soon they tell rival models apart.

    Parameters
    ----------
    rivals
        At least two. Outputs of the same name are compared.
    manoeuvres
        What might be driven, with the inputs of the rivals' models.
    error
        Chance of a wrong decision.
    jacobian
        Gives gradients for the search of the rivals' best parameters.

    Raises
    ------
    OptionError
        If there are fewer than two rivals, no manoeuvre, the error is not between 0 and a half, or no output is
        common.
    EstimationError
        If a model diverges in a manoeuvre.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {}, {"deflection": 0.05}, {}, 2)
    >>> time = np.arange(60) * 0.05
    >>> log = bg.MatchedLog("any", time, np.zeros((1, 60)), np.zeros((1, 60)))
    >>> damped, stiff = (bg.pose(swing, log, free, initial="model") for free in (["length", "damping"], ["length"]))
    >>> rivals = [Rival("damped", damped, np.array([1.0, 0.5])), Rival("declared", stiff, stiff.start)]
    >>> plans = [Manoeuvre(f"from {angle}", time, np.zeros((1, 60)), {"angle": angle}) for angle in (0.1, 1.0)]
    >>> [row.name for row in discriminate(rivals, plans).rows]
    ['from 1.0', 'from 0.1']
    """
    if len(rivals) < 2 or not manoeuvres:
        lacking = "a second rival" if len(rivals) < 2 else "a manoeuvre"
        raise OptionError(f"discrimination needs {lacking} - give at least two models and one manoeuvre")
    if not 0.0 < error < 0.5:
        raise OptionError(f"discrimination: an error of {error:g} - give a chance between 0 and 0.5", where=("error",))
    margin = math.log((1.0 - error) / error)
    found = [_discrimination(rivals, one, margin, jacobian) for one in manoeuvres]
    told = np.max([one.nats for one in found], axis=0) > _NOTHING
    asked = ~np.eye(len(rivals), dtype=np.bool_) & (told | ~told.T)
    rows = [replace(one, asked=asked) for one in found]
    rows.sort(key=lambda one: (one.soonest, -one.rate))
    return DiscriminationTable(tuple(one.name for one in rivals), tuple(rows), margin)


def _discrimination(rivals: Sequence[Rival], manoeuvre: Manoeuvre, margin: float, jacobian: Expand) -> Discrimination:
    size = len(rivals)
    nats, seconds = np.zeros((size, size)), np.zeros((size, size))
    for i, true in enumerate(rivals):
        own = _without_levels(planned_problem(true.problem, manoeuvre, true.point), true)
        for j, rival in enumerate(rivals):
            if i == j:
                continue
            course = _divergence(own, true, rival, manoeuvre, jacobian)
            nats[i, j] = course[-1]
            reached = np.flatnonzero(course >= margin)
            seconds[i, j] = manoeuvre.time[reached[0]] - manoeuvre.time[0] if reached.size else math.inf
    return Discrimination(manoeuvre.name, manoeuvre.duration, nats, seconds, ~np.eye(size, dtype=np.bool_))


@dataclass(frozen=True)
class _Shown:
    """What a rival's sensors would show: its problem on that log, the coordinates kept, and where they stand."""

    problem: EstimationProblem
    kept: tuple[int, ...]
    point: FloatArray


def _without_levels(planned: EstimationProblem, rival: Rival) -> _Shown:
    """The planned problem with noise levels fixed at their estimates: on a log without noise they would vanish."""
    held = estimated_filter(rival.problem, rival.point)
    moved = reduced(planned, lambda target: target.kind in ("parameter", "x0"), filter_model=held)
    plain = tuple(replace(one, prior_mean=None, prior_std=None) for one in moved.free)
    kept = [rival.problem.names.index(name) for name in moved.names]
    return _Shown(replace(moved, free=plain, priors=()), tuple(kept), rival.point[kept])


def _divergence(own: _Shown, true: Rival, rival: Rival, manoeuvre: Manoeuvre, jacobian: Expand) -> FloatArray:
    """Expected log-likelihood ratio up to every sample, shape (n,), the rival's parameters at their best for all."""
    theirs = _without_levels(planned_problem(rival.problem, manoeuvre, rival.point), rival)
    rows = _common(own.problem, theirs.problem)
    log = own.problem.logs[0]
    y = np.full(theirs.problem.logs[0].y.shape, np.nan)
    for mine, other in rows:
        y[other] = log.y[mine]
    # What is compared is what both measure.
    both = [mine for mine, _ in rows]
    seen = replace(log, y=np.where(np.isin(np.arange(len(log.y)), both)[:, np.newaxis], log.y, np.nan))
    here = replace(own.problem, logs=(seen,))
    there = replace(theirs.problem, logs=(replace(theirs.problem.logs[0], y=y),))
    best = _best(_held(there, theirs, rival.known), jacobian)
    scales_i = here.terms(own.point[:, np.newaxis]).log_scales[:, 0].reshape(log.y.shape)
    terms = there.terms(best[:, np.newaxis])
    shape = y.shape
    z, scales_j = terms.innovations[:, 0].reshape(shape), terms.log_scales[:, 0].reshape(shape)
    if not np.isfinite(z).all():
        raise EstimationError(
            f"{rival.name}: the filter diverges in the manoeuvre {manoeuvre.name!r} - use more substeps",
            where=(rival.name, manoeuvre.name),
        )
    total = np.zeros(log.time.size)
    for mine, other in rows:
        gap = scales_j[other] - scales_i[mine]
        measured = ~np.isnan(y[other])
        total += np.where(measured, gap + 0.5 * (np.exp(-2.0 * gap) + z[other] ** 2 - 1.0), 0.0)
    course: FloatArray = np.cumsum(total)
    return course


def _common(own: EstimationProblem, theirs: EstimationProblem) -> list[tuple[int, int]]:
    """Rows of outputs that both rivals measure, mine and theirs."""
    mine, other = (one.filter_model.model.names("output") for one in (own, theirs))
    noisy = (own.filter_model.measurement_noise, theirs.filter_model.measurement_noise)
    found = [(k, other.index(name)) for k, name in enumerate(mine) if name in other and all(name in n for n in noisy)]
    if not found:
        raise OptionError(
            f"discrimination: {own.filter_model.model.name} and {theirs.filter_model.model.name} measure no output of"
            " the same name - compare models of one machine",
            where=(own.filter_model.model.name, theirs.filter_model.model.name),
        )
    return found


@dataclass(frozen=True)
class _Held:
    """A rival's problem on what the true model would show, held near its estimate by what logs at hand know.

    ``root`` (k, n) times the distance from ``centre`` (n,) has unit variance.
    """

    problem: EstimationProblem
    centre: FloatArray
    root: FloatArray

    @property
    def lower(self) -> FloatArray:
        """Lower bounds, shape (n,)."""
        return self.problem.lower

    @property
    def upper(self) -> FloatArray:
        """Upper bounds, shape (n,)."""
        return self.problem.upper

    def known_terms(self, points: FloatArray) -> FloatArray:
        """Terms of what is known (k, members) at points (n, members)."""
        terms: FloatArray = self.root @ (points - self.centre[:, np.newaxis])
        return terms

    def terms(self, points: FloatArray) -> Terms:
        """Scalar terms at points (n, members), those of what is known last."""
        found, known = self.problem.terms(points), self.known_terms(points)
        return Terms(
            np.concatenate([found.innovations, known]), np.concatenate([found.log_scales, np.zeros(known.shape)])
        )

    def nll(self, points: FloatArray) -> FloatArray:
        """Values at points (n, members), but for their constant."""
        return self.terms(points).sums()


def _held(problem: EstimationProblem, shown: _Shown, known: FloatArray | None) -> _Held:
    """The rival's problem with the root of the information that logs at hand have of it."""
    size, kept = shown.point.size, list(shown.kept)
    if known is None or not size:
        return _Held(problem, shown.point, np.zeros((0, size)))
    eigen = scaled_eigen(known[np.ix_(kept, kept)])
    inverse = np.divide(1.0, eigen.scale, out=np.zeros_like(eigen.scale), where=eigen.scale > 0.0)
    root: FloatArray = np.sqrt(np.maximum(eigen.values, 0.0))[:, np.newaxis] * eigen.vectors.T * inverse
    return _Held(problem, shown.point, root)


def _best(held: _Held, jacobian: Expand) -> FloatArray:
    """Parameters (n,) with which the rival comes closest."""
    if not held.centre.size:
        return held.centre

    def expand(_: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
        expansions = jacobian(held.problem, points, steps)
        return tuple(_with_known(one, held, points[:, [m]]) for m, one in enumerate(expansions))

    state = gauss_newton(held, held.centre, _SETTINGS, jacobian=expand)
    best: FloatArray = state.points[:, state.best]
    return best


def _with_known(expansion: Expansion, held: _Held, point: FloatArray) -> Expansion:
    if expansion.terms is None or not len(held.root):
        return expansion
    rows = np.hstack([held.known_terms(point), held.root])
    innovations = np.vstack([expansion.terms.innovations, rows])
    log_scales = np.vstack([expansion.terms.log_scales, np.zeros(rows.shape)])
    return expansion_of(innovations, log_scales, expansion.evaluations)
