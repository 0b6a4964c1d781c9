"""How large and how small a noise level can be, by what the logs themselves can show.

A level is searched over many powers of ten, so its bounds must come from the data and not from a guess of its size. A
sensor's noise is at most the range of its channel. Noise that drives a state is at most what would move some channel
through its whole range within one sample: the state is pushed, and the machine, linearised where the logs begin,
carries the push to the sensors. Both are at least a millionth of that, the resolution of a good measurement chain (20
bits).

A sensor that shows multiples of a step only, a counter or a number written with two decimals, is off by the rounding at
least: the step over the root of twelve, Widrow, Kollar and Liu (1996), Statistical theory of quantization, IEEE
Transactions on Instrumentation and Measurement 45(2). A model that follows such a sensor closer takes its rounding for
motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.initial import initial_states
from bondgraph.estimate.objective import FloatArray
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.model import Model

#: Resolution of a measurement chain of 20 bits.
RESOLUTION = 2.0**-20

#: Numbers count as multiples of a step where they are off by less than this share of it.
_OFF = 0.02
#: Of so many gaps between any numbers all are multiples of the smallest, to that share, once in ten million times.
_FEWEST_GAPS = 6
#: A step below this share of the largest number is that of the floating-point numbers.
_FLOATS = 1e-12

#: Times after a push at which sensors are looked at: so many doublings of the sampling interval, a thousand samples.
_DOUBLINGS = 10

#: Relative step of the differences by which outputs are linearised.
_STEP = 1e-6


def sensor_bounds(logs: Sequence[MatchedLog], output: int) -> tuple[float, float] | None:
    """Least and largest standard deviation of a sensor's noise, in the unit of its channel; None where it is constant.

    Examples
    --------
    >>> log = MatchedLog("run", np.arange(3.0), np.zeros((0, 3)), np.array([[1.0, 3.0, 2.0]]))
    >>> sensor_bounds([log], 0)[1]
    2.0
    """
    span = _span(logs, output)
    return (RESOLUTION * span, span) if span > 0.0 else None


def sensor_rounding(logs: Sequence[MatchedLog], output: int) -> float:
    """The standard deviation of the rounding of a channel; zero where it shows no step.

    Examples
    --------
    >>> shown = 0.5 * np.round(20.0 * np.sin(np.arange(40.0)))
    >>> log = MatchedLog("run", np.arange(40.0), np.zeros((0, 40)), shown[np.newaxis])
    >>> round(sensor_rounding([log], 0), 4)
    0.1443
    """
    return step_shown(np.concatenate([log.y[output] for log in logs])) / math.sqrt(12.0)


def step_shown(values: FloatArray) -> float:
    """The step of which all values (n,) of a channel are multiples, beside an offset; zero where there is none.

    Examples
    --------
    >>> shown = np.array([3.0, 3.5, np.nan, 7.0, 9.5, 3.0, 4.0, 12.0, 13.0])
    >>> step_shown(shown), step_shown(np.sqrt(shown))
    (0.5, 0.0)
    """
    levels = np.unique(values[np.isfinite(values)])
    gaps = np.diff(levels)
    gaps = gaps[gaps > _FLOATS * float(np.abs(levels).max(initial=0.0))]
    if gaps.size < _FEWEST_GAPS:
        return 0.0
    many = gaps / gaps.min()
    return float(gaps.min()) if np.all(np.abs(many - np.round(many)) < _OFF) else 0.0


def process_bounds(
    model: Model, logs: Sequence[MatchedLog], theta: FloatArray, state: int
) -> tuple[float, float] | None:
    """Least and largest intensity of the noise that drives a state, per sqrt(s); None where no channel shows it.

    Parameters
    ----------
    model, logs
        The model, and logs matched to it.
    theta
        Parameters, shape (n_theta,).
    state
        Index of the state.
    """
    found = [_largest_push(model, logs, log, theta, state) for log in logs]
    levels = [push / math.sqrt(interval) for push, interval in filter(None, found)]
    return (RESOLUTION * max(levels), max(levels)) if levels else None


def _largest_push(
    model: Model, logs: Sequence[MatchedLog], log: MatchedLog, theta: FloatArray, state: int
) -> tuple[float, float] | None:
    """The smallest push of a state that moves some channel through its range, and the sampling interval."""
    if log.time.size < 2:
        return None
    own = theta.copy()
    for name, value in log.theta_overrides.items():
        own[model.index("parameter", name)] = value
    (x,) = initial_states(model, [log], own, "measured")
    interval = float(np.median(np.diff(log.time)))
    middle = inputs_of(model, log)[:, log.time.size // 2]
    with np.errstate(all="ignore"):
        slope = model.jacobian_x(float(log.time[0]), x, middle, own)
        shown = _output_slopes(model, float(log.time[0]), x, middle, own)
        if not (np.isfinite(slope).all() and np.isfinite(shown).all()):
            return None
        move = expm(slope * interval)
        peaks = np.abs(shown[:, state])
        for _ in range(_DOUBLINGS):
            seen = np.abs((shown @ move)[:, state])
            peaks = np.where(np.isfinite(seen), np.maximum(peaks, seen), peaks)
            move = move @ move
    spans = np.array([_span(logs, output) for output in range(len(model.outputs))])
    telling = (peaks > 0.0) & (spans > 0.0)
    return (float(np.min(spans[telling] / peaks[telling])), interval) if telling.any() else None


def _output_slopes(model: Model, t: float, x: FloatArray, u: FloatArray, theta: FloatArray) -> FloatArray:
    """Derivatives (n_y, n_x) of the outputs by the states, by central differences."""
    steps = _STEP * np.maximum(np.abs(x), 1.0)
    both = [model.output(t, x[:, np.newaxis] + sign * np.diag(steps), u, theta) for sign in (1.0, -1.0)]
    slopes: FloatArray = (both[0] - both[1]) / (2.0 * steps)
    return slopes


def _span(logs: Sequence[MatchedLog], output: int) -> float:
    """Range of a channel over all logs; zero where it was not measured."""
    measured = np.concatenate([log.y[output][~np.isnan(log.y[output])] for log in logs])
    return float(np.ptp(measured)) if measured.size else 0.0
