"""Rhythms: disturbances that repeat, as a load that is switched, a tooth that is broken, or the sun by day.

A disturbance of first order describes what wanders; what repeats leaves a line in the spectrum of the innovations, and
is described beside it as a shaping filter of second order,

    dx/dt = -x/T - w*y + noise, dy/dt = w*x - y/T, w = 2*pi/P,

whose covariance is nearly that of a cosine of the period P that is forgotten in the time T. References: Maybeck (1979),
Stochastic Models, Estimation, and Control, volume 1, section 4.11; Harvey (1989), Forecasting, Structural Time Series
Models and the Kalman Filter, section 2.3, for stochastic cycles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from bondgraph.build import BuiltModel, build
from bondgraph.correct.evidence.trials import Evidence, Trial
from bondgraph.correct.fits.assess import gain_p_value
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.models.shaping_filters import rhythm_at_state
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.follows import Follow

#: Times for which a rhythm is kept that are tried, as shares of the logarithm from a period to the longest log.
_TIMES = (0.3, 0.65, 1.0)
#: Sizes that are tried, as shares of that of the disturbance beside it.
_SIZES = (0.1, 0.3, 1.0)
#: The noise is searched so far beyond these, either way: three decades, a convention.
_FARTHEST = 1e3
_ITERATIONS, _TOLERANCE = 40, 0.05
#: Frequencies over whose mean a line stands out: enough for a mean, few enough that a spectrum is even over them. Those
#: next to a line have a part of it, where its period is no part of the log.
_AROUND, _NEXT = 51, 2
#: Share by which intervals between samples of one rate differ at most, by rounding of what was written.
_SAME_RATE = 1e-3
_NEIGHBOURS = np.where(np.abs(np.arange(_AROUND) - _AROUND // 2) > _NEXT, 1.0, 0.0) / (_AROUND - 2 * _NEXT - 1)


def line(fitted: Fit, level: float) -> float | None:
    """Period in s of the lowest line in the spectra of the innovations; None where none stands out at a level.

    Spectra of the logs are added up, channel by channel, and each ordinate is compared with the mean of its neighbours,
    by Fisher's distribution F. What is no sine leaves lines at multiples too, so that the lowest one counts.
    """
    steps = [float(np.median(np.diff(log.time))) for log in fitted.problem.logs]
    step = min(steps)  # spectra of other rates are of other frequencies
    logs = [log for log, own in zip(fitted.problem.logs, steps, strict=True) if own < step * (1.0 + _SAME_RATE)]
    runs = fitted.runs(logs)
    count = max(run.time.size for run in runs)
    found = []
    for row in range(len(fitted.problem.filter_model.model.outputs)):
        powers = [power for run in runs if (power := _spectrum(run, row, count)) is not None]
        if not powers or powers[0].size < 2 * _AROUND:
            continue
        whole = np.sum(powers, axis=0)
        beside = np.convolve(np.pad(whole, _AROUND // 2, mode="reflect"), _NEIGHBOURS, mode="valid")
        over = whole / np.maximum(beside, np.finfo(float).tiny)
        chance = stats.f.sf(over, 2 * len(powers), 2 * len(powers) * np.count_nonzero(_NEIGHBOURS)) * over.size
        found += [step * count / (k + 1) for k in np.flatnonzero(chance < level / len(runs[0].y))[:1]]
    return max(found, default=None)


def _spectrum(run: FilterRun, row: int, count: int) -> FloatArray | None:
    """The spectrum of the innovations of a channel without its mean, as of so many samples; None without samples."""
    seen = np.where(np.isnan(run.y[row]), np.nan, run.whitened[row])
    if np.isfinite(seen).sum() < _AROUND:
        return None
    values = np.nan_to_num(seen - np.nanmean(seen))
    power: FloatArray = np.abs(np.fft.rfft(values, count)[1:]) ** 2 / values.size
    return power


def rhythm(
    built: BuiltModel, base: Fit, train: Sequence[MatchedLog], first: Trial, state: str, level: float, journal: Journal
) -> Trial | None:
    """The rhythm beside a disturbance of first order, if it shows as a line and passes its tests.

    Parameters
    ----------
    built, base, train
        The model with the first disturbance, its fit and the logs of that.
    first, state
        That disturbance, and the state on which it acts.
    level
        Chance of a false alarm.
    journal
        Finished fits.
    """
    seconds = line(base, level)
    made = None if seconds is None else rhythm_at_state(built, train, state, seconds)
    if made is None:
        return None
    candidate = made[0]
    return attempted(lambda: _estimated(candidate, built, base, first, level, journal), lambda why: None)


def _estimated(
    candidate: Candidate, built: BuiltModel, base: Fit, first: Trial, level: float, journal: Journal
) -> Trial | None:
    """The trial of a rhythm, estimated with everything else; None where it does not pass."""
    extended = build(candidate.apply(built.graph))
    own, (time, *_) = first.candidate.effect.element, first.candidate.effect.shapes
    size = base.values[f"process({own})"] * float(np.sqrt(0.5 * base.values[time]))
    problem = _problem(extended, candidate, base, size)
    starts = [
        np.concatenate([base.point, _ends(problem, share, many * size)]) for share in _TIMES for many in _SIZES
    ]  # fmt: skip
    values = problem.nll(np.array(starts).T)
    best = starts[int(np.argmin(np.where(np.isfinite(values), values, np.inf)))]
    fitted = fit(problem, _ITERATIONS, _TOLERANCE, [best], journal=journal)
    gain = base.nll - fitted.nll
    measured = sum(int(np.isfinite(log.y).sum()) for log in problem.logs)
    ratio = float(stats.chi2.sf(2.0 * max(gain, 0.0), 3))  # its intensity, its period and the time it keeps that
    evidence = Evidence(
        gain, ratio, gain_p_value(base.own_runs, fitted.own_runs), gain - 1.5 * float(np.log(max(measured, 2))), 1
    )  # fmt: skip
    trial = Trial(candidate, gain, built=extended, fit=fitted, evidence=evidence)
    return trial if evidence.accepted(level) else None


def _problem(extended: BuiltModel, candidate: Candidate, base: Fit, size: float) -> EstimationProblem:
    """The problem of the model with a rhythm, its noise, time and period free beside everything else."""
    own, logs, used = candidate.effect.element, base.problem.logs, base.problem.filter_model
    setup = filter_setup(extended.model, [own], logs, with_nodes=False)
    both = (own, f"{own}_quarter")
    filter_model = replace(
        used,
        model=extended.model,
        process_noise={**used.process_noise, own: setup.filter_model.process_noise[own]},
        initial_std={**used.initial_std, **dict.fromkeys(both, size)},
        follows={**used.follows, **dict.fromkeys(both, Follow(0.0))},
    )
    free = list(at_optimum(base))
    for name in candidate.effect.shapes:
        lower, upper = candidate.bounds(name)
        free.append(FreeParameter(name, lower, upper, float(np.sqrt(lower * upper)), scale="log"))
    level = next(one for one in setup.noise if one.name == f"process({own})")
    usual = _noise(size, free[-2].start)
    free.append(replace(level, lower=usual / _FARTHEST, upper=usual * _FARTHEST, start=usual))
    return EstimationProblem(filter_model, logs, tuple(free), base.problem.initial)


def _ends(problem: EstimationProblem, share: float, size: float) -> list[float]:
    """Coordinates of the time, the period and the noise of a rhythm of a size (std); the time as a share."""
    time, period, level = problem.free[-3:]
    seconds = float(time.lower * (time.upper / time.lower) ** share)
    noise = float(np.clip(_noise(size, seconds), level.lower, level.upper))
    return [time.coordinate(seconds), period.coordinate(period.start), level.coordinate(noise)]


def _noise(size: float, seconds: float) -> float:
    """The noise that drives a rhythm of a size (std): its variance is noise^2*T/4 where it lasts for many periods."""
    return size * float(np.sqrt(4.0 / seconds))
