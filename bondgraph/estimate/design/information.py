"""Expected information of planned manoeuvres about the free parameters of a problem.

The Fisher information along a simulated manoeuvre is what a log of it tells on average, to first order in the noise.
With S the covariance of what is known before (priors or bounds, or logs at hand) and M the information, three numbers
rank manoeuvres: D, the nats by which a log is expected to narrow the parameters, log det(1 + S M)/2 (Lindley 1956;
Chaloner and Verdinelli 1995, Bayesian experimental design: a review, Statistical Science 10(3)); A, the mean share of
each parameter's variance that is left; E, the share of the standard deviation left along the direction that is told
worst. Without prior, D orders by log det M as Atkinson, Donev and Tobias (2007), Optimum Experimental Designs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bondgraph.errors import EstimationError, OptionError
from bondgraph.estimate.analysis.ranking import prior_std
from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.design.manoeuvres import Manoeuvre, planned_problem
from bondgraph.estimate.objective import Expand, FloatArray, fitted_expansion
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.frames import frame
from bondgraph.shown import Tabulated, own_axes
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table, number, text_table

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Parameters with more than this share of the worst direction are named.
_SHARE = 0.3


@dataclass(frozen=True)
class PlannedInformation:
    """What one manoeuvre would tell.

    Parameters
    ----------
    name, duration
        The manoeuvre, and its length in s.
    information
        Fisher information in the coordinates of the problem, shape (n, n), without what is known before.
    gain
        D: expected gain in nats over what is known before.
    mean_left
        A: mean share of the variance of each parameter that is left.
    worst_left, worst
        E: share of the standard deviation left along the worst direction, and the parameters in it.
    std_left
        Share of the standard deviation of each parameter that is left, shape (n,).
    log_det
        Logarithm of the determinant of the information, in units of what is known before; minus infinity where the
        manoeuvre alone does not tell all parameters.
    """

    name: str
    duration: float
    information: FloatArray
    gain: float
    mean_left: float
    worst_left: float
    worst: tuple[str, ...]
    std_left: FloatArray
    log_det: float

    @property
    def rate(self) -> float:
        """Expected nats per second."""
        return self.gain / self.duration


@dataclass(frozen=True, repr=False)
class DesignTable(Tabulated, Kept):
    """Manoeuvres by what they would tell, the most nats first; ``names`` are the free parameters."""

    names: tuple[str, ...]
    rows: tuple[PlannedInformation, ...]

    def __repr__(self) -> str:
        return f"<DesignTable of {len(self.rows)} manoeuvres; best: {self.rows[0].name}>"

    def table(self) -> Table:
        """Header, and a row for each manoeuvre."""
        header = ("manoeuvre", "s", "D [nats]", "nats/s", "A", "E", "told worst")
        rows = []
        for one in self.rows:
            numbers = (one.duration, one.gain, one.rate, one.mean_left, one.worst_left)
            rows.append([one.name, *map(number, numbers), "+".join(one.worst)])
        return header, rows

    def advice(self) -> tuple[str, ...]:
        """The best manoeuvre by each criterion, in sentences."""
        best = {
            "tells most": max(self.rows, key=lambda one: one.gain),
            "tells most per second": max(self.rows, key=lambda one: one.rate),
            "leaves least on average": min(self.rows, key=lambda one: one.mean_left),
            "leaves least of the worst": min(self.rows, key=lambda one: one.worst_left),
        }
        return tuple(f"{what}: {one.name}" for what, one in best.items())

    def summary(self) -> str:
        """A line for each manoeuvre, and which is the best by each criterion."""
        return "\n".join([text_table(*self.table()), *self.advice()])

    def to_dataframe(self) -> pandas.DataFrame:
        """The table as a data frame, with a column ``left_NAME`` for each parameter.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        columns: dict[str, Any] = {
            name: [getattr(one, name) for one in self.rows]
            for name in ("duration", "gain", "rate", "mean_left", "worst_left", "log_det")
        }
        columns |= {f"left_{name}": [float(one.std_left[k]) for one in self.rows] for k, name in enumerate(self.names)}
        return frame(columns, [one.name for one in self.rows], "manoeuvre")

    def to_dict(self) -> dict[str, Any]:
        """The table as JSON holds it."""
        rows = [
            {
                "manoeuvre": one.name, "duration": one.duration, "gain": one.gain, "rate": one.rate,
                "mean_left": one.mean_left, "worst_left": one.worst_left, "worst": list(one.worst),
                "log_det": one.log_det if math.isfinite(one.log_det) else None,
                "std_left": dict(zip(self.names, map(float, one.std_left), strict=True)),
            }
            for one in self.rows
        ]  # fmt: skip
        return {"manoeuvres": rows}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Share of the standard deviation left of every parameter, by manoeuvre, as a map of shades."""
        axes = own_axes(ax, 2.4 + 0.55 * len(self.names), 1.4 + 0.32 * len(self.rows))
        left = np.array([one.std_left for one in self.rows])
        axes.imshow(left, vmin=0.0, vmax=1.0, cmap="Blues_r", aspect="auto")
        for (k, j), share in np.ndenumerate(left):
            axes.text(j, k, _percent(float(share)), ha="center", va="center", fontsize="small", color=_on(float(share)))
        axes.set_xticks(range(len(self.names)), self.names, rotation=45, ha="right")
        axes.set_yticks(range(len(self.rows)), [f"{one.name}: {one.gain:.3g} nats" for one in self.rows])
        axes.grid(False)
        axes.set_xlabel("standard deviation left")
        return axes


def _percent(share: float) -> str:
    """A share in percent, small ones with two digits.

    Examples
    --------
    >>> [_percent(share) for share in (1.0, 0.347, 0.026, 0.00017)]
    ['100 %', '35 %', '2.6 %', '0.017 %']
    """
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"


def _on(share: float) -> str:
    """Colour of a text that is read on a shade."""
    return "white" if share < 0.5 else "black"


def rank_manoeuvres(
    problem: EstimationProblem,
    manoeuvres: Sequence[Manoeuvre],
    point: FloatArray | None = None,
    known: FloatArray | None = None,
    jacobian: Expand = derivatives,
) -> DesignTable:
    """Expected information of planned manoeuvres about the free parameters of a problem.

    Parameters
    ----------
    problem
        Filter model and free parameters with their bounds or priors; its logs count for nothing.
    manoeuvres
        What might be driven.
    point
        Where parameters are expected, shape (n,); None: where searches start.
    known
        Information of logs at hand in the coordinates of the problem, shape (n, n); None: none.
    jacobian
        Gives the information; by default exact derivatives where they repay.

    Raises
    ------
    OptionError
        If there is no manoeuvre.
    EstimationError
        If the model diverges in one.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {}, {"deflection": 0.05}, {"angle": 0.01, "rate": 0.01}, 2)
    >>> time = np.arange(60) * 0.05
    >>> log = bg.MatchedLog("any", time, np.zeros((1, 60)), np.zeros((1, 60)))
    >>> problem = bg.pose(swing, log, ["length", "damping"], initial="model")
    >>> plans = [Manoeuvre(f"from {angle}", time, np.zeros((1, 60)), {"angle": angle}) for angle in (0.1, 1.0)]
    >>> [row.name for row in rank_manoeuvres(problem, plans).rows]
    ['from 1.0', 'from 0.1']
    """
    if not manoeuvres:
        raise OptionError("design: no manoeuvre is planned - give scenarios or logs of inputs")
    where = problem.start if point is None else np.asarray(point, dtype=np.float64)
    kept = np.array([one.target.log is None for one in problem.free])
    names = tuple(name for name, keep in zip(problem.names, kept, strict=True) if keep)
    widths = prior_std(problem, where)[kept]
    before = np.eye(widths.size)
    if known is not None:
        before = before + known[np.ix_(kept, kept)] * np.outer(widths, widths)
    rows = []
    for one in manoeuvres:
        information = expected_information(problem, one, where, jacobian)
        rows.append(_planned(one, information, widths, before, names))
    return DesignTable(names, tuple(sorted(rows, key=lambda row: -row.gain)))


def expected_information(
    problem: EstimationProblem, manoeuvre: Manoeuvre, point: FloatArray, jacobian: Expand = derivatives
) -> FloatArray:
    """Fisher information of a planned manoeuvre in the coordinates of a problem, shape (n, n), without priors.

    Initial states of single logs have none and are left out.

    Raises
    ------
    EstimationError
        If the model diverges in the manoeuvre.
    """
    kept = [k for k, one in enumerate(problem.free) if one.target.log is None]
    where = np.asarray(point, dtype=np.float64)
    planned = planned_problem(problem, manoeuvre, where)
    terms = fitted_expansion(planned, where[kept], jacobian).terms
    if terms is None or not (np.isfinite(terms.innovations).all() and np.isfinite(terms.log_scales).all()):
        raise EstimationError(
            f"{problem.filter_model.model.name}: the filter diverges in the manoeuvre {manoeuvre.name!r}"
            " - use more substeps, or plan a gentler one",
            where=(manoeuvre.name,),
        )
    own = planned.logs[0].y.size  # rows of priors come after those of the log
    slopes_s = terms.log_scales[:own, 1:]
    slopes_e = terms.innovations[:own, 1:] + terms.innovations[:own, :1] * slopes_s
    information: FloatArray = slopes_e.T @ slopes_e + 2.0 * slopes_s.T @ slopes_s
    return information


def _planned(
    manoeuvre: Manoeuvre, information: FloatArray, widths: FloatArray, before: FloatArray, names: tuple[str, ...]
) -> PlannedInformation:
    scaled = information * np.outer(widths, widths)
    # In coordinates in which what is known before is the unit matrix.
    half = np.linalg.inv(np.linalg.cholesky(before))
    values, vectors = np.linalg.eigh(half @ scaled @ half.T)
    values = np.maximum(values, 0.0)
    prior = np.linalg.inv(before)
    left = half.T @ (vectors / (1.0 + values)) @ vectors.T @ half
    shares = np.diag(left) / np.diag(prior)
    direction = np.abs(half.T @ vectors[:, 0]) / np.sqrt(np.diag(prior))
    sign, log_det = np.linalg.slogdet(scaled)
    return PlannedInformation(
        name=manoeuvre.name,
        duration=manoeuvre.duration,
        information=information,
        gain=0.5 * float(np.log1p(values).sum()),
        mean_left=float(shares.mean()),
        worst_left=float(1.0 / math.sqrt(1.0 + values[0])),
        worst=tuple(name for name, share in zip(names, direction, strict=True) if share > _SHARE * direction.max()),
        std_left=np.sqrt(shares),
        log_det=float(log_det) if sign > 0.0 else -math.inf,
    )
