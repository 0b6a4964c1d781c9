"""Moves: how far a law moves what a model predicts, over the noise of each sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from bondgraph.correct.constants import INDIFFERENT
from bondgraph.correct.fits.horizon import horizon, predicted, windows
from bondgraph.data.log import FloatArray
from bondgraph.estimate.fitted import Fit
from bondgraph.text import number


def smallness(without: Fit, fitted: Fit, least: float) -> str:
    """Words on how little a law moves every sensor, empty where it moves one by ``least`` of its noise.

    Predictions are compared over whole logs, of a machine that process noise drives over the horizon. ``without`` is
    the fit that has everything but the law.
    """
    seconds = horizon(fitted, fitted.problem.logs) if fitted.driven > INDIFFERENT else math.inf
    shares = moves(without, fitted, seconds)
    if not shares or max(shares.values()) >= least:
        return ""
    channel = max(shares, key=lambda name: shares[name])
    over = f"over {number(seconds)} s" if math.isfinite(seconds) else "over whole logs"
    return f"{over} it moves no sensor by more than {shares[channel]:.2g} of its noise ({channel})"


def moves(without: Fit, fitted: Fit, seconds: float) -> Mapping[str, float]:
    """Root mean square of the difference of two models' predictions over so many seconds, over the noise, by channel.

    Each predicts from its own filtered states. A window that one cannot predict does not count; a channel that was not
    measured is left out.
    """
    names, logs = fitted.problem.filter_model.model.names("output"), fitted.problem.logs
    noise = fitted.problem.batch(fitted.point[:, np.newaxis]).noise_std[:, 0]
    apart: dict[str, list[FloatArray]] = {name: [] for name in names}
    for log, *runs in zip(logs, without.runs(logs), fitted.own_runs, strict=True):
        parts = windows(log, seconds)
        first, second = (predicted(one, log, run, parts) for one, run in zip((without, fitted), runs, strict=True))
        for row, name in enumerate(names):
            seen = np.isfinite(log.y[row]) & np.isfinite(first[row]) & np.isfinite(second[row])
            apart[name].append((second[row] - first[row])[seen])
    found = {name: np.concatenate(parts) for name, parts in apart.items()}
    return {
        name: float(np.sqrt(np.mean(found[name] ** 2)) / noise[row])
        for row, name in enumerate(names)
        if found[name].size and noise[row] > 0.0
    }
