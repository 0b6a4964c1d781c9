"""Results of simulations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.data.log import Log, LogChannel
from bondgraph.data.write import write_log
from bondgraph.errors import ModelError, OptionError, suggest
from bondgraph.frames import dataset, frame
from bondgraph.shown import Tabulated, own_axes
from bondgraph.simulate.model import Model
from bondgraph.simulate.outcome import Outcome, describe_end
from bondgraph.simulate.quantities import InputInfo, OutputInfo, StateInfo
from bondgraph.simulate.stored import Kept, store, stored
from bondgraph.text import Table, count, instant, number, text_table

#: The suffix of a whole trajectory; any other is that of a log.
_WHOLE = ".npz"

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes


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


@dataclass(frozen=True, repr=False)
class Trajectory(Tabulated, Kept):
    """States, outputs and inputs of one model over time.

    ``x`` (n_x, n), ``y`` (n_y, n) and ``u`` (n_u, n) are at ``time`` (n,), s. After ``ended_at`` x and y are NaN.
    ``events`` are in order of time (only of a model with modes, whose held inputs are in ``u``); at the very time of an
    event the states are those before it. ``cause`` names the law that ended the run, if one did.
    """

    model: Model
    time: FloatArray
    x: FloatArray
    y: FloatArray
    u: FloatArray
    outcome: Outcome
    ended_at: float
    events: tuple[EventRecord, ...] = ()
    cause: str = ""

    @property
    def end(self) -> str:
        """How the run ended, in words."""
        return self.cause or describe_end(self.outcome, self.ended_at)

    def __repr__(self) -> str:
        events = f", {count(len(self.events), 'event')}" if self.events else ""
        span = f"{instant(float(self.time[0]))} to {instant(float(self.time[-1]))} s"
        end = self.end.partition(" - ")[0]
        return f"<Trajectory {self.model.name}: {count(self.time.size, 'time')}, {span}{events}; {end}>"

    def summary(self) -> str:
        """The end of the run, what happened in it, and the table of its quantities."""
        return "\n".join([repr(self)[1:-1], *map(str, self.events), text_table(*self.table())])

    def table(self) -> Table:
        """A line for every state, output and input in declared units: start, least, largest and last value."""
        rows = [
            [info.name, info.display_unit or "1", *map(number, _extremes(info.shown(values)))]
            for info, values in self._rows()
        ]
        return ("name", "unit", "start", "least", "largest", "end"), rows

    def to_dataframe(self) -> pandas.DataFrame:
        """States, outputs and inputs in declared units over time, columns as in logs: ``name [unit]``.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        return frame(self._columns(), self.time, "time [s]")

    def to_xarray(self) -> xarray.Dataset:
        """States, outputs and inputs in declared units over ``time``; each has its unit as ``attrs["units"]``.

        Raises
        ------
        DataError
            If xarray is not installed.
        """
        return dataset(self._columns(), self.time)

    def save(self, path: str | Path) -> Path:
        """Write the trajectory whole, or its states, outputs and inputs as a log.

        With the suffix ``.npz`` all of it is kept, the model too, and :meth:`load` reads it. Any other suffix is that
        of a log, see :func:`bondgraph.data.write.write_log`, which :func:`bondgraph.data.read.read_log` reads.

        Raises
        ------
        DataError
            If the suffix is none of a log, or the package for it is not installed.
        OSError
            If the file cannot be written.
        """
        if Path(path).suffix.lower() == _WHOLE:
            return store(self, path)
        channels = {
            info.name: LogChannel(info.name, info.display_unit or "1", info.shown(values))
            for info, values in self._rows()
        }
        return write_log(path, Log(self.model.name, self.time, channels))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what :meth:`save` wrote to a file ``.npz``: the same values, to the last digit.

        Raises
        ------
        OptionError
            If the suffix is another, there is no such file, or it holds something else, is damaged, or is of another
            version.

        Examples
        --------
        >>> import tempfile
        >>> from bondgraph.simulate.example import pendulum
        >>> from bondgraph.simulate.simulation import simulate
        >>> run = simulate(pendulum(), np.arange(5) * 0.1)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     again = Trajectory.load(run.save(f"{folder}/run.npz"))
        >>> bool(np.array_equal(again.x, run.x))
        True
        """
        if Path(path).suffix.lower() != _WHOLE:
            raise OptionError(
                f"{path}: no {_WHOLE} file, and a log holds no model - read a log by bg.read_log, or save the "
                f"trajectory to {_WHOLE}",
                where=(str(path),),
            )
        return stored(cls, path)

    def plot(self, *names: str, ax: Axes | None = None) -> Axes:
        """Quantities over time in declared units: those named, else the outputs, else the states.

        Parameters
        ----------
        names
            States, outputs or inputs.
        ax
            Axes to draw on; None: new ones. Needs matplotlib.

        Raises
        ------
        ModelError
            If the model has no such quantity.
        """
        known = {info.name: (info, values) for info, values in self._rows()}
        chosen = names or self.model.names("output") or self.model.names("state")
        for name in chosen:
            if name not in known:
                raise ModelError(
                    f"{self.model.name}: no quantity {name!r}{suggest(name, known)} - there are {', '.join(known)}",
                    where=(name,),
                )
        curves = {f"{name} [{known[name][0].display_unit or 1}]": known[name] for name in chosen}
        axes = own_axes(ax)
        for label, (info, values) in curves.items():
            axes.plot(self.time, info.shown(values), label=label)
        axes.set(xlabel="time [s]", ylabel=next(iter(curves)) if len(curves) == 1 else "")
        if len(curves) > 1:
            axes.legend(loc="best", fontsize="small")
        return axes

    def _columns(self) -> dict[str, FloatArray]:
        """Values in declared units by ``name [unit]``."""
        return {f"{info.name} [{info.display_unit or 1}]": info.shown(values) for info, values in self._rows()}

    def _rows(self) -> list[tuple[StateInfo | OutputInfo | InputInfo, FloatArray]]:
        """Quantities with their values (n,), without inputs that follow others late.

        A state that is measured under its own name stands once.
        """
        model = self.model
        infos: list[StateInfo | OutputInfo | InputInfo] = [*model.states, *model.outputs, *model.inputs]
        found: dict[str, tuple[StateInfo | OutputInfo | InputInfo, FloatArray]] = {}
        for info, values in zip(infos, (*self.x, *self.y, *self.u), strict=True):
            if not (isinstance(info, InputInfo) and info.late_of):
                found.setdefault(info.name, (info, values))
        return list(found.values())

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
            raise ModelError(f"{name}: {self.end}", where=(name,))
        return self


def _extremes(values: FloatArray) -> tuple[float, float, float, float]:
    """First, least, largest and last value of those there are."""
    known = values[np.isfinite(values)]
    if not known.size:
        return (float("nan"),) * 4
    return float(known[0]), float(known.min()), float(known.max()), float(known[-1])


@dataclass(frozen=True, repr=False)
class BatchTrajectory(Kept):
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

    def __repr__(self) -> str:
        finished = sum(outcome is Outcome.OK for outcome in self.outcomes)
        sizes = f"{count(len(self.outcomes), 'member')}, {count(self.time.size, 'time')}"
        return f"<BatchTrajectory {self.model.name}: {sizes}; {finished} finished>"
