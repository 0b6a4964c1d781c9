"""Errors before and after: one step ahead and in free simulation, per channel and per log, against the sensor noise.

The first sample of a log tells where the machine starts: nothing was predicted before it, so it counts in no one-step
error, and the free simulation starts from the state that the filter takes from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bondgraph.correct.fit import Fit
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.filter.filter_run import FilterRun
from bondgraph.simulate.simulate import simulate
from bondgraph.simulate.trajectory import Trajectory


@dataclass(frozen=True)
class ChannelError:
    """Root mean square errors of one channel, in its unit; ``noise_std`` is the sensor noise that the fit found.

    Innovations count from the second sample: what is expected of the first is the prior, not a prediction.
    """

    innovation_rmse: float
    simulation_rmse: float
    noise_std: float


@dataclass(frozen=True)
class LogAssessment:
    """One log against one fitted model: its likelihood, its channels' errors, and the runs they were taken from."""

    log: MatchedLog
    nll: float
    channels: dict[str, ChannelError]
    filtered: FilterRun
    simulated: Trajectory


@dataclass(frozen=True)
class Assessment:
    """Several logs against one fitted model."""

    logs: tuple[LogAssessment, ...]

    @property
    def nll(self) -> float:
        """Negative log-likelihood of all logs."""
        return sum(log.nll for log in self.logs)

    @property
    def channels(self) -> dict[str, ChannelError]:
        """Errors over all logs: root mean squares weighted by the samples of each log."""
        pooled: dict[str, ChannelError] = {}
        for name in self.logs[0].channels if self.logs else ():
            parts = [(log.channels[name], _measured(log, name)) for log in self.logs if name in log.channels]
            pooled[name] = ChannelError(
                _pool([(part.innovation_rmse, weight) for part, weight in parts]),
                _pool([(part.simulation_rmse, weight) for part, weight in parts]),
                parts[0][0].noise_std,
            )
        return pooled


def _measured(log: LogAssessment, name: str) -> int:
    names = log.simulated.model.names("output")
    return int(np.isfinite(log.log.y[names.index(name)]).sum())


def _pool(parts: Sequence[tuple[float, int]]) -> float:
    total = sum(weight for _, weight in parts)
    return float(np.sqrt(sum(value**2 * weight for value, weight in parts) / total)) if total else float("nan")


def assess(fitted: Fit, logs: Sequence[MatchedLog]) -> Assessment:
    """Errors of a fitted model on logs, which may be others than those it was fitted to; nothing is re-estimated."""
    runs = fitted.runs(logs)
    return Assessment(tuple(_assess_log(fitted, log, run) for log, run in zip(logs, runs, strict=True)))


def _assess_log(fitted: Fit, log: MatchedLog, run: FilterRun) -> LogAssessment:
    simulated = free_simulation(fitted, log, run)
    model = simulated.model
    noise = fitted.problem.batch(fitted.point[:, np.newaxis]).noise_std[:, 0]
    channels = {}
    for row, name in enumerate(model.names("output")):
        seen = np.isfinite(log.y[row])
        if seen.any():
            error = (simulated.y[row] - log.y[row])[seen]
            innovation = run.innovation[row, 1:][seen[1:]]
            channels[name] = ChannelError(_rms(innovation), _rms(error), float(noise[row]))
    return LogAssessment(log, run.nll, channels, run, simulated)


def free_simulation(fitted: Fit, log: MatchedLog, filtered: FilterRun) -> Trajectory:
    """The fitted model left alone: nothing is given but the inputs and what the first sample says of the state."""
    filter_model = fitted.problem.filter_model
    model = filter_model.model
    theta = fitted.theta.copy()
    for name, value in log.theta_overrides.items():
        theta[model.index("parameter", name)] = value
    x0 = filtered.filtered_mean[: len(model.states), 0]
    return simulate(model, log.time, log.u, theta, x0, method="rk4", substeps=2 * filter_model.substeps, compiled=True)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
