"""What logs say of a correction once it is made: whether they confirm it, contradict it, or leave it open.

Training logs choose a correction, held-out logs never; both may contradict it. Held-out logs do by their likelihood,
where it falls by more than its standard error. And both do where a channel is predicted clearly worse: over the horizon
(restarted along the log) or in free simulation. A gain of likelihood beside such a prediction says that the noise of
the corrected model is more to the liking of the filter, not that its physics is.

A channel is clearly worse where the paired difference of squared errors over windows of time is above zero by more than
chance allows, all comparisons counted, and exceeds what its sensor's noise hides. Where something random drives the
machine, free simulation wanders with it, before and after: there the error must grow by as much as it was. Reference:
Diebold and Mariano (1995), J. Business Econ. Statist. 13(3), for paired comparisons of predictions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from bondgraph.correct.fits.assess import WINDOWS, Assessment, LogAssessment, gain_interval
from bondgraph.correct.fits.fit import Fit
from bondgraph.correct.fits.horizon import horizon, predicted, windows
from bondgraph.data.log import FloatArray

Data = Literal["training", "held-out"]
Kind = Literal["prediction", "free simulation"]
Standing = Literal["confirmed", "contradicted", "open"]

#: Chance of calling any channel clearly worse that is not, over all comparisons.
_LEVEL = 0.01
#: A gain of held-out likelihood confirms from so many of its standard errors on.
_CONFIRMS = 2.0
#: Nats that process noise takes of a fit, below which nothing random drives its machine.
_DRIVEN = 3.0


@dataclass(frozen=True)
class Compared:
    """One channel before and after a correction: root mean square errors in its unit, over all logs of one kind.

    ``p_worse``: chance that the error seems to grow so much though it does not. ``clearly`` worse: that is less than
    chance allows, and what was added exceeds what the sensor's noise hides.
    """

    data: Data
    kind: Kind
    channel: str
    before: float
    after: float
    p_worse: float
    clearly: bool

    def __str__(self) -> str:
        grown = f" ({self.after / self.before - 1.0:+.0%})" if self.before > 0.0 and math.isfinite(self.after) else ""
        return f"{self.kind} of {self.channel} on {self.data} logs {self.before:.3g} -> {self.after:.3g}{grown}"


@dataclass(frozen=True)
class Confirmation:
    """What the logs say of a correction.

    ``gain`` is that of held-out log-likelihood in nats with its standard ``error`` by blocks of time, both not a number
    without held-out logs, the error of logs too short to tell it; predictions run over ``horizon`` seconds.
    """

    gain: float
    error: float
    horizon: float
    compared: tuple[Compared, ...]

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Everything that speaks against the correction, as clauses with their numbers; none where nothing does."""
        said = []
        if self.gain < -self.error or self.gain == -math.inf:
            said.append(f"the log-likelihood of the held-out logs falls by {-self.gain:.3g}{self._within} nats")
        return (*said, *(str(one) for one in self.compared if one.clearly))

    @property
    def standing(self) -> Standing:
        """Whether the logs confirm the correction, contradict it, or leave it open."""
        if self.contradictions:
            return "contradicted"
        return "confirmed" if self.gain > 0.0 and self.gain > _CONFIRMS * self.error else "open"

    @property
    def _within(self) -> str:
        return f" ± {self.error:.3g}" if math.isfinite(self.error) else ""

    def __str__(self) -> str:
        said = {"confirmed": "confirmed", "contradicted": "contradicted", "open": "neither confirmed nor contradicted"}
        rest = "" if math.isnan(self.gain) else f"log-likelihood of held-out logs {self.gain:+.3g}{self._within} nats"
        return "; ".join([said[self.standing], *filter(None, [rest]), *self.contradictions])


def confirmation(
    nominal: Fit, corrected: Fit, before: Sequence[Assessment], after: Sequence[Assessment]
) -> Confirmation:
    """What training and held-out logs say of a correction, by its assessments on both kinds (in this order)."""
    held = [log.filtered for log in before[1].logs], [log.filtered for log in after[1].logs]
    gain, error = gain_interval(*held) if held[0] else (math.nan, math.nan)
    seconds = horizon(corrected, [log.log for log in after[0].logs])
    random = corrected.driven > _DRIVEN or nominal.driven > _DRIVEN
    found = [
        one
        for data, first, last in zip(("training", "held-out"), before, after, strict=True)
        for one in _errors(data, nominal, corrected, first.logs, last.logs, seconds)  # type: ignore[arg-type]
    ]
    return Confirmation(gain, error, seconds, tuple(_judged(one, random, len(found)) for one in found))


@dataclass(frozen=True)
class _Errors:
    """Errors of one channel over all logs of one kind: mean squares by window, before and after; the sensor's noise."""

    data: Data
    kind: Kind
    channel: str
    before: FloatArray
    after: FloatArray
    weight: FloatArray
    noise: float


def _errors(
    data: Data,
    nominal: Fit,
    corrected: Fit,
    before: Sequence[LogAssessment],
    after: Sequence[LogAssessment],
    seconds: float,
) -> list[_Errors]:
    """Errors of every channel in prediction and in free simulation, by windows of time."""
    pieces: dict[tuple[Kind, str], list[tuple[float, float, int]]] = {}
    noise: dict[str, float] = {}
    total = sum(float(one.log.time[-1] - one.log.time[0]) for one in before)
    for first, last in zip(before, after, strict=True):
        log, parts = first.log, windows(first.log, seconds)
        ahead = [predicted(nominal, log, first.filtered, parts), predicted(corrected, last.log, last.filtered, parts)]
        free, blocks = [first.simulated.y, last.simulated.y], windows(log, total / WINDOWS)
        for row, name in enumerate(first.simulated.model.names("output")):
            if name not in first.channels:
                continue
            noise[name] = min(first.channels[name].noise_std, last.channels[name].noise_std)
            kinds: tuple[tuple[Kind, list[FloatArray], list[tuple[int, int]]], ...]
            kinds = ("prediction", ahead, parts), ("free simulation", free, blocks)
            for kind, shown, cut in kinds:
                pieces.setdefault((kind, name), []).extend(_squares(log.y[row], [y[row] for y in shown], cut))
    found = []
    for (kind, name), values in pieces.items():
        told = np.array(values, dtype=np.float64).reshape(-1, 3)
        found.append(_Errors(data, kind, name, told[:, 0], told[:, 1], told[:, 2], noise[name]))
    return found


def _squares(
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


def _judged(one: _Errors, random: bool, count: int) -> Compared:
    """Whether a channel is clearly worse after the correction, ``count`` comparisons being made."""
    if not one.weight.size:
        return Compared(one.data, one.kind, one.channel, math.nan, math.nan, 1.0, False)
    before, after = (float(np.average(values, weights=one.weight)) for values in (one.before, one.after))
    p_worse = _p_worse(one.after - one.before, one.weight)
    margin = max(one.noise**2, before if random and one.kind == "free simulation" else 0.0)
    clearly = p_worse * count < _LEVEL and after - before > margin
    return Compared(one.data, one.kind, one.channel, math.sqrt(before), math.sqrt(after), p_worse, clearly)


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
