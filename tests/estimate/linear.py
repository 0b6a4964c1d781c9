"""A linear model with an exact likelihood in continuous time, by which that of the toolkit is checked.

Tests of searches that need many evaluations take it in place of the toolkit's; tests of what an estimate says do not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.likelihoods import Batch
from bondgraph.estimate.objective import Terms
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.model import Model
from tests.module_text import STACK

TEXT = (
    '''"""First-order lag driven by a force; resistance is stiction * viscosity, which only ever act together."""
import numpy as np

NAME = "lag"
FORMAT = "bondgraph-module/1"
STATES = (
    ("v", "m/s", 0.0, "speed"),
)
INPUTS = (
    ("force", "N", 0.0, "hold", None, "driving force"),
)
PARAMETERS = (
    ("mass", "kg", 2.0, 0.5, 8.0, "moving mass"),
    ("drag", "N s/m", 3.0, 0.1, 30.0, "linear resistance"),
    ("gain", "1", 1.0, 0.2, 5.0, "amplifier"),
    ("load", "kg", 0.0, None, None, "payload, weighed"),
    ("colour", "1", 1.0, 0.5, 2.0, "acts on nothing"),
)
OUTPUTS = (
    ("speed", "m/s", "speed"),
    ("speed_rpm", "rpm", "speed of the wheel"),
)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    return _stack(x, ((theta[2]*u[0] - theta[1]*x[0])/(theta[0] + theta[3]),))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    return _stack(x, (x[0], 30.0*x[0]))
'''
    + STACK
)

NOISE = {"speed": 0.05, "speed_rpm": 3.0}


def lag(**changes: object) -> FilterModel:
    """The lag with process and measurement noise."""
    given = {"process_noise": {"v": 0.1}, "measurement_noise": NOISE, "initial_std": {"v": 0.1}} | changes
    return FilterModel(Model.from_text(TEXT), **given)


class ExactLikelihood:
    """The Kalman filter of the lag with its exact discretisation, over all members at once."""

    def __init__(self) -> None:
        self.calls = 0

    def nll(self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch) -> np.ndarray:
        terms = self.terms(filter_model, logs, batch)
        measured = sum(int((~np.isnan(log.y)).sum()) for log in logs)
        return terms.sums() + 0.5 * np.log(2.0 * np.pi) * measured

    def terms(self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch) -> Terms:
        self.calls += 1
        parts = [self._one(filter_model, log, batch, x0) for log, x0 in zip(logs, batch.x0, strict=True)]
        return Terms(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))

    def _one(
        self, filter_model: FilterModel, log: MatchedLog, batch: Batch, x0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        theta = batch.theta.copy()
        for name, value in log.theta_overrides.items():
            theta[filter_model.model.index("parameter", name)] = value
        mass, drag, gain, load, _ = theta
        mean, variance = x0[0].copy(), np.full(mean_size(x0), filter_model.start_std[0] ** 2)
        z, s = np.zeros((2, len(log), mean.size)), np.zeros((2, len(log), mean.size))
        for k in range(len(log)):
            if k > 0:
                step = log.time[k] - log.time[k - 1]
                decay = np.exp(-drag / (mass + load) * step)
                mean = decay * mean + (1.0 - decay) * gain / drag * log.u[0, k - 1]
                variance = decay**2 * variance + batch.process_std[0] ** 2 * carried(drag / (mass + load), step)
            for row, slope in enumerate((1.0, 30.0)):
                if not np.isnan(log.y[row, k]):
                    spread = slope**2 * variance + batch.noise_std[row] ** 2
                    innovation = log.y[row, k] - slope * mean
                    z[row, k], s[row, k] = innovation / np.sqrt(spread), 0.5 * np.log(spread)
                    weight = slope * variance / spread
                    mean, variance = mean + weight * innovation, (1.0 - weight * slope) * variance
        return z.reshape(-1, mean.size), s.reshape(-1, mean.size)


def carried(rate: np.ndarray | float, step: float) -> np.ndarray | float:
    """Variance that white noise of unit intensity leaves over a step, in a state that forgets at a rate."""
    return -np.expm1(-2.0 * rate * step) / (2.0 * rate)


def mean_size(x0: np.ndarray) -> int:
    return x0.shape[1]


def simulated(
    name: str, seed: int, truth: dict[str, float], samples: int = 60, x0: float = 0.0, **overrides: float
) -> MatchedLog:
    """A log of the lag with its noises; ``overrides`` are known to the log and act in the simulation."""
    rng = np.random.default_rng([seed, len(name), ord(name[-1])])
    numbers = {"mass": 2.0, "drag": 3.0, "gain": 1.0, "load": 0.0, "process": 0.1, **NOISE} | truth | overrides
    time = np.arange(samples) * 0.1
    force = 6.0 * np.sign(np.sin(1.3 * time + seed)) + 2.0
    speed = np.empty(samples)
    speed[0] = x0 + 0.1 * rng.normal()
    rate = numbers["drag"] / (numbers["mass"] + numbers["load"])
    decay, driven = np.exp(-rate * 0.1), numbers["process"] * np.sqrt(carried(rate, 0.1))
    for k in range(1, samples):
        pushed = decay * speed[k - 1] + (1.0 - decay) * numbers["gain"] / numbers["drag"] * force[k - 1]
        speed[k] = pushed + driven * rng.normal()
    noise = rng.normal(size=(2, samples))
    y = np.array([speed + numbers["speed"] * noise[0], 30.0 * speed + numbers["speed_rpm"] * noise[1]])
    y[1, 1::2] = np.nan  # the second sensor is half as fast
    return MatchedLog(name, time, force[np.newaxis], y, overrides)
