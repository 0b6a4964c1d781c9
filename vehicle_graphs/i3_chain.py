"""The correction of the BMW i3 declaration step by step, from the force balance of the training trips.

Usage, after ``python -m vehicle_graphs.i3_logs FOLDER --out LOGS``::

    python -m vehicle_graphs.i3_chain LOGS --executor processes --out kept

The speed of the car is measured to 0.01 km/h, so the only state is known at every sample, and what the accelerometer
reads is an output of the model there: a fit is a regression of the generated output equation, with the loss of Huber
(1964) since friction brakes, whose pedal is not in the data, make heavy tails. Effects are added one by one as long as
each lowers the error on training trips that were left out (five groups of trips) by ``LEAST_GAIN``.

Printed after every step: the force error, that is the declared mass times the error in acceleration, root mean square
over all samples at which the car moves; over those at which the motor drives; over those at which the accelerator is
pressed, so that no friction brake can act; and over means of a second. Held-out trips are assessed and decide nothing.
Intervals of the parameters are those of the jackknife over the groups of trips (Efron 1982, The Jackknife, the
Bootstrap and Other Resampling Plans, chapter 3): they hold whatever errors of neighbouring samples have in common.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from scipy import stats
from scipy.optimize import least_squares

from bondgraph.build import build
from bondgraph.data.log import Log, MatchedLog
from bondgraph.data.matching import match
from bondgraph.data.read import read_log
from bondgraph.errors import DataError
from bondgraph.estimate.journal import Journal
from bondgraph.execute.executors import open_executor
from bondgraph.execute.tasks import as_done
from bondgraph.report.collect import parameter_changes
from bondgraph.report.figures import AFTER, BEFORE, MEASURED
from bondgraph.report.numbers import shown, with_interval
from bondgraph.report.page import Section, drawn, write_page
from bondgraph.report.progress import WorkProgress
from bondgraph.simulate.model import Model
from vehicle_graphs import i3
from vehicle_graphs.chain_reports import Command
from vehicle_graphs.commands import command_parser, importable_main, run_command
from vehicle_graphs.kept_fits import fit_key

FloatArray = npt.NDArray[np.float64]

#: Speed above which the car counts as moving [m/s].
MOVING = 1.0
#: Error in acceleration at which the loss turns from square to linear [m/s^2].
HUBER = 0.2
#: An effect must lower the error on left-out training trips by this share.
LEAST_GAIN = 0.003
#: Every how manieth sample is fitted (10 Hz data), and groups of trips for cross-validation.
THINNED, GROUPS = 10, 5


@dataclass(frozen=True)
class Samples:
    """Moving samples of several trips: speed (n,), inputs (n_u, n), acceleration (n,), and trip and second of each."""

    speed: FloatArray
    inputs: FloatArray
    acceleration: FloatArray
    trip: npt.NDArray[np.int64]
    second: npt.NDArray[np.int64]

    def rows(self, chosen: npt.NDArray[np.bool_]) -> Samples:
        """Some of the samples."""
        return Samples(
            self.speed[chosen],
            self.inputs[:, chosen],
            self.acceleration[chosen],
            self.trip[chosen],
            self.second[chosen],
        )


@dataclass(frozen=True)
class ForceError:
    """Root mean square force errors [N] of samples and of means of 1 s: while the car moves, while the motor drives.

    ``pressed_means``: those of means of 1 s over samples with the accelerator pressed.
    """

    moving: float
    driving: float
    moving_means: float
    driving_means: float
    pressed_means: float

    def __str__(self) -> str:
        samples = f"samples {self.moving:6.1f} N moving {self.driving:6.1f} N driving"
        means = f"means of 1 s {self.moving_means:6.1f} N moving {self.driving_means:6.1f} N driving"
        return f"{samples}; {means} {self.pressed_means:6.1f} N accelerator pressed"


@dataclass(frozen=True)
class Balance:
    """A fitted force balance."""

    effects: tuple[str, ...]
    model: Model
    values: dict[str, float]
    left_out: float
    std: dict[str, float]

    @property
    def ci95(self) -> dict[str, tuple[float, float]]:
        """95 % intervals by the quantile of Student's t for as many groups."""
        reach = float(stats.t.ppf(0.975, GROUPS - 1))
        return {name: (value - reach * self.std[name], value + reach * self.std[name])
                for name, value in self.values.items()}  # fmt: skip


def samples(logs: Sequence[Log], model: Model) -> Samples:
    """All samples of trips at which the car moves and both channels were measured."""
    parts = [_moving(index, match(log, model)) for index, log in enumerate(logs)]
    return Samples(
        *(np.concatenate([getattr(part, name) for part in parts], axis=-1)
          for name in ("speed", "inputs", "acceleration", "trip", "second"))
    )  # fmt: skip


def _moving(index: int, log: MatchedLog) -> Samples:
    speed, acceleration = log.y
    kept = (speed > MOVING) & np.isfinite(acceleration)
    second = np.floor(log.time[kept]).astype(np.int64)
    return Samples(speed[kept], log.u[:, kept], acceleration[kept], np.full(second.size, index), second)


def missing_acceleration(model: Model, values: dict[str, float], data: Samples) -> FloatArray:
    """What the accelerometer read beyond the model's output at the measured speed [m/s^2]."""
    outputs = model.output(0.0, data.speed[np.newaxis], data.inputs, model.theta(**values))
    missing: FloatArray = data.acceleration - outputs[model.index("output", "acceleration")]
    return missing


def fitted(model: Model, data: Samples) -> dict[str, float]:
    """All parameters that declare bounds, by the loss of Huber."""
    free = [info for info in model.parameters if info.lower is not None and info.upper is not None]
    lower, upper = (np.array([getattr(info, side) for info in free], dtype=float) for side in ("lower", "upper"))
    start = np.clip([info.value for info in free], lower + 1e-3 * (upper - lower), upper - 1e-3 * (upper - lower))

    def residual(shares: FloatArray) -> FloatArray:
        return missing_acceleration(model, _named(free, lower + shares * (upper - lower)), data)

    shares = (start - lower) / (upper - lower)
    found = least_squares(residual, shares, bounds=(0.0, 1.0), loss="huber", f_scale=HUBER, x_scale=0.1)
    return _named(free, lower + found.x * (upper - lower))


def _named(free: Sequence[object], values: FloatArray) -> dict[str, float]:
    return {str(getattr(info, "name", "")): float(value) for info, value in zip(free, values, strict=True)}


def force_error(model: Model, values: dict[str, float], data: Samples) -> ForceError:
    """Force errors of a fitted balance."""
    missing = i3.MASS * missing_acceleration(model, values, data)
    drives = data.inputs[model.index("input", "motor_torque")] > 0.0
    pressed = data.inputs[model.index("input", "pedal")] > i3.PRESSED
    means = [_rms(_means(missing[rows], data.rows(rows))) for rows in (pressed | ~pressed, drives, pressed)]
    return ForceError(_rms(missing), _rms(missing[drives]), *means)


def _means(values: FloatArray, data: Samples) -> FloatArray:
    """Means over each second of each trip that has at least five samples."""
    _, group = np.unique(data.trip * 10**6 + data.second, return_inverse=True)
    counts = np.bincount(group)
    means: FloatArray = (np.bincount(group, weights=values) / counts)[counts >= 5]
    return means


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(np.mean(values**2))) if values.size else math.nan


def balance(effects: tuple[str, ...], logs: Sequence[Log]) -> Balance:
    """A set of effects fitted to training trips, and its error on each group of trips that was left out."""
    model = build(i3.declared(effects)).model
    data = samples(logs, model)
    thin = data.rows(np.arange(data.speed.size) % THINNED == 0)
    values = fitted(model, thin)
    squares, without = 0.0, []
    for group in range(GROUPS):
        inside = thin.trip % GROUPS != group
        others = fitted(model, thin.rows(inside))
        without.append(list(others.values()))
        squares += float(np.sum(_huber(missing_acceleration(model, others, thin.rows(~inside)))))
    std = math.sqrt(GROUPS - 1) * np.std(without, axis=0)  # each fit lacks a group and keeps the others
    named = dict(zip(values, map(float, std), strict=True))
    return Balance(effects, model, values, i3.MASS * math.sqrt(squares / thin.speed.size), named)


def _huber(missing: FloatArray) -> FloatArray:
    """Twice Huber's loss: the square of a small error, linear in a large one."""
    size = np.abs(missing)
    loss: FloatArray = np.where(size < HUBER, size**2, HUBER * (2.0 * size - HUBER))
    return loss


@dataclass(frozen=True)
class Bench:
    """Who fits the sets of effects, the folder that keeps finished ones, and whom to tell."""

    executor: Executor | None = None
    folder: Path | None = None
    progress: Callable[[], None] = lambda: None

    def balances(self, sets: Sequence[tuple[str, ...]], train: Sequence[Log]) -> list[Balance]:
        """Sets of effects, fitted, in their order: as they were kept, or fitted by workers and kept."""
        journal = Journal(self.folder)
        models = [build(i3.declared(effects)).model for effects in sets]
        keys = [fit_key(model.text, {}, train) for model in models]
        found = {
            k: Balance(sets[k], models[k], content["values"], content["left_out"], content["std"])
            for k, key in enumerate(keys) if (content := journal.entry(key)) is not None
        }  # fmt: skip
        due = [k for k in range(len(sets)) if k not in found]
        for position, one in as_done(self.executor, balance, [(sets[k], train) for k in due]):
            found[due[position]] = one
            journal.enter(keys[due[position]], {"values": one.values, "left_out": one.left_out, "std": one.std})
            self.progress()
        return [found[k] for k in range(len(sets))]


def chain(
    train: Sequence[Log], holdout: Sequence[Log], bench: Bench | None = None
) -> tuple[list[Balance], list[Balance]]:
    """Steps of the correction, each printed when it is made, and what was tried last; see the module's first lines."""
    bench = bench or Bench()
    (current,) = bench.balances([()], train)
    steps = [current]
    _tell(current, train, holdout)
    while True:
        sets = [(*current.effects, name) for name in i3.EFFECTS if name not in current.effects]
        trials = sorted(bench.balances(sets, train), key=lambda trial: trial.left_out)
        for trial in trials:
            print(f"    {trial.effects[-1]:28s} left-out trips {trial.left_out:7.2f} N", flush=True)
        if not trials or trials[0].left_out > (1.0 - LEAST_GAIN) * current.left_out:
            return steps, trials
        current = trials[0]
        steps.append(current)
        _tell(current, train, holdout)


def _tell(step: Balance, train: Sequence[Log], holdout: Sequence[Log]) -> None:
    name = step.effects[-1] if step.effects else "start"
    told = [force_error(step.model, step.values, samples(logs, step.model)) for logs in (train, holdout)]
    print(f"{name:28s} left-out trips {step.left_out:7.2f} N\n    training: {told[0]}\n    held out: {told[1]}")
    print("    " + ", ".join(f"{key} {value:.5g}" for key, value in step.values.items()), flush=True)


def report_sections(
    steps: Sequence[Balance], tried: Sequence[Balance], train: Sequence[Log], holdout: Sequence[Log]
) -> list[Section]:
    """Errors of every step, parameters before and after, what was not added, and the missing force over the speed."""
    first, last = steps[0], steps[-1]
    groups = {"training": train, "held out": holdout}
    rows = []
    for step in steps:
        for group, logs in groups.items():
            found = force_error(step.model, step.values, samples(logs, step.model))
            name = step.effects[-1] if step.effects else "as declared"
            rows.append([name, group, *(shown(value, 4) for value in astuple(found)), shown(step.left_out, 4)])
    parameters = [
        [one.name, one.unit, shown(one.before, 4), *with_interval(one.after, one.ci95), one.meaning]
        for one in parameter_changes(last.model, first.values, last.values, last.ci95)
    ]
    figure = drawn(lambda axes: missing_plot(axes, (first, last), holdout), 8.0, 4.0)
    return [
        Section(
            "Error before and after", ["Root mean square force errors in N, samples and means of one second."],
            ["added", "trips", "moving", "driving", "moving, means", "driving, means", "pressed, means", "left out"],
            rows,
        ),
        Section("Missing force over the speed, held-out trips", figure=figure),
        Section(
            "Parameters", ["The intervals are those of the jackknife over groups of trips."],
            ["parameter", "unit", "before", "after", "95 % interval", "meaning"], parameters,
        ),
        Section(
            "Not added", [f"None lowers the error on left-out trips by {100.0 * LEAST_GAIN:g} %."],
            ["effect", "left-out trips [N]"], [[one.effects[-1], shown(one.left_out, 5)] for one in tried],
        ),
    ]  # fmt: skip


def missing_plot(axes: Axes | None, steps: Sequence[Balance], logs: Sequence[Log]) -> Axes:
    """The mean missing force over the speed, of the first and the last step; bins of a twentieth of the samples."""
    assert axes is not None
    for step, colour, label in zip(steps, (BEFORE, AFTER), ("before", "after"), strict=True):
        data = samples(logs, step.model)
        missing = i3.MASS * missing_acceleration(step.model, step.values, data)
        parts = np.array_split(np.argsort(data.speed), 20)
        middle = [[float(values[part].mean()) for part in parts] for values in (data.speed, missing)]
        axes.plot(*middle, "o-", color=colour, label=label, markersize=3.0)
    axes.axhline(0.0, color=MEASURED, linewidth=0.8)
    axes.set_xlabel("speed [m/s]")
    axes.set_ylabel("mean missing force [N]")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)
    return axes


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input, 130 when interrupted."""
    parser = command_parser("i3_chain", __doc__)
    parser.add_argument("logs", type=Path, help="folder written by vehicle_graphs.i3_logs")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of report.html and of finished fits, from which it goes on"
    )
    options = parser.parse_args(arguments)
    command = Command("i3_chain", sys.argv[1:] if arguments is None else arguments)

    def work() -> None:
        train, holdout = (
            [read_log(path) for path in sorted(options.logs.glob(f"{part}_*.csv.gz"))] for part in ("train", "test")
        )
        if len(train) < GROUPS or not holdout:
            raise DataError(f"{options.logs}: {len(train)} training trips - give the folder of vehicle_graphs.i3_logs")
        with (
            open_executor(options.executor) as executor,
            WorkProgress("fitting sets of effects", None, "fits") as progress,
        ):
            steps, tried = chain(train, holdout, Bench(executor, options.out, progress.advance))
        if options.out is not None:
            _write(options.out, steps, tried, (train, holdout), command)

    return run_command(work, f"the same command goes on with what is in {options.out}" if options.out else "")


def _write(
    folder: Path,
    steps: Sequence[Balance],
    tried: Sequence[Balance],
    logs: tuple[Sequence[Log], Sequence[Log]],
    command: Command,
) -> None:
    added = ", ".join(step.effects[-1] for step in steps[1:])
    answer = [f"Added one by one: {added}." if added else "Nothing that was tried is worth its parameters."]
    answer.append(f"Error on left-out trips: {steps[0].left_out:.4g} N before, {steps[-1].left_out:.4g} N after.")
    write_page(
        folder / "report.html", "BMW i3", "The force balance of the car, before and after the correction.", answer,
        report_sections(steps, tried, *logs), command.made(*logs),
    )  # fmt: skip
    print(f"report: {folder / 'report.html'}")


if __name__ == "__main__":
    sys.exit(importable_main("i3_chain"))
