"""Moves: how far a law moves what a model predicts, over the noise of each sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from bondgraph.correct.constants import INDIFFERENT
from bondgraph.correct.fits.horizon import horizon, predicted, windows
from bondgraph.correct.scores.gates import Gate
from bondgraph.data.log import FloatArray
from bondgraph.estimate.fitted import Fit
from bondgraph.text import number


def smallness(without: Fit, fitted: Fit, least: float, gate: Gate | None = None) -> str:
    """Words on how little a law moves every sensor, empty where it moves one by ``least`` of its noise.

    Predictions are compared over whole logs, of a machine that process noise drives over the horizon; those of an event
    where its ``gate`` lets it act. ``without`` is the fit that has everything but the law.
    """
    seconds = horizon(fitted, fitted.problem.logs) if fitted.driven > INDIFFERENT else math.inf
    shares = moves(without, fitted, seconds, gate)
    if not shares or max(shares.values()) >= least:
        return ""
    channel = max(shares, key=lambda name: shares[name])
    whole = "over whole logs" if gate is None else "where it acts"
    over = f"over {number(seconds)} s" if math.isfinite(seconds) else whole
    return f"{over} it moves no sensor by more than {shares[channel]:.2g} of its noise ({channel})"


def moves(without: Fit, fitted: Fit, seconds: float, gate: Gate | None = None) -> Mapping[str, float]:
    """Root mean square of the difference of two models' predictions over so many seconds, over the noise, by channel.

    Each predicts from its own filtered states. A window that one cannot predict does not count; a channel that was not
    measured is left out. With a ``gate`` the samples count at which it lets something act.
    """
    names, logs = fitted.problem.filter_model.model.names("output"), fitted.problem.logs
    noise = fitted.problem.batch(fitted.point[:, np.newaxis]).noise_std[:, 0]
    apart: dict[str, list[FloatArray]] = {name: [] for name in names}
    both = [(one, list(zip(one.problem.logs, one.own_runs, strict=True))) for one in (without, fitted)]
    for k, log in enumerate(logs):
        parts = windows(log, seconds)
        first, second = (predicted(one, *known[k], parts) for one, known in both)
        acts = np.ones(log.time.size, dtype=bool) if gate is None else gate.acts(log.time, log.name, logs) > 0.0
        for row, name in enumerate(names):
            seen = acts & np.isfinite(log.y[row]) & np.isfinite(first[row]) & np.isfinite(second[row])
            apart[name].append((second[row] - first[row])[seen])
    found = {name: np.concatenate(parts) for name, parts in apart.items()}
    return {
        name: float(np.sqrt(np.mean(found[name] ** 2)) / noise[row])
        for row, name in enumerate(names)
        if found[name].size and noise[row] > 0.0
    }
