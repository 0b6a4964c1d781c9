"""Is a series white? The portmanteau test of its autocorrelations.

Reference: Ljung and Box (1978), On a measure of lack of fit in time series models, Biometrika 65(2).
"""

from __future__ import annotations

import numpy as np
from scipy.fft import next_fast_len
from scipy.special import gammaincc

from bondgraph.arrays import BoolArray, FloatArray

#: Autocorrelations at most this many lags apart enter the whiteness test.
_MAX_LAGS = 20
#: Lags counted one by one, in multiples of those that are wanted.
_SHORTEST_LAGS = 2


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
    power = float(np.sum(centred**2))
    if power == 0.0:
        return 0.0, 0
    statistic, freedom = 0.0, 0
    for lag, pairs in _paired_lags(present, lags):
        # of a white series the squared correlation is pairs / (count (count + 2)) in the mean; not by a BLAS, whose
        # number of threads would show in the last digits
        correlation = float(np.sum(centred[lag:] * centred[:-lag])) / power
        statistic += correlation**2 * count * (count + 2.0) / pairs
        freedom += 1
    return statistic, freedom


def first_autocorrelation(series: FloatArray) -> float:
    """Correlation of neighbouring values of a series (n,), as many lags apart as a slow sensor is; NaN without any.

    Examples
    --------
    >>> steps = np.random.default_rng(0).standard_normal(4000)
    >>> round(first_autocorrelation(steps[1:] + 0.5 * steps[:-1]), 1)  # 0.5/(1 + 0.5^2)
    0.4
    """
    present = ~np.isnan(series)
    centred = np.where(present, series - np.mean(series[present]), 0.0) if present.any() else np.zeros(series.size)
    power = float(np.sum(centred**2))
    for lag, pairs in _paired_lags(present, 1) if power > 0.0 else ():
        return float(np.sum(centred[lag:] * centred[:-lag])) / power * float(present.sum()) / pairs
    return float("nan")


def _paired_lags(present: BoolArray, most: int) -> list[tuple[int, float]]:
    """The first lags at which at least half of the values (n,) have a partner, and how many have.

    The shortest lags are counted one by one: where few values are missing they are enough. Else all lags are counted at
    once by a Fourier transform: in a log of a million rows in which a slow sensor stands at odd times no lag may ever
    do, and looking at each would not end.
    """
    half, found = 0.5 * present.sum(), list[tuple[int, float]]()
    for lag in range(1, min(_SHORTEST_LAGS * most, present.size - 1) + 1):
        count = int(np.count_nonzero(present[lag:] & present[:-lag]))
        found += [(lag, float(count))] if count >= half else []
        if len(found) == most:
            return found
    size = next_fast_len(2 * present.size, real=True)
    shown = np.fft.rfft(present, size)
    pairs = np.rint(np.fft.irfft(np.abs(shown) ** 2, size)[: present.size])
    lags = 1 + np.flatnonzero(pairs[1:] >= half)[:most]
    return [(int(lag), float(pairs[lag])) for lag in lags]
