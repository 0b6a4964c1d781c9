"""Monitor of the tyres of the Ranger, counted on simulated drives: is a falling radius found, where, and how soon.

    python -m vehicle_graphs.radius_monitor --runs 50

counts detections, names and delays where the radius of the front tyres falls by 6 % in mid-run, and false alarms where
nothing changes. Every drive has a throttle and a road of its own; the truth is integrated with finer steps than the
filters have. The false alarms count against the rate that the detector declares.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.execute.executors import open_executor
from bondgraph.execute.tasks import as_done
from bondgraph.filter.detector import ChangeDetector, Detection
from bondgraph.filter.filter_model import FilterModel
from bondgraph.report.progress import WorkProgress
from bondgraph.simulate.inputs import InputSignal, hold_flags
from bondgraph.simulate.simulation import simulate
from bondgraph.text import text_table
from vehicle_graphs.commands import command_parser, importable_main, run_command
from vehicle_graphs.ranger import filter_model, monitored

#: Radii after a loss of air, relative to those before.
FALLEN = 0.94
CHANGES: Mapping[str, Mapping[str, float]] = {
    "front": {"radius_gain_f": FALLEN},
    "rear": {"radius_gain_r": FALLEN},
    "both": {"radius_gain_f": FALLEN, "radius_gain_r": FALLEN},
}

#: Samples per second, as in the recorded drives.
RATE = 40.0
#: Mean time between false alarms that is declared: a hundred hours of driving, s.
FALSE_ALARM_EVERY = 3.6e5
#: Runge-Kutta steps per sample of the truth; the gripping belt has a rate of up to 12000 1/s.
_TRUE_STEPS = 300
#: How the filters are integrated between samples: as a first search integrates a stiff model, at a fifth of the cost of
#: Runge-Kutta steps that the gripping belt leaves stable.
_METHOD: dict[str, Any] = {"method": "ros3p", "substeps": 12, "grading": 1.35}
#: Seconds between two random settings of the throttle, and their range.
_SETTING, _THROTTLE = 2.5, (0.1, 0.8)


@dataclass(frozen=True)
class Watched:
    """What the monitor found in a drive whose tyres changed at ``changed_at``, s; NaN where they did not."""

    detection: Detection
    changed_at: float

    @property
    def delay(self) -> float:
        """Seconds from the change to the alarm."""
        return self.detection.alarm_time - self.changed_at

    @property
    def is_false(self) -> bool:
        """An alarm without a change before it."""
        return bool(self.detection.alarm) and not self.delay >= 0.0


def monitor() -> FilterModel:
    """The filter of the monitor, with the noises of the sensors and of the road.

    Examples
    --------
    >>> monitor().method
    'ros3p'
    """
    return filter_model(monitored(), **_METHOD)


def drive(model: FilterModel, seed: int, seconds: float, change: Mapping[str, float] | None = None) -> MatchedLog:
    """A drive from rest at idle, as the filter believes drives come about; in its middle parameters change.

    Raises
    ------
    BondGraphError
        If the model diverges on the way.
    """
    own = model.model
    chance = np.random.default_rng((seed, 1))
    time = np.arange(round(seconds * RATE)) / RATE
    knots = np.arange(0.0, seconds + 2.0 * _SETTING, _SETTING)
    u = np.repeat(own.u0()[:, np.newaxis], time.size, axis=1)
    u[own.index("input", "throttle")] = np.interp(time, knots, chance.uniform(*_THROTTLE, knots.size))
    truth, hold, walk = u.copy(), hold_flags(own), own.index("input", "inclination_rate")
    # a rate that is held and drawn anew at every sample makes of the inclination the random walk of the filter
    truth[walk] = model.process_noise["inclination"] * np.sqrt(RATE) * chance.standard_normal(time.size)
    hold[walk] = True
    x0 = own.x0() + model.start_std * chance.standard_normal(len(own.states))
    half, y = time.size // 2, np.empty((len(own.outputs), time.size))
    for part, theta in ((slice(0, half + 1), {}), (slice(half, None), dict(change or {}))):
        signal = InputSignal(time[part], truth[:, part], hold)
        run = simulate(own, time[part], signal, own.theta(**theta), x0, "rk4", substeps=_TRUE_STEPS, compiled=True)
        x0, y[:, part] = run.raise_if_failed().x[:, -1], run.y
    y += model.noise_std[:, np.newaxis] * chance.standard_normal(y.shape)
    return MatchedLog(f"drive {seed}", time, u, y)


def watch(model: FilterModel, seed: int, seconds: float, change: str = "") -> Watched:
    """What the monitor finds in a drive with one of the changes, or with none.

    Raises
    ------
    BondGraphError
        If the model diverges on the way.
    """
    log = drive(model, seed, seconds, CHANGES[change] if change else None)
    detector = ChangeDetector(model, CHANGES, false_alarm_every=FALSE_ALARM_EVERY, interval=1.0 / RATE)
    changed_at = log.time[log.time.size // 2] if change else np.nan
    return Watched(detector.watch(log, until_alarm=True), float(changed_at))


def row(change: str, found: Sequence[Watched]) -> list[str]:
    """Of drives with a change (or none): how many, how many found and named rightly, false alarms, delays."""
    delays = [one.delay for one in found if one.detection.alarm == change and not one.is_false] if change else []
    false = sum(one.is_false for one in found)
    shown = [f"{np.median(delays):.3f}", f"{max(delays):.3f}"] if delays else ["-", "-"]
    return [change or "nothing", str(len(found)), str(len(delays)), str(false), *shown]


def main(arguments: Sequence[str] | None = None) -> int:
    """Count and print a table; 0 when done, 2 with a message for bad input, 130 when interrupted."""
    parser = command_parser("radius_monitor", __doc__)
    parser.add_argument("--runs", type=int, default=50, help="drives of each kind (default: 50)")
    parser.add_argument("--seconds", type=float, default=12.0, help="length of a drive, s (default: 12)")
    parser.add_argument("--first-seed", type=int, default=0, help="the same seeds give the same drives (default: 0)")
    parser.add_argument(
        "--changes", nargs="*", default=["front"], choices=[*CHANGES], help="changes to make (default: front)"
    )
    options = parser.parse_args(arguments)

    def work() -> None:
        model, changes = monitor(), ("", *options.changes)
        seeds = range(options.first_seed, options.first_seed + options.runs)
        tasks = [(model, seed, options.seconds, change) for change in changes for seed in seeds]
        found: dict[int, Watched] = {}
        with (
            open_executor(options.executor) as executor,
            WorkProgress("watching", len(tasks), "drives") as progress,
        ):
            for position, watched in as_done(executor, watch, tasks):
                found[position] = watched
                progress.advance()
        every = [[found[k * len(seeds) + j] for j in range(len(seeds))] for k in range(len(changes))]
        rows = [row(change, some) for change, some in zip(changes, every, strict=True)]
        header = ("what changes", "drives", "found and named", "false", "median delay [s]", "longest [s]")
        print(text_table(header, rows))

    return run_command(work)


if __name__ == "__main__":
    sys.exit(importable_main("radius_monitor"))
