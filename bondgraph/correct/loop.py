"""Closing the loop: fit, look at the residual, try what physics allows at every place, add what the data ask for, repeat.

graph + training logs -> fit -> scores of all candidates -> refits of the few best -> decision -> corrected graph -> fit

Held-out logs are assessed before and after and decide nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from bondgraph.correct.assess import Assessment, assess
from bondgraph.correct.build import BuiltModel, build
from bondgraph.correct.candidates import Candidate, Refused, candidates, places, superset
from bondgraph.correct.decide import Alternative, Trial, alternatives, choose, hurdle, judge
from bondgraph.correct.fit import Fit, Report, expand_with, fit, no_report
from bondgraph.correct.score import Scores, scores
from bondgraph.correct.setup import FilterSetup, filter_setup
from bondgraph.correct.whiteness import Whiteness, whiteness
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import with_values
from bondgraph.declare.effect import EffectFunction
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import DataError, EstimationError, OptionError
from bondgraph.estimate.free import FreeParameter, declared_free
from bondgraph.filter.filter_model import FilterModel

#: Candidates are compared to this many nats; the chosen one is then estimated to the end.
_REFIT_TOLERANCE = 0.1
_MOST_ITERATIONS, _MOST_ITERATIONS_GROWN = 25, 8

Verdict = Literal["effect found", "no missing effect", "unexplained residual"]


@dataclass(frozen=True)
class LoopSettings:
    """How far a correction goes.

    ``level`` is the chance of a false alarm over all candidates of one round; ``refits`` how many of the best scores are
    refitted; ``process_noise`` as in :func:`bondgraph.correct.setup.filter_setup`.
    """

    level: float = 0.01
    max_effects: int = 3
    refits: int = 6
    process_noise: str = "free"
    free: tuple[str, ...] = ()


@dataclass(frozen=True)
class Round:
    """One turn of the loop: what was tried on a fitted model and what was decided."""

    base: Fit
    trials: tuple[Trial, ...]
    refused: tuple[Refused, ...]
    scores: Scores
    chosen: Trial | None
    alternatives: tuple[Alternative, ...]


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
    if not train:
        raise DataError(f"{graph.name}: no training log - give at least one with --data")
    if not functions:
        raise OptionError(f"{graph.name}: no effect to try - give a module with effect functions")
    built = build(graph)
    setup = filter_setup(built.model, built.driven, train, settings.process_noise)
    free = (*free_parameters(setup, settings.free), *setup.noise)
    report("fit the declared model", 0, 1)
    nominal = fit(setup.filter_model, train, free)
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
        _verdict(added, residual, settings.level), reason, nominal, current,
        assess(nominal, train), assess(nominal, holdout), assess(current, train), assess(current, holdout),
        built, corrected_built, tuple(added), tuple(rounds), residual,
    )  # fmt: skip
    report("assess", 1, 1)
    return result


def free_parameters(setup: FilterSetup, names: Sequence[str]) -> tuple[FreeParameter, ...]:
    """The named parameters, or all that declare bounds; starts at a bound are moved inside."""
    model = setup.filter_model.model
    chosen = tuple(names) or tuple(info.name for info in model.parameters if info.lower is not None)
    if not chosen:
        raise EstimationError(
            f"{model.name}: no parameter declares bounds, so nothing is free - declare bounds or name parameters with --free"
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
    where = places(built, train, base.runs(train), base.theta)
    found, refused = candidates(built, functions, where, present)
    vanishing = [candidate for candidate in found if not candidate.effect.adds_state]
    growing = [candidate for candidate in found if candidate.effect.adds_state]
    report("score the candidates", 0, 1)
    result = _scores(built, base, vanishing)
    report("score the candidates", 1, 1)
    trials = [Trial(c, float(result.gain[j]), float(result.step[j])) for j, c in enumerate(vanishing)]
    trials += [Trial(candidate, 0.0, 0.0) for candidate in growing]
    promising = [j for j in np.argsort(-result.gain) if result.gain[j] > 0.5 * hurdle(train, len(found), settings.level)]
    picked = [*map(int, promising[: settings.refits]), *range(len(vanishing), len(found))]
    for done, j in enumerate(picked):
        report("refit the best candidates", done, len(picked))
        trials[j] = _refit(trials[j], built, base, train, len(found))
    report("refit the best candidates", 1, 1)
    chosen = choose(trials, settings.level)
    others = alternatives(chosen, trials, result, settings.level)
    return Round(base, tuple(trials), tuple(refused), result, chosen, tuple(others))


def _scores(built: BuiltModel, base: Fit, vanishing: Sequence[Candidate]) -> Scores:
    """Scores of all vanishing candidates, on one model that holds them all with zero coefficients."""
    everything = superset(built, vanishing)
    wide = replace(base.problem.filter_model, model=everything.model)
    held = replace(base, problem=replace(base.problem, filter_model=wide))
    coefficients = [_coefficients(candidate, wide)[0] for candidate in vanishing]
    expansion = expand_with(held, coefficients)
    one_sided = np.array([coefficient.lower >= 0.0 for coefficient in coefficients], dtype=bool)
    return scores(expansion, len(base.problem.free), one_sided)


def _coefficients(candidate: Candidate, filter_model: FilterModel) -> list[FreeParameter]:
    """Coefficients of a candidate as free parameters, on a linear scale since zero is where they begin."""
    parameters = {info.name: info for info in filter_model.model.parameters}
    found = []
    for name in candidate.effect.coefficients:
        info = parameters[name]
        if info.lower is None or info.upper is None:
            raise EstimationError(
                f"{candidate.label}: its coefficient {name} has no bounds - declare them in the effect function",
                where=(name,),
            )
        found.append(FreeParameter(name, info.lower, info.upper, info.value))
    return found


def _started(coefficient: FreeParameter, step: float) -> FreeParameter:
    """A coefficient that starts where its score points, inside its bounds."""
    reach = 0.5 * (coefficient.upper - coefficient.lower)
    start = coefficient.start + float(np.clip(step, -reach, reach))
    margin = 1e-6 * reach
    return replace(coefficient, start=float(np.clip(start, coefficient.lower + margin, coefficient.upper - margin)))


def _at(base: Fit) -> tuple[FreeParameter, ...]:
    """The free parameters of a fit, starting from its optimum."""
    values = base.values
    return tuple(
        replace(parameter, start=float(np.clip(values[parameter.name], parameter.lower, parameter.upper)))
        for parameter in base.problem.free
    )


def _refit(trial: Trial, built: BuiltModel, base: Fit, train: Sequence[MatchedLog], tried: int) -> Trial:
    """The candidate in the graph, the module regenerated, everything free estimated again from the fit without it."""
    extended = build(trial.candidate.apply(built.graph))
    filter_model = replace(base.problem.filter_model, model=extended.model)
    if trial.candidate.effect.adds_state:
        own = filter_setup(extended.model, extended.driven, train)
        filter_model = replace(
            filter_model, initial_std=own.filter_model.initial_std, substeps=own.filter_model.substeps
        )
    coefficients = [_started(free, trial.step) for free in _coefficients(trial.candidate, filter_model)]
    most = _MOST_ITERATIONS_GROWN if trial.candidate.effect.adds_state else _MOST_ITERATIONS
    refit = fit(filter_model, train, (*_at(base), *coefficients), most, _REFIT_TOLERANCE)
    names = [coefficient.name for coefficient in coefficients]
    return replace(trial, built=extended, fit=refit, evidence=judge(base, refit, names, tried))


def _estimated_again(chosen: Trial, train: Sequence[MatchedLog], report: Report) -> tuple[BuiltModel, Fit]:
    """The chosen candidate's model, estimated to the full tolerance from where its refit ended."""
    assert chosen.fit is not None and chosen.built is not None  # only refitted candidates are chosen
    report("add the effect and estimate again", 0, 1)
    fitted = fit(chosen.fit.problem.filter_model, train, _at(chosen.fit))
    report("add the effect and estimate again", 1, 1)
    return chosen.built, fitted


def _model_values(fitted: Fit) -> dict[str, float]:
    return {
        parameter.name: fitted.values[parameter.name]
        for parameter in fitted.problem.free
        if parameter.target.kind == "parameter"
    }


def _verdict(added: Sequence[Added], residual: Sequence[Whiteness], level: float) -> Verdict:
    if added:
        return "effect found"
    coloured = [test for test in residual if test.p_value * len(residual) < level]
    return "unexplained residual" if coloured else "no missing effect"
