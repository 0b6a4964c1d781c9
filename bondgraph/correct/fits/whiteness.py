"""Is there a residual at all: whiteness of the innovations of every channel over all training logs."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.estimate.fitted import Fit
from bondgraph.filter.consistency import ljung_box

#: Logs in which a channel has no more values than this do not tell whether its innovations are white.
_FEWEST = 40


@dataclass(frozen=True)
class Whiteness:
    """Ljung-Box test of one channel: ``p_value`` small means that its innovations are correlated in time."""

    channel: str
    p_value: float
    nis_mean: float
    first_correlation: float


def whiteness(fitted: Fit, logs: Sequence[MatchedLog]) -> tuple[Whiteness, ...]:
    """Tests of all measured channels; statistics of several logs add up.

    Reference: Ljung and Box (1978), Biometrika 65(2).
    """
    runs, found = fitted.runs(logs), []
    for row, name in enumerate(fitted.problem.filter_model.model.names("output")):
        series = [np.where(np.isnan(run.y[row]), np.nan, run.whitened[row]) for run in runs]
        series = [values for values in series if np.sum(~np.isnan(values)) > _FEWEST]
        if series:
            statistic, freedom = np.sum([ljung_box(values) for values in series], axis=0)
            together = np.concatenate(series)
            first = float(np.mean([np.corrcoef(values[1:], values[:-1])[0, 1] for values in map(_measured, series)]))
            p_value = float(stats.chi2.sf(statistic, freedom))
            found.append(Whiteness(name, p_value, float(np.nanmean(together**2)), first))
    return tuple(found)


def is_white(fitted: Fit, level: float, but: Collection[str] = ()) -> bool:
    """Whether the innovations of all channels ``but`` some could be white, at a level over all of them."""
    tests = whiteness(fitted, fitted.problem.logs)
    return all(test.p_value * len(tests) >= level for test in tests if test.channel not in but)


def _measured(values: FloatArray) -> FloatArray:
    present: FloatArray = values[~np.isnan(values)]
    return present
