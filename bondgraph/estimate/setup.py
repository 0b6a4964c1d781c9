"""How a declared model is filtered when nothing else is said: noises, start uncertainty and step from logs and model.

Measurement noise starts from what second differences of each channel show, process noise from the size of each state;
both are then estimated with the parameters, so these are starting points and not assumptions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.data.select import pieces
from bondgraph.errors import DataError, OptionError
from bondgraph.estimate.cyclic import ANYWHERE, repeats
from bondgraph.estimate.free import FreeParameter, declared_free
from bondgraph.estimate.initial import directly_measured, first_shown, initial_states
from bondgraph.filter.discretisation import step_times_rate
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.noise_choice import with_noise_nodes
from bondgraph.filter.runs import run
from bondgraph.simulate.late import first_inputs, inputs_of
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from bondgraph.text import few

#: Largest step times spectral radius that fixed-step RK4 takes (its limit of stability is 2.78).
_STEP_RADIUS = 1.8
#: A model that would need more explicit steps between two samples, at samples that are looked at or along the filter's
#: own course, is integrated by a stiff method: on a vehicle that coasts 29 of them cost as much as the steps of that.
_MOST_EXPLICIT = 25
#: Steps of a stiff method on the way; at the optimum of a vehicle with a gripping belt 12 gave the likelihood of 16 to
#: 0.03 nats and that of 32 to 4.4, while 8 missed it by 100.
_SEARCH_STEPS = 12
#: Each is this much longer than the one before, for sigma points relax anew after every sample when there is process
#: noise. Steps planned along the logs would be planned for the first guess of the noises, and a fit ends with others.
_SEARCH_GRADING = 1.35
_STIFF_METHOD = "ros3p"
#: Samples of each log at which its rates are looked at first.
_RATES = 25
#: A sensor's noise may be this much less than second differences say: beyond, its level has no slope to come back by.
_SENSOR_LOW = 1e-2
#: Process noise starts at this share of a state's size per sqrt(s), and may fall by this factor: a model with so little
#: is taken as next to exact, while searches with none at all are rugged.
_PROCESS_START, _PROCESS_LOW = 1e-3, 3e-2
#: Logs with fewer samples in a second are of a slow machine. Its level counts per square root of the time of so many
#: samples, the rate of the vehicles' logs: per root second it let a body that is read every 20 s walk by its sensor's
#: noise.
_SAMPLES = 20
#: A measured state starts at its first measurement, which the filter then takes once more: with so many standard
#: deviations of its sensor as uncertainty it counts as one sample. With one of them an outlier of 7.4 at the start of a
#: position cost 49 nats, which a bias of its sensor made good.
_START_WIDTH = 10.0
_SMALLEST = 1e-12
#: Samples of which second differences tell a level: two of these at least, whose median means something.
_FEWEST = 4
#: Rates are looked at along so many pieces of so many samples of a log that is longer than these, as a day is: each
#: piece is filtered with all that a filter records, and forty of its samples are looked at.
_PIECES, _PIECE = 8, 20_000


@dataclass(frozen=True)
class FilterSetup:
    """Filter model, free noise levels, and the sizes of the states that both were made from."""

    filter_model: FilterModel
    noise: tuple[FreeParameter, ...]
    sizes: FloatArray


def filter_setup(
    model: Model,
    driven: Sequence[str],
    logs: Sequence[MatchedLog],
    process_noise: str = "free",
    *,
    with_nodes: bool = True,
) -> FilterSetup:
    """Noises, start uncertainties and substeps for a model and its logs.

    Parameters
    ----------
    model
        The model.
    driven
        States on which process noise may act.
    logs
        Matched logs.
    process_noise
        ``"free"``: a level for every driven state is estimated. ``"none"``: the model is taken as exact, so
        that an estimate minimises the error of free simulation.
    with_nodes
        Decide how many nodes of process noise the logs need; else one, for those who take other things alone.

    Raises
    ------
    DataError
        If no output of the model is measured in any log.
    OptionError
        If ``process_noise`` is neither.
    """
    if process_noise not in ("free", "none"):
        raise OptionError(f"process noise {process_noise!r} - use 'free' or 'none'", where=(process_noise,))
    noise = {name: level for name, level in zip(model.names("output"), noise_levels(logs), strict=True) if level > 0}
    if not noise:
        raise _without_noise(model, logs)
    sizes = state_sizes(model, logs, looks_stiff(model, logs))
    unknown = unknown_drives(model, logs)
    share = _PROCESS_START / math.sqrt(max(1.0, _SAMPLES * _interval(logs)))
    process = {
        name: share * size
        for name, size in zip(model.names("state"), sizes, strict=True)
        if name in (*driven, *unknown) and process_noise == "free"
    }
    start_std = _start_std(model, logs, noise, sizes)
    looked_at = [piece for log in logs for piece in pieces(log, _PIECES, _PIECE)]
    filter_model = resolved(FilterModel(model, process, noise, start_std, substeps=1, alpha=1.0), looked_at)
    if with_nodes:
        filter_model = with_noise_nodes(filter_model, looked_at)
    least = {"std": _SENSOR_LOW, "process": _PROCESS_LOW}
    names = [f"std({name})" for name in noise] + [f"process({name})" for name in process]
    levels = [declared_free(name, filter_model, logs=logs) for name in names]
    rounding = {one.name: one.lower for one in levels if one.target.kind == "std"}
    free = [replace(one, lower=max(one.start * least[one.target.kind], rounding.get(one.name, 0.0))) for one in levels]
    return FilterSetup(filter_model, tuple(free), sizes)


def _without_noise(model: Model, logs: Sequence[MatchedLog]) -> DataError:
    """Why no noise of a sensor can be told: no output is measured, or none long enough."""
    names = model.names("output")
    seen = [name for row, name in enumerate(names) if any(np.isfinite(log.y[row]).any() for log in logs)]
    if seen:
        return DataError(
            f"{model.name}: no log has {_FEWEST} samples of {few(seen)}, which the noise of a sensor is taken from - "
            "give a longer log, or a longer part of it",
            where=(model.name, *seen),
        )
    return DataError(
        f"{model.name}: no log measures any of its outputs ({', '.join(names)}) - map columns with --map column=output",
        where=(model.name, *names),
    )


def _interval(logs: Sequence[MatchedLog]) -> float:
    """The usual interval between samples, s."""
    return float(np.median(np.concatenate([np.diff(log.time) for log in logs])))


def noise_levels(logs: Sequence[MatchedLog]) -> FloatArray:
    """Standard deviation of the fast part of each channel, shape (n_y,); zero where nothing was measured.

    Second differences of white noise have six times its variance, while a smooth signal nearly vanishes in them; their
    median absolute deviation does not mind outliers (factor 1.4826 for a Gaussian). A channel that is mostly constant
    because it is coarsely quantised takes the noise of its quantisation, step/sqrt(12).
    """
    levels = []
    for row in range(logs[0].y.shape[0]):
        measured = [log.y[row][~np.isnan(log.y[row])] for log in logs]
        pieces = [np.diff(values, 2) for values in measured if values.size >= _FEWEST]
        if not pieces:
            levels.append(0.0)
            continue
        second = np.concatenate(pieces)
        level = 1.4826 * float(np.median(np.abs(second))) / math.sqrt(6.0)
        steps = np.abs(np.concatenate([np.diff(values) for values in measured]))
        smallest = float(steps[steps > 0].min()) if (steps > 0).any() else 0.0
        spread = float(np.std(np.concatenate(measured)))
        levels.append(max(level, smallest / math.sqrt(12.0), 1e-6 * spread, _SMALLEST))
    return np.array(levels)


def unknown_drives(model: Model, logs: Sequence[MatchedLog]) -> tuple[str, ...]:
    """States that an input drives alone of which no log knows anything: they walk at random.

    An input that is the same throughout all logs, at the value it has by default, was not recorded. Where the rate of a
    state is nothing but that input (the inclination of a road, a wind), the state goes where nobody knows.
    """
    x0, u0, theta = model.x0(), model.u0(), model.theta()
    every = [inputs_of(model, log) for log in logs]
    silent = [row for row in range(len(model.inputs)) if all(bool(np.all(u[row] == u0[row])) for u in every)]
    found = []
    with np.errstate(all="ignore"):
        away = x0 + 0.1 * np.maximum(np.abs(x0), 1.0)
        still = np.array([model.rhs(0.0, x, u0, theta) for x in (x0, away)])
        for row in silent:
            moved = u0.copy()
            moved[row] += 1.0
            pushed = np.array([model.rhs(0.0, x, moved, theta) for x in (x0, away)])
            alone = (still == 0.0).all(axis=0) & (pushed != 0.0).all(axis=0)
            found += [model.names("state")[k] for k in np.flatnonzero(alone)]
    return tuple(found)


def state_sizes(model: Model, logs: Sequence[MatchedLog], stiff: bool = False) -> FloatArray:
    """How large each state gets, shape (n_x,): from what is measured of it, else a simulation, else its start.

    One that no simulation moves is at most as large as the sensors that show it, and an angle that acts by its sine is
    somewhere in one turn.
    """
    theta = model.theta()
    sizes = np.abs(model.x0())
    measured = directly_measured(model, first_inputs(model, logs[0]), theta)
    for output, (state, slope, offset) in measured.items():
        seen = np.concatenate([log.y[output] for log in logs])
        if np.isfinite(seen).any():
            sizes[state] = max(sizes[state], float(np.nanmax(np.abs((seen - offset) / slope))))
    if np.any(sizes < _SMALLEST):
        reached = _reached(model, logs, stiff)
        sizes = np.where(sizes < _SMALLEST, reached, sizes)
    if np.any(sizes < _SMALLEST):
        sizes = np.where(sizes < _SMALLEST, _shown(model, logs), sizes)
    sizes = np.where(sizes < _SMALLEST, 1.0, sizes)
    large = sizes > ANYWHERE
    return np.where(large & repeats(model, sizes), ANYWHERE, sizes) if large.any() else sizes


def _shown(model: Model, logs: Sequence[MatchedLog]) -> FloatArray:
    """How large states can be before some sensor would show more than it ever did; zero where none shows them."""
    x0, u0, theta = model.x0(), model.u0(), model.theta()
    largest = np.array([np.nanmax(np.abs(log.y), axis=1, initial=0.0) for log in logs]).max(axis=0)
    found = np.full(x0.size, np.inf)
    for k in range(x0.size):
        moved = x0.copy()
        moved[k] += 1e-4
        with np.errstate(all="ignore"):
            slopes = np.abs(model.output(0.0, moved, u0, theta) - model.output(0.0, x0, u0, theta)) / 1e-4
            limits = largest / slopes
        shows = (slopes > 1e-6) & (largest > 0.0)
        found[k] = float(np.min(limits[shows], initial=np.inf))
    return np.where(np.isfinite(found), found, 0.0)


def looks_stiff(model: Model, logs: Sequence[MatchedLog]) -> bool:
    """Whether explicit steps would have to be very short, by the model's rates at the measured states."""
    theta = model.theta()
    measured = directly_measured(model, first_inputs(model, logs[0]), theta)
    fastest = 0.0
    for log in logs:
        for k in np.unique(np.linspace(0, log.time.size - 1, _RATES).astype(int)):
            x = model.x0()
            for output, (state, slope, offset) in measured.items():
                if np.isfinite(log.y[output, k]):
                    x[state] = (log.y[output, k] - offset) / slope
            with np.errstate(all="ignore"):
                slopes = model.jacobian_x(float(log.time[k]), x, inputs_of(model, log)[:, k], theta)
            if np.isfinite(slopes).all():
                step = float(np.median(np.diff(log.time)))
                fastest = max(fastest, step * float(np.abs(np.linalg.eigvals(slopes)).max(initial=0.0)))
    return fastest > _MOST_EXPLICIT * _STEP_RADIUS


def _reached(model: Model, logs: Sequence[MatchedLog], stiff: bool) -> FloatArray:
    """Largest states in the first tenth of a free simulation of the first log; zero where it fails."""
    log = logs[0]
    count = max(20, log.time.size // 10)
    x0 = initial_states(model, [log], model.theta(), "measured")[0]
    method: dict[str, Any] = {"method": "ros3p", "substeps": 16, "compiled": True} if stiff else {"rtol": 1e-4}
    run = simulate(model, log.time[:count], inputs_of(model, log)[:, :count], _theta(model, log), x0, **method)
    with np.errstate(all="ignore"):
        reached = np.nanmax(np.abs(run.x), axis=1)
    return np.where(np.isfinite(reached), reached, 0.0)


def _theta(model: Model, log: MatchedLog) -> FloatArray:
    return model.theta(**dict(log.theta_overrides))


def _start_std(
    model: Model, logs: Sequence[MatchedLog], noise: dict[str, float], sizes: FloatArray
) -> dict[str, float]:
    """A measured state starts anywhere near its first measurement, any other anywhere within its size."""
    std = dict(zip(model.names("state"), map(float, sizes), strict=True))
    for output, one in first_shown(model, logs[0], model.theta()).items():
        name = model.names("output")[output]
        if name in noise:
            sensor, size = abs(noise[name] / one.slope), sizes[one.state]
            std[model.names("state")[one.state]] = max(min(_START_WIDTH * sensor, size), sensor, 1e-9 * size)
    return {name: max(value, _SMALLEST) for name, value in std.items()}


def resolved(filter_model: FilterModel, logs: Sequence[MatchedLog]) -> FilterModel:
    """The filter with an integration that resolves its model along the logs: explicit where that is not too fine.

    A belt may grip at none of the samples that are looked at first; the filter's own course then shows it.
    """
    if not looks_stiff(filter_model.model, logs):
        explicit = fine_enough(filter_model, logs)
        if explicit.substeps <= _MOST_EXPLICIT:
            return explicit
    return replace(filter_model, method=_STIFF_METHOD, substeps=_SEARCH_STEPS, grading=_SEARCH_GRADING)


def fine_enough(filter_model: FilterModel, logs: Sequence[MatchedLog]) -> FilterModel:
    """The filter with as many substeps as keep step times fastest rate moderate along its own filtered states.

    The rates of a model depend on where it is (a slipping belt is slow, a gripping one fast), and states that are not
    measured are known only to the filter; so it is run, looked at, and refined until it is stable.
    """
    model = filter_model.model
    while filter_model.substeps <= _MOST_EXPLICIT:
        largest = 0.0
        for log in logs:
            theta = _theta(model, log)
            x0 = initial_states(model, [log], theta, "measured")[0]
            largest = max(largest, step_times_rate(run(filter_model, log, theta, x0=x0), log, theta))
        if largest <= _STEP_RADIUS:
            break
        factor = largest / _STEP_RADIUS if math.isfinite(largest) else 2.0
        wanted = math.ceil(filter_model.substeps * min(max(factor, 1.25), 4.0))
        filter_model = replace(filter_model, substeps=wanted)
    return filter_model
