"""Confirmation of a correction by logs: they confirm it, contradict it, or leave it open.

Training logs choose a correction, held-out logs never; both may contradict it. Held-out logs do by their likelihood,
noise levels scaled to them, where it falls by more than two standard errors, as a gain of so many confirms it: by
more than one it fell on three of fifteen machines whose laws were right, where the held-out log alone had pulses. And
both do where a channel is predicted clearly worse: over the horizon (restarted along the log) or in free simulation. A
gain of likelihood beside such a prediction says that the noise of the corrected model is more to the liking of the
filter, not that its physics is. Nor does a gain confirm laws that came with a disturbance: they must gain beside it.

Where something random drives the machine, free simulation wanders with it, before and after: there the error must grow
by as much as it was.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bondgraph.correct.constants import CONFIRMS, INDIFFERENT, WINDOWS
from bondgraph.correct.fits.assess import Assessment, LogAssessment, ScaledGain, scaled_gain
from bondgraph.correct.fits.compared import Compared, Data, Errors, Kind, judged, squares
from bondgraph.correct.fits.horizon import horizon, predicted, windows
from bondgraph.data.log import FloatArray
from bondgraph.estimate.fitted import Fit

Standing = Literal["confirmed", "contradicted", "open"]


@dataclass(frozen=True)
class Confirmation:
    """Answer of the logs to a correction.

    ``gain`` is that of held-out log-likelihood in nats, noise levels scaled to these logs, with its standard ``error``
    by blocks of time, both not a number without held-out logs, the error of logs too short to tell it; predictions run
    over ``horizon`` seconds. ``noise``: how many times as large as the corrected model expects innovations are there.
    ``laws`` is what laws gain there beside disturbances that both models have; None where there are no disturbances.
    """

    gain: float
    error: float
    horizon: float
    compared: tuple[Compared, ...]
    noise: float = math.nan
    laws: ScaledGain | None = None

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Everything that speaks against the correction, as clauses with their numbers; none where nothing does."""
        said = []
        if self.gain < -CONFIRMS * self.error or self.gain == -math.inf:
            said.append(f"the log-likelihood of the held-out logs falls by {-self.gain:.3g}{self._within} nats")
        if self.laws is not None and self.laws.gain < -CONFIRMS * self.laws.error:
            within = f"{-self.laws.gain:.3g} ± {self.laws.error:.3g}"
            said.append(f"beside the disturbance the laws lose {within} nats on the held-out logs")
        return (*said, *(str(one) for one in self.compared if one.clearly))

    @property
    def standing(self) -> Standing:
        """Their answer in a word: confirmed, contradicted, or open."""
        if self.contradictions:
            return "contradicted"
        gains = [(self.gain, self.error), *([(self.laws.gain, self.laws.error)] if self.laws is not None else [])]
        return "confirmed" if all(gain > max(CONFIRMS * error, 0.0) for gain, error in gains) else "open"

    @property
    def _within(self) -> str:
        return f" ± {self.error:.3g}" if math.isfinite(self.error) else ""

    def __str__(self) -> str:
        said = {"confirmed": "confirmed", "contradicted": "contradicted", "open": "neither confirmed nor contradicted"}
        rest = "" if math.isnan(self.gain) else f"log-likelihood of held-out logs {self.gain:+.3g}{self._within} nats"
        return "; ".join([said[self.standing], *filter(None, [rest]), *self.contradictions])


def confirmation(
    nominal: Fit,
    corrected: Fit,
    before: Sequence[Assessment],
    after: Sequence[Assessment],
    disturbed: Assessment | None = None,
) -> Confirmation:
    """The answer of training and held-out logs to a correction, from its assessments on both kinds, in this order.

    ``disturbed`` is that of the model with disturbances and no laws on the held-out logs, if the correction has both.
    """
    held = [log.filtered for log in before[1].logs], [log.filtered for log in after[1].logs]
    told = scaled_gain(*held) if held[0] else ScaledGain(math.nan, math.nan, math.nan)
    seconds = horizon(corrected, [log.log for log in after[0].logs])
    random = corrected.driven > INDIFFERENT or nominal.driven > INDIFFERENT
    found = [
        one
        for data, first, last in zip(("training", "held-out"), before, after, strict=True)
        for one in _errors(data, nominal, corrected, first.logs, last.logs, seconds)  # type: ignore[arg-type]
    ]
    compared = tuple(judged(one, random, len(found)) for one in found)
    laws = None
    if disturbed is not None and held[1]:
        laws = scaled_gain([log.filtered for log in disturbed.logs], held[1])
    return Confirmation(told.gain, told.error, seconds, compared, told.noise, laws)


def _errors(
    data: Data,
    nominal: Fit,
    corrected: Fit,
    before: Sequence[LogAssessment],
    after: Sequence[LogAssessment],
    seconds: float,
) -> list[Errors]:
    """Errors of every channel in prediction and in free simulation, by windows of time."""
    pieces: dict[tuple[Kind, str], list[tuple[float, float, int]]] = {}
    noise: dict[str, float] = {}
    infos = {info.name: info for info in nominal.problem.filter_model.model.outputs}
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
                pieces.setdefault((kind, name), []).extend(squares(log.y[row], [y[row] for y in shown], cut))
    found = []
    for (kind, name), values in pieces.items():
        told = np.array(values, dtype=np.float64).reshape(-1, 3)
        found.append(Errors(data, kind, name, told[:, 0], told[:, 1], told[:, 2], noise[name], infos[name]))
    return found
