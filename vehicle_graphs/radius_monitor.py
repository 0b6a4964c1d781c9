"""Monitor of the tyres of the Ranger, counted on simulated drives: is a falling radius found, where, and how soon.

    python -m vehicle_graphs.radius_monitor --runs 50 --out monitored

counts detections, names and delays where the radius of the front tyres falls by 6 % in mid-run, and false alarms where
nothing changes. Every drive has a throttle and a road of its own; the truth is integrated with finer steps than the
filters have. The false alarms count against the rate that the detector declares. The folder holds ``report.html``,
``result.json`` and the finished drives: the same command goes on with them, and more of them may be asked for.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from bondgraph.cli.numbers import count, positive, seed
from bondgraph.data.log import MatchedLog
from bondgraph.estimate.journal import Journal
from bondgraph.execute.executors import open_executor
from bondgraph.execute.tasks import as_done
from bondgraph.files import write_text
from bondgraph.filter.detector import ChangeDetector, Detection
from bondgraph.filter.filter_model import FilterModel
from bondgraph.report.figures import LINES
from bondgraph.report.numbers import shown
from bondgraph.report.page import Section, drawn, write_page
from bondgraph.report.progress import WorkProgress
from bondgraph.shown import own_axes
from bondgraph.simulate.inputs import InputSignal, hold_flags
from bondgraph.simulate.simulation import simulate
from bondgraph.text import text_table
from vehicle_graphs.chain_reports import Command
from vehicle_graphs.commands import command_parser, importable_main, run_command
from vehicle_graphs.effect_study.tables import rate, said
from vehicle_graphs.kept_fits import fit_key
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
_HEADER = ("what changes", "drives", "found and named", "false", "median delay [s]", "longest [s]")


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

    def to_dict(self) -> dict[str, Any]:
        """As values of JSON; NaN stands for no alarm and no change."""
        own = asdict(self.detection)
        own["time"] = own["time"].tolist()
        own["evidence"] = {name: values.tolist() for name, values in own["evidence"].items()}
        return {"detection": own, "changed_at": self.changed_at}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Watched:
        """Drive from what :meth:`to_dict` gave, bit for bit."""
        own = dict(content["detection"])
        own["time"] = np.array(own["time"])
        own["evidence"] = {name: np.array(values) for name, values in own["evidence"].items()}
        return cls(Detection(**own), content["changed_at"])


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


def drive_key(model: FilterModel, seed: int, seconds: float, change: str) -> str:
    """Digest of all that the answer to a drive depends on: machine, noises, steps, detector, the drive itself."""
    noises = [sorted(one.items()) for one in (model.process_noise, model.measurement_noise, model.initial_std)]
    steps = (model.method, model.substeps, model.grading, _TRUE_STEPS, _SETTING, _THROTTLE)
    text = repr((model.model.text, noises, steps, CHANGES, change))
    numbers = {"seed": seed, "seconds": seconds, "rate": RATE, "false_alarm_every": FALSE_ALARM_EVERY}
    return fit_key(text, numbers, [])


def watch_all(
    model: FilterModel,
    changes: Sequence[str],
    seeds: Sequence[int],
    seconds: float,
    kept: Journal,
    executor: Executor | None = None,
) -> dict[str, list[Watched]]:
    """What the monitor finds in every drive with each of the changes, in the order of the seeds.

    Drives that were kept are taken as they are, others kept as soon as they are finished.

    Raises
    ------
    BondGraphError
        If the model diverges on the way.
    """
    drives = [(change, seed) for change in changes for seed in seeds]
    keys = [drive_key(model, seed, seconds, change) for change, seed in drives]
    known = {k: Watched.from_dict(content) for k, key in enumerate(keys) if (content := kept.entry(key)) is not None}
    due = [k for k in range(len(drives)) if k not in known]
    with WorkProgress("watching", len(drives), "drives") as progress:
        for _ in known:
            progress.advance()
        tasks = [(model, drives[k][1], seconds, drives[k][0]) for k in due]
        for position, watched in as_done(executor, watch, tasks):
            known[due[position]] = watched
            kept.enter(keys[due[position]], watched.to_dict())
            progress.describe(_told(drives[due[position]][0], watched))
            progress.advance()
    return {
        change: [known[k] for k, (own, _) in enumerate(drives) if own == change] for change in dict.fromkeys(changes)
    }


def _told(change: str, watched: Watched) -> str:
    return f"{change or 'nothing'} changed: {watched.detection.alarm or 'no alarm'}"


def row(change: str, found: Sequence[Watched]) -> list[str]:
    """Of drives with a change (or none): how many, how many found and named rightly, false alarms, delays."""
    delays = _delays(change, found)
    false = sum(one.is_false for one in found)
    seconds = [f"{np.median(delays):.3f}", f"{max(delays):.3f}"] if delays else ["-", "-"]
    return [change or "nothing", str(len(found)), str(len(delays)), str(false), *seconds]


def _delays(change: str, found: Sequence[Watched]) -> list[float]:
    """Seconds to the alarms that name the change."""
    return [one.delay for one in found if one.detection.alarm == change and not one.is_false] if change else []


def result(found: Mapping[str, Sequence[Watched]]) -> dict[str, Any]:
    """Counts and delays of each change as values, for ``result.json``."""
    every = [one for some in found.values() for one in some]
    return {
        "changes": {
            change or "nothing": {
                "drives": len(some),
                "named": rate(len(_delays(change, some)), len(some)) if change else None,
                "false_alarms": sum(one.is_false for one in some),
                "alarms": dict(Counter(one.detection.alarm or "none" for one in some)),
                "delays": _delays(change, some),
            }
            for change, some in found.items()
        },
        "hours_without_change": _hours(every),
        "false_alarms": sum(one.is_false for one in every),
        "declared_hours_to_a_false_alarm": FALSE_ALARM_EVERY / 3600.0,
    }


def _hours(found: Sequence[Watched]) -> float:
    """Hours that were watched before anything changed."""
    ends = (float(np.fmin(one.changed_at, one.detection.time[-1])) for one in found)
    return sum(ends) / 3600.0


def write_monitor(found: Mapping[str, Sequence[Watched]], folder: Path, command: Command, first_seed: int) -> None:
    """Write ``result.json`` and ``report.html``: counts, names, delays, the evidence along one drive of each."""
    values = result(found)
    write_text(folder / "result.json", json.dumps(values, indent=1))
    changed = [change for change in found if change]
    sections = [Section("What was found", ["Delays in s, from the change to the alarm."], _HEADER, _counts(found))]
    if changed:
        names = ("none", *CHANGES)
        rows = [[change or "nothing", *(str(_alarms(some)[name]) for name in names)] for change, some in found.items()]
        sections.append(Section("What was named", ["Drives by the alarm that was raised."], ("change", *names), rows))
    if any(_delays(change, found[change]) for change in changed):
        sections.append(Section("Delays", figure=drawn(lambda ax: _plot_delays(found, ax), 7.5, 3.2)))
    for change in changed:
        detection = found[change][0].detection
        text = [f"The radius fell at {found[change][0].changed_at:g} s. Evidence in nats; the scale is logarithmic."]
        title = f"Evidence along a drive: {change}"
        sections.append(Section(title, text, figure=drawn(detection.plot, 7.5, 3.2)))
    subtitle = (
        f"Simulated drives of the Ranger: is a radius that falls by {100.0 * (1.0 - FALLEN):.0f} % found, where, "
        "and how soon?"
    )
    write_page(
        folder / "report.html", "Monitor of the tyres", subtitle, _answer(found, values), sections,
        command.made(seed=first_seed),
    )  # fmt: skip


def _counts(found: Mapping[str, Sequence[Watched]]) -> list[list[str]]:
    """Rows of the table of counts, with the intervals of the shares."""
    rows = []
    for change, some in found.items():
        name, drives, named, false, *delays = row(change, some)
        rows.append([name, drives, said(rate(int(named), len(some))) if change else "-", false, *delays])
    return rows


def _alarms(found: Sequence[Watched]) -> Counter[str]:
    return Counter(one.detection.alarm or "none" for one in found)


def _answer(found: Mapping[str, Sequence[Watched]], values: Mapping[str, Any]) -> list[str]:
    """What was found, in sentences."""
    lines = []
    for change, some in found.items():
        delays = _delays(change, some)
        if change:
            soon = f", after {shown(float(np.median(delays)))} s in the median" if delays else ""
            lines.append(f"{change}: named in {said(rate(len(delays), len(some)))}{soon}.")
    false, hours = values["false_alarms"], values["hours_without_change"]
    alarms = f"{false or 'No'} false alarm{'' if false < 2 else 's'}"
    every = values["declared_hours_to_a_false_alarm"]
    return [*lines, f"{alarms} in {shown(hours)} h watched before any change; declared is one in {every:g} h at most."]


def _plot_delays(found: Mapping[str, Sequence[Watched]], ax: Axes | None) -> Axes:
    """Share of the drives of each change in which it was named, over the time since."""
    axes = own_axes(ax)
    delays = {change: np.sort(_delays(change, some)) for change, some in found.items() if change}
    end = 1.1 * max(float(own[-1]) for own in delays.values() if own.size)
    for (change, own), colour, line in zip(delays.items(), LINES, ("-", "--", ":"), strict=False):
        shares = 100.0 * np.arange(own.size + 1) / len(found[change])
        axes.step([0.0, *own, end], [*shares, shares[-1]], where="post", label=change, color=colour, ls=line)
    axes.set(xlabel="time since the change [s]", ylabel="named [% of drives]", xlim=(0.0, end), ylim=(0.0, 104.0))
    axes.legend(loc="lower right")
    return axes


def main(arguments: Sequence[str] | None = None) -> int:
    """Count, print a table and write a report; 0 when done, 2 for bad input, 130 when interrupted."""
    parser = command_parser("radius_monitor", __doc__)
    parser.add_argument("--runs", type=count, default=50, help="drives of each kind (default: 50)")
    parser.add_argument("--seconds", type=positive, default=12.0, help="length of a drive, s (default: 12)")
    parser.add_argument("--first-seed", type=seed, default=0, help="the same seeds give the same drives (default: 0)")
    parser.add_argument(
        "--changes", nargs="*", default=["front"], choices=[*CHANGES], help="changes to make (default: front)"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of report.html and of finished drives, from which it goes on"
    )
    options = parser.parse_args(arguments)
    command = Command("radius_monitor", sys.argv[1:] if arguments is None else arguments)

    def work() -> None:
        kept = Journal(options.out)
        seeds = range(options.first_seed, options.first_seed + options.runs)
        with open_executor(options.executor) as executor:
            found = watch_all(monitor(), ("", *options.changes), seeds, options.seconds, kept, executor)
        print(text_table(_HEADER, [row(change, some) for change, some in found.items()]))
        if options.out is not None:
            write_monitor(found, options.out, command, options.first_seed)
            print(f"report: {options.out / 'report.html'}")

    return run_command(work, f"the same command goes on with what is in {options.out}" if options.out else "")


if __name__ == "__main__":
    sys.exit(importable_main("radius_monitor"))
