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
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

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
from bondgraph.estimate.local import fit
from bondgraph.estimate.noise_starts import noisy_starts
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.simulate.simulation import simulate

#: An effect must lower the error on unseen training logs by this share.
LEAST_GAIN = 0.03
#: Starts of a fit beside the end of the last step: as declared, and spread over the bounds.
STARTS = 4
_TOLERANCE, _ITERATIONS = 0.02, 80


@dataclass(frozen=True)
class Machine:
    """What a chain needs to know of a machine: the graph with some effects, and which may be declared together.

    ``window``: samples at the start of a log that may tell the initial state; with none it is as declared.
    """

    declared: Callable[[Sequence[str]], BondGraph]
    effects: tuple[str, ...]
    possible: Callable[[Sequence[str]], bool] = lambda effects: True
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


def forward_selection(
    machine: Machine,
    train: Sequence[Log],
    holdout: Sequence[Log],
    tell: Callable[[Step], None] = lambda step: None,
    begin: Sequence[str] = (),
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
    """
    current = tried(machine, tuple(begin), train, {})
    steps = [Step(current, (), holdout_errors(machine, current, holdout))]
    tell(steps[-1])
    while True:
        sets = [(*current.effects, name) for name in machine.effects if name not in current.effects]
        trials = [tried(machine, names, train, current.values) for names in sets if machine.possible(names)]
        trials.sort(key=lambda trial: trial.unseen)
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
            found.append(fit(filter_model, logs, declared, _ITERATIONS, _TOLERANCE, starts))
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


def simulation_errors(built: BuiltModel, values: dict[str, float], logs: Sequence[MatchedLog]) -> dict[str, float]:
    """Root mean square error of the first output in free simulation, by log."""
    errors = {}
    for log in logs:
        theta = {name: value for name, value in values.items() if name in built.model.names("parameter")}
        run = simulate(built.model, log.time, log.u, theta, method="rk4", substeps=8, compiled=True)
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
