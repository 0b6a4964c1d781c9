"""Closing the loop: fit, look at the residual, try what physics allows everywhere, add what the data ask for, repeat.

graph + training logs -> fit -> scores of all candidates -> refits of the few best -> decision -> corrected graph -> fit

Held-out logs are assessed before and after and decide nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from bondgraph.correct.absent import absent_when_zero
from bondgraph.correct.assess import Assessment, assess
from bondgraph.correct.build import BuiltModel, build
from bondgraph.correct.candidates import Candidate, Refused, candidates, places, superset
from bondgraph.correct.decide import alternatives, choose, detectable, hurdle, score_blocks
from bondgraph.correct.fit import Fit, Report, expand_with, fit, no_report, noisy_starts, restricted
from bondgraph.correct.refit import Ground, at_optimum, coefficients, refit_best, try_storage
from bondgraph.correct.score import Scores, scores
from bondgraph.correct.setup import FilterSetup, filter_setup
from bondgraph.correct.trials import Alternative, Detectable, Trial
from bondgraph.correct.whiteness import Whiteness, whiteness
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import with_values
from bondgraph.declare.effect import EffectFunction, Place
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import DataError, EstimationError, OptionError
from bondgraph.estimate.free import FreeParameter, declared_free

#: Measurements per free parameter below which nothing can be concluded.
_MEASUREMENTS_EACH = 20
#: The declared model is fitted to this many nats, far below what an effect must gain.
_TOLERANCE = 0.05
_MOST_ITERATIONS = 60

Verdict = Literal["effect found", "no missing effect", "unexplained residual"]


@dataclass(frozen=True)
class LoopSettings:
    """How far a correction goes.

    ``level`` is the chance of a false alarm over all candidates of one round; ``refits`` how many of the best scores
    are refitted at most; ``process_noise`` as in :func:`bondgraph.correct.setup.filter_setup`.
    """

    level: float = 0.01
    max_effects: int = 3
    refits: int = 6
    process_noise: str = "free"
    free: tuple[str, ...] = ()


@dataclass(frozen=True)
class Round:
    """One turn of the loop: what was tried on a fitted model, what was decided, and what could have been seen."""

    base: Fit
    trials: tuple[Trial, ...]
    refused: tuple[Refused, ...]
    scores: Scores
    chosen: Trial | None
    alternatives: tuple[Alternative, ...]
    detectable: tuple[Detectable, ...] = ()


@dataclass(frozen=True)
class Added:
    """An effect that was added, its coefficients estimated anew with everything else free."""

    trial: Trial
    coefficients: tuple[str, ...]


@dataclass(frozen=True)
class ClosedLoop:
    """The whole correction: both models fitted and assessed, and the history of decisions."""

    verdict: Verdict
    reason: str
    nominal: Fit
    corrected: Fit
    nominal_train: Assessment
    nominal_holdout: Assessment
    corrected_train: Assessment
    corrected_holdout: Assessment
    nominal_built: BuiltModel
    corrected_built: BuiltModel
    added: tuple[Added, ...]
    rounds: tuple[Round, ...]
    whiteness: tuple[Whiteness, ...] = field(default=())

    @property
    def corrected_graph(self) -> BondGraph:
        """The declaration with the added effects and the estimated values."""
        return self.corrected_built.graph

    @property
    def detectable(self) -> tuple[Detectable, ...]:
        """What could still have been seen in the training logs: the power behind "nothing more is missing"."""
        return self.rounds[-1].detectable if self.rounds else ()


def close_loop(
    graph: BondGraph,
    train: Sequence[MatchedLog],
    holdout: Sequence[MatchedLog],
    functions: Sequence[EffectFunction],
    settings: LoopSettings | None = None,
    report: Report = no_report,
) -> ClosedLoop:
    """Find what a declared graph lacks, from measured logs, and return the corrected declaration.

    Parameters
    ----------
    graph
        The declared graph; parameters with bounds are free unless ``settings.free`` names them.
    train, holdout
        Logs matched to the graph's model. Held-out logs are assessed and decide nothing.
    functions
        Effect functions to try.
    settings
        Levels and limits.
    report
        Called with a stage and its progress.

    Raises
    ------
    DataError
        If there is no training log.
    EstimationError
        If the declared model cannot be fitted at all.
    BondGraphError
        If the graph is refused.
    """
    settings = settings or LoopSettings()
    _check_given(graph, train, functions)
    built = build(graph)
    setup = filter_setup(built.model, built.driven, train, settings.process_noise)
    free = (*free_parameters(setup, settings.free), *setup.noise)
    _check_enough(graph, train, len(free))
    report("fit the declared model", 0, 1)
    nominal = fit(setup.filter_model, train, free, _MOST_ITERATIONS, _TOLERANCE, noisy_starts(free))
    report("fit the declared model", 1, 1)
    current, current_built = nominal, built
    added: list[Added] = []
    rounds: list[Round] = []
    reason = f"the limit of {settings.max_effects} effects was reached"
    while len(added) < settings.max_effects:
        present = {(a.trial.candidate.function.__name__, a.trial.candidate.place.label) for a in added}
        turn = one_round(current_built, current, train, functions, settings, report, present)
        rounds.append(turn)
        if turn.chosen is None:
            reason = "no further candidate passes the tests" if added else "no candidate passes the tests"
            break
        current_built, current = _estimated_again(turn.chosen, train, report)
        added.append(Added(turn.chosen, turn.chosen.candidate.effect.coefficients))
    residual = whiteness(current, train)
    corrected_built = build(with_values(current_built.graph, _model_values(current)))
    report("assess", 0, 1)
    result = ClosedLoop(
        *_verdict(added, residual, settings.level, reason), nominal, current,
        assess(nominal, train), assess(nominal, holdout), assess(current, train), assess(current, holdout),
        built, corrected_built, tuple(added), tuple(rounds), residual,
    )  # fmt: skip
    report("assess", 1, 1)
    return result


def _check_given(graph: BondGraph, train: Sequence[MatchedLog], functions: Sequence[EffectFunction]) -> None:
    if not train:
        raise DataError(f"{graph.name}: no training log - give at least one with --data")
    if not functions:
        raise OptionError(f"{graph.name}: no effect to try - give a module with effect functions")


def _check_enough(graph: BondGraph, train: Sequence[MatchedLog], free: int) -> None:
    measured = sum(int(np.isfinite(log.y).sum()) for log in train)
    if measured < _MEASUREMENTS_EACH * free:
        raise DataError(
            f"{graph.name}: {measured} measurements in {', '.join(log.name for log in train)} are too few for {free} "
            f"free parameters and noise levels - give longer logs, at least {_MEASUREMENTS_EACH * free} measurements"
        )


def free_parameters(setup: FilterSetup, names: Sequence[str]) -> tuple[FreeParameter, ...]:
    """The named parameters, or all that declare bounds; starts at a bound are moved inside."""
    model = setup.filter_model.model
    chosen = tuple(names) or tuple(info.name for info in model.parameters if info.lower is not None)
    if not chosen:
        raise EstimationError(
            f"{model.name}: no parameter declares bounds, so nothing is free - declare bounds, or name some with --free"
        )
    return tuple(declared_free(name, setup.filter_model) for name in chosen)


def one_round(
    built: BuiltModel,
    base: Fit,
    train: Sequence[MatchedLog],
    functions: Sequence[EffectFunction],
    settings: LoopSettings,
    report: Report,
    present: Collection[tuple[str, str]] = (),
) -> Round:
    """Score every candidate on the fitted model, refit the best, decide."""
    report("score the candidates", 0, 1)
    runs = base.runs(train)
    where = places(built, train, runs, base.theta)
    found, refused = candidates(built, functions, where, present)
    found, spoiling = absent_when_zero(built, found, train, runs)
    refused += spoiling
    if not found:
        raise DataError(_nothing_to_try(built, where, refused))
    vanishing = [candidate for candidate in found if not candidate.effect.adds_state]
    need = hurdle(train, len(found), settings.level)
    result, seen = _scored(built, base, vanishing, need)
    report("score the candidates", 1, 1)
    corrected_p = np.minimum(1.0, result.p_value * len(found))
    trials = [
        Trial(candidate, float(result.gain[j]), float(result.step[j]), score_p=float(corrected_p[j]))
        for j, candidate in enumerate(vanishing)
    ]
    ground = Ground(built, base, tuple(train), len(found), settings.level, need)
    trials = refit_best(trials, result, ground, settings.refits, report)
    for candidate in (candidate for candidate in found if candidate.effect.adds_state):
        report("try storages", len(trials) - len(vanishing), len(found) - len(vanishing))
        best = choose(trials, settings.level)
        beat = np.inf if best is None or best.fit is None else best.fit.nll
        trials.append(try_storage(Trial(candidate, 0.0, 0.0), ground, beat))
    chosen = choose(trials, settings.level)
    others = alternatives(chosen, trials, result, settings.level)
    return Round(base, tuple(trials), tuple(refused), result, chosen, tuple(others), seen)


def _scored(
    built: BuiltModel, base: Fit, vanishing: Sequence[Candidate], need: float
) -> tuple[Scores, tuple[Detectable, ...]]:
    """Scores of all vanishing candidates, on one model that holds them all with zero coefficients; and their power."""
    everything = superset(built, vanishing)
    wide = replace(base.problem.filter_model, model=everything.model)
    added = [coefficients(candidate, wide)[0] for candidate in vanishing]
    expansion = expand_with(base, wide, added)
    free = ~base.held
    one_sided = np.array([coefficient.lower >= 0.0 for coefficient in added], dtype=bool)
    kept = np.concatenate([free, np.ones(len(added), dtype=bool)])
    result = scores(restricted(expansion, kept), int(free.sum()), one_sided, score_blocks(base.problem))
    units = {info.name: info.unit for info in everything.model.parameters}
    return result, detectable(vanishing, added, result, units, need)


def _nothing_to_try(built: BuiltModel, where: Sequence[Place], refused: Sequence[Refused]) -> str:
    if not where:
        return (
            f"{built.graph.name}: nothing moves in the training logs at any junction, so no effect could show - take "
            "logs in which the machine works"
        )
    reasons = "; ".join(f"{no.effect} at {no.place} {no.why}" for no in refused[:3])
    return (
        f"{built.graph.name}: no effect can be tried at any of {len(where)} places"
        f"{f' ({reasons})' if reasons else ''} - give other effect functions"
    )


def _estimated_again(chosen: Trial, train: Sequence[MatchedLog], report: Report) -> tuple[BuiltModel, Fit]:
    """The chosen candidate's own model, estimated to the full tolerance from where its refit ended."""
    if chosen.fit is None or chosen.built is None:
        raise EstimationError(f"{chosen.candidate.label}: only a candidate that was refitted can be added")
    report("add the effect and estimate again", 0, 1)
    filter_model = replace(chosen.fit.problem.filter_model, model=chosen.built.model)
    fitted = fit(filter_model, train, at_optimum(chosen.fit))
    report("add the effect and estimate again", 1, 1)
    return chosen.built, fitted


def _model_values(fitted: Fit) -> dict[str, float]:
    return {
        parameter.name: fitted.values[parameter.name]
        for parameter in fitted.problem.free
        if parameter.target.kind == "parameter"
    }


def _verdict(added: Sequence[Added], residual: Sequence[Whiteness], level: float, reason: str) -> tuple[Verdict, str]:
    coloured = [test.channel for test in residual if test.p_value * len(residual) < level]
    left = f"; the innovations of {', '.join(coloured)} stay coloured" if coloured else ""
    if added:
        return "effect found", reason + left
    return "unexplained residual" if coloured else "no missing effect", reason + left
