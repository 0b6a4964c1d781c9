"""A correction by forward selection, for what ``bondgraph close-loop`` cannot add by itself.

Effects that change what a sensor reads, or bring several parameters or states of their own, have no coefficient that
is zero when they are absent. They are tried here by declaring the graph with each of them, fitting everything free to
the training logs, and comparing by errors on training logs that the fit has not seen (cross-validation, Stone 1974,
J. R. Stat. Soc. B 36) and by the Bayesian information criterion. Held-out logs are assessed after each step and
decide nothing.

The models are taken as exact (no process noise), so that a fit minimises the error of free simulation.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.data.log import Log, MatchedLog
from bondgraph.data.matching import match
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import BondGraphError
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.handover import spread_starts
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit
from bondgraph.estimate.noise_starts import noisy_starts
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.execute.executors import open_executor
from bondgraph.execute.tasks import as_done
from bondgraph.report import series
from bondgraph.report.html import Provenance, ReportData, write_report
from bondgraph.report.progress import WorkProgress
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from bondgraph.simulate.trajectory import Trajectory
from vehicle_graphs.chain_reports import Command, Fitted, chain_report, held, intervals
from vehicle_graphs.commands import command_parser, run_command
from vehicle_graphs.kept_fits import fit_key

#: An effect must lower the error on unseen training logs by this share.
LEAST_GAIN = 0.03
#: Starts of a fit beside the end of the last step: as declared, and spread over the bounds.
STARTS = 4
_TOLERANCE, _ITERATIONS = 0.02, 80


def _all_together(effects: Sequence[str]) -> bool:
    return True


@dataclass(frozen=True)
class Machine:
    """What a chain needs to know of a machine: the graph with some effects, and which may be declared together.

    ``window``: samples at the start of a log that may tell the initial state; with none it is as declared.
    """

    declared: Callable[[Sequence[str]], BondGraph]
    effects: tuple[str, ...]
    possible: Callable[[Sequence[str]], bool] = _all_together
    window: int = 0


@dataclass(frozen=True)
class Tried:
    """A set of effects, fitted: errors in free simulation per log, and how surely."""

    effects: tuple[str, ...]
    values: dict[str, float]
    nll: float
    free: int
    measured: int
    train: dict[str, float]
    unseen: float

    @property
    def penalised(self) -> float:
        """Negative log-likelihood with the penalty of the Bayesian information criterion."""
        return self.nll + 0.5 * self.free * math.log(self.measured)


@dataclass(frozen=True)
class Step:
    """One step of a chain: what was chosen, what else was tried, and the held-out errors that decided nothing."""

    chosen: Tried
    rejected: tuple[Tried, ...]
    holdout: dict[str, float]


@dataclass(frozen=True)
class Bench:
    """Who fits the sets of effects, and the folder in which finished ones are kept; without one nothing is kept."""

    executor: Executor | None = None
    folder: Path | None = None
    progress: Callable[[], None] = lambda: None

    def tried(
        self, machine: Machine, sets: Sequence[tuple[str, ...]], train: Sequence[Log], known: dict[str, float]
    ) -> list[Tried]:
        """Sets of effects, fitted, in their order: as they were kept, or fitted by workers and kept."""
        keys = [fit_key(build(machine.declared(effects)).text, known, train) for effects in sets]
        journal = Journal(self.folder)
        found = {k: _tried_again(one) for k, key in enumerate(keys) if (one := journal.entry(key)) is not None}
        due = [k for k in range(len(sets)) if k not in found]
        for position, fitted in as_done(self.executor, tried, [(machine, sets[k], train, known) for k in due]):
            found[due[position]] = fitted
            journal.enter(keys[due[position]], asdict(fitted))
            self.progress()
        return [found[k] for k in range(len(sets))]


def _tried_again(kept: dict[str, Any]) -> Tried:
    return Tried(**{**kept, "effects": tuple(kept["effects"])})


def forward_selection(
    machine: Machine,
    train: Sequence[Log],
    holdout: Sequence[Log],
    tell: Callable[[Step], None] = lambda step: None,
    begin: Sequence[str] = (),
    bench: Bench | None = None,
) -> list[Step]:
    """Add effects one by one as long as each lowers the error on unseen training logs and pays for its parameters.

    Parameters
    ----------
    machine
        Graphs and effects.
    train, holdout
        Logs; with at least two training logs, each is once left out.
    tell
        Called after every step.
    begin
        Effects to begin with.
    bench
        Who fits; None: this process, one set after the other.
    """
    bench = bench or Bench()
    (current,) = bench.tried(machine, [tuple(begin)], train, {})
    steps = [Step(current, (), holdout_errors(machine, current, holdout))]
    tell(steps[-1])
    while True:
        sets = [(*current.effects, name) for name in machine.effects if name not in current.effects]
        possible = [names for names in sets if machine.possible(names)]
        trials = sorted(bench.tried(machine, possible, train, current.values), key=lambda trial: trial.unseen)
        best = next((trial for trial in trials if _better(trial, current)), None)
        if best is None:
            steps[-1] = replace(steps[-1], rejected=(*steps[-1].rejected, *trials))
            return steps
        others = tuple(trial for trial in trials if trial is not best)
        steps.append(Step(best, others, holdout_errors(machine, best, holdout)))
        tell(steps[-1])
        current = best


def _better(trial: Tried, current: Tried) -> bool:
    return trial.unseen < (1.0 - LEAST_GAIN) * current.unseen and trial.penalised < current.penalised


def tried(machine: Machine, effects: tuple[str, ...], train: Sequence[Log], known: dict[str, float]) -> Tried:
    """A set of effects fitted to all training logs, and to all but one in turn."""
    built = build(machine.declared(effects))
    logs = [match(log, built.model) for log in train]
    fitted = fitted_exactly(built, logs, known)
    errors = simulation_errors(built, fitted.values, logs)
    unseen = []
    for left in logs if len(logs) > 1 else []:
        others = fitted_exactly(built, [log for log in logs if log is not left], fitted.values, spread=0)
        unseen.append(simulation_errors(built, others.values, [left])[left.name])
    pooled = math.sqrt(float(np.mean(np.square(unseen)))) if unseen else math.inf
    measured = sum(int(np.isfinite(log.y).sum()) for log in logs)
    return Tried(effects, fitted.values, fitted.nll, len(fitted.problem.free), measured, errors, pooled)


def fitted_exactly(built: BuiltModel, logs: Sequence[MatchedLog], known: dict[str, float], spread: int = STARTS) -> Fit:
    """The best of several fits with all that declares bounds free, the initial state known, without process noise.

    Raises
    ------
    EstimationError
        If the model diverges from every start.
    """
    setup = filter_setup(built.model, built.driven, logs, "none")
    filter_model = replace(setup.filter_model, initial_std={})
    declared = (*free_parameters(setup, ()), *setup.noise)
    warm = tuple(_from(parameter, known) for parameter in declared)
    further = spread_starts(EstimationProblem(filter_model, tuple(logs), declared), spread, seed=0) if spread else None
    found: list[Fit] = []
    failed: BondGraphError | None = None
    for start in (np.array([p.coordinate(p.start) for p in warm]), *(() if further is None else further.T)):
        starts = [*_at_noise_levels(declared, start)]
        try:
            found.append(
                fit(EstimationProblem(filter_model, tuple(logs), tuple(declared)), _ITERATIONS, _TOLERANCE, starts)
            )
        except BondGraphError as error:
            failed = error
    if not found and failed is not None:
        raise failed
    return min(found, key=lambda one: one.nll)


def _from(parameter: FreeParameter, known: dict[str, float]) -> FreeParameter:
    value = known.get(parameter.name, parameter.start)
    return replace(parameter, start=float(np.clip(value, parameter.lower, parameter.upper)))


def _at_noise_levels(declared: Sequence[FreeParameter], start: np.ndarray) -> list[np.ndarray]:
    """The same start with several noise levels."""
    reference = np.array([p.coordinate(p.start) for p in declared])
    return [start + (point - reference) for point in noisy_starts(declared)[:3]]


def simulated(model: Model, values: Mapping[str, float], log: MatchedLog) -> Trajectory:
    """Free simulation of a log with fitted values."""
    theta = {name: value for name, value in values.items() if name in model.names("parameter")}
    return simulate(model, log.time, log.u, theta, method="rk4", substeps=8, compiled=True)


def simulation_errors(built: BuiltModel, values: dict[str, float], logs: Sequence[MatchedLog]) -> dict[str, float]:
    """Root mean square error of the first output in free simulation, by log."""
    errors = {}
    for log in logs:
        run = simulated(built.model, values, log)
        errors[log.name] = float(np.sqrt(np.nanmean((run.y[0] - log.y[0]) ** 2)))
    return errors


def holdout_errors(machine: Machine, chosen: Tried, holdout: Sequence[Log]) -> dict[str, float]:
    """Errors of a fitted set of effects on held-out logs."""
    built = build(machine.declared(chosen.effects))
    return simulation_errors(built, chosen.values, [match(log, built.model) for log in holdout])


def table(steps: Sequence[Step]) -> str:
    """The chain as text: what was added, errors on training, unseen training and held-out logs, and the runners-up."""
    lines = []
    for step in steps:
        chosen = step.chosen
        name = chosen.effects[-1] if chosen.effects else "start"
        parts = [
            " ".join(f"{log} {error:.4g}" for log, error in group.items()) for group in (chosen.train, step.holdout)
        ]
        told = f"unseen: {chosen.unseen:.4g} | BIC/2 {chosen.penalised:.1f}"
        lines.append(f"{name:20s} train: {parts[0]} | {told} | held out: {parts[1]}")
        for other in step.rejected:
            lines.append(f"    not {other.effects[-1]:20s} unseen {other.unseen:.4g}, BIC/2 {other.penalised:.1f}")
    return "\n".join(lines)


def selection_report(
    title: str, machine: Machine, steps: Sequence[Step], logs: tuple[Sequence[Log], Sequence[Log]], made: Provenance
) -> ReportData:
    """The report of a forward selection; intervals are those of the last fit, taken up once more where it ended."""
    first, last = steps[0].chosen, steps[-1].chosen
    built = build(machine.declared(last.effects))
    fitted = fitted_exactly(built, [match(log, built.model) for log in logs[0]], last.values, spread=0)
    history = [
        series.Step(
            k, "added", step.chosen.effects[-1],
            f"error on unseen training logs {before.chosen.unseen:.4g} -> {step.chosen.unseen:.4g}, criterion (BIC/2) "
            f"{before.chosen.penalised:.1f} -> {step.chosen.penalised:.1f}",
        )
        for k, (before, step) in enumerate(pairwise(steps), start=1)
    ]  # fmt: skip
    tried = [
        series.Tried(
            other.effects[-1], "", last.nll - other.nll,
            f"error on unseen training logs {other.unseen:.4g} instead of {last.unseen:.4g}, criterion (BIC/2) "
            f"{other.penalised:.1f} instead of {last.penalised:.1f}",
        )
        for other in steps[-1].rejected if other.effects[:-1] == last.effects
    ]  # fmt: skip
    return chain_report(
        title, Fitted(machine.declared(first.effects), first.values),
        Fitted(machine.declared(last.effects), last.values, intervals(fitted), held(fitted)),
        logs, simulated, history, made, tried=tried,
        notes=[
            "The intervals take the errors of free simulation for white; where they are not, the intervals are too "
            "narrow.",
            "An effect is added where it lowers the error on training logs that its fit has not seen by "
            f"{100.0 * LEAST_GAIN:g} % at least, and pays for its parameters.",
        ],
    )  # fmt: skip


def chain_command(
    name: str,
    doc: str | None,
    machine: Machine,
    read: Callable[[Path], tuple[list[Log], list[Log]]],
    arguments: Sequence[str] | None,
) -> int:
    """Command line of a chain; 0 when done, 2 with a message for bad input, 130 when interrupted.

    Parameters
    ----------
    name, doc
        Module and docstring of the chain.
    machine
        Graphs and effects.
    read
        Gives training and held-out logs of a folder.
    arguments
        Of the command; None: those of the process.
    """
    parser = command_parser(name, doc)
    parser.add_argument("logs", type=Path, help=f"folder written by vehicle_graphs.{name.removesuffix('_chain')}_logs")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of report.html and of finished fits, from which it goes on"
    )
    options = parser.parse_args(arguments)
    command = Command(name, sys.argv[1:] if arguments is None else arguments)

    def work() -> None:
        train, test = read(options.logs)
        with (
            open_executor(options.executor) as executor,
            WorkProgress("fitting sets of effects", None, "fits") as progress,
        ):
            bench = Bench(executor, options.out, progress.advance)
            steps = forward_selection(machine, train, test, lambda step: print(table([step]), flush=True), (), bench)
        print("the chain, with what was tried after its last step:")
        print(table(steps))
        if options.out is not None:
            title = name.removesuffix("_chain").replace("_", " ")
            data = selection_report(title, machine, steps, (train, test), command.made(train, test))
            write_report(data, options.out / "report.html")
            print(f"report: {options.out / 'report.html'}")

    return run_command(work, f"the same command goes on with what is in {options.out}" if options.out else "")
