"""Which parameters to free with given logs, which to fix, and which to measure otherwise.

Parameters are compared in units of what is known of them before: the standard deviation of a prior, or of a uniform law
over the bounds. They are taken one after the other, always the one of which the logs tell most that the parameters
taken before do not tell as well; a parameter is freed while that halves what is not known of it. Of those that are left
the logs either feel nothing, so that any plausible value does, or they feel them and take them for others: then a value
must come from elsewhere. References: Yao et al. (2003), Modeling ethylene/butene copolymerization with multi-site
catalysts, Polymer Reaction Engineering 11(3), for the successive choice; Brun, Reichert and Künsch (2001), Practical
identifiability analysis of large environmental simulation models, Water Resources Research 37(4), for the scaling.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bondgraph.estimate.analysis.combinations import Combination, combinations
from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.objective import Expand, FloatArray, fitted_expansion
from bondgraph.estimate.sensitivities import Sensitivity, sensitivity_from
from bondgraph.frames import frame
from bondgraph.shown import Tabulated, own_axes
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table, known, text_table

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: A parameter is freed if the logs halve its standard deviation: information of at least 3 beside the 1 of the prior.
_TOLD = 3.0
#: What is left of an information after others took their share is rounding below this share of it.
_ROUNDING = 1e-10
#: Logs feel a parameter if its error of one standard deviation costs half a nat, which a test could see one time in
#: six: information of 1.
_FELT = 1.0

Advice = Literal["free", "fix", "measure"]
_COLOURS = {"free": "#1f5fa8", "fix": "#8b95a1", "measure": "#d9772b"}
_MEANING = {
    "free": "these logs tell them",
    "fix": "these logs do not feel them, any plausible value does",
    "measure": "these logs feel them, but take them for others",
}


@dataclass(frozen=True)
class RankedParameter:
    """One parameter in the order of a ranking, in the unit of the model.

    Parameters
    ----------
    name
        Free parameter.
    advice
        ``"free"``, ``"fix"`` or ``"measure"`` otherwise.
    influence
        Nats that an error of ``prior_std`` in this parameter alone costs, to second order.
    prior_std
        What is known before: of the prior, or of a uniform law over the bounds.
    std_alone, std_joint
        Standard deviation from the logs alone were all others known, and with all of them free (NaN: none).
    std_freed
        Standard deviation with only those freed that should be; NaN for others.
    partner
        The freed parameter that it would be taken for, and the correlation of their effects.
    """

    name: str
    advice: Advice
    influence: float
    prior_std: float
    std_alone: float
    std_joint: float
    std_freed: float
    partner: tuple[str, float] = ("", 0.0)


@dataclass(frozen=True, repr=False)
class Ranking(Tabulated, Kept):
    """Advice for every free parameter, most informative first, with the sensitivities behind it.

    ``combinations`` are groups of which the logs tell only products or sums.
    """

    parameters: tuple[RankedParameter, ...]
    combinations: tuple[Combination, ...]
    sensitivity: Sensitivity

    def __repr__(self) -> str:
        return f"<Ranking: {'; '.join(self.advice())}>"

    def named(self, advice: Advice) -> tuple[str, ...]:
        """Names of the parameters with an advice, in order."""
        return tuple(one.name for one in self.parameters if one.advice == advice)

    def advice(self) -> tuple[str, ...]:
        """The advice in sentences: what to free, to fix, to measure otherwise, and what acts only together."""
        verbs = {"free": "free", "measure": "measure otherwise", "fix": "fix"}
        lines = []
        for kind, verb in verbs.items():
            chosen = [one for one in self.parameters if one.advice == kind]
            named = ", ".join(self._with_partner(one) for one in chosen)
            lines += [f"{verb} {named}: {_MEANING[kind]}"] if chosen else []
        return (*lines, *map(str, self.combinations))

    def _with_partner(self, one: RankedParameter) -> str:
        return f"{one.name} (taken for {one.partner[0]}, {one.partner[1]:.3f})" if one.partner[0] else one.name

    def table(self) -> Table:
        """Header, and a row for each parameter with standard deviations in declared units."""
        header = ("parameter", "unit", "advice", "nats", "known before", "std alone", "std joint", "std if freed")
        rows = [
            [one.name, unit, one.advice, *map(known, (one.influence, *shown))]
            for one, (unit, shown) in zip(self.parameters, self._shown(), strict=True)
        ]
        return header, rows

    def summary(self) -> str:
        """A line for each parameter in declared units, and the advice."""
        return "\n".join([text_table(*self.table()), *self.advice()])

    def _shown(self) -> list[tuple[str, list[float]]]:
        """Unit and standard deviations as they are shown."""
        table, found = self.sensitivity, []
        for one in self.parameters:
            k = table.names.index(one.name)
            show = table.quantities[k].shown
            zero = show(0.0)
            values = (one.prior_std, one.std_alone, one.std_joint, one.std_freed)
            found.append((table.units[k], [abs(show(value) - zero) for value in values]))
        return found

    def to_dataframe(self) -> pandas.DataFrame:
        """The table as a data frame in declared units.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        shown = self._shown()
        names = ("prior_std", "std_alone", "std_joint", "std_freed")
        columns: dict[str, Any] = {
            "advice": [one.advice for one in self.parameters],
            "influence": [one.influence for one in self.parameters],
            "unit": [unit for unit, _ in shown],
        }
        columns |= {name: [values[k] for _, values in shown] for k, name in enumerate(names)}
        return frame(columns, [one.name for one in self.parameters], "parameter")

    def to_dict(self) -> dict[str, Any]:
        """Ranking, combinations and sensitivities as JSON holds them, in declared units."""
        rows = {
            one.name: {
                "advice": one.advice, "influence": _json(one.influence), "unit": unit,
                **dict(zip(("prior_std", "std_alone", "std_joint", "std_freed"), map(_json, shown), strict=True)),
                "taken_for": one.partner[0] or None, "alike": one.partner[1],
            }
            for one, (unit, shown) in zip(self.parameters, self._shown(), strict=True)
        }  # fmt: skip
        together = [
            {"names": list(one.names), "known": list(one.known), "law": one.law, "condition": _json(one.condition)}
            for one in self.combinations
        ]
        words = {"advice": list(self.advice())}
        return {"ranking": rows, "combinations": together, **words, **self.sensitivity.to_dict()}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Standard deviation of every parameter over what is known of it before: alone, and with all of them free."""
        axes = own_axes(ax, 6.4, 0.9 + 0.3 * len(self.parameters))
        for k, one in enumerate(reversed(self.parameters)):
            alone, joint = one.std_alone / one.prior_std, one.std_joint / one.prior_std
            colour = _COLOURS[one.advice]
            ends = [min(alone, 1e3), min(joint, 1e3) if math.isfinite(joint) else 1e3]
            axes.plot(ends, [k, k], color=colour, linewidth=1.5)
            axes.plot(
                ends[0], k, "o", color=colour, markerfacecolor="white", label="all others known" if k == 0 else None
            )
            marker = "o" if math.isfinite(joint) else ">"
            axes.plot(ends[1], k, marker, color=colour, label="all free" if k == 0 else None)
        axes.axvline(1.0, color="0.5", linewidth=0.8)
        axes.set_xscale("log")
        axes.set_yticks(range(len(self.parameters)), [f"{one.name}: {one.advice}" for one in reversed(self.parameters)])
        axes.set_xlabel("standard deviation from the logs over what is known before")
        axes.legend(loc="best", fontsize="small")
        return axes


def _json(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def rank_parameters(problem: Problem, point: FloatArray | None = None, jacobian: Expand = derivatives) -> Ranking:
    """Which of the free parameters of a problem its logs can tell, before anything is estimated.

    Parameters
    ----------
    problem
        Free parameters with their bounds or priors, and logs.
    point
        Coordinates, shape (n,); None: where searches start.
    jacobian
        Gives the information; by default exact derivatives where they repay.

    Raises
    ------
    EstimationError
        If the model diverges there.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(100) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> print(*rank_parameters(bg.pose(swing, log, ["length", "damping"])).advice())
    free length, damping: these logs tell them
    """
    where = problem.start if point is None else np.asarray(point, dtype=np.float64)
    expansion = fitted_expansion(problem, where, jacobian)
    table = sensitivity_from(problem, where, expansion)
    widths = prior_std(problem, where)
    slopes = np.array([one.slope(value) for one, value in zip(problem.free, problem.values(where), strict=True)])
    scaled = _from_logs(problem, where, expansion.information) * np.outer(widths, widths)
    chosen, order = _successive(scaled)
    with np.errstate(divide="ignore", invalid="ignore"):
        alone = widths * slopes / np.sqrt(np.diag(scaled))
    freed = np.full(widths.size, np.nan)
    if chosen:
        spread = np.linalg.inv(scaled[np.ix_(chosen, chosen)])
        freed[chosen] = (widths * slopes)[chosen] * np.sqrt(np.diag(spread))
    rows = []
    for k in order:
        advice: Advice = "free" if k in chosen else "fix" if scaled[k, k] < _FELT else "measure"
        partner = _partner(problem.names, scaled, chosen, k) if advice == "measure" else ("", 0.0)
        own = (float(0.5 * scaled[k, k]), float(widths[k] * slopes[k]), float(alone[k]))
        joint = (float(table.std_joint[k]), float(freed[k]))
        rows.append(RankedParameter(problem.names[k], advice, *own, *joint, partner))
    return Ranking(tuple(rows), combinations(problem, where, expansion.information), table)


def prior_std(problem: Problem, point: FloatArray) -> FloatArray:
    """What is known of each coordinate before, shape (n,): prior, or a uniform law over the bounds."""
    uniform = (problem.upper - problem.lower) / math.sqrt(12.0)
    values = problem.values(point)
    known = [
        width if one.prior_std is None else min(one.prior_std / one.slope(float(value)), width)
        for one, width, value in zip(problem.free, uniform, values, strict=True)
    ]
    return np.array(known)


def _from_logs(problem: Problem, point: FloatArray, information: FloatArray) -> FloatArray:
    """Information without that of the priors, shape (n, n)."""
    values = problem.values(point)
    priors = [
        0.0 if one.prior_std is None else (one.slope(float(value)) / one.prior_std) ** 2
        for one, value in zip(problem.free, values, strict=True)
    ]
    return information - np.diag(priors)


def _successive(scaled: FloatArray) -> tuple[list[int], list[int]]:
    """Coordinates that should be free, in order of choice, and all of them in the order of the ranking."""
    chosen: list[int] = []
    left = list(range(scaled.shape[0]))
    remaining = scaled.copy()
    while left:
        best = max(left, key=lambda k: remaining[k, k])
        if not remaining[best, best] > max(_TOLD, _ROUNDING * scaled[best, best]):
            break
        chosen.append(best)
        left.remove(best)
        column = remaining[:, best].copy()
        remaining -= np.outer(column, column) / column[best]
    return chosen, [*chosen, *sorted(left, key=lambda k: -scaled[k, k])]


def _partner(names: tuple[str, ...], scaled: FloatArray, chosen: list[int], k: int) -> tuple[str, float]:
    """The chosen parameter whose effect is most like that of another one, and the correlation of both."""
    if not chosen:
        return "", 0.0
    alike = {j: float(scaled[k, j] / math.sqrt(scaled[k, k] * scaled[j, j])) for j in chosen}
    best = max(alike, key=lambda j: abs(alike[j]))
    return names[best], alike[best]
