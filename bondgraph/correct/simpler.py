"""Other laws in the place of those that were found: what came beside a law may speak for a simpler one, or a rival.

A law is chosen beside what its round knew. Stribeck friction of a winch was chosen before the gusts on its load were
described; beside these dry friction loses 1.1 nats to it, with two parameters fewer. So at the end each law with
several coefficients is weighed against the simpler ones at its place, and the best of those that do as well by the
Bayesian information criterion is taken. Others that the data do not tell from it are named with it. A law beside which
others were found is weighed against those that came near it in its round, too: of a kiln whose thermocouple lags and
whose flue draws, a lag of the heater was chosen while the flue was unknown.

A sum of laws of one signal is weighed against single laws that draw its curve, and so is a law with those that complete
its form. A leak of a pump with the power 1.35 of the pressure was chosen as an overflow, which a straight leak
completed; a loss in a hose with the power 1.75 of its flow as a square, which a dead zone of the pump completed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.correct.constants import INDIFFERENT, MOSTLY
from bondgraph.correct.evidence.certified import refined
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.fits.whiteness import is_white
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.models.shaping_filters import DISTURBANCE
from bondgraph.correct.progress import Decision, Progress, reduced_to
from bondgraph.correct.round import Round, RoundSettings
from bondgraph.correct.search.storages import started_anew
from bondgraph.correct.shapes.completions import arguments
from bondgraph.correct.shapes.formula import formula_of, is_long
from bondgraph.correct.shapes.offered import Residual
from bondgraph.correct.shapes.relatives import single_laws
from bondgraph.data.log import FloatArray
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.fitted import at_optimum
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.filter.filter_model import FilterModel
from bondgraph.text import count, few

#: Rivals that are refitted in the place of a law; each costs a fit. A convention.
_RIVALS = 2


def in_simpler_laws(state: Progress, rounds: Sequence[Round], settings: RoundSettings) -> Progress:
    """The state with each of its laws in the place of which a simpler one does as well replaced by that.

    So is a law in the place of which a rival of its round does better beside what came after it. None of stiff models
    in the place of a sum, and no rivals: their refits are costly.
    """
    for k in range(len(state.added)):
        state = _simplified(state, k, rounds, settings)
    for k in range(len(state.added)):
        state = _against_rivals(state, k, rounds, settings)
    return state


def in_one_law(
    state: Progress, rounds: Sequence[Round], settings: RoundSettings, completes: Mapping[str, str]
) -> Progress:
    """The state with single laws in the place of several, where one law does as well as all of them.

    ``completes`` are labels of laws by those that complete them. A constant beside a law at its place is tried with it.
    """
    for first in [one.candidate.label for one in state.laws]:
        whole = next((one for one in state.added if one.candidate.label == first), None)
        if whole is None:  # it went with another one
            continue
        beside = [one for one in state.added if _adds_to(one, whole, completes, state.built.graph)]
        if beside and not any(one.candidate.effect.regime or one.gate is not None for one in beside):
            index = next(k for k, one in enumerate(state.added) if one is whole)
            others = _singles(state, index, rounds, settings, beside)
            state = _best(state, index, others, rounds, settings, beside)
    return state


def _adds_to(law: Trial, whole: Trial, completes: Mapping[str, str], graph: BondGraph) -> bool:
    """True for a law that completes another one, or is a constant at its place."""
    if law is whole:
        return False
    here = law.candidate.place.label == whole.candidate.place.label
    return completes.get(law.candidate.label) == whole.candidate.label or (
        here and arguments(law, graph) == frozenset()
    )


def _simplified(state: Progress, index: int, rounds: Sequence[Round], settings: RoundSettings) -> Progress:
    """The state with the best simpler law in the place of one, if one does as well."""
    is_sum = bool(state.added[index].forms) or is_long(state.added[index].candidate.function)
    others = _singles(state, index, rounds, settings) if is_sum else _simpler(state, index, rounds)
    return _best(state, index, others, rounds, settings)


def _best(
    state: Progress,
    index: int,
    others: Sequence[_Other],
    rounds: Sequence[Round],
    settings: RoundSettings,
    beside: Sequence[Trial] = (),
) -> Progress:
    """The state with the best of some laws in the place of one, and of those ``beside`` it, if one does as well."""
    found = [
        attempted(lambda one=one: _with(state, index, one, len(rounds), settings, beside), lambda why: None)  # type: ignore[misc]
        for one in others
    ]
    ranked = sorted(filter(None, found), key=_criterion)
    if not ranked:
        return state
    best, *rest = ranked
    index -= sum(_is_one_of(one, beside) for one in state.added[:index])
    alike = tuple(one.added[index].candidate.label for one in rest if _criterion(one) - _criterion(best) < INDIFFERENT)
    taken = replace(best.added[index], stands_for=alike)
    return replace(best, added=tuple(taken if k == index else one for k, one in enumerate(best.added)))


def _is_one_of(trial: Trial, several: Sequence[Trial]) -> bool:
    return any(trial is one for one in several)


def _criterion(state: Progress) -> float:
    """The Bayesian information criterion of a state, halved: nats, the smaller the better."""
    measured = sum(int(np.isfinite(log.y).sum()) for log in state.train)
    return state.fit.nll + 0.5 * math.log(max(measured, 2)) * len(state.fit.problem.free)


@dataclass(frozen=True)
class _Other:
    """A law for the place of one, its free parameters with where they start, and the nats that it must do better.

    Less than none of a rival, which may do as well.
    """

    trial: Trial
    own: tuple[FreeParameter, ...]
    least: float = 0.0


def _singles(
    state: Progress, index: int, rounds: Sequence[Round], settings: RoundSettings, beside: Sequence[Trial] = ()
) -> list[_Other]:
    """Single laws that draw nearly the curve of a sum of laws, of which some stand ``beside`` the one at an index."""
    whole, *others = [replace(one, fit=state.fit, built=state.built) for one in (state.added[index], *beside)]
    effect, stiff = whole.candidate.effect, state.fit.problem.filter_model.is_stiff
    if not rounds or stiff or effect.channel or effect.regime or whole.gate is not None:
        return []
    turn = rounds[-1]
    left = Residual(state.built, turn.linear, turn.probed, turn.signals, turn.located)
    context = Context(state.built, state.fit, state.train, 1, settings.level, 0.0, settings.journal)
    trials = [one for each in rounds for one in each.trials]
    most = sum(len(one.candidate.effect.parameters) for one in (whole, *beside))
    return attempted(
        lambda: [
            _Other(trial, own) for trial, own in single_laws(whole, trials, left, context, others) if len(own) <= most
        ],
        lambda why: [],
    )


def _simpler(state: Progress, index: int, rounds: Sequence[Round]) -> list[_Other]:
    """Refitted laws of the dictionary at the place of a law that have fewer parameters than it.

    None that did not transfer in its round: of a mixer whose grease warms a spring to the frame came in so.
    """
    law = state.added[index]
    effect = law.candidate.effect
    if effect.kind == DISTURBANCE or effect.channel or effect.regime or law.gate is not None:
        return []
    best: dict[str, Trial] = {}
    for one in (trial for turn in rounds for trial in turn.trials):
        own, known = one.candidate.effect, best.get(one.candidate.label)
        alike = one.candidate.place.label == law.candidate.place.label and one.gate is None and not own.regime
        if not alike or one.fit is None or own.channel or own.adds_state or formula_of(one.candidate.function):
            continue
        if one.transfer is not None and not one.transfer.passes:
            continue
        if len(own.parameters) < len(effect.parameters) and (known is None or one.gain > known.gain):
            best[one.candidate.label] = one
    return [_Other(one, _refitted(one)) for one in best.values()]


def _against_rivals(state: Progress, index: int, rounds: Sequence[Round], settings: RoundSettings) -> Progress:
    """The state with the best rival in the place of a law, if one does clearly better; else with those that do as well.

    Equals of a law that was not known to be one of several are named with it.
    """
    found = [
        made
        for one in _rivals(state, index, rounds)
        if (made := attempted(lambda one=one: _with(state, index, one, len(rounds), settings), lambda why: None))  # type: ignore[misc]
    ]
    if not found:
        return state
    best = min(found, key=_criterion)
    chosen = best if _criterion(best) < _criterion(state) - INDIFFERENT else state
    labels = [one.added[index].candidate.label for one in (state, *found) if one is not chosen]
    worth = [_criterion(one) for one in (state, *found) if one is not chosen]
    alike = tuple(label for label, one in zip(labels, worth, strict=True) if one - _criterion(chosen) < INDIFFERENT)
    law = replace(chosen.added[index], rivals=alike)
    return replace(chosen, added=tuple(law if k == index else one for k, one in enumerate(chosen.added)))


def _rivals(state: Progress, index: int, rounds: Sequence[Round]) -> list[_Other]:
    """Refitted laws that explained most of what a law did in its round, if more was found after that."""
    law = state.added[index]
    stiff, effect = state.fit.problem.filter_model.is_stiff, law.candidate.effect
    labels = [None if one.chosen is None else one.chosen.candidate.label for one in rounds]
    chosen = [k for k, label in enumerate(labels) if label == law.candidate.label]
    if stiff or effect.kind == DISTURBANCE or effect.regime or law.gate is not None or law.forms or not chosen:
        return []
    turn = rounds[chosen[-1]]
    if not any(labels[chosen[-1] + 1 :]):
        return []
    there = {one.candidate.label for one in state.added}
    near = [
        one
        for one in turn.trials
        if one.candidate.label not in there
        and one.fit is not None
        and one.gate is None
        and not one.candidate.effect.regime
        and not formula_of(one.candidate.function)
        and turn.chosen is not None
        and one.gain > MOSTLY * turn.chosen.gain
    ]
    best = sorted(near, key=lambda one: -one.gain)[:_RIVALS]
    return [_Other(one, _refitted(one), -INDIFFERENT) for one in best]


def _refitted(trial: Trial) -> tuple[FreeParameter, ...]:
    """The free parameters of a law that was refitted, to start where that ended."""
    assert trial.fit is not None  # only those are taken
    return tuple(one for one in at_optimum(trial.fit) if one.name in trial.candidate.effect.parameters)


def _with(
    state: Progress, index: int, other: _Other, number: int, settings: RoundSettings, beside: Sequence[Trial] = ()
) -> Progress | None:
    """The state with another law in the place of one, and of those ``beside`` it; None where it does not do as well."""
    law, trial = state.added[index], other.trial
    if law.evidence is None:
        return None
    kept = [trial if k == index else one for k, one in enumerate(state.added) if not _is_one_of(one, beside)]
    reduced = reduced_to(state, kept)
    filter_model = _with_starts_of(trial, reduced.problem.filter_model)
    problem = replace(reduced.problem, filter_model=filter_model, free=(*reduced.problem.free, *other.own))
    fitted = min(
        (fit(problem, starts=[start], journal=settings.journal) for start in _starts(problem, trial)),
        key=lambda one: one.nll,
    )
    if trial.candidate.effect.adds_state:
        before = reduced_to(state, [one for one in kept if one is not trial]).built
        fitted = started_anew(fitted, before, reduced.built, trial.candidate.effect.channel, settings.journal)
    instead = replace(state, built=reduced.built, fit=fitted)
    lost, gained = fitted.nll - state.fit.nll, _criterion(state) - _criterion(instead)
    unproven = bool(other.least and trial.candidate.effect.channel) and not is_white(fitted, settings.level)
    if reduced.baseless or unproven or not gained > other.least:
        return None
    fitted, check = refined(fitted, settings.journal, settings.substeps)
    evidence = replace(
        law.evidence, delta_nll=law.evidence.delta_nll - lost, bic_gain=law.evidence.bic_gain + gained
    )  # fmt: skip
    taken = replace(
        trial, fit=fitted, built=reduced.built, evidence=evidence, transfer=law.transfer,
        simplifies=law.candidate.label, stands_for=(), instead=None, remark="",
    )  # fmt: skip
    action, why = ("replaced" if other.least else "simplified"), _why(other, law, beside, lost)
    return replace(
        instead, fit=fitted, check=check,
        added=tuple(taken if one is trial else one for one in reduced.kept),
        history=(*state.history, Decision(number, action, law.candidate.label, why)),
    )  # fmt: skip


def _why(other: _Other, law: Trial, beside: Sequence[Trial], lost: float) -> str:
    """Why another law takes the place of one, and of those ``beside`` it; ``lost`` nats of likelihood."""
    nats = f"{abs(lost):.1f} nats {'less' if lost > 0.0 else 'more'}"
    if other.least:
        return f"{other.trial.candidate.label} does better beside what was found later: {nats}"
    fewer = sum(len(one.candidate.effect.parameters) for one in (law, *beside)) - len(other.own)
    why = f"{other.trial.candidate.label} does as well: {nats} with {count(fewer, 'parameter')} fewer"
    return why + (f", and takes the place of {few([one.candidate.label for one in beside])} too" if beside else "")


def _with_starts_of(trial: Trial, filter_model: FilterModel) -> FilterModel:
    """The filter with the starts of the states that a law brings, as they were where it was refitted."""
    if trial.fit is None:
        return filter_model
    own, names = trial.fit.problem.filter_model, filter_model.model.names("state")
    return replace(
        filter_model,
        initial_std={
            **{name: std for name, std in own.initial_std.items() if name in names}, **filter_model.initial_std,
        },
        follows={**{name: at for name, at in own.follows.items() if name in names}, **filter_model.follows},
    )  # fmt: skip


def _starts(problem: EstimationProblem, other: Trial) -> list[FloatArray]:
    """The start of a problem with another law (n,), and one with its shapes as declared: widths have many optima."""
    model, shapes = other.candidate.model, other.candidate.effect.shapes
    declared = [
        one.coordinate(float(np.clip(model.parameters[model.index("parameter", one.name)].value, one.lower, one.upper)))
        if one.name in shapes
        else start
        for one, start in zip(problem.free, problem.start, strict=True)
    ]
    return [problem.start, np.array(declared)] if shapes else [problem.start]
