"""The record of a filter over one log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bondgraph.errors import FilterError, suggest
from bondgraph.filter.filter_model import FilterModel
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
    NaN, ``ended_at`` is the last time that was finished, and ``cause`` says more of it, where more is known.
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
            why = self.cause or describe_end(self.outcome, self.ended_at)
            raise FilterError(f"{self.log_name}: {why}", where=(self.log_name,))
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
