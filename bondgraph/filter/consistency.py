"""Is the filter consistent with its data? Innovations must be as large as the filter says, and white.

The normalised innovation squared (NIS) of a consistent filter is chi-square distributed with one degree of freedom per
measured channel; its mean over n samples then lies, with the given probability, in a band around that number. Whiteness
is tested by the portmanteau statistic of the autocorrelations.

References
----------
Bar-Shalom, Li and Kirubarajan (2001), Estimation with applications to tracking and navigation, section 5.4;
Ljung and Box (1978), On a measure of lack of fit in time series models, Biometrika 65(2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc, gammaincinv

from bondgraph.errors import FilterError
from bondgraph.filter.filter_run import FilterRun
from bondgraph.simulate.arrays import FloatArray

#: Autocorrelations at most this many lags apart enter the whiteness test.
_MAX_LAGS = 20


@dataclass(frozen=True)
class ChannelConsistency:
    """One channel: measured values, rms of its innovations, mean NIS with its band, and p-value of whiteness.

    ``rmse`` is in ``unit``, that in which the channel is shown. The NIS is in the band with the probability asked for
    if the filter is consistent; a ``whiteness_p`` near zero means that an innovation can be foretold from those before
    it.
    """

    name: str
    unit: str
    count: int
    rmse: float
    nis_mean: float
    nis_band: tuple[float, float]
    whiteness_p: float


@dataclass(frozen=True)
class Consistency:
    """All channels, and the joint NIS per measured value with its band."""

    channels: tuple[ChannelConsistency, ...]
    nis_mean: float
    nis_band: tuple[float, float]

    def channel(self, name: str) -> ChannelConsistency:
        """The measured channel called ``name``.

        Raises
        ------
        FilterError
            If it was not measured.
        """
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise FilterError(
            f"no innovations of {name!r} - measured were {', '.join(channel.name for channel in self.channels)}",
            where=(name,),
        )


def consistency(run: FilterRun, confidence: float = 0.95) -> Consistency:
    """Consistency of a filter with one log.

    Parameters
    ----------
    run
        As :func:`bondgraph.filter.runs.run` gives it.
    confidence
        Probability of the bands.

    Raises
    ------
    FilterError
        If the filter did not reach the end of the log, or the confidence is no probability.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.filter.runs import run
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> consistency(run(swing, log, compiled=False)).channel("deflection").count
    40
    """
    run.raise_if_failed()
    if not 0.0 < confidence < 1.0:
        raise FilterError(f"confidence={confidence!r} is no probability - give a number such as 0.95")
    normalised = normalised_innovations(run)
    channels = []
    for row, info in enumerate(run.filter_model.model.outputs):
        count = int(np.sum(~np.isnan(normalised[row])))
        if count:
            rmse = float(np.sqrt(np.nanmean(run.innovation[row] ** 2)))
            nis = float(np.nanmean(normalised[row] ** 2))
            band = nis_band(count, count, confidence)
            white = whiteness_p(normalised[row])
            channels.append(ChannelConsistency(info.name, info.display_unit, count, info.shown(rmse), nis, band, white))
    values = int(run.measured_channels.sum())
    joint = float(np.sum(run.whitened**2) / values) if values else np.nan
    return Consistency(tuple(channels), joint, nis_band(values, values, confidence))


def normalised_innovations(run: FilterRun) -> FloatArray:
    """Innovations over their own standard deviations, shape (n_y, n), NaN where nothing was measured."""
    variance = np.einsum("iik->ik", run.output_cov)
    normalised: FloatArray = np.where(np.isnan(run.y), np.nan, run.innovation / np.sqrt(variance))
    return normalised


def nis_band(values: int, samples: int, confidence: float = 0.95) -> tuple[float, float]:
    """Band of the mean over ``samples`` of a NIS that sums ``values`` independent squares in all.

    Examples
    --------
    >>> [round(edge, 3) for edge in nis_band(100, 50)]
    [1.484, 2.591]
    """
    if not values:
        return (np.nan, np.nan)
    tail = 0.5 * (1.0 - confidence)
    low, high = (2.0 * float(gammaincinv(0.5 * values, share)) / samples for share in (tail, 1.0 - tail))
    return (low, high)


def whiteness_p(series: FloatArray) -> float:
    """p-value of the hypothesis that a series (n,) is white; NaN where it is too short to tell.

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal(400)
    >>> whiteness_p(noise) > 0.05, whiteness_p(np.cumsum(noise)) < 1e-6
    (True, True)
    """
    statistic, freedom = ljung_box(series)
    return float(gammaincc(0.5 * freedom, 0.5 * statistic)) if freedom else float("nan")


def ljung_box(series: FloatArray) -> tuple[float, int]:
    """Portmanteau statistic of a series (n,) and its degrees of freedom; none where it is too short or constant.

    Missing values (NaN) keep their place, so lags count samples and only pairs of measured values enter; lags at which
    fewer than half of the values have a partner (those between the samples of a slow sensor) are left out. Statistics
    of independent series add up, and so do their degrees of freedom.

    Examples
    --------
    >>> slow = np.full(1000, np.nan)
    >>> slow[::5] = np.random.default_rng(0).standard_normal(200)
    >>> statistic, freedom = ljung_box(slow)
    >>> bool(statistic < 40), freedom
    (True, 20)
    """
    present = ~np.isnan(series)
    count = int(present.sum())
    lags = min(_MAX_LAGS, count // 5)
    if lags < 1:
        return 0.0, 0
    centred = np.where(present, series - np.mean(series[present]), 0.0)
    power = float(centred @ centred)
    if power == 0.0:
        return 0.0, 0
    measured = present.astype(np.float64)
    statistic, freedom = 0.0, 0
    for lag in range(1, series.size):
        pairs = float(measured[lag:] @ measured[:-lag])
        if pairs >= 0.5 * count:
            # of a white series the squared correlation is pairs / (count (count + 2)) in the mean
            correlation = float(centred[lag:] @ centred[:-lag]) / power
            statistic += correlation**2 * count * (count + 2.0) / pairs
            freedom += 1
        if freedom == lags:
            break
    return statistic, freedom
