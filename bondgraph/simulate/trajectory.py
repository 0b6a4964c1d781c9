"""Results of simulations."""

from __future__ import annotations

from dataclasses import dataclass

from bondgraph.arrays import FloatArray
from bondgraph.errors import ModelError
from bondgraph.simulate.model import Model
from bondgraph.simulate.outcome import Outcome, describe_end


@dataclass(frozen=True)
class EventRecord:
    """An event of a simulation: when [s], of which element, and what happened.

    Examples
    --------
    >>> print(EventRecord(0.25, "plates", "locks"))
    t = 0.25 s: plates locks
    """

    time: float
    element: str
    what: str

    def __str__(self) -> str:
        return f"t = {self.time:.12g} s: {f'{self.element} ' if self.element else ''}{self.what}"


@dataclass(frozen=True)
class Trajectory:
    """States, outputs and inputs of one model over time.

    ``x`` (n_x, n), ``y`` (n_y, n) and ``u`` (n_u, n) are at ``time`` (n,), s. After ``ended_at`` x and y are NaN.
    ``events`` are in order of time (only of a model with modes, whose held inputs are in ``u``); at the very time of an
    event the states are those before it.
    """

    model: Model
    time: FloatArray
    x: FloatArray
    y: FloatArray
    u: FloatArray
    outcome: Outcome
    ended_at: float
    events: tuple[EventRecord, ...] = ()

    def state(self, name: str) -> FloatArray:
        """One state over time, shape (n,)."""
        values: FloatArray = self.x[self.model.index("state", name)]
        return values

    def output(self, name: str) -> FloatArray:
        """One output over time, shape (n,)."""
        values: FloatArray = self.y[self.model.index("output", name)]
        return values

    def input(self, name: str) -> FloatArray:
        """One input over time, shape (n,)."""
        values: FloatArray = self.u[self.model.index("input", name)]
        return values

    def raise_if_failed(self) -> Trajectory:
        """The trajectory itself, if it reached its last time.

        Raises
        ------
        ModelError
            If it did not, saying when it ended and why.
        """
        if self.outcome is not Outcome.OK:
            name = self.model.name
            raise ModelError(f"{name}: {describe_end(self.outcome, self.ended_at)}", where=(name,))
        return self


@dataclass(frozen=True)
class BatchTrajectory:
    """Trajectories of many members of one model.

    ``x`` (n_x, n, members) and ``y`` (n_y, n, members) are at ``time`` (n,), s. ``ended_at`` (members,) is the last
    time at which a member was finite; after it the member is NaN.
    """

    model: Model
    time: FloatArray
    x: FloatArray
    y: FloatArray
    outcomes: tuple[Outcome, ...]
    ended_at: FloatArray
