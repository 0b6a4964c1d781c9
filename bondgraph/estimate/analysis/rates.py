"""Which rate of samples an estimation needs: standard deviations and cost of the same logs at several rates.

Of a log at a lower rate every k-th sample is left, with its noise as it is: nothing is averaged. So what is lost is
the information of samples, and what the inputs did between them. Information is that expected where the model is right:
measurements are replaced by what sensors would show without noise, so that no misfit of a start mixes in.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bondgraph.coherent import Displayed
from bondgraph.data.log import MatchedLog
from bondgraph.data.select import decimate
from bondgraph.errors import OptionError
from bondgraph.estimate.derivatives.exact import derivatives, filtering_work
from bondgraph.estimate.free_simulation import expected_problem
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.objective import BoolArray, Expand, FloatArray
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.sensitivities import sensitivity
from bondgraph.filter.choice import choose_method
from bondgraph.filter.decay_rule import MOST_INSIDE
from bondgraph.filter.filter_model import FilterModel
from bondgraph.frames import frame
from bondgraph.shown import Tabulated, own_axes
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table, number, text_table

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: A rate serves as well as the highest if no standard deviation is larger by more than this share.
_WORSE = 0.1


@dataclass(frozen=True)
class RateRow:
    """One rate: ``rate`` in 1/s, samples in all logs, standard deviations (n,) in the unit of the model, and cost.

    ``work`` counts integration steps of sigma points in one likelihood, ``cpu`` is its processor time in s.
    """

    rate: float
    samples: int
    std: FloatArray
    work: int
    cpu: float
    method: str


@dataclass(frozen=True, repr=False)
class RateTable(Tabulated, Kept):
    """Standard deviations with all parameters free, at several rates, the highest first.

    Parameters
    ----------
    names, units, quantities
        Free parameters and how they are shown.
    judged
        Which of them the verdict is about, shape (n,): parameters and initial states, not noise levels.
    rows
        One for each rate.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    quantities: tuple[Displayed, ...]
    judged: BoolArray
    rows: tuple[RateRow, ...]

    def __repr__(self) -> str:
        return f"<RateTable: {', '.join(number(row.rate) for row in self.rows)} 1/s; {self.verdict}>"

    @property
    def sufficient(self) -> float:
        """The lowest rate in 1/s at which no judged deviation is more than a tenth above that of the highest."""
        best, found = self.rows[0].std, self.rows[0].rate
        known = np.isfinite(best) & self.judged
        for row in self.rows[1:]:
            if not (row.std[known] <= (1.0 + _WORSE) * best[known]).all():
                break
            found = row.rate
        return found

    @property
    def verdict(self) -> str:
        """The answer in a sentence, with what the next lower rate would cost and save."""
        if len(self.rows) == 1:
            only = number(self.rows[0].rate)
            return f"{only} 1/s alone says nothing of what is enough - name a higher rate beside it, that of the logs"
        last = self.sufficient
        lower = next((row for row in self.rows if row.rate < last), None)
        enough = "is needed" if last == self.rows[0].rate else "is enough"
        if lower is None:
            return f"{number(last)} 1/s {enough}: no standard deviation grows by more than {_WORSE:.0%}"
        base = next(row for row in self.rows if row.rate == last)
        growth = (lower.std / base.std)[np.isfinite(base.std) & self.judged]
        told = growth.size > 0 and bool(np.isfinite(growth).all())
        lost = f"up to {growth.max():.2f} times the standard deviation" if told else "a parameter unknown"
        saved = f"{lower.work / base.work:.2f} times the work"
        return f"{number(last)} 1/s {enough}: {number(lower.rate)} 1/s leave {lost} for {saved}"

    def _shown(self, row: RateRow) -> list[float]:
        shows = [one.shown for one in self.quantities]
        return [abs(show(float(std)) - show(0.0)) for show, std in zip(shows, row.std, strict=True)]

    def table(self) -> Table:
        """Header, and a row for each rate: samples, cost, standard deviations in declared units."""
        header = ["rate [1/s]", "samples", "work", "CPU [s]"]
        header += [f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True)]
        rows = [
            [number(row.rate), str(row.samples), number(float(row.work)), number(row.cpu)]
            + [number(value) if math.isfinite(value) else "not told" for value in self._shown(row)]
            for row in self.rows
        ]
        return header, rows

    def summary(self) -> str:
        """A line for each rate, and the answer."""
        return f"{text_table(*self.table())}\n{self.verdict}"

    def to_dataframe(self) -> pandas.DataFrame:
        """The table as a data frame with a row for each rate.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        columns: dict[str, Any] = {
            "samples": [row.samples for row in self.rows],
            "work": [row.work for row in self.rows],
            "cpu": [row.cpu for row in self.rows],
        }
        shown = [self._shown(row) for row in self.rows]
        columns |= {f"std_{name}": [values[k] for values in shown] for k, name in enumerate(self.names)}
        return frame(columns, [row.rate for row in self.rows], "rate")

    def to_dict(self) -> dict[str, Any]:
        """The table as JSON holds it, in declared units."""
        rows = [
            {
                "rate": row.rate, "samples": row.samples, "work": row.work, "cpu": row.cpu, "method": row.method,
                "std": {name: _json(value) for name, value in zip(self.names, self._shown(row), strict=True)},
            }
            for row in self.rows
        ]  # fmt: skip
        return {"rates": rows, "verdict": self.verdict}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Standard deviations over those at the highest rate, and the cost of a likelihood, against the rate."""
        axes = own_axes(ax)
        rates = [row.rate for row in self.rows]
        for k, name in enumerate(self.names):
            if np.isfinite(self.rows[0].std[k]):
                axes.plot(rates, [row.std[k] / self.rows[0].std[k] for row in self.rows], "o-", label=name)
        axes.plot(rates, [row.work / self.rows[0].work for row in self.rows], "s--", color="0.5", label="cost")
        axes.set_xscale("log")
        axes.set_xticks(rates, [number(rate) for rate in rates])
        axes.minorticks_off()
        axes.set_xlabel("rate [1/s]")
        axes.set_ylabel("over that at the highest rate")
        axes.legend(loc="best", fontsize="small")
        return axes


def _json(value: float) -> float | None:
    return value if math.isfinite(value) else None


def rate_table(
    problem: Problem,
    rates: Sequence[float],
    point: FloatArray | None = None,
    jacobian: Expand = derivatives,
) -> RateTable:
    """Standard deviations of the free parameters, and cost, of the logs of a problem at several rates.

    Parameters
    ----------
    problem
        Free parameters and logs, at the rate at which they were recorded.
    rates
        Samples per second to look at; those above the rate of the logs change nothing.
    point
        Coordinates that are taken as true, shape (n,); None: where searches start.
    jacobian
        Gives the information.

    Raises
    ------
    OptionError
        If no rate is given, or one leaves a log with fewer than two samples.
    EstimationError
        If the model diverges at a rate.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(100) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> table = rate_table(bg.pose(swing, log, ["length"]), [20.0, 5.0])
    >>> [row.samples for row in table.rows], bool(table.rows[1].std[0] > table.rows[0].std[0])
    ([100, 25], True)
    """
    if not rates:
        raise OptionError("rates: none are given - give samples per second, such as 40,20,10,5", where=("rates",))
    where = problem.start if point is None else np.asarray(point, dtype=np.float64)
    rows, table = [], None
    for rate in sorted(rates, reverse=True):
        pairs = zip(problem.parts, problem.rows, strict=True)
        slower = problem.with_parts([expected_problem(at_rate(part, rate), where[places]) for part, places in pairs])
        table = sensitivity(slower, where, jacobian)
        used = [choose_method(part.filter_model, part.logs) for part in slower.parts]
        decided = slower.with_filters(used)
        decided.nll(where[:, np.newaxis])  # what is compiled once is no cost of a rate
        began = time.process_time()
        decided.nll(where[:, np.newaxis])
        spent = time.process_time() - began
        samples = sum(len(log) for log in slower.logs)
        rows.append(RateRow(rate, samples, table.std_joint, filtering_work(decided), spent, _methods(used)))
    assert table is not None  # there is at least one rate
    judged = np.array([one.target.kind in ("parameter", "x0") for one in problem.free], dtype=np.bool_)
    return RateTable(table.names, table.units, table.quantities, judged, tuple(rows))


def _methods(used: Sequence[FilterModel]) -> str:
    """The methods of filters, each once."""
    return ", ".join(dict.fromkeys(str(one.method) for one in used))


def at_rate(problem: EstimationProblem, rate: float) -> EstimationProblem:
    """The problem with its logs at a lower rate, and with integration steps of the same length as before.

    Raises
    ------
    OptionError
        If a log is left with fewer than two samples.
    """
    logs = tuple(decimate(log, rate) for log in problem.logs)
    for log in logs:
        if len(log) < 2:
            raise OptionError(
                f"rates: {rate:g} samples per second leave {len(log)} of log {log.name} - give a higher rate",
                where=(log.name, f"{rate:g}"),
            )
    starts = tuple(
        dict(zip(problem.filter_model.model.names("state"), map(float, x0), strict=True))
        for x0 in problem.initial_states
    )
    longer = _interval(logs) / _interval(problem.logs)
    declared = problem.filter_model
    stretched = replace(
        declared, substeps=max(1, math.ceil(declared.substeps * longer - 1e-6)), plan=None,
        noise_nodes=min(math.ceil(declared.noise_nodes * longer - 1e-6), MOST_INSIDE),
        noise_reach=declared.noise_reach * longer,
    )  # fmt: skip
    return replace(problem, logs=logs, filter_model=stretched, initial=starts)


def _interval(logs: Sequence[MatchedLog]) -> float:
    """Median interval between samples in s."""
    return float(np.median(np.concatenate([np.diff(log.time) for log in logs])))
