"""Simpler laws at the place of the best one, searched from where that ended: their scores may underrate them far."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bondgraph.correct.fits.fit import WITHIN_REACH, Fit
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.refits.refit import Ground, abrupt, refit_alone
from bondgraph.correct.refits.runoff import CLOSE
from bondgraph.correct.refits.trials import Trial

#: Searches of simpler laws are finished by exact derivatives from this share of what the best gains on: they are few.
#: Dry friction of a sheave, searched from where a law of three coefficients had gained 693 nats, ended at 587, where
#: the linearised filter promised 23; exact derivatives promised 182, and led to 825. Laws that switch and ended with
#: less are searched again.
_FINISHED = 0.5


def also_simpler(trials: Sequence[Trial], ground: Ground) -> list[Trial]:
    """The trials; those of one coefficient at the place of the best refitted from there, if it is in a unit of its own.

    Friction that gives way before it slides, or slides the easier the faster, is soft, so that a search from little
    process noise finds it. Dry friction of a vehicle's sheave, which both of them were, had scores of 5 and 10 nats
    and gained 62 by a search of its own, where the others gained 281 and 982 and it gains 1084 and 1086 from there.
    The same is done at the places of others that ended close to the best, where no search was made: a loss of 110 nats
    at the crank and of 103 at the gearbox, each with a coefficient for both directions, was one with the same for both
    at the gearbox, whose score of 1.9 nats nothing followed. A law that switches is searched from the amplitudes that
    it is tried at too: dry friction of 1.2 nats at the sheave gained 865, where a loss by the load gained 698 before;
    also if it has been searched from its score, but ended far behind: another gained 54, the loss by the load 750.
    """
    done = list(trials)
    best = max((one for one in done if one.fit is not None), key=lambda one: one.gain, default=None)
    if best is None or best.gain < ground.need:
        return done
    worth = min(best.gain - WITHIN_REACH, _FINISHED * best.gain)
    close = [one for one in done if one is not best and one.fit is not None and one.gain > best.gain - CLOSE]
    for end in (best, *sorted(close, key=lambda one: -one.gain)):
        for j, trial in enumerate(done):
            due = trial.gate is None and (end is best or trial.evidence is None)
            if due and _is_simpler(trial.candidate, end.candidate):
                done[j] = _from_there(trial, end, ground, worth)
            behind = end is best and trial.gate is None and done[j].gain < worth
            if (done[j].evidence is None or behind) and _switches(done[j].candidate, end.candidate):
                done[j] = _from_amplitudes(done[j], ground)
    return done


def _from_there(trial: Trial, end: Trial, ground: Ground, worth: float) -> Trial:
    """The trial, or its refit from where another ended, if a coefficient of that has its unit and it gains more."""
    ended = end.fit
    assert ended is not None  # else it has no end
    unit = _unit(trial.candidate, trial.candidate.effect.coefficients[0])
    own = [name for name in end.candidate.effect.coefficients if _unit(end.candidate, name) == unit]
    if not own:
        return trial
    level = ended.values[max(own, key=lambda name: _certainty(ended, name))]
    shared = ended.point[: ground.base.point.size]
    again = trial.attempted(lambda: refit_alone(trial, [level], ground, worth=worth, points=[shared]))
    return _better(trial, again)


def _from_amplitudes(trial: Trial, ground: Ground) -> Trial:
    """The trial refitted from the best of the amplitudes at which it is tried, without the effect that was found.

    Never given up: what a search of a law that switches still promises is told too low, as its score is.
    """
    amplitudes = abrupt(trial.candidate, np.ones(1))
    again = trial.attempted(lambda: refit_alone(trial, [1.0], ground, shares=amplitudes))
    return _better(trial, again)


def _better(trial: Trial, again: Trial) -> Trial:
    """The trial, or its new refit if that gains more; what has a refit cares for no search that failed."""
    return again if trial.fit is None or (not again.failed and again.gain > trial.gain) else trial


def _switches(one: Candidate, end: Candidate) -> bool:
    """Whether a law at the same place switches, without a state, and needs one coefficient."""
    effect = one.effect
    if one.place.label != end.place.label or not effect.amplitudes or effect.adds_state:
        return False
    return len(effect.parameters) == 1


def _is_simpler(one: Candidate, best: Candidate) -> bool:
    if one.place.label != best.place.label or len(one.effect.parameters) != 1:
        return False
    return len(best.effect.parameters) > 1 or set(one.model.names("state")) < set(best.model.names("state"))


def _certainty(fitted: Fit, name: str) -> float:
    """How many of its standard deviations a coefficient is from zero."""
    return abs(fitted.values[name]) / max(fitted.std[name], np.finfo(float).tiny)


def _unit(candidate: Candidate, name: str) -> str:
    model = candidate.model
    return model.parameters[model.index("parameter", name)].unit
