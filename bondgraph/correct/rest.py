"""The end of a loop: what stays unexplained, and which named effects it makes needless."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bondgraph.correct.evidence.certified import refined
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.given import beside_given
from bondgraph.correct.evidence.moves import smallness
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import Candidate, candidates, places
from bondgraph.correct.models.failures import FAILURES, attempted, reason
from bondgraph.correct.models.shaping_filters import DISTURBANCE
from bondgraph.correct.places.located import locate
from bondgraph.correct.places.probes import Probe, Signal, probes, signals
from bondgraph.correct.places.unexplained import (
    Spline,
    Unexplained,
    distinct,
    needless,
    splines,
    table_effect,
    unexplained,
)
from bondgraph.correct.progress import Decision, Progress, rounds_done, standing, without
from bondgraph.correct.round import Round, RoundSettings
from bondgraph.correct.scores.scoring import Linearisation, linearisation
from bondgraph.correct.search.refit import refit_from
from bondgraph.correct.shapes.completions import completions
from bondgraph.correct.shapes.formula import formula_of, is_long
from bondgraph.correct.simpler import in_one_law, in_simpler_laws
from bondgraph.correct.small_rests import as_well, least_beside, too_small
from bondgraph.correct.wandering import with_disturbance

#: Functions without a law are tried at so many places.
_SUSPECTS = 8
#: A law is no mere relative of a function where it explains more than this share of what the function does: their
#: curves then differ by less than half of their size, free parameters aside. A convention. Of a boiler that loses heat
#: with the power 4/3 of its temperature, convection with 5/4 explained 82 %.
_MOST_OF_IT = 0.75


@dataclass(frozen=True)
class Rest:
    """Where a loop ends: its state, what stays unexplained, and what of that could not be looked for.

    ``completes``: labels of laws that only complete the form of another, with its label. ``explained``: nats that
    effects explained which what stays unexplained made needless, so that it explains as many at least. ``small``: a
    sentence on a function that is too small to be told, if one is.
    """

    state: Progress
    unexplained: tuple[Unexplained, ...]
    cautions: tuple[str, ...] = ()
    completes: Mapping[str, str] = field(default_factory=dict)
    explained: float = 0.0
    small: str = ""


def settle(state: Progress, rounds: Sequence[Round], settings: RoundSettings, tables: bool) -> Rest:
    """Try functions without a law on the final model; withdraw what they make needless; add a table if asked for.

    Laws that simpler ones replace as well are replaced first.
    """
    state = _still_standing(state, in_simpler_laws(state, rounds, settings), settings)
    settings.report("look for what stays unexplained", 0, 1)
    begun = state.fit.nll
    found, state, cautions, completes = _searched(state, rounds, settings)
    single = _still_standing(state, in_one_law(state, rounds, settings, completes), settings)
    if single is not state:
        found, state, cautions, completes = _searched(single, rounds, settings)
    small = "" if found is None else _small(state, found, settings)
    settings.report("look for what stays unexplained", 1, 1)
    if found is None or small:
        return Rest(state, (), cautions, completes, small=small)
    explained = state.fit.nll - begun
    if tables:
        state, said = _attempted(lambda: _with_table(state, found, len(rounds), settings), state, "add a table of it")
        cautions = (*cautions, *said)
    return Rest(state, (found,), cautions, completes, explained)


def _still_standing(before: Progress, after: Progress, settings: RoundSettings) -> Progress:
    """The state without laws that are in doubt beside others that took the place of one; the same where none did."""
    if after is before:
        return after
    return standing(after, [], "beside what took the place of another law", rounds_done(after), settings)


def _small(state: Progress, found: Unexplained, settings: RoundSettings) -> str:
    """A sentence on a function that is too small to be told, or no more than given constants explain; empty otherwise.

    Of stiff models every function is told: the fit with it is costly.
    """
    made, _ = candidates(state.built, [table_effect(found)], [found.place])
    if not made or state.fit.problem.filter_model.is_stiff:
        return ""
    trial = attempted(lambda: _tabulated(made[0], state, found, settings), lambda why: None)
    if trial is None or trial.fit is None:
        return ""
    small = smallness(state.fit, trial.fit, least_beside(state.laws, found.gain))
    what = f"an unknown {found.variable} at {found.place.label} as a function of {found.signal}"
    if small:
        return too_small(f"{what} gains {found.gain:.1f} nats", small)
    given = beside_given(trial, _context(state, settings)).given
    return as_well(f"{what}, that gains {found.gain:.1f} nats", given) if given else ""


def at_random(rest: Rest, settings: RoundSettings) -> Progress:
    """The state with a disturbance that explains more than what stays unexplained as a function, if there is one.

    A function of time is no law, and a disturbance is preferred to it. What a function of another signal explains is
    not blamed on the noise of a sensor.
    """
    functions = [one for one in rest.unexplained if one.signal != "time"]
    if functions and any(one.action == "withdrawn" and one.what.startswith(DISTURBANCE) for one in rest.state.history):
        return rest.state  # a function explained more than it
    measured = max(sum(int(np.isfinite(log.y).sum()) for log in rest.state.train), 2)
    gained = (max(one.gain, rest.explained) - 0.5 * one.knots.size * math.log(measured) for one in functions)
    worth = max(gained, default=0.0)
    return with_disturbance(rest.state, settings, worth, sensors=not functions)


def _searched(
    state: Progress, rounds: Sequence[Round], settings: RoundSettings
) -> tuple[Unexplained | None, Progress, tuple[str, ...], Mapping[str, str]]:
    """The function that stays unexplained, the state without needless effects, cautions, and laws that complete others.

    Nothing of it is worth the result of the rounds: a search that fails ends here, with its reason.
    """
    found: Unexplained | None = None
    try:
        known = rounds[-1].linear if rounds and rounds[-1].base is state.fit else linearisation(state.fit, state.train)
        found, linear, tried = _look(state, known, settings.level)
        needed: set[str] = set()
        while found is not None and state.added:
            spare = [
                k
                for k, trial in enumerate(state.added)
                if trial.candidate.label not in needed and _is_spare(trial, linear, tried, found)
            ]
            if not spare:
                break
            why = f"needless beside an unknown {found.variable} at {found.place.label} as a function of {found.signal}"
            fewer = without(state, spare[-1], "withdrawn", why, len(rounds), settings)
            left = _look(fewer, linearisation(fewer.fit, fewer.train), settings.level)
            if left[0] is None:  # the function shows only beside it: so it is no relative of the function
                break
            gone, kind = state.added[spare[-1]].candidate.label, state.added[spare[-1]].candidate.effect.kind
            share = 1.0 if kind == DISTURBANCE else _MOST_OF_IT
            if (
                not is_long(state.added[spare[-1]].candidate.function)
                and fewer.fit.nll - state.fit.nll > share * left[0].gain
            ):
                needed.add(gone)  # a disturbance has no size that the function could take, a law most of its shape
                continue
            state = standing(fewer, [], f"without {gone}", len(rounds), settings)
            if state is not fewer:
                left = _look(state, linearisation(state.fit, state.train), settings.level)
            found, linear, tried = left
        completes = completions(state.laws, state.declared, state.built.graph, linear, tried)
    except FAILURES as error:
        return found, state, (f"what stays unexplained could not be looked for to the end: {reason(error)}",), {}
    return found, state, (), completes


def _is_spare(trial: Trial, linear: Linearisation, tried: Sequence[Spline], found: Unexplained) -> bool:
    """True for an effect that may be a near relative of a function that stays unexplained beside it.

    A formula of its signal is: it leaves a part of what a free function explains. Another formula is a shape of its
    own, and a fault of a sensor no law.
    """
    effect, formula = trial.candidate.effect, formula_of(trial.candidate.function)
    if formula is not None:
        alike = trial.candidate.place.label in (found.place.label, *found.like)
        return alike and formula.signals == (found.signal,)
    return not effect.channel and needless(linear, tried, found, effect.coefficients)


def _attempted(action: Callable[[], Progress], state: Progress, what: str) -> tuple[Progress, tuple[str, ...]]:
    """What an action makes of the state, or the state as it is and why that failed."""
    return attempted(lambda: (action(), ()), lambda why: (state, (f"could not {what}: {why}",)))


def _look(
    state: Progress, linear: Linearisation, level: float
) -> tuple[Unexplained | None, Linearisation, tuple[Spline, ...]]:
    where = places(state.built, state.train, linear.runs, state.fit.theta_of(state.built.model))
    known = distinct(signals(state.built, linear, where))
    tried = splines(linear, _suspects(linear, probes(state.built, linear, where), known), known)
    measured = sum(int(np.isfinite(log.y).sum()) for log in state.train)
    return unexplained(tried, measured, level), linear, tried


def _suspects(linear: Linearisation, found: Sequence[Probe], known: Sequence[Signal]) -> list[Probe]:
    """The places at which functions are tried: all, or in a large machine those that explain most of the rest."""
    if len(found) <= _SUSPECTS:
        return list(found)
    ranked = [place.junction for place in locate(linear, found, known)]
    order = sorted(found, key=lambda probe: ranked.index(probe.place.output or probe.place.label))
    return order[:_SUSPECTS]


def _with_table(state: Progress, found: Unexplained, number: int, settings: RoundSettings) -> Progress:
    """The unexplained function as an element with a table, its points estimated with everything else."""
    made, _ = candidates(state.built, [table_effect(found)], [found.place])
    if not made:
        return state
    trial = _tabulated(made[0], state, found, settings)
    if trial.fit is None or trial.built is None:
        return state
    why = f"asked for: {found.variable} as a function of {found.signal}, {found.knots.size} points"
    fitted, check = refined(trial.fit, settings.journal, settings.substeps)
    return replace(
        state, built=trial.built, fit=fitted, check=check, added=(*state.added, trial),
        history=(*state.history, Decision(number, "added", trial.candidate.label, why)),
    )  # fmt: skip


def _tabulated(made: Candidate, state: Progress, found: Unexplained, settings: RoundSettings) -> Trial:
    """The refit of a state with a function as a table."""
    return refit_from(Trial(made, found.gain), [float(value) for value in found.values], _context(state, settings))


def _context(state: Progress, settings: RoundSettings) -> Context:
    return Context(state.built, state.fit, state.train, 1, settings.level, 0.0, settings.journal)
