"""The record of a filter over one log: on its samples, and on the nodes of the process noise between them.

What one sample knows of the next follows from what each node knows of the one after it: with the covariance P after
node j, noise included, and C between the states at j and j + 1, the transition is Phi = C' P^-1, and an interval's
transition is the product of those of its steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.errors import FilterError, suggest
from bondgraph.filter.beliefs_shown import belief_axes, belief_columns, belief_table
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.misfit import ChannelInnovations, Misfit, channel_misfits
from bondgraph.filter.samples import Samples
from bondgraph.frames import dataset, frame
from bondgraph.shown import Tabulated
from bondgraph.simulate.outcome import Outcome, describe_end
from bondgraph.text import Table, count, number, text_table

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

#: Eigenvalues of a correlation matrix below this share of the largest are rounding.
ROUNDING = 1e-11


@dataclass(frozen=True, repr=False)
class FilterRun(Tabulated):
    """Beliefs before and after each measurement, and what the measurements said.

    Shapes: time (n,); means (n_s, n) and covariances (n_s, n_s, n) of the filter's state, ``predicted`` before and
    ``filtered`` after the measurement of a sample; ``cross_cov`` (n_s, n_s, n) between the filtered state of the sample
    before and the predicted one; ``output_mean`` (n_y, n) and ``output_cov`` (n_y, n_y, n) expected of all channels,
    noise included (without it for channels that are not used); ``innovation`` (n_y, n), NaN where nothing was measured;
    ``whitened`` and ``log_scales`` (n_y, n) as in :class:`bondgraph.filter.belief.Update`.

    The prior is the belief at the first sample, which is updated without a prediction. After a failure everything is
    NaN, ``ended_at`` is the last time that was finished, and ``cause`` says more of it, where more is known. ``nodes``
    has the same on the nodes of the process noise.
    """

    filter_model: FilterModel
    log_name: str
    time: FloatArray
    y: FloatArray
    predicted_mean: FloatArray
    predicted_cov: FloatArray
    filtered_mean: FloatArray
    filtered_cov: FloatArray
    cross_cov: FloatArray
    output_mean: FloatArray
    output_cov: FloatArray
    whitened: FloatArray
    log_scales: FloatArray
    floored_pivots: int
    outcome: Outcome
    ended_at: float
    cause: str = ""
    nodes: NodeRecord | None = None

    @property
    def end(self) -> str:
        """How the run ended, in words."""
        return self.cause or describe_end(self.outcome, self.ended_at)

    def __repr__(self) -> str:
        end = self.end.partition(" - ")[0]
        sizes = f"{count(self.time.size, 'sample')}, {count(len(self.filter_model.state_names), 'state')}"
        value = f", NLL {self.nll:.6g}" if self.outcome is Outcome.OK else ""
        return f"<FilterRun {self.filter_model.model.name}, {self.log_name}: {sizes}{value}; {end}>"

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
        row = self._row(name)
        deviation: FloatArray = np.sqrt(self.filtered_cov[row, row])
        return deviation

    def summary(self) -> str:
        """The end of the run, and tables of states and channels in declared units."""
        states = belief_table(self.filter_model, self.filtered_mean, self.filtered_cov)
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
        columns = belief_columns(self.filter_model, self.filtered_mean, self.filtered_cov)
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

    def raise_if_failed(self) -> FilterRun:
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


@dataclass(frozen=True, repr=False)
class NodeRecord:
    """The record of a filter on the nodes of a log.

    ``run`` has the nodes as its samples; ``samples`` the log; ``process_cov`` (n_s, n_s) the noise per second.
    """

    run: FilterRun
    samples: Samples
    process_cov: FloatArray

    def __repr__(self) -> str:
        return f"<NodeRecord {self.run.log_name}: {count(self.run.time.size, 'node')}>"

    def at_samples(self) -> FilterRun:
        """The record on the samples of the log, which keeps this one as its ``nodes``."""
        run, samples = self.run, self.samples
        if samples.sample.size == samples.time.size and not samples.noise_start.any():
            return replace(run, nodes=self)
        chosen = samples.sample
        names = ("predicted_mean", "predicted_cov", "filtered_mean", "filtered_cov", "output_mean", "output_cov")
        arrays = {name: getattr(run, name)[..., chosen] for name in (*names, "whitened", "log_scales")}
        finished = np.searchsorted(run.time[chosen], run.ended_at, side="right") - 1
        return replace(
            run, time=run.time[chosen], y=run.y[:, chosen], cross_cov=self._cross_cov(), nodes=self,
            ended_at=float(run.time[chosen[max(int(finished), 0)]]), **arrays,
        )  # fmt: skip

    def transitions(self) -> FloatArray:
        """Transitions (m-1, n_s, n_s) of the filter over each step, in the directions that are not known exactly."""
        cross = np.moveaxis(self.run.cross_cov[..., 1:], -1, 0)
        return np.swapaxes(solved(self.driven_cov(), cross), 1, 2)

    def noise_gathered(self, state: int) -> FloatArray:
        """Covariance (n-1, n_s, n_s) that noise of intensity one in a state leaves over each interval of the log."""
        samples, size = self.samples, self.process_cov.shape[0]
        moves = self.transitions()
        gathered = np.zeros((samples.sample.size - 1, size, size))
        unit = np.zeros((size, size))
        unit[state, state] = 1.0
        edges = samples.sample
        longest = int(np.max(np.diff(edges), initial=0))
        for hop in range(longest):
            own = np.flatnonzero(np.diff(edges) > hop)
            step = edges[own] + hop
            begun = gathered[own] + unit * samples.noise_start[step, np.newaxis, np.newaxis]
            moved = moves[step] @ begun @ np.swapaxes(moves[step], 1, 2)
            gathered[own] = moved + unit * samples.noise_end[step, np.newaxis, np.newaxis]
        return gathered

    def driven_cov(self) -> FloatArray:
        """Covariances (m-1, n_s, n_s) from which the points of each step were drawn."""
        before = np.moveaxis(self.run.filtered_cov[..., :-1], -1, 0)
        return before + self.samples.noise_start[:, np.newaxis, np.newaxis] * self.process_cov

    def _cross_cov(self) -> FloatArray:
        """Covariance (n_s, n_s, n) between the state at a sample and that expected at the next."""
        edges = self.samples.sample
        cross = np.moveaxis(self.run.cross_cov[..., 1:], -1, 0)
        before = np.moveaxis(self.run.filtered_cov[..., :-1], -1, 0)
        driven = self.driven_cov()
        found = np.full((edges.size, *self.process_cov.shape), np.nan)
        counts = np.diff(edges)
        for hop in range(int(np.max(counts, initial=0))):
            own = np.flatnonzero(counts > hop)
            step = edges[own] + hop
            if hop == 0 and not self.samples.noise_start.any():
                found[own + 1] = cross[step]
                continue
            reached = before[step] if hop == 0 else found[own + 1]
            found[own + 1] = reached @ solved(driven[step], cross[step])
        return np.moveaxis(found, 0, -1)


def solved(cov: FloatArray, cross: FloatArray) -> FloatArray:
    """``cov^-1 cross`` for stacks (m, n, n); directions that are known up to rounding take no part.

    Scaled to unit variances first, since states in different units may differ by many orders of magnitude.

    Examples
    --------
    >>> solved(np.diag([4.0, 0.0])[np.newaxis], np.ones((1, 2, 2)))[0]
    array([[0.25, 0.25],
           [0.  , 0.  ]])
    """
    variance = np.einsum("kii->ki", cov)
    usable = np.asarray(np.isfinite(cov).all(axis=(1, 2)) & np.isfinite(cross).all(axis=(1, 2)))
    known = ~(variance > 0.0)
    scale = np.where(known, 0.0, 1.0 / np.sqrt(np.where(known, 1.0, variance)))
    correlation = np.where(usable[:, np.newaxis, np.newaxis], cov * scale[:, :, np.newaxis] * scale[:, np.newaxis], 0.0)
    values, vectors = np.linalg.eigh(correlation)
    good = values > ROUNDING * values[:, -1:]
    inverse = np.where(good, 1.0 / np.where(good, values, 1.0), 0.0)
    scaled = scale[:, :, np.newaxis] * np.where(usable[:, np.newaxis, np.newaxis], cross, 0.0)
    found: FloatArray = vectors @ (inverse[:, :, np.newaxis] * (np.swapaxes(vectors, 1, 2) @ scaled))
    found = scale[:, :, np.newaxis] * found
    found[~usable] = np.nan
    return found


def normalised_innovations(run: FilterRun) -> FloatArray:
    """Innovations over their own standard deviations, shape (n_y, n), NaN where nothing was measured.

    Outliers are as large as they count, where measurements are robust.
    """
    variance, robust = np.einsum("iik->ik", run.output_cov), run.filter_model.robust
    normalised: FloatArray = np.where(np.isnan(run.y), np.nan, run.innovation / np.sqrt(variance))
    return robust.counted(normalised) if robust else normalised
