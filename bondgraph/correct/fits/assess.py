"""Errors before and after: one step ahead and in free simulation, per channel and per log, against the sensor noise.

Nothing was predicted before the first sample of a log, so it counts in no one-step error. The free simulation starts at
the state of that sample, as a smoother takes it from the first twentieth of the log.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr, stdtrit

from bondgraph.correct.constants import BLOCKS, WINDOWS
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free_simulation import left_alone
from bondgraph.filter.filter_run import FilterRun
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.trajectory import Trajectory
from bondgraph.text import count

#: Degrees of freedom of the tails by which held-out logs may surprise, and turns that find a scale to a thousandth.
_TAILS, _TURNS = 4.0, 40


@dataclass(frozen=True)
class ChannelError:
    """Root mean square errors of one channel, in its unit; ``noise_std`` is the sensor noise that the fit found.

    Innovations count from the second sample: what is expected of the first is the prior, not a prediction. The 95 %
    intervals rest on blocks of time (see :func:`rms_interval`).
    """

    innovation_rmse: float
    simulation_rmse: float
    noise_std: float
    innovation_ci95: tuple[float, float] = (float("nan"), float("nan"))
    simulation_ci95: tuple[float, float] = (float("nan"), float("nan"))


@dataclass(frozen=True, repr=False)
class LogAssessment:
    """One log against one fitted model: its likelihood, its channels' errors, and the runs they were taken from."""

    log: MatchedLog
    nll: float
    channels: dict[str, ChannelError]
    filtered: FilterRun
    simulated: Trajectory

    def __repr__(self) -> str:
        return f"<LogAssessment {self.log.name}: {count(len(self.channels), 'channel')}, NLL {self.nll:.6g}>"


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
            if simulated.outcome is not Outcome.OK:  # an outcome, and no figure
                error = np.full(error.shape, np.inf)
            innovation = run.innovation[row, 1:][seen[1:]]
            intervals = rms_interval(innovation), rms_interval(error)
            channels[name] = ChannelError(_rms(innovation), _rms(error), float(noise[row]), *intervals)
    return LogAssessment(log, run.nll, channels, run, simulated)


def free_simulation(fitted: Fit, log: MatchedLog, filtered: FilterRun) -> Trajectory:
    """The fitted model left alone, see :func:`bondgraph.estimate.free_simulation.left_alone`."""
    return left_alone(filtered, fitted.theta, log)


def rms_interval(values: FloatArray) -> tuple[float, float]:
    """The 95 % interval of a root mean square, by the scatter of the mean square over blocks of time.

    Neighbouring errors belong together, so that the number of values says nothing about how sure their mean is.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal(4000)
    >>> low, high = rms_interval(noise)
    >>> 0.95 < low < 1.0 < high < 1.05
    True
    """
    known = values[np.isfinite(values)]
    if known.size < 2 * WINDOWS:
        return float("nan"), float("nan")
    squares = np.array([np.mean(part**2) for part in np.array_split(known, WINDOWS)])
    reach = float(stdtrit(WINDOWS - 1, 0.975) * squares.std(ddof=1) / np.sqrt(WINDOWS))
    middle = float(squares.mean())
    return float(np.sqrt(max(middle - reach, 0.0))), float(np.sqrt(middle + reach))


def gain_interval(
    before: Sequence[FilterRun], after: Sequence[FilterRun], blocks: int = WINDOWS
) -> tuple[float, float]:
    """Gain of log-likelihood from one filter to another on the same logs, and its standard error, by blocks of time."""
    gains = np.concatenate([
        last.log_likelihood - first.log_likelihood for first, last in zip(before, after, strict=True)
    ])  # fmt: skip
    if gains.size < 2 * blocks or not np.isfinite(gains).all():
        return sum(run.nll for run in before) - sum(run.nll for run in after), float("nan")
    sums = np.array([part.sum() for part in np.array_split(gains, blocks)])
    return float(gains.sum()), float(sums.std(ddof=1) * np.sqrt(blocks))


@dataclass(frozen=True)
class ScaledGain:
    """Gain of log-likelihood on logs to which the noise of both filters was scaled, nats, with its standard error.

    ``noise``: how many times as large as the second filter expects innovations are.
    """

    gain: float
    error: float
    noise: float


def scaled_gain(before: Sequence[FilterRun], after: Sequence[FilterRun]) -> ScaledGain:
    """Gain of log-likelihood from one filter to another, innovations of each channel scaled, with tails for surprises.

    Noise levels belong to the logs that they were estimated from. On others, with pulses of a disturbance that those do
    not have, a filter that knows its machine better expects less noise, and loses likelihood by that alone: on a linear
    drive 4600 nats, beside innovations of a third. So whitened innovations of a channel are taken as Student's t with
    the scale that makes them likeliest and four degrees of freedom, Lange, Little and Taylor (1989), Robust statistical
    modeling using the t distribution, J. American Statistical Association 84(408). The first sample, which nothing
    predicts, does not count. The error rests on blocks of time.
    """
    with np.errstate(invalid="ignore", over="ignore"):  # of a filter that fails nothing is a number
        (first, _), (last, noise) = _scaled(before), _scaled(after)
        gains = last - first
    if not np.isfinite(gains).all():
        return ScaledGain(float(np.sum(gains)) if np.isfinite(first).all() else math.nan, math.nan, noise)
    sums = np.array([part.sum() for part in np.array_split(gains, WINDOWS)])
    error = float(sums.std(ddof=1) * np.sqrt(WINDOWS)) if gains.size >= 2 * WINDOWS else math.nan
    return ScaledGain(float(gains.sum()), error, noise)


def _scaled(runs: Sequence[FilterRun]) -> tuple[FloatArray, float]:
    """Scaled log-likelihoods of all samples but the first of each log, (n,), and the scale over all channels."""
    from scipy import stats  # slow to load, and only held-out logs of a correction ask for it

    z = np.concatenate([run.whitened[:, 1:] for run in runs], axis=1)
    log_s = np.concatenate([run.log_scales[:, 1:] for run in runs], axis=1)
    seen = np.concatenate([np.isfinite(run.y[:, 1:]) for run in runs], axis=1)
    gains = np.zeros(z.shape)
    for row in range(z.shape[0]):
        own = z[row, seen[row]]
        scale = _scale(own)
        gains[row, seen[row]] = stats.t.logpdf(own / scale, _TAILS) - np.log(scale) - log_s[row, seen[row]]
    return gains.sum(axis=0), float(np.sqrt(np.mean(z[seen] ** 2))) if seen.any() else math.nan


def _scale(z: FloatArray) -> float:
    """The likeliest scale of values (n,) with Student's t, by its fixed point; one of none and of zeros."""
    scale = float(np.sqrt(np.mean(z**2))) if z.size else 0.0
    for _ in range(_TURNS if 0.0 < scale < math.inf else 0):
        scale *= math.sqrt(float(np.mean((_TAILS + 1.0) * z**2 / (_TAILS * scale**2 + z**2))))
    return scale or 1.0


def gain_p_value(before: Sequence[FilterRun], after: Sequence[FilterRun]) -> float:
    """P-value of a gain of log-likelihood, by its scatter over blocks of time; one where there are too few samples.

    One that rests on few of them is worth little, however large. Reference: Vuong (1989), Econometrica 57(2).
    """
    gain, error = gain_interval(before, after, BLOCKS)
    return float(stdtr(BLOCKS - 1, -gain / error)) if error > 0.0 else 1.0


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
