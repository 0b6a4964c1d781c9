"""Records of a filter over one log: what tables, pictures and tests need, however much was kept."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.errors import FilterError, suggest
from bondgraph.filter.beliefs_shown import belief_axes, belief_columns, belief_table
from bondgraph.filter.misfit import ChannelInnovations, Misfit, channel_misfits
from bondgraph.frames import dataset, frame
from bondgraph.shown import Tabulated
from bondgraph.simulate.outcome import Outcome, describe_end
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table, count, number, text_table

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

    from bondgraph.filter.filter_model import FilterModel


class AbstractRun(Tabulated, Kept):
    """A filter over one log: means and standard deviations of its states, and what the measurements said.

    Shapes are those of :class:`bondgraph.filter.filter_run.FilterRun`.
    """

    if TYPE_CHECKING:  # fields of the records that are final

        @property
        def filter_model(self) -> FilterModel: ...  # noqa: D102

        @property
        def log_name(self) -> str: ...  # noqa: D102

        @property
        def time(self) -> FloatArray: ...  # noqa: D102

        @property
        def y(self) -> FloatArray: ...  # noqa: D102

        @property
        def filtered_mean(self) -> FloatArray: ...  # noqa: D102

        @property
        def filtered_var(self) -> FloatArray: ...  # noqa: D102

        @property
        def output_mean(self) -> FloatArray: ...  # noqa: D102

        @property
        def output_var(self) -> FloatArray: ...  # noqa: D102

        @property
        def whitened(self) -> FloatArray: ...  # noqa: D102

        @property
        def log_scales(self) -> FloatArray: ...  # noqa: D102

        @property
        def outcome(self) -> Outcome: ...  # noqa: D102

        @property
        def ended_at(self) -> float: ...  # noqa: D102

        @property
        def cause(self) -> str: ...  # noqa: D102

    @property
    def end(self) -> str:
        """How the run ended, in words."""
        return self.cause or describe_end(self.outcome, self.ended_at)

    def __repr__(self) -> str:
        end = self.end.partition(" - ")[0]
        sizes = f"{count(self.time.size, 'sample')}, {count(len(self.filter_model.state_names), 'state')}"
        value = f", NLL {self.nll:.6g}" if self.outcome is Outcome.OK else ""
        return f"<{type(self).__name__} {self.filter_model.model.name}, {self.log_name}: {sizes}{value}; {end}>"

    @property
    def innovation(self) -> FloatArray:
        """Measured minus expected outputs, shape (n_y, n)."""
        return self.y - self.output_mean

    @property
    def measured_channels(self) -> IntArray:
        """Number of channels measured at each sample, shape (n,)."""
        count: IntArray = np.sum(~np.isnan(self.y), axis=0)
        return count

    @property
    def nis(self) -> FloatArray:
        """Normalised innovation squared of each sample, shape (n,), NaN where nothing was measured."""
        return np.where(self.measured_channels > 0, np.sum(self.whitened**2, axis=0), np.nan)

    @property
    def log_likelihood(self) -> FloatArray:
        """Logarithm of the density of each sample's measurement given those before it, shape (n,)."""
        constants = 0.5 * np.log(2.0 * np.pi) * self.measured_channels
        total: FloatArray = -np.sum(0.5 * self.whitened**2 + self.log_scales, axis=0) - constants
        return total

    @property
    def nll(self) -> float:
        """Negative log-likelihood of the log; infinite after a failure."""
        return float(-self.log_likelihood.sum()) if self.outcome is Outcome.OK else np.inf

    @property
    def misfits(self) -> tuple[Misfit, ...]:
        """Channels that the model does not explain in this log; empty where it does.

        Raises
        ------
        FilterError
            If the filter did not reach the end of the log.
        """
        self.raise_if_failed()
        rows = zip(self.filter_model.model.outputs, normalised_innovations(self), self.innovation, strict=True)
        channels = [
            ChannelInnovations(info.name, info.display_unit, values, errors, info.shown(1.0))
            for info, values, errors in rows
        ]
        measured = [channel for channel in channels if channel.count]
        return channel_misfits(measured, (self.log_name,), self.filter_model.measurement_noise)

    def mean(self, name: str) -> FloatArray:
        """Filtered mean of one state or appended parameter, shape (n,)."""
        row: FloatArray = self.filtered_mean[self._row(name)]
        return row

    def std(self, name: str) -> FloatArray:
        """Filtered standard deviation of one state or appended parameter, shape (n,)."""
        deviation: FloatArray = np.sqrt(self.filtered_var[self._row(name)])
        return deviation

    def summary(self) -> str:
        """The end of the run, and tables of states and channels in declared units."""
        states = belief_table(self.filter_model, self.filtered_mean, self.filtered_var)
        return "\n\n".join([repr(self)[1:-1], text_table(*states), text_table(*self.table())])

    def table(self) -> Table:
        """A line for each measured channel in its declared unit.

        It has the count of values measured, the root mean square of the innovations, and the mean of their square over
        the variance that the filter expects, which is near one where the model explains the channel.
        """
        rows = zip(self.filter_model.model.outputs, normalised_innovations(self), self.innovation, strict=True)
        channels = [
            [
                info.name,
                info.display_unit or "1",
                str(known.size),
                number(info.shown(_rms(known))),
                number(_rms(normal) ** 2),
            ]
            for info, scaled, errors in rows
            if (known := errors[~np.isnan(errors)]).size and (normal := scaled[~np.isnan(scaled)]).size
        ]
        return ("channel", "unit", "measured", "rms innovation", "mean NIS"), channels

    def to_dataframe(self) -> pandas.DataFrame:
        """Filtered states with their standard deviations, then each channel measured and predicted, over time.

        In declared units, columns ``name [unit]``, ``name_std [unit]``, ``name_measured [unit]`` and
        ``name_predicted [unit]``.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        return frame(self._columns(), self.time, "time [s]")

    def to_xarray(self) -> xarray.Dataset:
        """What :meth:`to_dataframe` holds, over ``time``; each variable has its unit as ``attrs["units"]``.

        Raises
        ------
        DataError
            If xarray is not installed.
        """
        return dataset(self._columns(), self.time)

    def _columns(self) -> dict[str, FloatArray]:
        """States and channels by ``name [unit]``."""
        columns = belief_columns(self.filter_model, self.filtered_mean, self.filtered_var)
        for info, measured, predicted in zip(self.filter_model.model.outputs, self.y, self.output_mean, strict=True):
            columns[f"{info.name}_measured [{info.display_unit or 1}]"] = info.shown(measured)
            columns[f"{info.name}_predicted [{info.display_unit or 1}]"] = info.shown(predicted)
        return columns

    def plot(self, name: str | None = None, ax: Axes | None = None) -> Axes:
        """A state or followed parameter over time with two standard deviations, in its declared unit.

        Parameters
        ----------
        name
            Which; None: the last one, a followed parameter where there is one.
        ax
            Axes to draw on; None: new ones. Needs matplotlib.

        Raises
        ------
        FilterError
            If the filter has no such state.
        """
        known = self.filter_model.state_names[-1] if name is None else name
        return belief_axes(self.filter_model, known, self.time, self.mean(known), self.std(known), ax)

    def raise_if_failed(self) -> Self:
        """The run itself, if it reached the end of the log.

        Raises
        ------
        FilterError
            If it did not, saying when it ended and why.
        """
        if self.outcome is not Outcome.OK:
            raise FilterError(f"{self.log_name}: {self.end}", where=(self.log_name,))
        return self

    def _row(self, name: str) -> int:
        names = self.filter_model.state_names
        if name not in names:
            raise FilterError(
                f"{self.filter_model.model.name}: the filter has no state {name!r}{suggest(name, names)}"
                f" - it has {', '.join(names)}",
                where=(name,),
            )
        return names.index(name)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def normalised_innovations(run: AbstractRun) -> FloatArray:
    """Innovations over their own standard deviations, shape (n_y, n), NaN where nothing was measured.

    Outliers are as large as they count, where measurements are robust.
    """
    variance, robust = run.output_var, run.filter_model.robust
    normalised: FloatArray = np.where(np.isnan(run.y), np.nan, run.innovation / np.sqrt(variance))
    return robust.counted(normalised) if robust else normalised
