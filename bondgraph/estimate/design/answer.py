"""The answer of a design: what manoeuvres tell of the parameters of a machine, and which tells its rivals apart."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.design.discrimination import DiscriminationTable, Rival
from bondgraph.estimate.design.information import DesignTable
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.objective import FloatArray, fitted_expansion
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.shown import Tabulated
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


@dataclass(frozen=True, repr=False)
class Design(Tabulated, Kept):
    """Information of planned manoeuvres about the parameters of a model, and about its rivals if there are any."""

    model: str
    information: DesignTable
    discrimination: DiscriminationTable | None = None

    def __repr__(self) -> str:
        rivals = f", {len(self.discrimination.rivals)} rivals" if self.discrimination else ""
        first = self.discrimination or self.information
        return f"<Design of {self.model}: {len(self.information.rows)} manoeuvres{rivals}; best: {first.rows[0].name}>"

    @property
    def advice(self) -> tuple[str, ...]:
        """Advice on what to drive, in sentences."""
        rivals = (self.discrimination.advice,) if self.discrimination else ()
        return (*rivals, *self.information.advice())

    def table(self) -> Table:
        """Header, and a row for each manoeuvre: with rivals how soon it tells them apart, else what it tells."""
        return (self.discrimination or self.information).table()

    def summary(self) -> str:
        """All tables as a terminal shows them."""
        parts = [self.information.summary()]
        parts += [self.discrimination.summary()] if self.discrimination else []
        return "\n\n".join(parts)

    def to_dataframe(self) -> pandas.DataFrame:
        """A row for each manoeuvre, those that tell most of the parameters first.

        Columns are those of ``information``; with rivals also ``apart_nats``, ``apart_rate`` and ``apart_seconds``: of
        the pair that is told apart worst, and the time until all are.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        found = self.information.to_dataframe()
        if self.discrimination:
            apart = self.discrimination.to_dataframe()[["nats", "rate", "seconds"]]
            found = found.join(apart.add_prefix("apart_"))
        return found

    def to_dict(self) -> dict[str, Any]:
        """All numbers as JSON holds them."""
        found: dict[str, Any] = {"information": self.information.to_dict()}
        return found | ({"discrimination": self.discrimination.to_dict()} if self.discrimination else {})

    def plot(self, ax: Axes | None = None) -> Axes:
        """With rivals how fast each manoeuvre tells them apart, else what it leaves of every standard deviation."""
        return (self.discrimination or self.information).plot(ax)


def standing(
    name: str,
    problem: EstimationProblem,
    point: FloatArray | None = None,
    *,
    fitted: bool = False,
    executor: Executor | None = None,
) -> Rival:
    """A model where a design expects it, with what the logs of its problem know already.

    Parameters
    ----------
    name
        How tables call it.
    problem
        What is free in it; logs without a measurement know nothing.
    point
        Where its parameters are expected, shape (n,); None: where searches start.
    fitted
        Estimate them from the logs first, unless a point is given.
    executor
        Who evaluates members of that search.

    Raises
    ------
    EstimationError
        If the model diverges where it stands.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {}, {"deflection": 0.05}, {}, 2)
    >>> log = bg.MatchedLog("any", np.arange(60) * 0.05, np.zeros((1, 60)), np.full((1, 60), np.nan))
    >>> standing("swing", bg.pose(swing, log, ["length"], initial="model")).known is None
    True
    """
    where: FloatArray = problem.start if point is None else point
    if all(np.isnan(log.y).all() for log in problem.logs):
        return Rival(name, problem, where)
    if fitted and point is None:
        where = estimate(problem, Settings(method="gradient", certify="none"), executor=executor).point
    return Rival(name, problem, where, fitted_expansion(problem, where, derivatives).information)
