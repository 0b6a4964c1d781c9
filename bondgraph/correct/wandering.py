"""Disturbances beside laws: when one is added to a model, and when it explains a law that was chosen.

Noise that drives a machine is coloured by a law with a memory as by a disturbance. A lag, a storage and a late sensor
explain coloured innovations, whatever coloured them: through a mass on a spring the white noise of a platen becomes a
slow one. Of a press whose load wanders such a mass of ten times the platen explained 531 nats. What is a law of the
machine explains something beside a disturbance, too.
"""

from __future__ import annotations

from dataclasses import replace

from bondgraph.correct.constants import MOSTLY
from bondgraph.correct.evidence.certified import refined
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.fits.compared import predicts_worse
from bondgraph.correct.fits.whiteness import is_white
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.models.shaping_filters import DISTURBANCE, state_under
from bondgraph.correct.progress import Decision, Progress, rounds_done, standing
from bondgraph.correct.round import RoundSettings
from bondgraph.correct.search.disturbances import described, disturbances
from bondgraph.correct.search.refit import refit_from
from bondgraph.correct.search.rhythms import rhythm
from bondgraph.estimate.fitted import Fit


def with_disturbance(
    state: Progress, settings: RoundSettings, worth: float = 0.0, rival: Fit | None = None, *, sensors: bool = True
) -> Progress:
    """The state with the disturbance that explains most, if innovations are coloured and one passes its tests.

    It must gain more than ``worth`` nats beyond the penalty for its parameters, which a ``rival`` gains if there is
    one; ``sensors``: that of a sensor is one. Laws that are in doubt beside it go.
    """
    settings.report("look for a disturbance", 0, 1)
    found = disturbances(
        state.built, state.fit, state.train, settings.level, settings.journal, sensors=sensors, worth=worth, rival=rival
    )
    settings.report("look for a disturbance", 1, 1)
    if found is None or found.fit is None or found.built is None or found.evidence is None:
        return state
    if found.evidence.bic_gain <= worth:
        return state
    number = rounds_done(state) + 1
    why = f"{described(found, found.fit)}; gains {found.evidence.delta_nll:.1f} nats, p = {found.p_value:.2g}"
    decision = Decision(number, "disturbance", found.candidate.label, why)
    fitted, check = refined(found.fit, settings.journal, settings.substeps)
    disturbed = replace(
        state, built=found.built, fit=fitted, check=check, added=(*state.added, found),
        history=(*state.history, decision),
    )  # fmt: skip
    disturbed, sure = _with_rhythm(disturbed, found, number, settings)
    return standing(disturbed, sure, f"beside {found.candidate.label}", number, settings)


def _with_rhythm(state: Progress, first: Trial, number: int, settings: RoundSettings) -> tuple[Progress, list[Trial]]:
    """The state with what repeats beside a disturbance, if something does, and both disturbances."""
    moved = state_under(first.candidate, state.built.model.names("state"))
    if moved is None:
        return state, [first]
    found = rhythm(state.built, state.fit, state.train, first, moved, settings.level, settings.journal)
    if found is None or found.fit is None or found.built is None:
        return state, [first]
    fitted, check = refined(found.fit, settings.journal, settings.substeps)
    why = f"{described(found, fitted)}; gains {found.gain:.1f} nats, p = {found.p_value:.2g}"
    told = Decision(number, "disturbance", found.candidate.label, why)
    added, history = (*state.added, found), (*state.history, told)
    return replace(state, built=found.built, fit=fitted, check=check, added=added, history=history), [first, found]


def explained_at_random(state: Progress, chosen: Trial, settings: RoundSettings) -> Progress:
    """The state with a disturbance in the place of a candidate that it explains better, if it does.

    A wind that lasts correlates with every law for a while, and the scatter of blocks tells too little of it: of a law
    without memory that leaves innovations coloured, the disturbance must explain more, and not predict worse over the
    horizon. Of one with a memory it must explain most, and leave it nothing. What a law of the machine explains is not
    blamed on the noise of a sensor.
    """
    effect, known = chosen.candidate.effect, {one.candidate.effect.kind for one in state.added}
    if DISTURBANCE in known or chosen.evidence is None or chosen.fit is None:
        return state
    gained = chosen.evidence.bic_gain
    remembers = len(chosen.candidate.model.states) > len(state.built.model.states)
    if not (remembers or effect.channel):
        if is_white(chosen.fit, settings.level):
            return state
        other = with_disturbance(state, settings, gained, chosen.fit, sensors=False)
        return state if predicts_worse(chosen.fit, other.fit, state.train) else other
    other = with_disturbance(state, settings, MOSTLY * gained)
    disturbance = next((one for one in other.added if one.candidate.effect.kind == DISTURBANCE), None)
    if disturbance is None or disturbance.evidence is None:
        return state
    clearly = disturbance.evidence.bic_gain > gained
    return other if clearly or not attempted(lambda: _stands(chosen, other, settings), lambda why: True) else state


def _stands(chosen: Trial, other: Progress, settings: RoundSettings) -> bool:
    """True for a candidate that passes the tests beside a disturbance, too."""
    made, _ = candidates(other.built, [chosen.candidate.function], [chosen.candidate.place])
    if not made or chosen.fit is None or chosen.evidence is None:
        return True
    context = Context(
        other.built, other.fit, other.train, chosen.evidence.tried, settings.level, 0.0, settings.journal
    )  # fmt: skip
    begun = [chosen.fit.values[name] for name in chosen.candidate.effect.parameters]
    beside = refit_from(Trial(made[0], 0.0), begun, context)
    return beside.evidence is not None and beside.evidence.accepted(settings.level)
