"""How whitened innovations respond to a small change of the model: the filter linearised along its own run, gains held.

A change of the model shifts the rates of the states by some df(t) and the outputs by some dh(t) along the run. Held at
its gains, the filter passes that on linearly from sample to sample:

    dx-[k] = F[k] dx[k-1] + T phi1 df[k-1] + T phi2 (df[k] - df[k-1]),      dy[k] = H[k] dx-[k] + dh[k],
    dz[k]  = -W[k] dy[k],                                                    dx[k] = dx-[k] - K[k] dy[k],

with the transition F = exp(A T), phi1 and phi2 the integrals of the exponential for rates that are linear over the
interval, W the inverse Cholesky factor of the innovation covariance and K the gain. Any number of changes go through
together, each a lane, at the cost of one pass. Reference for the phi functions: Hochbruck and Ostermann (2010),
Exponential integrators, Acta Numerica 19; for scores by a linearised filter: Basseville and Nikiforov (1993), Detection
of Abrupt Changes, chapter 8.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from bondgraph.compile.machine_code import has_numba
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.errors import FilterError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.linear.exponentials import phi
from bondgraph.filter.linear.intervals import NODES, Kicks, filter_transitions, kicks
from bondgraph.filter.samples import Samples
from bondgraph.simulate.inputs import hold_flags
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.model import Model

#: Finite differences take at least this share of a state's largest value.
_FINEST = 1e-6
#: Samples of a piece of lanes that are joined.
_PIECE = 128


@dataclass(frozen=True)
class Path:
    """Where one log leads a model: the points at which a changed model is compared with the declared one.

    ``start`` and ``end`` (n_x, n - 1) are the states at both ends of every interval (of a stiff model at two points
    inside it), ``u_left`` and ``u_right`` (n_u, n - 1) the inputs there; ``before`` (n_x, n) the states expected before
    each measurement, ``u`` (n_u, n) and ``time`` (n,) at the samples; ``theta`` (n_theta,) the parameters of this log;
    ``shares`` the parts of an interval that have passed at its two points.
    """

    model: Model
    log: MatchedLog
    time: FloatArray
    start: FloatArray
    end: FloatArray
    u_left: FloatArray
    u_right: FloatArray
    before: FloatArray
    u: FloatArray
    theta: FloatArray
    shares: tuple[float, ...] = (0.0, 1.0)

    def inputs_for(self, other: Model) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Inputs of another model at both ends of the intervals, and at the samples; late ones follow from the log."""
        names = self.model.names("input")
        if other.names("input") == names:
            return self.u_left, self.u_right, self.u
        u = inputs_of(other, self.log).copy()
        left = u[:, :-1]
        bend = np.where(hold_flags(other)[:, np.newaxis], 0.0, u[:, 1:] - left)
        ends = [left + share * bend for share in self.shares]
        for row, name in enumerate(other.names("input")):
            if name in names:
                known = names.index(name)
                ends[0][row], ends[1][row], u[row] = self.u_left[known], self.u_right[known], self.u[known]
        return ends[0], ends[1], u

    @property
    def intervals(self) -> FloatArray:
        """Lengths of the intervals, shape (n - 1,)."""
        return np.diff(self.time)

    def parameters(self, other: Model) -> dict[str, float]:
        """Parameters by name for another model, as far as it has those of the model of this path."""
        known = other.names("parameter")
        values = zip(self.model.names("parameter"), map(float, self.theta), strict=True)
        return {name: value for name, value in values if name in known}

    @functools.cached_property
    def declared(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rates of the states at both ends of the intervals, and outputs: what changed models are compared with."""
        model = self.model
        with np.errstate(all="ignore"):
            return (
                model.rhs(self.time[:-1], self.start, self.u_left, self.theta),
                model.rhs(self.time[1:], self.end, self.u_right, self.theta),
                model.output(self.time, self.before, self.u, self.theta),
            )


@dataclass(frozen=True)
class LinearLog:
    """The linearised filter over one log; arrays have samples first.

    ``transition`` of the states over an interval, ``early`` and ``late`` what shifts of the rates at its two points
    leave at its end (n - 1, n_x, n_x), ``slope`` (n, n_y, n_x), ``gain`` (n, n_x, n_y), ``whitener`` (n, n_y, n_y),
    zero rows for what was not measured; ``whitened`` (n_y, n).
    """

    path: Path
    transition: FloatArray
    early: FloatArray
    late: FloatArray
    slope: FloatArray
    gain: FloatArray
    whitener: FloatArray
    whitened: FloatArray


@dataclass(frozen=True)
class Change:
    """How changes of the model shift it along one log, each lane a change.

    ``start`` and ``end`` (n_x, n - 1, lanes) are shifts of the rates, ``outputs`` (n_y, n, lanes) of the outputs;
    ``begun`` (n_x, lanes) are shifts of the initial states, None: there are none.
    """

    start: FloatArray
    end: FloatArray
    outputs: FloatArray
    begun: FloatArray | None = None


def linearise(run: FilterRun, log: MatchedLog, theta: FloatArray, kicked: Kicks | None = None) -> LinearLog:
    """The filter of a run with its gains held.

    Parameters
    ----------
    run
        The record of the filter over the log.
    log
        The log.
    theta
        Parameters (n_theta,) with which it ran; what the log knows is taken from the log.
    kicked
        Of a stiff model: what :func:`kicked_along` gave for a run next to this one; None: it is asked anew.
    """
    filter_model = run.filter_model
    model, samples = filter_model.model, Samples.whole(filter_model, log)
    own = samples.theta(filter_model, theta)
    spread = np.sqrt(np.maximum(np.einsum("iik->ik", run.predicted_cov), 0.0))
    step = np.maximum(spread, _FINEST * np.maximum(np.abs(run.predicted_mean).max(axis=1, keepdims=True), 1e-3))
    slope = _slopes(lambda x: model.output(log.time, x, _lanes(samples.u, x), own), run.predicted_mean, step)
    whitener, gain = _update(run, slope)
    stiff = filter_model.is_stiff and has_numba()
    found = _relaxing(run, log, samples, own, kicked) if stiff else _smooth(run, log, samples, own, step)
    path, transition, early, late = found
    return LinearLog(path, transition, early, late, slope, gain, whitener, run.whitened)


def _smooth(
    run: FilterRun, log: MatchedLog, samples: Samples, own: FloatArray, step: FloatArray
) -> tuple[Path, FloatArray, FloatArray, FloatArray]:
    """The path of a model that hardly bends over an interval, with transitions from its slopes at both ends."""
    model, time = run.filter_model.model, log.time
    path = Path(
        model, log, time, run.filtered_mean[:, :-1], run.predicted_mean[:, 1:], samples.u_left, samples.u_right,
        run.predicted_mean, samples.u, own,
    )  # fmt: skip
    first = _slopes(lambda x: model.rhs(time[:-1], x, _lanes(path.u_left, x), own), path.start, step[:, :-1])
    last = _slopes(lambda x: model.rhs(time[1:], x, _lanes(path.u_right, x), own), path.end, step[:, 1:])
    return path, *_transitions(0.5 * (first + last), path.intervals)


def kicked_along(run: FilterRun, log: MatchedLog, theta: FloatArray) -> Kicks:
    """What kicks of the states of a stiff model leave, along the run of its filter over a log with theta (n_theta,)."""
    samples = Samples.whole(run.filter_model, log)
    return kicks(run.filter_model, samples, run.filtered_mean[:, :-1], samples.theta(run.filter_model, theta))


def _relaxing(
    run: FilterRun, log: MatchedLog, samples: Samples, own: FloatArray, kicked: Kicks | None
) -> tuple[Path, FloatArray, FloatArray, FloatArray]:
    """The path of a stiff model, with the transitions of :mod:`bondgraph.filter.linear.intervals`."""
    found = kicks(run.filter_model, samples, run.filtered_mean[:, :-1], own) if kicked is None else kicked
    before = run.predicted_mean
    path = Path(
        run.filter_model.model, log, log.time, before[:, :-1], before[:, 1:], samples.u_left, samples.u_right, before,
        samples.u, own,
    )  # fmt: skip
    path = _between_samples(path, samples, found.reached)
    return path, filter_transitions(run), *_by_nodes(found.moved, path.intervals)


def _transitions(slopes: FloatArray, intervals: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Transitions of linear rates, and what shifts of them at both ends of each interval leave."""
    lengths = intervals[:, np.newaxis, np.newaxis]
    whole, level, ramp = phi(slopes * lengths)
    return whole, lengths * (level - ramp), lengths * ramp


def open_loop(path: Path, filter_model: FilterModel, noise_std: FloatArray) -> LinearLog:
    """A model left alone along a path, its sensors (n_y,) as noisy as said: the filter without gains."""
    model = filter_model.model
    slope = output_slopes(path, model)
    count, outputs, size = slope.shape
    whitener = np.broadcast_to(np.diag(np.nan_to_num(1.0 / noise_std)), (count, outputs, outputs))
    gain, whitened = np.zeros((count, size, outputs)), np.zeros((outputs, count))
    if filter_model.is_stiff and has_numba():
        samples = Samples.whole(filter_model, path.log)
        found = kicks(filter_model, samples, path.before[:, :-1], path.theta, (0.0, *NODES))
        transition, (early, late) = found.moved[:, 0], _by_nodes(found.moved[:, 1:], path.intervals)
        path = _between_samples(path, samples, found.reached[:, 1:])
    else:
        step = np.maximum(_FINEST * np.abs(path.before).max(axis=1, keepdims=True), 1e-9) * np.ones(path.before.shape)
        first, last = (
            _slopes(lambda x, t=t, u=u: model.rhs(t, x, _lanes(u, x), path.theta), at, step[:, 1:])  # type: ignore[misc]
            for t, u, at in ((path.time[:-1], path.u_left, path.start), (path.time[1:], path.u_right, path.end))
        )
        transition, early, late = _transitions(0.5 * (first + last), path.intervals)
    return LinearLog(path, transition, early, late, slope, gain, whitener, whitened)


def _between_samples(path: Path, samples: Samples, reached: FloatArray) -> Path:
    """The path of a stiff model: states (n - 1, nodes, n_x) and inputs at the points of the quadrature."""
    bend = samples.u_right - samples.u_left
    left, right = (samples.u_left + node * bend for node in NODES)
    return replace(path, start=reached[:, 0].T, end=reached[:, 1].T, u_left=left, u_right=right, shares=tuple(NODES))


def _by_nodes(moved: FloatArray, intervals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What shifts of the rates at both points of the quadrature leave."""
    early, late = (0.5 * intervals[:, np.newaxis, np.newaxis] * moved[:, node] for node in (0, 1))
    return early, late


def output_slopes(path: Path, model: Model) -> FloatArray:
    """Derivatives of all outputs by the states along a path, shape (n, n_y, n_x)."""
    step = np.maximum(_FINEST * np.abs(path.before).max(axis=1, keepdims=True), 1e-9) * np.ones(path.before.shape)
    return _slopes(lambda x: model.output(path.time, x, _lanes(path.u, x), path.theta), path.before, step)


def _lanes(u: FloatArray, x: FloatArray) -> FloatArray:
    """Inputs (n_u, n) for points (n_x, lanes, n)."""
    return np.broadcast_to(u[:, np.newaxis], (u.shape[0], *x.shape[1:]))


def _slopes(function: Callable[[FloatArray], FloatArray], points: FloatArray, step: FloatArray) -> FloatArray:
    """Derivatives of a function of the states at points (n_x, n), shape (n, rows, n_x), by central differences."""
    size = points.shape[0]
    offsets = np.eye(size)[:, :, np.newaxis] * step[:, np.newaxis]
    middle = np.repeat(points[:, np.newaxis], size, axis=1)
    with np.errstate(all="ignore"):
        above, below = function(middle + offsets), function(middle - offsets)
    slopes = (above - below) / (2.0 * step)[np.newaxis]
    return np.nan_to_num(np.moveaxis(slopes, -1, 0), nan=0.0, posinf=0.0, neginf=0.0)


def _update(run: FilterRun, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Whitening matrices (n, n_y, n_y) and gains (n, n_x, n_y); what was not measured has no part in either.

    Raises
    ------
    FilterError
        If the covariance of the outputs is singular at a sample.
    """
    seen = np.isfinite(run.y).T
    both = seen[:, :, np.newaxis] & seen[:, np.newaxis]
    size = seen.shape[1]
    cov = np.where(both, np.moveaxis(run.output_cov, -1, 0), 0.0) + np.eye(size) * ~seen[:, :, np.newaxis]
    try:
        whitener = np.linalg.inv(np.linalg.cholesky(cov)) * both
    except np.linalg.LinAlgError as error:
        raise FilterError(
            f"{run.log_name}: the covariance of what is expected of the sensors is not positive definite to rounding "
            "- use larger measurement noise, or smaller initial uncertainty",
            where=(run.log_name,),
        ) from error
    known = slope * seen[:, :, np.newaxis]
    cross = np.moveaxis(run.predicted_cov, -1, 0) @ np.swapaxes(known, 1, 2)
    return whitener, cross @ np.swapaxes(whitener, 1, 2) @ whitener


def model_change(path: Path, changed: Model, theta: FloatArray, size: float) -> Change:
    """The shift of rates and outputs along a path from its model to another, divided by ``size``; one lane.

    States of the changed model that the declared one does not have start at their declared values and follow the path
    (:func:`own_states`). ``theta`` are the parameters of the changed model.
    """
    rows = np.array([changed.index("state", name) for name in path.model.names("state")], dtype=int)
    own = own_states(path, changed, theta)
    first, last, shown = path.declared
    left, right, at_samples = path.inputs_for(changed)
    with np.errstate(all="ignore"):
        shifts = []
        for t, x, u, extra, before in (
            (path.time[:-1], path.start, left, own[:, :-1], first),
            (path.time[1:], path.end, right, own[:, 1:], last),
        ):
            shifts.append((changed.rhs(t, _joined(changed, rows, x, extra), u, theta)[rows] - before) / size)
        outputs = changed.output(path.time, _joined(changed, rows, path.before, own), at_samples, theta)
        outputs = (outputs - shown) / size
    start, end, seen = (np.nan_to_num(a, nan=0.0, posinf=0.0, neginf=0.0)[..., np.newaxis] for a in (*shifts, outputs))
    return Change(start, end, seen)


def _joined(changed: Model, rows: np.ndarray, x: FloatArray, extra: FloatArray) -> FloatArray:
    """States of the changed model from those of the declared one and its own."""
    joined = np.empty((len(changed.states), x.shape[1]))
    joined[rows] = x
    joined[_others(changed, rows)] = extra
    return joined


def _others(changed: Model, rows: np.ndarray) -> np.ndarray:
    return np.setdiff1d(np.arange(len(changed.states)), rows)


def own_states(path: Path, changed: Model, theta: FloatArray) -> FloatArray:
    """States that only the changed model has, carried along the path from where they settle at its first point.

    Their rates are taken as linear in them, which those of lags, integrals and friction with hysteresis are; shape
    (extra, n).
    """
    rows = np.array([changed.index("state", name) for name in path.model.names("state")], dtype=int)
    others = _others(changed, rows)
    found = np.empty((others.size, path.time.size))
    if not others.size:
        return found
    start = changed.x0(theta)[others]

    def rates(t: FloatArray, x: FloatArray, u: FloatArray, own: FloatArray) -> FloatArray:
        extra = np.repeat(own[:, np.newaxis], x.shape[1], axis=1)
        with np.errstate(all="ignore"):
            moved: FloatArray = changed.rhs(t, _joined(changed, rows, x, extra), u, theta)[others]
        return np.where(np.isfinite(moved), moved, 0.0)

    levels, slopes = [], []
    left, right, _ = path.inputs_for(changed)
    for t, x, u in ((path.time[:-1], path.start, left), (path.time[1:], path.end, right)):
        level = rates(t, x, u, start)
        levels.append(level.T)
        slopes.append(
            np.moveaxis(np.array([rates(t, x, u, start + unit) - level for unit in np.eye(start.size)]), 2, 0)
        )
    lengths = path.intervals[:, np.newaxis, np.newaxis]
    slope = 0.5 * (slopes[0] + slopes[1]).swapaxes(1, 2)
    whole, first, second = phi(slope * lengths)
    driven = lengths * (first @ levels[0][:, :, np.newaxis] + second @ (levels[1] - levels[0])[:, :, np.newaxis])
    moved = -np.linalg.pinv(slope[0]) @ levels[0][0] if slope.shape[0] else np.zeros(start.size)
    if start.size == 1:  # of floats the recursion takes a fifteenth of the time that arrays take
        steps = zip(whole[:, 0, 0].tolist(), driven[:, 0, 0].tolist(), strict=True)
        found[0] = start[0] + np.array(list(accumulate(steps, _follow, initial=float(moved[0]))))
        return found
    found[:, 0] = start + moved
    for k in range(lengths.shape[0]):
        moved = whole[k] @ moved + driven[k, :, 0]
        found[:, k + 1] = start + moved
    return found


def _follow(moved: float, step: tuple[float, float]) -> float:
    return step[0] * moved + step[1]


def unchanged(path: Path, lanes: int) -> Change:
    """Changes that change nothing."""
    states, outputs = path.start.shape[0], len(path.model.outputs)
    still = np.zeros((states, path.intervals.size, lanes))
    return Change(still, still, np.zeros((outputs, path.time.size, lanes)))


def together(changes: Sequence[Change]) -> Change:
    """Changes side by side, a lane each."""
    if len(changes) == 1:
        return changes[0]
    every = zip(*((change.start, change.end, change.outputs) for change in changes), strict=True)
    return Change(*map(_side_by_side, every))


def _side_by_side(parts: Sequence[FloatArray]) -> FloatArray:
    """Arrays joined along their last axis, in pieces that stay in the processor's memory: ten times as fast."""
    joined = np.empty((*parts[0].shape[:2], sum(part.shape[2] for part in parts)))
    for first in range(0, joined.shape[1], _PIECE):
        piece = slice(first, first + _PIECE)
        np.concatenate([part[:, piece] for part in parts], axis=2, out=joined[:, piece])
    return joined
