"""Logs of a true machine: drives, effects of a wanted size, process noise, sensor noise of several kinds.

Both sizes of an effect are root mean squares over the training logs in free simulation without any noise, in standard
deviations of a sensor, of the output that shows it most. How much outputs differ with and without the effect
(``shown``) says what the effect does. How far they are from what the declared model can do once its free parameters
have been fitted (``left``) says what there is to be found: friction that a free parameter imitates may show thirty
times the noise and leave nothing. Cases are made with a wanted size of what is left, as long as what is shown stays
below :data:`LARGEST`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.effect import Effect
from bondgraph.errors import DataError
from bondgraph.filter.draw import draw_logs
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.batch import simulate_batch
from bondgraph.simulate.model import Model
from bondgraph.simulate.trajectory import BatchTrajectory
from vehicle_graphs.effect_study.cases import Case, Noise
from vehicle_graphs.effect_study.machine import Kind, StudyMachine, coefficient_values

#: Largest size that an effect shows: beyond it the machine is another one.
LARGEST = 100.0
#: A wanted size is met within this share, in so many tries at most, as long as the parameters are taken as linear.
_NEAR, _TRIES = 0.03, 12
#: What a fit leaves is compared with it so many times at most, until it is met within this share.
_COMPARISONS, _NEAR_ENOUGH = 5, 0.1
#: By how much an effect with which the machine diverges counts as too large.
_DIVERGED = 10.0
#: Iterations by which the declared model is fitted to outputs without noise.
_ITERATIONS = 8
#: That fit ends when an iteration takes away less than this share of the squares.
_SETTLED = 2e-3
#: Correlation of coloured noise from sample to sample, and degrees of freedom of heavy tails.
COLOUR, TAILS = 0.9, 3.0
#: Steps of free parameters for what they can imitate, as a share of their values.
_STEP = 1e-3


@dataclass(frozen=True)
class Drive:
    """A drive to be simulated: times and inputs, and the sample from which the effects act."""

    pattern: MatchedLog
    begin: int = 0

    def pieces(self, off: FloatArray, on: FloatArray) -> list[tuple[MatchedLog, FloatArray]]:
        """Parts of the drive, sharing their ends, each with its parameters."""
        last = len(self.pattern) - 1
        if self.begin <= 0 or self.begin >= last:
            return [(self.pattern, on if self.begin <= 0 else off)]
        return [(_part(self.pattern, 0, self.begin + 1), off), (_part(self.pattern, self.begin, last + 1), on)]


def _part(log: MatchedLog, first: int, end: int) -> MatchedLog:
    return MatchedLog(log.name, log.time[first:end], log.u[:, first:end], log.y[:, first:end])


@dataclass(frozen=True)
class Truth:
    """The simulated machine: its model with the effects in it, and the parameters with (``on``) and without them."""

    kinds: tuple[Kind, ...]
    effects: tuple[Effect, ...]
    model: Model
    on: FloatArray
    off: FloatArray

    @property
    def values(self) -> dict[str, dict[str, float]]:
        """True coefficients and shapes of every effect by its label."""
        return {
            kind.label: {name: float(self.on[self.model.index("parameter", name)]) for name in effect.parameters}
            for kind, effect in zip(self.kinds, self.effects, strict=True)
        }


@dataclass(frozen=True)
class Drawn:
    """Training and held-out logs with the truth behind them.

    ``noise``: standard deviations of the sensors. ``shown`` and ``left`` by output, see the module. ``promise``: nats
    of log-likelihood that lie in what is left, where no process noise veils it.
    """

    train: tuple[MatchedLog, ...]
    holdout: tuple[MatchedLog, ...]
    truth: Truth
    noise: Mapping[str, float]
    shown: dict[str, float]
    left: dict[str, float]
    promise: float


def draw(machine: StudyMachine, case: Case) -> Drawn:
    """The logs of a case; the same case gives the same logs.

    Raises
    ------
    DataError
        If the machine diverges, or its drives do not show the effect.
    """
    rng = np.random.default_rng([case.seed, *case.family.encode(), *case.subject.encode()])
    plain, _ = machine.model()
    drives = [_drive(machine, plain, f"train_{k + 1}", rng) for k in range(machine.train)]
    holdout = _drive(machine, plain, "holdout_1", rng)
    if case.family == "part":
        drives = in_last_part(drives)
    values = _true_values(machine, rng, case.exact_parameters)
    imitation = _Imitation(machine, values, drives)
    truth = _sized_truth(imitation, case.kinds(machine), case.size)
    shown, left, promise = imitation.judge(truth)
    logs = [_measured(machine, truth, drive, case.noise, rng) for drive in (*drives, holdout)]
    return Drawn(tuple(logs[:-1]), tuple(logs[-1:]), truth, machine.noise, shown, left, promise)


def _drive(machine: StudyMachine, model: Model, name: str, rng: np.random.Generator) -> Drive:
    time = np.arange(0.0, machine.seconds, 1.0 / machine.rate)
    y = np.full((len(model.outputs), time.size), np.nan)
    for output in machine.noise:
        y[model.index("output", output)] = 0.0
    return Drive(MatchedLog(name, time, machine.excite(model, time, rng), y))


def in_last_part(drives: Sequence[Drive]) -> list[Drive]:
    """Training drives with effects that begin half way through all of them."""
    samples = np.array([len(drive.pattern) for drive in drives])
    ends = np.cumsum(samples)
    begins = np.clip(ends[-1] // 2 - (ends - samples), 0, samples)
    return [Drive(drive.pattern, int(begin)) for drive, begin in zip(drives, begins, strict=True)]


def _true_values(machine: StudyMachine, rng: np.random.Generator, exact: bool) -> dict[str, float]:
    """True values of the free parameters, inside their bounds."""
    values = {}
    for info in machine.free():
        drawn = info.value * (1.0 + machine.spread * rng.uniform(-1.0, 1.0))
        lower, upper = (-np.inf if info.lower is None else info.lower), (np.inf if info.upper is None else info.upper)
        values[info.name] = float(info.value if exact else np.clip(drawn, lower, upper))
    return values


def _sized_truth(imitation: _Imitation, kinds: tuple[Kind, ...], size: float) -> Truth:
    """The true machine; each of its effects alone would have the wanted size.

    Raises
    ------
    DataError
        If an effect would have to be larger than it can be.
    """
    machine, values = imitation.machine, imitation.values
    found: dict[str, float] = {}
    for kind in kinds:
        (effect,) = machine.model((kind,))[1]
        first = _first_coefficient(imitation, kind, size)
        if abs(first) > kind.largest:
            raise DataError(
                f"{machine.name}: these drives do not show {kind.label} - it would have to be {first:.3g}, and is at "
                f"most {kind.largest:.3g}"
            )
        found |= coefficient_values(kind, effect, first)
    return _truth(machine, kinds, values, found)


def _truth(machine: StudyMachine, kinds: tuple[Kind, ...], values: dict[str, float], found: dict[str, float]) -> Truth:
    model, effects = machine.model(kinds)
    return Truth(kinds, effects, model, model.theta(**values, **found), model.theta(**values))


def _first_coefficient(imitation: _Imitation, kind: Kind, size: float) -> float:
    """The first coefficient with which a fit without noise leaves the wanted size; no more is shown than the largest.

    It is searched with linear parameters, then corrected by what a fit leaves, between values that are too small and
    too large. Where the machine diverges before, the largest coefficient is taken with which it does not.
    """
    first = _near(imitation, kind, size)
    best, known = (np.inf, first), dict[bool, tuple[float, float]]()
    for _ in range(_COMPARISONS):
        ratio = _over_wanted(imitation, kind, size, first)
        if abs(np.log(ratio)) < best[0]:
            best = abs(float(np.log(ratio))), first
        if best[0] < _NEAR_ENOUGH:
            break
        known[ratio > 1.0] = np.log(abs(first)), np.log(ratio)
        if len(known) == 2:
            (small, below), (large, above) = known[False], known[True]
            part = float(np.clip(below / (below - above), 0.15, 0.85))
            first = float(np.copysign(np.exp(small + part * (large - small)), first))
        else:
            first *= float(np.clip(1.0 / ratio, 0.2, 5.0))
    return best[1]


def _over_wanted(imitation: _Imitation, kind: Kind, size: float, first: float) -> float:
    """What a fit leaves over the wanted size, or what is shown over the largest; large where the machine diverges."""
    try:
        shown, left, _ = imitation.judge(_alone(imitation, kind, first))
    except DataError:
        return _DIVERGED
    return max(max(left.values()) / size, max(shown.values()) / LARGEST, 1e-6)


def _near(imitation: _Imitation, kind: Kind, size: float) -> float:
    """The coefficient that leaves the wanted size if the free parameters were linear."""
    first = found = kind.guess
    diverging = np.inf
    for _ in range(_TRIES):
        shown, left = imitation.sizes(_alone(imitation, kind, first))
        if np.isfinite(shown):
            found = first
            wanted = min(size / max(left, 1e-12), LARGEST / max(shown, 1e-12))
            if abs(wanted - 1.0) < _NEAR:
                break
            first *= float(np.clip(wanted, 0.1, 10.0))
        else:
            diverging, first = abs(first), 0.2 * first
        if abs(first) >= diverging:  # half way, on a logarithmic scale, to where it diverges
            first = float(np.copysign(np.sqrt(abs(found) * diverging), first))
    return found


def _alone(imitation: _Imitation, kind: Kind, first: float) -> Truth:
    (effect,) = imitation.machine.model((kind,))[1]
    return _truth(imitation.machine, (kind,), imitation.values, coefficient_values(kind, effect, first))


class _Imitation:
    """What the declared model shows on the training drives, and what its free parameters can imitate."""

    def __init__(self, machine: StudyMachine, values: dict[str, float], drives: Sequence[Drive]) -> None:
        self.machine = replace(machine, substeps=machine.sizing or machine.substeps)
        self.values, self.drives = values, drives
        self.plain, _ = machine.model()
        self.names = list(machine.noise)
        self.without, slopes = self._expanded(np.array(list(values.values())))
        self.span, _ = np.linalg.qr(slopes)

    def _seen(self, model: Model, off: FloatArray, on: FloatArray) -> FloatArray:
        """Measured outputs in standard deviations of their sensors, (n_measured, samples, members)."""
        machine = self.machine
        rows = [model.index("output", name) for name in self.names]
        std = np.array([machine.noise[name] for name in self.names])[:, np.newaxis, np.newaxis]
        seen: FloatArray = outputs(machine, model, self.drives, off, on)[rows] / std
        return seen

    def _expanded(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Outputs of the declared model, and their slopes over its free parameters in steps, (values, n_free)."""
        steps = self._steps(point)
        points = point[:, np.newaxis] + np.concatenate([np.zeros((point.size, 1)), np.diag(steps)], axis=1)
        members = np.repeat(self.plain.theta()[:, np.newaxis], points.shape[1], axis=1)
        members[[self.plain.index("parameter", name) for name in self.values]] = points
        runs = self._seen(self.plain, members, members)
        return runs[:, :, 0], (runs[:, :, 1:] - runs[:, :, :1]).reshape(-1, point.size)

    def _steps(self, point: FloatArray) -> FloatArray:
        steps: FloatArray = _STEP * np.where(point == 0.0, 1.0, np.abs(point))
        return steps

    def sizes(self, truth: Truth) -> tuple[float, float]:
        """What a truth shows and leaves in the output that shows most; the parameters taken as linear."""
        effect = self._seen(truth.model, truth.off, truth.on)[:, :, 0] - self.without
        if not np.isfinite(effect).all():
            return np.nan, np.nan
        rest = effect.ravel() - self.span @ (self.span.T @ effect.ravel())
        return max(_rms(effect)), max(_rms(rest.reshape(effect.shape)))

    def judge(self, truth: Truth) -> tuple[dict[str, float], dict[str, float], float]:
        """What a truth shows and leaves by output, and the nats in what is left after a fit without noise.

        Raises
        ------
        DataError
            If the true machine diverges.
        """
        seen = self._seen(truth.model, truth.off, truth.on)[:, :, 0]
        if not np.isfinite(seen).all():
            labels = ", ".join(kind.label for kind in truth.kinds) or "nothing missing"
            raise DataError(f"{self.machine.name} with {labels} diverges - take smaller sizes or more substeps")
        rest = self._fitted(seen) if truth.kinds else np.zeros(seen.shape)
        shown, left = (dict(zip(self.names, _rms(d), strict=True)) for d in (seen - self.without, rest))
        return shown, left, 0.5 * float(np.sum(rest**2))

    def _fitted(self, seen: FloatArray) -> FloatArray:
        """What the declared model leaves of outputs without noise when its free parameters are fitted to them."""
        infos = self.machine.free()
        lower = np.array([-np.inf if info.lower is None else info.lower for info in infos])
        upper = np.array([np.inf if info.upper is None else info.upper for info in infos])
        point = np.array(list(self.values.values()))
        runs, slopes = self._expanded(point)
        rest, damping = seen - runs, 1.0
        for _ in range(_ITERATIONS):
            step, *_ = np.linalg.lstsq(slopes, rest.ravel(), rcond=1e-9)
            reached = np.clip(point + damping * step * self._steps(point), lower, upper)
            runs, steeper = self._expanded(reached)
            before, after = float(np.sum(rest**2)), float(np.sum((seen - runs) ** 2))
            if np.isfinite(steeper).all() and after < before:
                point, slopes, rest = reached, steeper, seen - runs
                if damping == 1.0 and before - after < _SETTLED * before:
                    break
                damping = min(1.0, 4.0 * damping)
            else:
                damping *= 0.25
        return rest


def _rms(values: FloatArray) -> list[float]:
    return [float(value) for value in np.sqrt(np.mean(values**2, axis=1))]


def outputs(
    machine: StudyMachine, model: Model, drives: Sequence[Drive], off: FloatArray, on: FloatArray
) -> FloatArray:
    """Outputs of all drives without any noise, (n_y, samples of all drives, *batch); NaN where the machine diverges."""
    parts = []
    for drive in drives:
        pieces = drive.pieces(off, on)
        x = settled(machine, model, drive.pattern.u[:, 0], pieces[0][1])
        for number, (piece, theta) in enumerate(pieces):
            run = _simulated(machine, model, piece, theta, x)
            x = run.x[:, -1]
            parts.append(run.y[:, min(number, 1) :])
    return np.concatenate(parts, axis=1)


def settled(machine: StudyMachine, model: Model, u: FloatArray, theta: FloatArray) -> FloatArray:
    """States after the first inputs were held for a while, (n_x, members)."""
    if machine.settle <= 0.0:
        return np.repeat(model.x0()[:, np.newaxis], 1 if theta.ndim == 1 else theta.shape[1], axis=1)
    time = np.arange(-machine.settle, 0.5 / machine.rate, 1.0 / machine.rate)
    held = np.repeat(u[:, np.newaxis], time.size, axis=1)
    return simulate_batch(model, time, held, theta, method=machine.method, substeps=machine.substeps).x[:, -1]


def _simulated(
    machine: StudyMachine, model: Model, piece: MatchedLog, theta: FloatArray, x: FloatArray
) -> BatchTrajectory:
    return simulate_batch(model, piece.time, piece.u, theta, x, method=machine.method, substeps=machine.substeps)


def _measured(machine: StudyMachine, truth: Truth, drive: Drive, noise: Noise, rng: np.random.Generator) -> MatchedLog:
    """A drive as the sensors show it."""
    model, pattern = truth.model, drive.pattern
    outputs = []
    pieces = drive.pieces(truth.off, truth.on)
    x = settled(machine, model, pattern.u[:, 0], pieces[0][1])[:, 0]
    for number, (piece, theta) in enumerate(pieces):
        states = _states(machine, model, piece, theta, x, int(rng.integers(2**31)))
        x = states[:, -1]
        members = np.repeat(theta[:, np.newaxis], states.shape[1], axis=1)
        outputs.append(model.output(piece.time, states, piece.u, members)[:, min(number, 1) :])
    y = np.concatenate(outputs, axis=1)
    std = np.array([machine.noise.get(name, np.nan) for name in model.names("output")])
    shown = pattern.u.copy()
    for name in machine.hidden:
        row = model.index("input", name)
        shown[row] = model.u0()[row]
    return MatchedLog(pattern.name, pattern.time, shown, y + std[:, np.newaxis] * sensor_noise(noise, y.shape, rng))


def _states(
    machine: StudyMachine, model: Model, piece: MatchedLog, theta: FloatArray, x: FloatArray, seed: int
) -> FloatArray:
    """States along a piece of a drive, shape (n_x, n), with process noise where the machine has some.

    Raises
    ------
    DataError
        If the machine diverges.
    """
    if machine.process:
        filter_model = FilterModel(model, machine.process, machine.noise, {}, substeps=machine.substeps)
        drawn = draw_logs(filter_model, piece, 1, seed, theta=theta, x0=x, substeps=machine.substeps)
        states: FloatArray = drawn.states[:, :, 0]
        return states
    found = _simulated(machine, model, piece, theta[:, np.newaxis], x[:, np.newaxis]).x[:, :, 0]
    if not np.isfinite(found).all():
        raise DataError(f"{machine.name} diverges on {piece.name} - take smaller sizes or more substeps")
    return found


def sensor_noise(kind: Noise, shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Noise of unit variance over time (the last axis): white, correlated from sample to sample, or with heavy tails.

    Examples
    --------
    >>> noise = sensor_noise("coloured", (1, 20000), np.random.default_rng(1))
    >>> bool(0.8 < noise.std() < 1.2), bool(0.88 < np.corrcoef(noise[0, 1:], noise[0, :-1])[0, 1] < 0.92)
    (True, True)
    """
    if kind == "heavy":
        tails: FloatArray = rng.standard_t(TAILS, shape) * np.sqrt((TAILS - 2.0) / TAILS)
        return tails
    noise = rng.standard_normal(shape)
    if kind == "coloured":
        for k in range(1, shape[-1]):
            noise[..., k] = COLOUR * noise[..., k - 1] + np.sqrt(1.0 - COLOUR**2) * noise[..., k]
    return noise
