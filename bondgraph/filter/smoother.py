"""The unscented Rauch-Tung-Striebel smoother: states given the whole log.

Backwards from the last sample, with the gain G = C P^-1 of the covariance C between the filtered state of a sample and
the predicted state of the next, whose covariance is P:

    mean     = filtered mean + G (next smoothed mean - next predicted mean)
    cov      = filtered cov  + G (next smoothed cov  - next predicted cov) G'

C was gathered by the filter with the same sigma points as P, so nothing is propagated again.

Reference: Sarkka (2008), Unscented Rauch-Tung-Striebel smoother, IEEE Trans. Automatic Control 53(3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.errors import FilterError, suggest
from bondgraph.filter.bands import FilterBands
from bondgraph.filter.beliefs_shown import belief_axes, belief_columns, belief_table
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun, solved
from bondgraph.frames import dataset, frame
from bondgraph.shown import Tabulated
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table, count, text_table

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

#: Samples whose gains are computed together: some megabytes.
_AT_ONCE = 1000


class AbstractSmootherRun(Tabulated, Kept):
    """Smoothed means and variances (n_s, n) of the filter's state at ``time`` (n,)."""

    if TYPE_CHECKING:  # fields of the records that are final

        @property
        def filter_model(self) -> FilterModel: ...  # noqa: D102

        @property
        def log_name(self) -> str: ...  # noqa: D102

        @property
        def time(self) -> FloatArray: ...  # noqa: D102

        @property
        def smoothed_mean(self) -> FloatArray: ...  # noqa: D102

        @property
        def smoothed_var(self) -> FloatArray: ...  # noqa: D102

    def __repr__(self) -> str:
        sizes = f"{count(self.time.size, 'sample')}, {count(len(self.state_names), 'state')}"
        return f"<{type(self).__name__} {self.filter_model.model.name}, {self.log_name}: {sizes}>"

    @property
    def state_names(self) -> tuple[str, ...]:
        """States of the model, then appended parameters."""
        return self.filter_model.state_names

    def summary(self) -> str:
        """What was smoothed, and the table of the states."""
        return "\n".join([repr(self)[1:-1], text_table(*self.table())])

    def table(self) -> Table:
        """A line for every state in its declared unit: smoothed mean at both ends, and its standard deviation."""
        return belief_table(self.filter_model, self.smoothed_mean, self.smoothed_var)

    def to_dataframe(self) -> pandas.DataFrame:
        """Smoothed means and standard deviations over time in declared units, columns ``name [unit]``.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        columns = belief_columns(self.filter_model, self.smoothed_mean, self.smoothed_var)
        return frame(columns, self.time, "time [s]")

    def to_xarray(self) -> xarray.Dataset:
        """Smoothed means and standard deviations over ``time``; each variable has its unit as ``attrs["units"]``.

        Raises
        ------
        DataError
            If xarray is not installed.
        """
        return dataset(belief_columns(self.filter_model, self.smoothed_mean, self.smoothed_var), self.time)

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
            If the smoother has no such state.
        """
        known = self.state_names[-1] if name is None else name
        return belief_axes(self.filter_model, known, self.time, self.mean(known), self.std(known), ax)

    def mean(self, name: str) -> FloatArray:
        """Smoothed mean of one state or appended parameter, shape (n,)."""
        row: FloatArray = self.smoothed_mean[self._row(name)]
        return row

    def std(self, name: str) -> FloatArray:
        """Smoothed standard deviation of one state or appended parameter, shape (n,)."""
        deviation: FloatArray = np.sqrt(np.maximum(self.smoothed_var[self._row(name)], 0.0))
        return deviation

    def _row(self, name: str) -> int:
        if name not in self.state_names:
            raise FilterError(
                f"the smoother has no state {name!r}{suggest(name, self.state_names)}"
                f" - it has {', '.join(self.state_names)}",
                where=(name,),
            )
        return self.state_names.index(name)


@dataclass(frozen=True, repr=False)
class SmootherRun(AbstractSmootherRun):
    """Smoothed means (n_s, n) and covariances (n_s, n_s, n) of the filter's state at ``time`` (n,)."""

    filter_model: FilterModel
    log_name: str
    time: FloatArray
    smoothed_mean: FloatArray
    smoothed_cov: FloatArray

    @property
    def smoothed_var(self) -> FloatArray:
        """Variances of the smoothed states, shape (n_s, n)."""
        variances: FloatArray = np.einsum("iik->ik", self.smoothed_cov)
        return variances


def smooth(run: FilterRun) -> SmootherRun:
    """Smooth a filtered log.

    Parameters
    ----------
    run
        As :func:`bondgraph.filter.runs.run` gives it.

    Raises
    ------
    FilterError
        If the filter did not reach the end of the log, or took it sample by sample.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> filtered = bg.filter_log(swing, log, compiled=False)
    >>> bool(bg.smooth(filtered).std("rate")[0] < filtered.std("rate")[0])
    True
    """
    run.raise_if_failed()
    if isinstance(run, FilterBands):
        raise FilterError(
            f"{run.log_name}: bands have no covariances, which smoothing needs"
            " - filter the log with keep 'smoothed', or with keep 'all'",
            where=(run.log_name,),
        )
    if run.nodes is None:
        raise FilterError(
            f"{run.log_name}: filtered on line, where nothing is kept of how samples depend on each other"
            " - filter the log as a whole to smooth it",
            where=(run.log_name,),
        )
    mean, cov = run.filtered_mean.copy(), run.filtered_cov.copy()
    smooth_back(run, mean, cov)
    return SmootherRun(run.filter_model, run.log_name, run.time, mean, cov)


def smoothed_start(run: FilterRun, until: float) -> FloatArray:
    """The state at the first sample, shape (n_s,), by all that was measured until a time.

    Of a run that failed on its way, or whose beginning cannot be smoothed, what the first sample says of it.

    Parameters
    ----------
    run
        As :func:`bondgraph.filter.runs.run` gives it.
    until
        The last time that counts, in s.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 2.0}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 40)), np.sin(3.1 * time)[np.newaxis])
    >>> filtered = bg.filter_log(swing, log, compiled=False)
    >>> float(filtered.mean("rate")[0]), round(float(smoothed_start(filtered, 0.2)[1]), 1)
    (0.0, 3.2)
    """
    size = int(np.count_nonzero(run.time <= until))
    mean, cov = run.filtered_mean[:, :size].copy(), run.filtered_cov[..., :size].copy()
    if size > 1 and run.outcome is Outcome.OK:
        smooth_back(run, mean, cov)
    found: FloatArray = mean[:, 0]
    return found if np.isfinite(found).all() else run.filtered_mean[:, 0]


def smooth_back(run: FilterRun, mean: FloatArray, cov: FloatArray) -> None:
    """Smooth the samples of a run, or of its beginning, but the last of them, which is smoothed already.

    Parameters
    ----------
    run
        Of which beliefs and ``cross_cov`` are read; the latter of the first sample is not.
    mean, cov
        Smoothed means (n_s, n) and covariances (n_s, n_s, n) of the first n samples; those of the last of them are
        read, the others written.
    """
    for end in range(mean.shape[1] - 1, 0, -_AT_ONCE):
        own = slice(max(end - _AT_ONCE, 0), end)
        ahead = slice(own.start + 1, end + 1)
        # copies in order of samples: those of filtered beliefs become smoothed ones
        filtered, predicted, cross = (
            np.array(np.moveaxis(array, -1, 0), order="C")
            for array in (run.filtered_cov[..., own], run.predicted_cov[..., ahead], run.cross_cov[..., ahead])
        )
        means, expected = (
            np.array(array.T, order="C") for array in (run.filtered_mean[:, own], run.predicted_mean[:, ahead])
        )
        gains = np.ascontiguousarray(np.swapaxes(solved(predicted, np.swapaxes(cross, 1, 2)), 1, 2))
        now, spread = mean[:, end].copy(), cov[..., end].copy()
        for k in range(end - 1 - own.start, -1, -1):
            now, spread = _stepped(gains[k], means[k], filtered[k], expected[k], predicted[k], now, spread)
            means[k], filtered[k] = now, spread
        mean[:, own], cov[..., own] = means.T, np.moveaxis(filtered, 0, -1)


def smooth_step(
    filtered_mean: FloatArray,
    filtered_cov: FloatArray,
    cross_cov: FloatArray,
    predicted_mean: FloatArray,
    predicted_cov: FloatArray,
    smoothed_mean: FloatArray,
    smoothed_cov: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Smoothed mean (n,) and covariance (n, n) of a sample from those of the next one.

    Parameters
    ----------
    filtered_mean, filtered_cov
        Of this sample.
    cross_cov
        Between this sample's filtered and the next sample's predicted state, (n, n).
    predicted_mean, predicted_cov, smoothed_mean, smoothed_cov
        Of the next sample.

    Examples
    --------
    >>> one, zero = np.eye(1), np.zeros(1)
    >>> smooth_step(zero, one, one, zero, 2 * one, np.ones(1), one)
    (array([0.5]), array([[0.75]]))
    """
    gain = solved(predicted_cov[np.newaxis], cross_cov.T[np.newaxis])[0].T
    return _stepped(gain, filtered_mean, filtered_cov, predicted_mean, predicted_cov, smoothed_mean, smoothed_cov)


def _stepped(
    gain: FloatArray,
    filtered_mean: FloatArray,
    filtered_cov: FloatArray,
    predicted_mean: FloatArray,
    predicted_cov: FloatArray,
    smoothed_mean: FloatArray,
    smoothed_cov: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """As :func:`smooth_step`, with the gain ``cross_cov predicted_cov^-1`` (n, n).

    States that are known exactly have none. Directions that are known up to rounding (fast states that have forgotten
    where they were) say nothing about the sample before: they have none either.
    """
    mean = filtered_mean + gain @ (smoothed_mean - predicted_mean)
    cov = filtered_cov + gain @ (smoothed_cov - predicted_cov) @ gain.T
    return mean, 0.5 * (cov + cov.T)
