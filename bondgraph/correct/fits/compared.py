"""Predictions of two models against each other: is a channel clearly worse by one than by the other.

It is where the paired difference of squared errors over windows of time is above zero by more than chance allows, all
comparisons counted, and exceeds what the sensor's noise hides. Reference: Diebold and Mariano (1995), J. Business Econ.
Statist. 13(3), for paired comparisons of predictions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from bondgraph.correct.constants import LEVEL
from bondgraph.correct.fits.horizon import horizon, predicted, windows
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.estimate.fitted import Fit
from bondgraph.simulate.quantities import OutputInfo

Data = Literal["training", "held-out", "left-out"]
Kind = Literal["prediction", "free simulation"]


@dataclass(frozen=True)
class Compared:
    """One channel before and after a correction: root mean square errors in its unit, over all logs of one kind.

    ``p_worse``: chance that the error seems to grow so much though it does not. ``clearly`` worse: that is less than
    chance allows, and what was added exceeds what the sensor's noise hides. ``info`` knows the declared unit.
    """

    data: Data
    kind: Kind
    channel: str
    before: float
    after: float
    p_worse: float
    clearly: bool
    info: OutputInfo | None = None

    def __str__(self) -> str:
        """The errors in words, in the unit in which the channel was declared."""
        grown = f" ({self.after / self.before - 1.0:+.0%})" if self.before > 0.0 and math.isfinite(self.after) else ""
        before, after = (one if self.info is None else self.info.shown(one) for one in (self.before, self.after))
        unit = "" if self.info is None or self.info.display_unit in ("", "1") else f" {self.info.display_unit}"
        return f"{self.kind} of {self.channel} on {self.data} logs {before:.3g} -> {after:.3g}{unit}{grown}"


@dataclass(frozen=True)
class Errors:
    """Errors of one channel over all logs of one kind: mean squares by window, before and after; the sensor's noise."""

    data: Data
    kind: Kind
    channel: str
    before: FloatArray
    after: FloatArray
    weight: FloatArray
    noise: float
    info: OutputInfo | None = None


def squares(
    measured: FloatArray, shown: Sequence[FloatArray], parts: Sequence[tuple[int, int]]
) -> list[tuple[float, float, int]]:
    """Mean squared errors before and after in each window, with its number of measurements."""
    found = []
    for first, last in parts:
        rows = slice(first + 1, last + 1)
        seen = np.isfinite(measured[rows])
        errors = [np.where(np.isfinite(y[rows]), y[rows] - measured[rows], np.inf)[seen] for y in shown]
        if seen.any() and np.isfinite(errors[0]).all():
            found.append((float(np.mean(errors[0] ** 2)), float(np.mean(errors[1] ** 2)), int(seen.sum())))
    return found


def judged(one: Errors, random: bool, count: int) -> Compared:
    """True for a channel that is clearly worse after the correction, among ``count`` comparisons."""
    if not one.weight.size:
        return Compared(one.data, one.kind, one.channel, math.nan, math.nan, 1.0, False, one.info)
    before, after = (float(np.average(values, weights=one.weight)) for values in (one.before, one.after))
    p_worse = _p_worse(one.after - one.before, one.weight)
    margin = max(one.noise**2, before if random and one.kind == "free simulation" else 0.0)
    clearly = p_worse * count < LEVEL and after - before > margin
    return Compared(one.data, one.kind, one.channel, math.sqrt(before), math.sqrt(after), p_worse, clearly, one.info)


def is_worse(compared: Sequence[Compared]) -> bool:
    """True where all channels together are shown worse: by the geometric mean of their ratios of errors.

    With noise levels as large as the errors, that is a loss of likelihood: half the logarithm of each mean square.

    Examples
    --------
    >>> def one(channel: str, after: float) -> Compared:
    ...     return Compared("left-out", "prediction", channel, 1.0, after, 0.0, True)
    >>> is_worse([one("current_d", 0.1), one("current_q", 1.02)]), is_worse([one("speed", 0.95), one("angle", 1.5)])
    (False, True)
    """
    return _grow([(one.before, one.after) for one in compared])


def predicts_worse(first: Fit, second: Fit, logs: Sequence[MatchedLog]) -> bool:
    """True where a second fit predicts the channels of logs worse over the horizon than the first.

    By the ratio of their root mean square errors, of several channels its geometric mean.
    """
    seconds = horizon(first, logs)
    pieces: list[list[tuple[float, float, int]]] = [[] for _ in first.problem.filter_model.model.outputs]
    for log, *runs in zip(logs, first.runs(logs), second.runs(logs), strict=True):
        parts = windows(log, seconds)
        shown = [predicted(one, log, run, parts) for one, run in zip((first, second), runs, strict=True)]
        for row, found in enumerate(pieces):
            found += squares(log.y[row], [y[row] for y in shown], parts)
    told = [np.array(found, dtype=np.float64) for found in pieces if found]
    return _grow([tuple(np.average(one[:, :2], axis=0, weights=one[:, 2])) for one in told])


def _grow(errors: Sequence[tuple[float, float]]) -> bool:
    """True where errors before and after, of several channels, grow by the geometric mean of their ratios."""
    return sum(math.log(after / before) for before, after in errors if before > 0.0 and after > 0.0) > 0.0


def _p_worse(grown: FloatArray, weight: FloatArray) -> float:
    """P-value of a mean growth of squared errors over windows, by its scatter over neighbouring pairs of them.

    Neighbours share what disturbs both; taken by two they tell of that. One that is no number was not predicted at all.
    """
    if np.isinf(grown).any():
        return 0.0
    sums = np.add.reduceat(grown * weight, np.arange(0, grown.size, 2))
    if sums.size < 2 or float(np.std(sums)) == 0.0:
        return 1.0
    scatter = float(np.std(sums, ddof=1)) * math.sqrt(sums.size)
    return float(stats.t.sf(float(sums.sum()) / scatter, sums.size - 1))
