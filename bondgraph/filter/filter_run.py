"""The record of a filter over one log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bondgraph.errors import FilterError, suggest
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.misfit import ChannelInnovations, Misfit, channel_misfits
from bondgraph.simulate.arrays import FloatArray, IntArray
from bondgraph.simulate.outcome import Outcome, describe_end


@dataclass(frozen=True)
class FilterRun:
    """Beliefs before and after each measurement, and what the measurements said.

    Shapes: time (n,); means (n_s, n) and covariances (n_s, n_s, n) of the filter's state, ``predicted`` before and
    ``filtered`` after the measurement of a sample; ``cross_cov`` (n_s, n_s, n) between the filtered state of the sample
    before and the predicted one; ``output_mean`` (n_y, n) and ``output_cov`` (n_y, n_y, n) expected of all channels,
    noise included (without it for channels that are not used); ``innovation`` (n_y, n), NaN where nothing was measured;
    ``whitened`` and ``log_scales`` (n_y, n) as in :class:`bondgraph.filter.belief.Update`.

    The prior is the belief at the first sample, which is updated without a prediction. After a failure everything is
    NaN, and ``ended_at`` is the last time that was finished.
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
        channels = [ChannelInnovations(info.name, info.unit, values, errors) for info, values, errors in rows]
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

    def raise_if_failed(self) -> FilterRun:
        """The run itself, if it reached the end of the log.

        Raises
        ------
        FilterError
            If it did not, saying when it ended and why.
        """
        if self.outcome is not Outcome.OK:
            raise FilterError(f"{self.log_name}: {describe_end(self.outcome, self.ended_at)}", where=(self.log_name,))
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


def normalised_innovations(run: FilterRun) -> FloatArray:
    """Innovations over their own standard deviations, shape (n_y, n), NaN where nothing was measured."""
    variance = np.einsum("iik->ik", run.output_cov)
    normalised: FloatArray = np.where(np.isnan(run.y), np.nan, run.innovation / np.sqrt(variance))
    return normalised
