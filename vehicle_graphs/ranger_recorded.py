"""The recorded runs of the Ranger: coast-downs first, then engine and CVT from the drives, then what the filter says.

    python -m vehicle_graphs.ranger_recorded FOLDER --out found
    python -m vehicle_graphs.ranger_recorded FOLDER --out found --joint

``FOLDER`` holds ``coast_down_*.csv`` and ``drive_*.csv``. The coast-downs tell rolling resistance, drag, brakes, pitch
offset, tyre radius and pitch stiffness. That result with its covariance is the prior of the second stage: the first
part of every drive tells the eight parameters of engine and CVT, by a search with continuation in process noise, how
fast the inclination of the road changes at the speed of a drive, and more of the first six. Then the whole drives,
most of which no estimate has seen, are filtered with what was found. ``--joint`` also estimates everything from
coast-downs and drives at once, each filtered with its own model, and compares the intervals. Written are the
estimates, the consistency of every channel, and a picture per drive with smoothed states, their bands and the
measurements.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from bondgraph.build import build
from bondgraph.data.log import MatchedLog
from bondgraph.data.matching import match
from bondgraph.data.read import read_log
from bondgraph.declare.editing import with_values
from bondgraph.errors import DataError
from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.initial import initial_states
from bondgraph.estimate.joint import Problem, pose_joint
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.priors import MultivariateNormal
from bondgraph.estimate.problem import pose
from bondgraph.estimate.result import Estimate
from bondgraph.execute.executors import open_executor
from bondgraph.filter.consistency import Consistency, consistency
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.runs import run
from bondgraph.filter.smoother import smooth
from bondgraph.report.collect import output_bands, state_bands
from bondgraph.report.estimation import write_estimate
from bondgraph.report.figures import save_figure
from bondgraph.report.html import Provenance
from bondgraph.report.numbers import shown, with_interval
from bondgraph.report.page import Section, write_page
from bondgraph.report.plots import state_figure
from bondgraph.report.progress import WorkProgress
from vehicle_graphs import ranger
from vehicle_graphs.chain_reports import Command
from vehicle_graphs.commands import command_parser, run_command
from vehicle_graphs.ranger_filters import NOISE
from vehicle_graphs.thesis import (
    COAST_DOWN,
    COASTING_STEPS,
    DRIVELINE,
    DRIVING_GRADING,
    DRIVING_SEARCH,
    DRIVING_STEPS,
)

#: The random walk of the inclination is that of the coast-downs at first; drives are faster.
ROAD = "process(inclination)"

#: Coast-downs start at this speed [m/s].
COASTING_SPEED = 15.0

#: Seconds of every drive from which the driveline is estimated: a start, full throttle, lifting, braking. The search
#: filters them hundreds of times; the rest is kept to look at the result.
EXCERPT = 24.0


@dataclass(frozen=True)
class Recorded:
    """What was found: both stages, by drive how consistent the filter is with them, and everything at once if asked."""

    coasting: Estimate
    driving: Estimate
    drives: Mapping[str, Looked]
    joint: Estimate | None = None


@dataclass(frozen=True)
class Way:
    """How estimations are made: where their states are kept, whether they go on from there, and who computes.

    With a ``command`` each stage leaves the report of an estimate in its folder.
    """

    folder: Path
    resume: bool = False
    executor: Executor | None = None
    command: Command | None = None

    def estimated(self, problem: Problem, settings: Settings, stage: str) -> Estimate:
        """The estimate of a stage, by exact derivatives.

        Raises
        ------
        KeyboardInterrupt
            If it was interrupted: the next stage would build on a search that is not finished.
        """
        folder = self.folder / stage.replace(" ", "_")
        folder.mkdir(parents=True, exist_ok=True)
        with WorkProgress(stage, None, "evaluations") as work:
            found = estimate(
                problem, settings, progress=work.trace, folder=folder, resume=self.resume,
                jacobian=exact_derivatives, executor=self.executor,
            )  # fmt: skip
        if found.outcome is SearchOutcome.INTERRUPTED:
            raise KeyboardInterrupt
        if self.command is not None:
            write_estimate(found, folder, self.command.made())
        return found


def read_runs(folder: Path, pattern: str, filter_model: FilterModel) -> list[MatchedLog]:
    """Logs of a folder, by name.

    Raises
    ------
    DataError
        If there are none.
    """
    paths = sorted(folder.glob(pattern))
    if not paths:
        raise DataError(f"{folder}: holds no {pattern} - give the folder of the recorded runs", where=(str(folder),))
    return [match(read_log(path), filter_model.model) for path in paths]


def estimate_coasting(logs: Sequence[MatchedLog], filter_model: FilterModel, way: Way) -> Estimate:
    """Stage 1: what runs in neutral tell."""
    stiff = replace(filter_model, method="ros3p", substeps=COASTING_STEPS)
    settings = Settings(method="gradient", starts=1)
    problem = pose(stiff, logs, COAST_DOWN, initial=tuple(_rolling(log, filter_model) for log in logs))
    return way.estimated(problem, settings, "coast-downs")


def _rolling(log: MatchedLog, filter_model: FilterModel) -> dict[str, float]:
    """How a coast-down starts: at 15 m/s, all wheels turning as the measured rear ones, the suspension at rest."""
    axle = float(log.y[filter_model.model.index("output", "axle_speed"), 0])
    return {"forward_velocity": COASTING_SPEED, "rear_axle_speed": axle, "front_axle_speed": axle}


def estimate_driving(
    logs: Sequence[MatchedLog], filter_model: FilterModel, known: MultivariateNormal, way: Way
) -> Estimate:
    """Stage 2: engine and CVT, from the first part of each drive, with what is known of the rest as a prior."""
    stiff = replace(filter_model, method="ros3p", substeps=DRIVING_STEPS, grading=DRIVING_GRADING)
    parts = [log.rows(log.time - log.time[0] < EXCERPT) for log in logs]
    settings = Settings(method="gradient", starts=1, continuation="process-noise", gradient=DRIVING_SEARCH)
    problem = pose(stiff, parts, (*known.names, *DRIVELINE, ROAD), initial="settled", priors=[known])
    return way.estimated(problem, settings, "drives")


def estimate_jointly(coasting: Estimate, driving: Estimate, way: Way) -> Estimate:
    """Everything from coast-downs and drives at once, from where the second stage ended."""
    drives = replace(driving.single, priors=())
    there = {**coasting.values, **driving.values}
    parts = [
        replace(part, free=tuple(replace(one, start=there[one.name]) for one in part.free))
        for part in (coasting.single, drives)
    ]
    settings = Settings(method="gradient", starts=1, gradient=DRIVING_SEARCH)
    return way.estimated(pose_joint(parts), settings, "coast-downs and drives")


@dataclass(frozen=True)
class Looked:
    """A whole drive, filtered with what was found: how consistent, and its picture."""

    found: Consistency
    figure: Figure = field(compare=False)


def look(log: MatchedLog, filter_model: FilterModel, folder: Path) -> Looked:
    """Filter and smooth a whole drive, and draw it."""
    model = filter_model.model
    (start,) = initial_states(model, [log], model.theta(), "settled")
    record = run(filter_model, log, x0=start).raise_if_failed()
    better = smooth(record)
    smoothed = replace(record, filtered_mean=better.smoothed_mean, filtered_cov=better.smoothed_cov)
    found = consistency(record)
    bands = (*state_bands(record, smoothed), *output_bands(record, smoothed, log.u))
    told = [f"{c.name} {c.nis_mean:.3f} ({c.nis_band[0]:.3f} to {c.nis_band[1]:.3f})" for c in found.channels]
    pairs = [", ".join(told[k : k + 2]) for k in range(0, len(told), 2)]
    title = "\n".join([f"{log.name}: mean NIS (and its 95 % band)", *pairs])
    figure = state_figure(bands, title)
    save_figure(figure, folder / f"{log.name}.png")
    return Looked(found, figure)


def study_runs(data: Path, way: Way, jointly: bool = False) -> Recorded:
    """All stages, and everything at once if asked; writes ``result.json`` and a picture per drive."""
    coast_filter = NOISE["ranger_coast_down"].filter_model(build(ranger.coast_down()).model)
    coasting = estimate_coasting(read_runs(data, "coast_down_*.csv", coast_filter), coast_filter, way)
    graph = with_values(ranger.full(), dict(coasting.values))
    full_filter = NOISE["ranger_full"].filter_model(build(graph).model)
    logs = read_runs(data, "drive_*.csv", full_filter)
    driving = estimate_driving(logs, full_filter, coasting.as_prior(), way)
    joint = estimate_jointly(coasting, driving, way) if jointly else None
    values = {one.name: driving.values[one.name] for one in driving.problem.free if one.target.kind == "parameter"}
    road = driving.filter_model.process_noise
    found = replace(NOISE["ranger_full"].filter_model(build(with_values(graph, values)).model), process_noise=road)
    result = Recorded(coasting, driving, {log.name: look(log, found, way.folder) for log in logs}, joint)
    (way.folder / "result.json").write_text(json.dumps(_written(result), indent=1), encoding="utf-8")
    return result


def table(result: Recorded) -> str:
    """Estimates with their standard deviations, and the consistency of every channel, as aligned text."""
    lines = [f"{'parameter':22}{'declared':>12}{'found':>12}{'std':>12}{'change':>9}"]
    for one in (result.coasting, result.driving):
        for free in one.problem.free:
            value, std = one.values[free.name], one.std[free.name]
            change = f"{100.0 * (value / free.start - 1.0):+.1f} %" if free.start else ""
            lines.append(f"{free.name:22}{free.start:>12.5g}{value:>12.5g}{std:>12.2g}{change:>9}")
        lines.append(f"  {one.outcome.value}; NLL {one.nll:.2f}, {one.evaluations} evaluations\n  {one.certification}")
    lines += [] if result.joint is None else comparison(result.driving, result.joint)
    for name, looked in result.drives.items():
        found = looked.found
        lines.append(f"{name}: NIS {shown(found.nis_mean)} in {shown(found.nis_band[0])} to {shown(found.nis_band[1])}")
        for c in found.channels:
            mark = "" if c.nis_band[0] <= c.nis_mean <= c.nis_band[1] else "  outside"
            band = f"{c.nis_band[0]:.3f} to {c.nis_band[1]:.3f}"
            lines.append(f"  {c.name:18}{c.nis_mean:>8.3f} in {band}, whiteness p {shown(c.whiteness_p)}{mark}")
    return "\n".join(lines)


def comparison(staged: Estimate, joint: Estimate) -> list[str]:
    """95 % intervals of the second stage beside those of everything at once, and how far apart they are."""
    heads = (f"{which:>12}{'95 % interval':>24}" for which in ("staged", "jointly"))
    lines = [f"{'parameter':22}{''.join(heads)}{'apart':>8}{'width':>8}"]
    for name in staged.problem.names:
        ends = [f"{one.ci95[name][0]:.5g} to {one.ci95[name][1]:.5g}" for one in (staged, joint)]
        apart = (staged.values[name] - joint.values[name]) / joint.std[name]
        values = [f"{one.values[name]:>12.5g}{end:>24}" for one, end in zip((staged, joint), ends, strict=True)]
        lines.append(f"{name:22}{''.join(values)}{apart:>+8.2f}{staged.std[name] / joint.std[name]:>8.2f}")
    spread = "apart: in standard deviations of the joint estimate; width: standard deviation, staged over joint"
    lines.append(f"  {spread}\n  {joint.outcome.value}; {joint.evaluations} evaluations\n  {joint.certification}")
    return lines


def _written(result: Recorded) -> dict[str, Any]:
    return {
        "coasting": result.coasting.to_dict(),
        "driving": result.driving.to_dict(),
        "joint": None if result.joint is None else result.joint.to_dict(),
        "drives": {
            name: {
                "nis_mean": looked.found.nis_mean,
                "nis_band": list(looked.found.nis_band),
                "channels": {
                    c.name: {"nis_mean": c.nis_mean, "nis_band": list(c.nis_band), "whiteness_p": c.whiteness_p}
                    for c in looked.found.channels
                },
            }
            for name, looked in result.drives.items()
        },
    }


def write_recorded(result: Recorded, folder: Path, made: Provenance) -> None:
    """Write ``report.html``: estimates with intervals, how consistent the filter is, and the drives."""
    stages = [("Coast-downs", result.coasting), ("Drives", result.driving)]
    if result.joint is not None:
        stages.append(("Coast-downs and drives at once", result.joint))
    sections = [
        Section(
            title, [f"{one.outcome.value[:1].upper()}{one.outcome.value[1:]}.", f"{one.certification}."],
            ("parameter", "declared", "found", "95 % interval"),
            [(free.name, shown(free.start, 4), *with_interval(one.values[free.name], one.ci95[free.name]))
             for free in one.problem.free],
        )
        for title, one in stages
    ]  # fmt: skip
    for name, looked in result.drives.items():
        rows = [
            (c.name, shown(c.nis_mean, 3), " to ".join(shown(end, 3) for end in c.nis_band), shown(c.whiteness_p, 2))
            for c in looked.found.channels
        ]
        sections.append(Section(name, (), ("channel", "mean NIS", "95 % band", "whiteness p"), rows, looked.figure))
    outside = sum(
        not c.nis_band[0] <= c.nis_mean <= c.nis_band[1] for one in result.drives.values() for c in one.found.channels
    )
    channels = sum(len(one.found.channels) for one in result.drives.values())
    answer = [
        f"{len(result.coasting.problem.free)} parameters from coast-downs, {len(result.driving.problem.free)} from "
        f"drives; of the mean NIS of {channels} channels of whole drives {outside} are outside their bands.",
        "The reports of the stages, with the errors before and after, are in their folders.",
    ]
    write_page(
        folder / "report.html", "The recorded runs of the Ranger",
        "Coast-downs first, then engine and CVT from the drives, then what the filter says.", answer, sections, made,
    )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input, 130 when interrupted."""
    parser = command_parser("ranger_recorded", __doc__)
    parser.add_argument("data", type=Path, metavar="FOLDER", help="folder of the recorded runs")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write, made if absent")
    parser.add_argument("--joint", action="store_true", help="also estimate from coast-downs and drives at once")
    parser.add_argument("--resume", action="store_true", help="go on from the states of the searches in --out")
    options = parser.parse_args(arguments)
    command = Command("ranger_recorded", sys.argv[1:] if arguments is None else arguments)

    def work() -> None:
        options.out.mkdir(parents=True, exist_ok=True)
        with open_executor(options.executor) as executor:
            way = Way(options.out, options.resume, executor, command)
            result = study_runs(options.data, way, options.joint)
        print(table(result))
        write_recorded(result, options.out, command.made())
        print(f"written: {options.out}")

    return run_command(work, "the same command with --resume goes on")


if __name__ == "__main__":
    sys.exit(main())
