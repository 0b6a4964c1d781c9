"""Closing the loop: fit, look at the residual, try what physics allows everywhere, add what the data ask for, repeat.

graph + training logs -> fit -> scores of all candidates -> refits of the few best -> decision -> corrected graph -> fit

Integration steps are certified before anything is scored, and for every model that follows. After every addition the
effects that are already there are tested again (backward elimination), and whether the new one is the same throughout
the data. At the end a function without a law is tried at every place: it says what stays unexplained, and withdraws a
named effect that it makes needless. Held-out logs are assessed before and after and decide nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from bondgraph.build import BuiltModel, build
from bondgraph.correct.cautions import at_bounds, cautions_of, left_bounds, of_added
from bondgraph.correct.confirmation import Confirmation, confirmation
from bondgraph.correct.constants import LEVEL, MOST_EFFECTS, MOST_REFITS
from bondgraph.correct.corrected import corrected
from bondgraph.correct.declared_fit import (
    DeclaredFit,
    fit_declared,
    fit_otherwise,
    otherwise_after_all,
    straight_is_likelier,
)
from bondgraph.correct.evidence.certified import doubts
from bondgraph.correct.evidence.replaced import beyond_declared
from bondgraph.correct.evidence.trials import Added, Detectable, Trial
from bondgraph.correct.fits.assess import Assessment, assess
from bondgraph.correct.fits.whiteness import Whiteness, is_white, whiteness
from bondgraph.correct.granted import Clock, in_round, strictly
from bondgraph.correct.models.failures import FAILURES, attempted
from bondgraph.correct.models.failures import reason as reason_of
from bondgraph.correct.models.resting import without_resting_state
from bondgraph.correct.models.shaping_filters import DISTURBANCE
from bondgraph.correct.models.started import start_cautions
from bondgraph.correct.models.typical import typical_inputs
from bondgraph.correct.off_constants import with_off_constants, without_needless_constants
from bondgraph.correct.places.structure import Structure, everywhere, structure
from bondgraph.correct.places.unexplained import Unexplained
from bondgraph.correct.progress import Decision, OffConstant, Progress, advance, reduced_to, without_events
from bondgraph.correct.quiet_before import simulated_better
from bondgraph.correct.rest import Rest, at_random, settle
from bondgraph.correct.round import Round, RoundSettings, one_round, round_cautions, unsearched
from bondgraph.correct.search.disturbances import Disturbance, described
from bondgraph.correct.small_rests import small_rest
from bondgraph.correct.together import two_laws
from bondgraph.correct.verdict import Verdict, unproven, verdict
from bondgraph.correct.wandering import explained_at_random
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import without_input_rates
from bondgraph.declare.effect import EffectFunction, members_of
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.sensors import SENSOR_FAULTS
from bondgraph.errors import BondGraphError, DataError, EstimationError, OptionError
from bondgraph.estimate.certify import Check
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.initial import InitialRule
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import Report, fit, no_report
from bondgraph.text import count, few


@dataclass(frozen=True)
class LoopSettings:
    """How far a correction goes.

    ``level`` is the chance of a false alarm over all candidates of the first round, see
    :meth:`bondgraph.correct.round.RoundSettings.beside` for later ones; ``refits`` how many of the best scores
    are refitted at most; ``process_noise`` as in :func:`bondgraph.estimate.setup.filter_setup`; ``faults``: faults
    of sensors are candidates too; ``tables``: what stays unexplained is added as a table whose points are parameters;
    ``journal`` keeps finished fits; ``without`` names effects and faults that are not tried; ``inputs_as_declared``:
    inputs run between samples as declared, though a log of constant pieces looks held; ``initial`` is the rule by which
    states begin, also those of added effects, see :func:`bondgraph.estimate.initial.initial_states`; ``minutes`` is the
    time after which no round goes on.
    """

    level: float = LEVEL
    max_effects: int = MOST_EFFECTS
    refits: int = MOST_REFITS
    process_noise: str = "free"
    free: tuple[str, ...] = ()
    faults: bool = True
    tables: bool = False
    journal: Journal = field(default_factory=Journal)
    without: tuple[str, ...] = ()
    inputs_as_declared: bool = False
    initial: InitialRule = "measured"
    minutes: float = math.inf


@dataclass(frozen=True, repr=False)
class ClosedLoop:
    """The whole correction: both models fitted and assessed, and the history of decisions.

    ``nominal_check`` and ``corrected_check`` say what halved integration steps would change. Both built models may have
    rates among their inputs that no equation uses, see :func:`bondgraph.correct.fits.rates.with_followed_rates`.
    ``confirmation`` is what the logs say of the correction, None where nothing was added. ``events`` act in part of one
    log; they are no part of the corrected declaration, and their sizes are those of ``eventful``, the fit with them.
    ``disturbances`` wander at random; the corrected declaration has them as states that noise drives. ``held`` and
    ``limited`` are inputs that are held, and band limited, between samples in both models, against the declaration.
    ``constants`` are given ones that are off: the corrected model has them as estimated.
    """

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
    structure: Structure
    nominal_check: Check
    corrected_check: Check
    whiteness: tuple[Whiteness, ...] = ()
    unexplained: tuple[Unexplained, ...] = ()
    history: tuple[Decision, ...] = ()
    cautions: tuple[str, ...] = ()
    confirmation: Confirmation | None = None
    events: tuple[Added, ...] = ()
    eventful: Fit | None = None
    disturbances: tuple[Disturbance, ...] = ()
    held: tuple[str, ...] = ()
    constants: tuple[OffConstant, ...] = ()
    limited: tuple[str, ...] = ()

    def __repr__(self) -> str:
        name, added = self.nominal_built.graph.name, few([one.trial.candidate.label for one in self.added])
        return f"<{type(self).__name__} {name}: {self.verdict}; added {added}; {count(len(self.rounds), 'round')}>"

    @property
    def corrected_graph(self) -> BondGraph:
        """The declaration with the added effects and the estimated values."""
        return without_resting_state(without_input_rates(self.corrected_built.graph))

    @property
    def corrected_text(self) -> str:
        """The module that is generated from :attr:`corrected_graph`."""
        built, graph = self.corrected_built, self.corrected_graph
        return built.text if graph is built.graph else build(graph).text

    @property
    def unproven(self) -> Trial | None:
        """The best candidate of the last round that passes the tests and was not chosen; None without one."""
        return unproven(self.rounds, LEVEL)

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
        If there is no training log, or too little in them.
    EstimationError
        If the declared model cannot be fitted at all.
    BondGraphError
        If the graph is refused.
    """
    settings = settings or LoopSettings()
    _check_given(graph, train, functions)
    report = clock = Clock(report, settings.minutes)
    begun = fit_declared(graph, train, holdout, settings, report)
    found, rounds, result = _closed(begun, functions, settings, report)
    if (other := found.otherwise) is not None and not clock.spent:
        report(f"begin anew with {few(other.inputs.names)} {other.inputs.words} between samples", 0, 1)
        begun = fit_otherwise(graph, train, holdout, settings, other) or replace(begun, straight=())
        found, rounds, result = _closed(begun, functions, settings, report)
    if begun.otherwise and any(
        straight_is_likelier(begun, fitted, built, settings.journal) for fitted, built in _explaining(found, rounds)
    ):
        begun = fit_declared(graph, train, holdout, replace(settings, inputs_as_declared=True), report)
        return _closed(begun, functions, settings, report)[2]()
    return result()


def _explaining(found: Progress, rounds: Sequence[Round]) -> list[tuple[Fit, BuiltModel]]:
    """The model where a loop ends, and one that alone explains more and was not believed: inputs may be why."""
    tried = [one for one in rounds[0].trials if one.fit is not None and one.built is not None] if rounds else []
    best = max(tried, key=lambda one: one.gain, default=None)
    fits = [(found.fit, found.built)]
    if best is not None and best.fit is not None and best.built is not None and best.fit.nll < found.fit.nll:
        fits.append((best.fit, best.built))
    return fits


def _closed(
    begun: DeclaredFit, functions: Sequence[EffectFunction], settings: LoopSettings, report: Report
) -> tuple[Progress, tuple[Round, ...], Callable[[], ClosedLoop]]:
    """Where the rounds end from a fit of the declared model, the rounds, and what makes the result of that."""
    told = structure(begun.built, everywhere(begun.built), begun.train, begun.setup.sizes)
    offered = (*functions, *(SENSOR_FAULTS if settings.faults else ()))
    wanted = [one for one in offered if one.__name__ not in settings.without]
    typical = typical_inputs(begun.built.model, begun.train)
    every = tuple(member for one in wanted for member in members_of(one, begun.graph, typical))
    substeps = begun.setup.filter_model.substeps
    own = RoundSettings(settings.level, settings.refits, report, settings.journal, substeps)
    start = Progress(begun.graph, begun.built, begun.fit, begun.train, check=begun.check)
    state, rounds, reason = _rounds(start, every, own, settings.max_effects, begun=begun)
    if state.anew:
        rest = Rest(state, ())
        return state, tuple(rounds), lambda: _result(begun, start, rest, rounds, told, reason, settings, report)
    rest = settle(state, rounds, own, settings.tables)
    while _withdrawn(state, rest) and len(state.added) == settings.max_effects and not settings.tables:
        state, rounds, reason = _rounds(rest.state, every, own, settings.max_effects, rounds)
        rest = settle(state, rounds, own, settings.tables)
    disturbed = at_random(rest, own)
    if disturbed is not rest.state:  # what it hid may show now
        state, rounds, reason = _rounds(disturbed, every, own, settings.max_effects, rounds)
        rest = settle(state, rounds, own, settings.tables)
    return rest.state, tuple(rounds), lambda: _result(begun, start, rest, rounds, told, reason, settings, report)


def _withdrawn(before: Progress, after: Rest) -> bool:
    """True where an effect turned out to be needless at the end, which makes room for another."""
    return len(after.state.added) < len(before.added)


def _rounds(
    state: Progress,
    functions: Sequence[EffectFunction],
    own: RoundSettings,
    most: int,
    earlier: Sequence[Round] = (),
    begun: DeclaredFit | None = None,
) -> tuple[Progress, list[Round], str]:
    """Add what is found until nothing passes, or shows inputs to be held: the state, the rounds, and why they ended.

    What fails in the first round is told; later ones have results that are worth keeping. Every round adds an effect or
    takes one out for good, so that they end.
    """
    rounds, granted = list(earlier), replace(own, report=strictly(own.report))
    while (room := most - state.named) > 0 and len(rounds) - len(earlier) < 2 * most + 1:
        own = replace(granted.beside(state.named), report=in_round(granted.report, len(rounds) + 1))
        try:
            turn = one_round(state.built, state.fit, state.train, functions, own, state.present, state.added)
            rounds.append(turn)
            pair = two_laws(state, turn, functions, own) if room > 1 else None
            off = with_off_constants(state, turn, functions, own) if pair is None else state
            if off is not state:
                state = off
                continue
            before = state
            if pair is not None:
                state, rounds = pair[0], [*rounds[:-1], *pair[1]]
            elif turn.chosen is None:
                further = "further " if state.added else ""
                passes = f"no {further}candidate passes the tests" if turn.trials else "no effect could be tried"
                passes = "all else that passes the tests is small" if small_rest(turn.trials) else passes
                return state, rounds, passes
            else:
                disturbed = explained_at_random(state, turn.chosen, own)
                state = advance(state, turn, own) if disturbed is state else disturbed
            state = _with_inputs(begun, before, without_needless_constants(state, own), own.journal)
            if state.anew:
                return state, rounds, "inputs run otherwise between samples after all"
        except FAILURES as error:
            number = len(rounds) + (not rounds or rounds[-1].base is not state.fit)
            if not rounds:
                if isinstance(error, BondGraphError):
                    raise
                why = f"{state.built.graph.name}: no candidate could be tried: {reason_of(error)}"
                raise EstimationError(f"{why} - check units, initial states and declared values") from error
            return state, rounds, f"round {number} could not be finished: {reason_of(error)}"
    return state, rounds, f"the limit of {count(most, 'effect')} was reached (--max-effects {most + 1} looks for more)"


def _with_inputs(begun: DeclaredFit | None, before: Progress, after: Progress, journal: Journal) -> Progress:
    """The state after a law was added, with the inputs that it shows to run another way, or straight after all."""
    if begun is None or not after.laws:
        return after
    other = otherwise_after_all(begun, (before.fit, before.built), (after.fit, after.built), journal)
    straight = bool(begun.otherwise) and straight_is_likelier(begun, after.fit, after.built, journal)
    return replace(after, otherwise=other, straight=straight)


def _result(
    begun: DeclaredFit,
    start: Progress,
    rest: Rest,
    rounds: Sequence[Round],
    told: Structure,
    reason: str,
    settings: LoopSettings,
    report: Report,
) -> ClosedLoop:
    nominal, first, holdout = begun.fit, begun.check, begun.holdout
    state = _eventless(start, rest.state)
    current, last = state.fit, state.check
    assert last is not None  # every fit of the way is certified
    beside = rest.state if state.laws or state.constants else state  # an event that is known colours nothing
    residual = whiteness(beside.fit, beside.train)
    corrected_built, undeclared = corrected(begun.fit, state)
    report("assess", 0, 1)
    every = [
        Added(one, one.candidate.effect.parameters, rest.completes.get(one.candidate.label, "")) for one in state.added
    ]
    added = tuple(one for one in every if one.trial.candidate.effect.kind != DISTURBANCE)
    random = tuple(described(one.trial, current) for one in every if one not in added)
    history = (*state.history, Decision(len(rounds), "stopped", "", reason))
    before = assess(nominal, nominal.problem.logs), assess(nominal, holdout)
    after = assess(current, state.train), assess(current, holdout)
    cautions = (
        *begun.cautions, *cautions_of(nominal, rounds, current), *_doubts(begun, state, first, last), *rest.cautions,
        *(round_cautions(rounds[0]) if rounds else ()),
        *unsearched(rounds, settings.refits, is_white(beside.fit, settings.level)),
        *start_cautions(undeclared), *of_added(state, rest.state, settings.journal),
        *filter(None, [(small_rest(rounds[-1].trials) if rounds else "") or rest.small]),
        *(simulated_better(nominal, before, after, settings.journal) if state.laws or state.constants else ()),
    )  # fmt: skip
    disturbed = _disturbed(state, holdout, settings) if added and random else None
    logs = confirmation(nominal, current, before, after, disturbed) if every or state.constants else None
    doubted = unproven(rounds, settings.level)
    result = ClosedLoop(
        *verdict(added, random, rest.unexplained, residual, settings.level, reason, logs, doubted), nominal, current,
        *before, *after, begun.built, corrected_built, added, tuple(rounds), told, first, last,
        residual, rest.unexplained, history, cautions, logs, _events(rest.state), rest.state.fit, random,
        begun.running("hold"), state.constants, begun.running("band limited"),
    )  # fmt: skip
    report("assess", 1, 1)
    return result


def _disturbed(state: Progress, holdout: Sequence[MatchedLog], settings: LoopSettings) -> Assessment | None:
    """The model with its disturbances and without its laws on held-out logs; None where it cannot be fitted."""
    kept = [one for one in state.added if one.candidate.effect.kind == DISTURBANCE]

    def assessed() -> Assessment:
        return assess(fit(reduced_to(state, kept).problem, journal=settings.journal), holdout)

    return attempted(assessed, lambda why: None)


def _eventless(start: Progress, state: Progress) -> Progress:
    """The state without events; where nothing else was added, the declared model as it was fitted."""
    if len(state.laws) == len(state.added):
        return state
    if state.laws or state.constants:
        return without_events(state)
    return replace(start, history=state.history)


def _events(state: Progress) -> tuple[Added, ...]:
    return tuple(Added.of(one, {}) for one in state.added if one.gate is not None)


def _doubts(begun: DeclaredFit, state: Progress, first: Check, last: Check) -> list[str]:
    """Sentences on integration steps of both models, and on bounds that hold or were left in the corrected one."""
    if state.fit is begun.fit:
        return doubts("declared", first)
    left = beyond_declared(begun.fit, state.fit)
    bounds = at_bounds(state.fit, "corrected", [name for name in begun.fit.problem.names if name not in left])
    gone = [left_bounds(name, state.fit, state.laws, state.declared) for name in left]
    return [*bounds, *gone, *doubts("declared", first), *doubts("corrected", last)]


def _check_given(graph: BondGraph, train: Sequence[MatchedLog], functions: Sequence[EffectFunction]) -> None:
    if not train:
        raise DataError(f"{graph.name}: no training log - give at least one with --data")
    if not functions:
        raise OptionError(f"{graph.name}: no effect to try - give a module with effect functions")
