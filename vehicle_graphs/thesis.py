"""The thesis' estimation, redone with known truth, to see whether its estimates are biased and its intervals hold.

    python -m vehicle_graphs.thesis --out study                        coast-downs, 20 repetitions, both suspensions
    python -m vehicle_graphs.thesis --stage driveline --out study      engine and CVT
    python -m vehicle_graphs.thesis --repetitions 3 --short --out try  a quick look
    python -m vehicle_graphs.thesis --executor processes --out study   on all cores; also dask://HOST:PORT

Every repetition draws true parameters, simulates logs with them, and estimates them back. Stage *coast-down* estimates
rolling resistance, drag, brake gain, pitch offset, tyre radius and pitch stiffness from two runs in neutral, once with
the suspension that the logs were made with and once with the quasi-static one of the thesis (P. M. Auby 2016), which
that work names as the source of its bias. Stage *driveline* estimates eight parameters of engine and CVT from a drive;
what the coast-downs tell is taken as known there. The nominal values are tens of thousands of nats away on a drive of
12 s, 850 000 on one of 45 s, where a plain gradient search from them got stuck; with continuation in process noise (see
``bondgraph.estimate.continuation``) it arrived on drives of 6 to 45 s, on those of 12 s within 60 to 220 evaluations.
``--method pso`` searches with the swarm of the thesis, 80 particles and 101 iterations: on a drive of 6 s its 8080
evaluations ended 5 nats short of the gradient search's optimum. An interrupted study goes on where it stopped: each
repetition is a file in the folder.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bondgraph.build import build
from bondgraph.data.log import MatchedLog
from bondgraph.errors import DataError
from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import pose
from bondgraph.estimate.recovery import Recovery, Trial, recovery, recovery_table
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings
from bondgraph.estimate.solvers.particle_swarm import SwarmSettings
from bondgraph.execute.executors import open_executor
from bondgraph.execute.tasks import as_done
from bondgraph.files import write_text
from bondgraph.filter.draw import draw_logs
from bondgraph.filter.filter_model import FilterModel
from bondgraph.report.figures import AFTER, BEFORE, figure_style, save_figure
from bondgraph.report.numbers import shown
from bondgraph.report.page import Section, write_page
from bondgraph.report.progress import WorkProgress
from bondgraph.simulate.model import Model
from vehicle_graphs import ranger
from vehicle_graphs.chain_reports import Command
from vehicle_graphs.commands import command_parser, importable_main, run_command
from vehicle_graphs.ranger_filters import SENSORS

#: Samples per second of the thesis.
RATE = 40.0
#: The inclination as a random walk, the only process noise of the thesis [rad per sqrt(s)]; gentler than on the road of
#: the logs, so that a vehicle without drive keeps rolling forwards for half a minute.
INCLINATION_WALK = 0.004
#: What is not known of the start of a run.
START_STD = {
    "forward_velocity": 0.05, "rear_axle_speed": 0.1, "front_axle_speed": 0.1, "height": 0.05, "inclination": 0.01,
    "heave": 0.001, "pitch": 0.002,
}  # fmt: skip
#: True values are drawn within this share of their nominal ones; the offset of the pitch within this many radians.
SPREAD, OFFSET_SPREAD = 0.12, 0.02
#: Steps between samples of the stiff method that filters (the estimates are certified with twice as many).
COASTING_STEPS, DRIVING_STEPS = 4, 16
#: In a drive each step is this much longer than the one before: sigma points relax onto the gripping belt at first. At
#: 1.35 the last steps are so long that they jump across the zone where belt and tyre grip, and the likelihood far from
#: its optimum becomes chaotic (a change of 1e-6 in one parameter moves it by thousands of nats).
DRIVING_GRADING = 1.2
#: Runge-Kutta steps between samples of the simulated truth: the tyre at standstill has a rate of 3600 1/s, the gripping
#: belt one of up to 12000 1/s.
TRUE_STEPS = {"coast-down": 80, "driveline": 250}

#: The swarm of the thesis: 80 particles and 101 iterations, 8080 evaluations of the likelihood.
THESIS_SWARM = SwarmSettings(members=80, iterations=100, patience=100)
#: The driveline's likelihood has kinks (the weaker of two clutch forces, ends of travel) that are worth
#: thousandths of a nat; a search must not follow them for ever.
DRIVING_SEARCH = GaussNewtonSettings(tolerance=1e-3, patience=3, least_gain=1e-2)

COAST_DOWN = ("f_r", "CdA", "brake_gain", "th_off", "r_d", "spring_gain")
DRIVELINE = ("T_pk", "T_f0", "k_u", "m_fw", "F_p0", "k_p", "r_h", "mu_b")


@dataclass(frozen=True)
class Variant:
    """A model that estimates, and the stage it belongs to."""

    name: str
    stage: str
    graph: str
    free: tuple[str, ...]


VARIANTS = (
    Variant("dynamic suspension", "coast-down", "coast_down", COAST_DOWN),
    Variant("quasi-static suspension", "coast-down", "coast_down_quasi_static", COAST_DOWN),
    Variant("full model", "driveline", "full", DRIVELINE),
)
STAGES = tuple(dict.fromkeys(variant.stage for variant in VARIANTS))


@functools.cache
def _model(graph: str) -> Model:
    return build(getattr(ranger, graph)()).model


def _filter_model(graph: str) -> FilterModel:
    model = _model(graph)
    states, outputs = model.names("state"), model.names("output")
    return FilterModel(
        model,
        {"inclination": INCLINATION_WALK},
        {name: std for name, std in SENSORS.items() if name in outputs},
        {name: std for name, std in START_STD.items() if name in states},
        substeps=DRIVING_STEPS if graph == "full" else COASTING_STEPS,
        method="ros3p",
        grading=DRIVING_GRADING if graph == "full" else 1.0,
        alpha=0.5,
    )


def _pattern(model: Model, name: str, duration: float, inputs: Mapping[str, np.ndarray]) -> MatchedLog:
    times = np.arange(0.0, duration, 1.0 / RATE)
    u = np.repeat(model.u0()[:, np.newaxis], times.size, axis=1)
    for channel, values in inputs.items():
        u[model.index("input", channel)] = values
    return MatchedLog(name, times, u, np.zeros((len(model.outputs), times.size)))


def coast_downs(model: Model, rng: np.random.Generator, short: bool) -> list[MatchedLog]:
    """Two runs in neutral from 15 m/s: one rolls, one is braked now and then."""
    duration = 6.0 if short else 30.0
    times = np.arange(0.0, duration, 1.0 / RATE)
    brake = np.zeros(times.size)
    for start in np.arange(1.0, duration - 2.0, 6.0):
        on = start + rng.uniform(0.0, 2.0)
        brake += rng.uniform(0.05, 0.25) * np.clip(np.minimum((times - on) / 0.2, (on + 1.2 - times) / 0.2), 0.0, 1.0)
    return [_pattern(model, "rolling", duration, {}), _pattern(model, "braked", duration, {"brake": brake})]


def drives(model: Model, rng: np.random.Generator, short: bool) -> list[MatchedLog]:
    """One drive in high gear from rest: throttle of changing size, lifted at least once, and the brake while it is.

    The start tells most: 6 s tell the clutches to 3 to 7 %, 24 s to 2 to 5 %. Friction of the engine shows when the
    throttle is lifted.
    """
    duration = 6.0 if short else 12.0
    times = np.arange(0.0, duration, 1.0 / RATE)
    knots = np.arange(0.0, duration + 4.0, 2.0)
    pressed = (rng.random(knots.size) > 0.25) & (np.arange(knots.size) != 2)
    throttle = np.interp(times, knots, rng.uniform(0.05, 1.0, knots.size) * pressed)
    stops = np.interp(times, knots, np.where(rng.random(knots.size) > 0.85, rng.uniform(0.1, 0.4, knots.size), 0.0))
    return [_pattern(model, "drive", duration, {"throttle": throttle, "brake": np.where(throttle < 0.05, stops, 0.0)})]


def draw_truth(model: Model, free: Sequence[str], rng: np.random.Generator) -> dict[str, float]:
    """True values of the free parameters, around their nominal ones."""
    truth = {}
    for name in free:
        nominal = model.parameters[model.index("parameter", name)].value
        spread = SPREAD * nominal if nominal else OFFSET_SPREAD
        truth[name] = float(nominal + spread * rng.uniform(-1.0, 1.0))
    return truth


def _rolling_start(truth: Mapping[str, float], model: Model) -> dict[str, float]:
    """Rolling at 15 m/s; the tyre radius is what the wheels turn by, so this much of the truth a driver can see."""
    radius = truth.get("r_d", model.parameters[model.index("parameter", "r_d")].value)
    return {"forward_velocity": 15.0, "rear_axle_speed": 15.0 / radius, "front_axle_speed": 15.0 / radius}


@dataclass(frozen=True)
class Study:
    """What to do: how often, with which search, where to keep it."""

    folder: Path
    repetitions: int = 20
    seed: int = 0
    method: str = "gradient"
    short: bool = False

    def trial(self, variant: Variant, repetition: int) -> Trial:
        """The trial of one repetition: from its file, or computed and written there."""
        return self.trials([(variant, repetition)])[variant, repetition]

    def trials(
        self,
        due: Sequence[tuple[Variant, int]],
        done: Callable[[], None] = lambda: None,
        executor: Executor | None = None,
    ) -> dict[tuple[Variant, int], Trial]:
        """The trials of repetitions of variants: from their files, or computed and written there.

        Parameters
        ----------
        due
            Variants, each with the number of a repetition.
        done
            Called for every trial that is there.
        executor
            Whose workers compute, see :mod:`bondgraph.execute`; None: one after the other in this process.

        Raises
        ------
        DataError
            If the folder holds trials of another study.
        """
        found = {}
        for one in due:
            known = self._known(*one)
            if known is not None:
                found[one] = known
                done()
        missing = [one for one in due if one not in found]
        for position, trial in as_done(executor, self._estimated, missing):
            one = missing[position]
            content = {"settings": self._own, "trial": dataclasses.asdict(trial)}
            self._path(*one).parent.mkdir(parents=True, exist_ok=True)
            write_text(self._path(*one), json.dumps(content, indent=1))
            found[one] = trial
            done()
        return found

    @property
    def _own(self) -> list[object]:
        return [self.seed, self.method, self.short]

    def _path(self, variant: Variant, repetition: int) -> Path:
        return self.folder / variant.stage / f"{variant.graph}_{repetition + 1:03d}.json"

    def _known(self, variant: Variant, repetition: int) -> Trial | None:
        """A trial that was finished before."""
        path = self._path(variant, repetition)
        if not path.is_file():
            return None
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["settings"] != self._own:
            raise DataError(
                f"{path}: was made with seed, method, short = {kept['settings']}, now asked for {self._own} - take "
                "another folder or remove this one",
                where=(str(path),),
            )
        return Trial(**kept["trial"])

    def _estimated(self, variant: Variant, repetition: int) -> Trial:
        stage = STAGES.index(variant.stage)
        rng = np.random.default_rng([self.seed, stage, repetition])
        maker = _filter_model("coast_down" if variant.stage == "coast-down" else "full")
        truth = draw_truth(maker.model, variant.free, rng)
        coasting = variant.stage == "coast-down"
        start = _rolling_start(truth, maker.model) if coasting else {}
        patterns = coast_downs(maker.model, rng, self.short) if coasting else drives(maker.model, rng, self.short)
        logs = [
            draw_logs(
                maker, pattern, 1, int(rng.integers(2**31)),
                theta=maker.model.theta(**truth), x0=maker.model.x0(**start), substeps=TRUE_STEPS[variant.stage],
            ).logs[0]
            for pattern in patterns
        ]  # fmt: skip
        estimator = _filter_model(variant.graph)
        problem = pose(estimator, logs, variant.free, initial=(start,) * len(logs))
        began = time.process_time()
        found = estimate(problem, self._settings(variant), jacobian=exact_derivatives)
        spent = time.process_time() - began
        trial = dataclasses.replace(Trial.of(found, truth), cpu=spent)
        # The thesis' swarm is meant to end after its iterations.
        planned = self.method == "pso" and found.outcome is SearchOutcome.ITERATION_LIMIT
        return dataclasses.replace(trial, failure="") if planned else trial

    def _settings(self, variant: Variant) -> Settings:
        coasting, swarm_only = variant.stage == "coast-down", self.method == "pso"
        return Settings(
            method=self.method,
            seed=self.seed,
            starts=1,
            continuation="none" if coasting or swarm_only else "process-noise",
            swarm=THESIS_SWARM if swarm_only else Settings().swarm,
            gradient=GaussNewtonSettings() if coasting else DRIVING_SEARCH,
        )


def run_study(study: Study, stages: Sequence[str], executor: Executor | None = None) -> dict[str, Recovery]:
    """All variants of the stages; writes ``result.json`` and ``recovery.png`` into the folder."""
    chosen = [variant for variant in VARIANTS if variant.stage in stages]
    due = [(variant, repetition) for variant in chosen for repetition in range(study.repetitions)]
    with WorkProgress("estimating", len(due), "repetitions") as work:
        trials = study.trials(due, work.advance, executor)
    found = {
        variant.name: recovery([trials[variant, repetition] for repetition in range(study.repetitions)])
        for variant in chosen
    }
    written = {name: dataclasses.asdict(result) for name, result in found.items()}
    (study.folder / "result.json").write_text(json.dumps(written, indent=1), encoding="utf-8")
    save_figure(recovery_figure(found), study.folder / "recovery.png")
    return found


def write_recovery(found: Mapping[str, Recovery], study: Study, command: Command) -> None:
    """Write ``report.html``: a table for each variant, and the picture of errors and coverage."""
    header = ("parameter", "truth", "mean error", "of its s.e.", "scatter", "stated", "covered", "")
    sections = [Section("Mean errors and coverage", figure=recovery_figure(found))]
    for name, result in found.items():
        rows = [
            (
                row.name, shown(row.truth, 4), shown(row.mean_error, 3), f"{row.in_standard_errors:+.1f}",
                shown(row.scatter, 3), shown(row.stated, 3), f"{100.0 * row.coverage:.0f} %",
                "biased" if row.biased else "",
            )
            for row in result.parameters
        ]  # fmt: skip
        failed = [f"Failed: {failure}." for failure in result.failures]
        sections.append(Section(name[:1].upper() + name[1:], failed, header, rows))
    answer = [
        f"{name}: {100.0 * result.coverage:.0f} % of the 95 % intervals hold the truth, "
        f"{sum(row.biased for row in result.parameters)} of {len(result.parameters)} parameters are biased."
        for name, result in found.items()
    ]
    write_page(
        study.folder / "report.html", "The thesis' estimation with known truth",
        f"{study.repetitions} repetitions: are estimates biased, and do their intervals hold?", answer, sections,
        command.made(seed=study.seed),
    )  # fmt: skip


def recovery_figure(found: Mapping[str, Recovery]) -> Figure:
    """Mean error of every parameter in units of the scatter, with twice its standard error, and the coverage."""
    names = list(dict.fromkeys(row.name for result in found.values() for row in result.parameters))
    with figure_style():
        figure = Figure(figsize=(9.0, 1.4 + 0.42 * len(names)), layout="constrained")
        errors, covered = figure.subplots(1, 2, sharey=True, width_ratios=(2.2, 1.0))
        for number, (label, result) in enumerate(found.items()):
            colour = (AFTER, BEFORE)[number % 2]
            for row in result.parameters:
                at = len(names) - 1 - names.index(row.name) + 0.22 * (0.5 - number % 2)
                bar = 2.0 * row.standard_error / row.stated
                first = label if row is result.parameters[0] else None
                errors.errorbar(
                    row.mean_error / row.stated, at, xerr=bar, fmt="o", color=colour, capsize=3, label=first
                )
                covered.plot(100.0 * row.coverage, at, "o", color=colour)
        errors.axvline(0.0, color="#5b636d", linewidth=0.8)
        errors.set_yticks(range(len(names)), names[::-1])
        errors.set_xlabel("mean error over the stated standard deviation, with two standard errors")
        figure.legend(*errors.get_legend_handles_labels(), loc="outside upper left", ncols=len(found))
        covered.axvline(95.0, color="#5b636d", linewidth=0.8)
        covered.set_xlim(-3.0, 103.0)
        covered.set_xlabel("95 % intervals that hold the truth [%]")
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input, 130 when interrupted."""
    parser = command_parser("thesis", __doc__)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the study, made if absent")
    parser.add_argument("--stage", choices=(*STAGES, "both"), default="coast-down", help="default: coast-down")
    parser.add_argument("--repetitions", type=int, default=20, metavar="N", help="default: 20; at least 2")
    parser.add_argument("--method", choices=("gradient", "pso", "both"), default="gradient", help="default: gradient")
    parser.add_argument("--seed", type=int, default=0, help="default: 0")
    parser.add_argument("--short", action="store_true", help="runs of 6 s instead of 30 s and 12 s")
    options = parser.parse_args(arguments)
    command = Command("thesis", sys.argv[1:] if arguments is None else arguments)
    study = Study(options.out, max(options.repetitions, 2), options.seed, options.method, options.short)

    def work() -> None:
        options.out.mkdir(parents=True, exist_ok=True)
        with open_executor(options.executor) as executor:
            found = run_study(study, STAGES if options.stage == "both" else (options.stage,), executor)
        for name, result in found.items():
            print(f"{name}, {study.repetitions} repetitions\n{recovery_table(result)}\n")
        write_recovery(found, study, command)
        names = ("result.json", "recovery.png", "report.html")
        print(f"written: {', '.join(str(options.out / name) for name in names)}")

    return run_command(work, f"the same command goes on with what is in {options.out}")


if __name__ == "__main__":
    sys.exit(importable_main("thesis"))
