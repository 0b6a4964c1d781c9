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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from bondgraph.arrays import FloatArray
from bondgraph.errors import FilterError
from bondgraph.filter.abstract_run import AbstractRun, normalised_innovations
from bondgraph.filter.misfit import LEVEL, ChannelInnovations, Misfit, channel_tests
from bondgraph.filter.whiteness import ljung_box, whiteness_p
from bondgraph.simulate.outcome import Outcome

__all__ = [
    "ChannelConsistency", "Consistency", "consistency", "innovation_tests", "joined_innovations", "ljung_box",
    "misfits", "nis_band", "normalised_innovations", "whiteness_p",
]  # fmt: skip

#: Missing samples put between logs, so that no autocorrelation reaches from one into the next.
_APART = 50


@dataclass(frozen=True)
class ChannelConsistency:
    """One channel: measured values, rms of its innovations, mean NIS with its band, and p-value of whiteness.

    ``rmse`` is in ``unit``, that in which the channel is shown. The NIS is in the band with the probability asked for
    if the filter is consistent; a ``whiteness_p`` near zero means that an innovation can be foretold from those before
    it. ``refused`` readings did not pass the gate of a robust filter: they count as zero in the NIS.
    """

    name: str
    unit: str
    count: int
    rmse: float
    nis_mean: float
    nis_band: tuple[float, float]
    whiteness_p: float
    refused: int = 0


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


def consistency(run: AbstractRun, confidence: float = 0.95) -> Consistency:
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
            refused = _refused(run, normalised[row], row)
            channels.append(
                ChannelConsistency(info.name, info.display_unit, count, info.shown(rmse), nis, band, white, refused)
            )
    values = int(run.measured_channels.sum())
    # of robust measurements whitened innovations are residuals, whose squares have another mean
    squares = normalised[~np.isnan(normalised)] if run.filter_model.robust else run.whitened
    joint = float(np.sum(squares**2) / values) if values else np.nan
    return Consistency(tuple(channels), joint, nis_band(values, values, confidence))


def _refused(run: AbstractRun, normalised: FloatArray, row: int) -> int:
    """Number of readings of a channel that a gate kept from the filter; none without one."""
    robust = run.filter_model.robust
    if robust is None or not robust.refuses:
        return 0
    return int(np.sum((normalised == 0.0) & (run.innovation[row] != 0.0)))


def joined_innovations(runs: Sequence[AbstractRun]) -> tuple[ChannelInnovations, ...]:
    """Innovations of the channels that were measured in some runs of one model, over all their logs."""
    if not runs:
        return ()
    gap = np.full((len(runs[0].filter_model.model.outputs), _APART), np.nan)
    normalised = np.concatenate([part for one in runs for part in (normalised_innovations(one), gap)], axis=1)
    errors = np.concatenate([part for one in runs for part in (_counted_errors(one), gap)], axis=1)
    joined = [
        ChannelInnovations(info.name, info.display_unit, normalised[row], errors[row], info.shown(1.0))
        for row, info in enumerate(runs[0].filter_model.model.outputs)
    ]
    return tuple(channel for channel in joined if channel.count)


def _counted_errors(run: AbstractRun) -> FloatArray:
    """Innovations (n_y, n), outliers as large as they count: else a few of them would be the error of a channel."""
    return normalised_innovations(run) * np.sqrt(run.output_var) if run.filter_model.robust else run.innovation


def misfits(
    runs: Sequence[AbstractRun],
    noise: Mapping[str, float] | None = None,
    level: float = LEVEL,
    *,
    guessed: bool = False,
) -> tuple[Misfit, ...]:
    """Channels that a model does not explain, over the logs of some runs together.

    Parameters
    ----------
    runs
        Of one filter model; those that failed are left out.
    noise
        Standard deviation of a sensor's noise by output, where it is known better than the filter says; an estimate
        that widens it to the misfit would hide the misfit otherwise.
    level
        Chance that a model that is right is reported.
    guessed
        Whether the filter's noises were guessed from second differences of the same logs.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.filter.runs import run
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(200) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 200)), 0.5 * np.cos(2.5 * time)[np.newaxis])
    >>> [(one.channel, one.is_coloured, one.is_large) for one in misfits([run(swing, log, compiled=False)])]
    [('deflection', True, True)]
    """
    return tuple(one for one in innovation_tests(runs, noise, level, guessed=guessed) if one.contradicts)


def innovation_tests(
    runs: Sequence[AbstractRun],
    noise: Mapping[str, float] | None = None,
    level: float = LEVEL,
    *,
    guessed: bool = False,
) -> tuple[Misfit, ...]:
    """The tests behind :func:`misfits` of all channels, whether they contradict the model or not."""
    good = [one for one in runs if one.outcome is Outcome.OK]
    declared = good[0].filter_model.measurement_noise if good else {}
    logs = tuple(one.log_name for one in good)
    return channel_tests(joined_innovations(good), logs, {**declared, **(noise or {})}, level, guessed=guessed)


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
