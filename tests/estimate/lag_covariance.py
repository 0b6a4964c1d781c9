"""The lag of ``linear`` as one Gaussian vector: mean course and covariance of all its measurements, by hand.

Process noise is that of the sampled scheme, std^2 dt at the end of every interval, so that nothing is approximated.
"""

from __future__ import annotations

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.filter.filter_model import FilterModel
from tests.estimate.linear import lag

MASS, DRAG, STD, WALK, START = 2.0, 3.0, 0.05, 0.1, 0.1


def one_sensor(**changes: object) -> FilterModel:
    """The lag with one sensor, its process noise added at the samples."""
    given = {
        "measurement_noise": {"speed": STD}, "process_noise": {"v": WALK}, "initial_std": {"v": START},
        "substeps": 8, "noise_scheme": "sampled",
    } | changes  # fmt: skip
    return lag(**given)


def pushed(name: str = "run", samples: int = 40, step: float = 0.1, seed: int = 5) -> MatchedLog:
    """A log of the lag driven up and down, held between samples, whose measurements are all zero."""
    time = np.arange(samples) * step
    force = 6.0 * np.sign(np.sin(1.3 * time + seed)) + 2.0
    y = np.zeros((2, samples))
    y[1] = np.nan
    return MatchedLog(name, time, force[np.newaxis], y)


def unit_course(log: MatchedLog, mass: float = MASS, drag: float = DRAG) -> np.ndarray:
    """Speed (n,) by a gain of one from rest: what the measurements move by with the gain."""
    course = np.zeros(len(log))
    for k in range(1, len(log)):
        decay = np.exp(-drag / mass * (log.time[k] - log.time[k - 1]))
        course[k] = decay * course[k - 1] + (1.0 - decay) / drag * log.u[0, k - 1]
    return course


def covariance(log: MatchedLog, walk: float = WALK, start: float = START) -> np.ndarray:
    """Covariance (n, n) of the measured speeds."""
    size = len(log)
    decay = np.exp(-DRAG / MASS * np.diff(log.time))
    moves = np.zeros((size, size))  # of each state by each noise: the start, then one at the end of every interval
    for k in range(size):
        moves[k, k] = start if k == 0 else walk * np.sqrt(log.time[k] - log.time[k - 1])
        if k > 0:
            moves[k, :k] = decay[k - 1] * moves[k - 1, :k]
    return moves @ moves.T + STD**2 * np.eye(size)
