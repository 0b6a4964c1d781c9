"""How far a loop has come: the model with what was added, its fit, and every decision with its reason."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.correct.constants import LEVEL
from bondgraph.correct.declared_fit import OtherwiseAfterAll
from bondgraph.correct.evidence.certified import refined
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import doubt, judge
from bondgraph.correct.evidence.floors import without_floors
from bondgraph.correct.evidence.replaced import in_place_of_elements
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.fits.starts import with_starts
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.models.shaping_filters import DISTURBANCE
from bondgraph.correct.round import Round, RoundSettings
from bondgraph.correct.scores.gates import Constancy, Gate, When, constancy, gated, with_gate
from bondgraph.correct.search.refit import refit_from
from bondgraph.correct.shapes.forms import as_one, joined, own_form
from bondgraph.data.log import MatchedLog
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import DeclarationError, EstimationError
from bondgraph.estimate.certify import Check
from bondgraph.estimate.fitted import Fit, at_optimum, restricted
from bondgraph.estimate.local import fit
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import EstimationProblem


@dataclass(frozen=True)
class Decision:
    """One decision: its round, what was done, and why.

    ``action`` is ``"added"``, ``"given constant"`` (one that is off explains most of a law), ``"as given"`` (it is not
    off after all), ``"own form"`` (what was added became a part of a law), ``"simplified"`` (a simpler law took its
    place), ``"replaced"`` (a rival did), ``"event"``, ``"not constant"``, ``"dropped"``, ``"withdrawn"``,
    ``"disturbance"`` or ``"stopped"``.
    """

    round: int
    action: str
    what: str
    why: str


@dataclass(frozen=True)
class OffConstant:
    """A given constant that is free after all: its name and the value that was given, in the unit of the model.

    ``gain`` is what it gains, in nats, with those that were freed with it, ``would`` says which law would gain how much
    without. ``others`` are constants each of which would do as well in its place.
    """

    name: str
    given: float
    gain: float
    would: str
    others: tuple[str, ...] = ()


@dataclass(frozen=True)
class Progress:
    """The declared graph, the model so far with its fit, the training logs, what was added, and all decisions.

    ``added`` holds events too, effects that act in part of a log only: as long as the search goes on they are in the
    model, and the logs know their times. ``check`` says what halved steps would change at the fit.
    ``banned`` are effects that were dropped, by function and place: they are not offered again. ``otherwise`` are
    inputs that what was added shows to run another way between samples: all begins anew so, or with straight lines
    where it shows ``straight`` ones to be likelier after all. ``constants`` are given ones that are free after all.
    """

    declared: BondGraph
    built: BuiltModel
    fit: Fit
    train: tuple[MatchedLog, ...]
    added: tuple[Trial, ...] = ()
    history: tuple[Decision, ...] = ()
    banned: frozenset[tuple[str, str]] = frozenset()
    check: Check | None = None
    otherwise: OtherwiseAfterAll | None = None
    straight: bool = False
    constants: tuple[OffConstant, ...] = ()

    @property
    def anew(self) -> bool:
        """True where all begins anew with inputs that run otherwise between samples."""
        return self.otherwise is not None or self.straight

    @property
    def present(self) -> set[tuple[str, str]]:
        """Effects that are not to be offered, by name of function and label of place."""
        return {_key(part) for trial in self.added for part in trial.forms or (trial,)} | self.banned

    @property
    def laws(self) -> tuple[Trial, ...]:
        """Effects that were added to the declaration: everything but events."""
        return tuple(trial for trial in self.added if trial.gate is None)

    @property
    def named(self) -> int:
        """How many laws were added; a disturbance is none."""
        return sum(trial.candidate.effect.kind != DISTURBANCE for trial in self.laws)


def _key(trial: Trial) -> tuple[str, str]:
    return trial.candidate.function.__name__, trial.candidate.place.label


def advance(state: Progress, turn: Round, settings: RoundSettings) -> Progress:
    """Add what a round chose, estimate everything again, and test what is there once more."""
    chosen = turn.chosen
    if chosen is None or chosen.evidence is None:
        raise EstimationError("only a candidate that was refitted can be added")
    settings.report("add the effect and estimate again", 0, 1)
    number = rounds_done(state) + 1
    evidence = chosen.evidence
    why = (
        f"gains {evidence.delta_nll:.1f} nats, p = {max(evidence.p_value, evidence.p_robust):.2g} over "
        f"{evidence.tried} tried"
    )
    history = [Decision(number, "added", chosen.candidate.label, why)]
    chosen, train = _in_time(state, turn, chosen, number, history, settings)
    if chosen.gate is not None:
        history[0] = replace(history[0], action="event")
    state = _estimated(replace(state, train=train), chosen, settings)
    state = certified(replace(state, history=(*state.history, *history)), number, settings)
    settings.report("add the effect and estimate again", 1, 1)
    if not state.added:
        return state
    state, last = _in_own_form(state, number, settings)
    state = _without_needless_disturbance(state, last, number, settings)
    # earlier effects that are no longer needed beside the last one go
    return standing(state, [last], f"beside {last.candidate.label}", number, settings)


def certified(state: Progress, number: int, settings: RoundSettings) -> Progress:
    """The state with steps so short that its fit depends on them no more.

    Where that takes shorter ones, what was added last is judged again with these, and withdrawn if it fails then.
    """
    fitted, check = refined(state.fit, settings.journal, settings.substeps)
    finer = replace(state, fit=fitted, check=check)
    if fitted is state.fit or not state.added or state.added[-1].evidence is None:
        return finer
    last, evidence = state.added[-1], state.added[-1].evidence
    steps = fitted.problem.filter_model.substeps
    bare = without(finer, len(state.added) - 1, "withdrawn", f"judged with {steps} integration steps", number, settings)
    sure = judge(bare.fit, fitted, last.candidate.effect, evidence.tried, last.gate is not None)
    sure = replace(sure, p_robust=max(sure.p_robust, evidence.p_robust))
    if not sure.accepted(settings.level):
        why = (
            f"with {steps} integration steps between samples it gains {sure.delta_nll:.1f} nats, p = {sure.p_value:.2g}"
        )
        return replace(bare, history=(*finer.history, Decision(number, "withdrawn", last.candidate.label, why)))
    return replace(finer, added=(*finer.added[:-1], replace(last, evidence=sure)))


def rounds_done(state: Progress) -> int:
    """Number of the last round in which something was decided."""
    return max((decision.round for decision in state.history), default=0)


def _estimated(state: Progress, chosen: Trial, settings: RoundSettings) -> Progress:
    """The chosen candidate's own model, estimated to the full tolerance from where its refit ended."""
    if chosen.fit is None or chosen.built is None:
        raise EstimationError(f"{chosen.candidate.label}: only a candidate that was refitted can be added")
    filter_model = replace(chosen.fit.problem.filter_model, model=chosen.built.model)
    if filter_model.is_stiff and chosen.fit.outcome is SearchOutcome.CONVERGED:  # to all that its filter can tell
        fitted = without_floors(chosen.fit, settings.journal)
        return replace(state, built=chosen.built, fit=fitted, added=(*state.added, chosen))
    initial = chosen.fit.problem.initial
    problem = EstimationProblem(filter_model, tuple(state.train), at_optimum(chosen.fit), initial)
    fitted = fit(problem, journal=settings.journal)
    fitted = without_floors(with_starts(fitted, settings.journal), settings.journal)
    freed = in_place_of_elements(fitted, chosen.candidate, state.fit, state.built.graph, settings.journal)
    if freed is not fitted and doubt(freed, chosen.candidate.effect) < settings.level:
        fitted = freed  # a refit is rough, and may not have shown it
    return replace(state, built=chosen.built, fit=fitted, added=(*state.added, chosen))


def _in_time(
    state: Progress, turn: Round, chosen: Trial, number: int, history: list[Decision], settings: RoundSettings
) -> tuple[Trial, tuple[MatchedLog, ...]]:
    """The chosen effect as an event, if it is absent in a part of a log and that explains more."""
    effect = chosen.candidate.effect
    if chosen.gate is not None:
        history.append(Decision(number, "event", chosen.candidate.label, f"acts {chosen.gate}"))
        return chosen, with_gate(state.train, effect, chosen.gate)
    if chosen.fit is None or effect.adds_state or effect.channel or len(effect.coefficients) != 1:
        return chosen, state.train
    found = constancy(chosen.fit, effect.coefficients[0])
    if found.p_value > settings.level:
        return chosen, state.train
    context = Context(
        state.built, state.fit, state.train, turn.tried, settings.level, 0.0, settings.journal
    )  # fmt: skip
    trials = [
        trial for when in _sides(found) for trial in _gated_refit(chosen, Gate(when, found.log, found.time), context)
    ]
    best = min(trials, key=lambda trial: np.inf if trial.fit is None else trial.fit.nll, default=None)
    measured = sum(int(np.isfinite(log.y).sum()) for log in state.train)
    worth = 0.5 * math.log(measured) + math.log(160.0)
    if best is None or best.fit is None or best.gate is None or chosen.fit.nll - best.fit.nll < worth:
        what = f"its size changes near {found.time:.4g} s of {found.log} (p = {found.p_value:.2g})"
        history.append(Decision(number, "not constant", chosen.candidate.label, what))
        return chosen, state.train
    why = f"acts {best.gate}: {chosen.fit.nll - best.fit.nll:.1f} nats better than throughout (p = {found.p_value:.2g})"
    history.append(Decision(number, "event", chosen.candidate.label, why))
    return best, with_gate(state.train, best.candidate.effect, best.gate)


def _sides(found: Constancy) -> tuple[When, ...]:
    """Whether an effect may be an event from a time on, or until it: where it can be absent on the other side."""
    if not found.switches:
        return ()
    return ("from",) if abs(found.before) < abs(found.after) else ("until",)


def _gated_refit(chosen: Trial, gate: Gate, context: Context) -> list[Trial]:
    fitted = chosen.fit
    function = gated(chosen.candidate.function, gate, context.train)
    made, _ = candidates(context.built, [function], [chosen.candidate.place])
    if not made or fitted is None:
        return []
    train = with_gate(context.train, made[0].effect, gate)
    start = [fitted.values[name] for name in chosen.candidate.effect.coefficients]
    trial = replace(chosen, candidate=made[0], gate=gate, stands_for=())
    tried = trial.attempted(lambda: refit_from(trial, start, replace(context, train=train)))
    return [] if tried.failed else [tried]


def _in_own_form(state: Progress, number: int, settings: RoundSettings) -> tuple[Progress, Trial]:
    """The state, and what was added last: as a part of a law where that has a form of its own by it."""
    *earlier, last = state.added
    whole = next((k for k, one in enumerate(earlier) if own_form(one, last, state.built.graph)), None)
    if last.gate is not None or whole is None:
        return state, last
    label = earlier[whole].candidate.label
    why = f"{last.candidate.label} is of the same signal at the same place: the logs tell only their sum"
    earlier[whole] = joined(earlier[whole], last)
    history = (*state.history, Decision(number, "own form", label, why))
    state = _in_fewer_parts(replace(state, added=tuple(earlier), history=history), whole, number, settings)
    return state, state.added[whole]


def _in_fewer_parts(state: Progress, whole: int, number: int, settings: RoundSettings) -> Progress:
    """The state with a law in as few parts as explain as much: what came first may only have been near it."""
    *earlier, _ = state.added[whole].forms
    for part in earlier:
        law = state.added[whole]
        rest = as_one(tuple(one for one in law.forms if one is not part), law.candidate.model)
        reduced = reduced_to(state, [rest if one is law else one for one in state.added])
        fitted = _refitted(reduced, settings)
        if fitted is None:  # without it the rest has no value somewhere: it is needed
            continue
        assert part.evidence is not None  # it was chosen
        told = judge(fitted, state.fit, part.candidate.effect, part.evidence.tried)
        if told.bic_gain > 0.0:
            continue
        fitted, check = refined(fitted, settings.journal, settings.substeps)
        why = f"as a part of {law.candidate.label} it gains {told.delta_nll:.1f} nats, too little"
        state = replace(
            state, built=reduced.built, fit=fitted, check=check, added=reduced.kept,
            history=(*state.history, Decision(number, "dropped", part.candidate.label, why)),
        )  # fmt: skip
    return state


def _refitted(reduced: Reduced, settings: RoundSettings) -> Fit | None:
    """The fit of a model with a part of what was added; None where it has no value."""
    return attempted(lambda: fit(reduced.problem, journal=settings.journal), lambda why: None)


def _without_needless_disturbance(state: Progress, last: Trial, number: int, settings: RoundSettings) -> Progress:
    """The state without disturbances whose intensity and time are not worth their penalty beside the last effect."""
    measured = sum(int(np.isfinite(log.y).sum()) for log in state.train)
    why = f"its intensity and its time are worth less than their penalty beside {last.candidate.label}"
    for trial in [one for one in state.added if one.candidate.effect.kind == DISTURBANCE]:
        index = next((k for k, one in enumerate(state.added) if one is trial), None)
        if index is not None:  # a rhythm stands beside a first one, and may go with it
            fewer = without(state, index, "dropped", why, number, settings)
            state = fewer if fewer.fit.nll - state.fit.nll < math.log(measured) else state
    return state


def standing(state: Progress, sure: Sequence[Trial], how: str, number: int, settings: RoundSettings) -> Progress:
    """The state without its effects that are in doubt, the most doubtful first; those that are ``sure`` stay."""
    while doubtful := [k for k, trial in enumerate(state.added) if all(trial is not one for one in sure)]:
        doubts = [doubt(state.fit, state.added[k].candidate.effect) for k in doubtful]
        worst = int(np.argmax(doubts))
        if doubts[worst] < LEVEL:
            break
        state = without(state, doubtful[worst], "dropped", f"p = {doubts[worst]:.2g} {how}", number, settings)
    return state


def without_events(state: Progress) -> Progress:
    """The state without its events; everything else keeps the values that were estimated beside them.

    Time is no law: what happened in one log will not happen again when the machine is simulated. A fit that knew
    nothing of an event would let the laws make up for it.
    """
    reduced = reduced_to(state, state.laws)
    kept = np.isin(state.fit.problem.names, reduced.problem.names)
    point = state.fit.point[kept]
    nll = float(reduced.problem.nll(point[:, np.newaxis])[0])
    fitted = Fit(
        reduced.problem, point, nll, restricted(state.fit.expansion, kept), state.fit.evaluations, state.fit.outcome
    )
    return replace(state, built=reduced.built, fit=fitted, train=reduced.problem.logs, added=state.laws)


def without(state: Progress, index: int, action: str, why: str, number: int, settings: RoundSettings) -> Progress:
    """The state with one added effect taken out again, everything else estimated anew.

    Effects that act on what it had added go with it.
    """
    gone = state.added[index]
    reduced = reduced_to(state, [trial for k, trial in enumerate(state.added) if k != index])
    problem = reduced.problem
    fitted = fit(problem, journal=settings.journal)
    fitted, check = refined(fitted, settings.journal, settings.substeps)
    beside = f"has nothing to act on without {gone.candidate.label}"
    history = [
        Decision(number, action, gone.candidate.label, why),
        *(Decision(number, "dropped", one.candidate.label, beside) for one in reduced.baseless),
    ]
    return replace(
        state, built=reduced.built, fit=fitted, check=check, train=problem.logs, added=reduced.kept,
        banned=state.banned | {_key(gone)}, history=(*state.history, *history),
    )  # fmt: skip


@dataclass(frozen=True)
class Reduced:
    """A model with a part of what was added, and what is to be fitted of it, from where the fit with all of it is.

    ``baseless`` are effects that found nothing to act on without those that went.
    """

    built: BuiltModel
    problem: EstimationProblem
    kept: tuple[Trial, ...]
    baseless: tuple[Trial, ...]


def reduced_to(state: Progress, kept: Sequence[Trial]) -> Reduced:
    """The model of a state with other effects in the place of those that were added."""
    graph, stay, baseless = rebuilt(state.declared, kept)
    built = build(graph)
    names = built.model.names("state")
    known = set(built.model.names("parameter"))
    added = {name for one in state.added for name in one.candidate.effect.parameters}
    lost = added - known
    free = tuple(
        one
        for one in at_optimum(state.fit)
        if one.name not in lost and (one.target.kind not in ("x0", "process") or one.target.name in names)
    )
    own = state.fit.problem.filter_model
    filter_model = replace(
        own,
        model=built.model,
        process_noise={name: std for name, std in own.process_noise.items() if name in names},
        initial_std={name: std for name, std in own.initial_std.items() if name in names},
    )
    train = tuple(
        replace(log, theta_overrides={n: v for n, v in log.theta_overrides.items() if n in known})
        for log in state.train
    )
    return Reduced(built, EstimationProblem(filter_model, train, free, state.fit.problem.initial), stay, baseless)


def rebuilt(graph: BondGraph, trials: Sequence[Trial]) -> tuple[BondGraph, tuple[Trial, ...], tuple[Trial, ...]]:
    """A graph with the effects of trials, those that it has, and those that found nothing to act on."""
    kept, baseless = [], []
    for trial in trials:
        try:
            graph = trial.candidate.apply(graph)
            kept.append(trial)
        except DeclarationError:
            baseless.append(trial)
    return graph, tuple(kept), tuple(baseless)
