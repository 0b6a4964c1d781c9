"""Small rests: what passes the tests and moves the sensors too little to be given a name.

With long logs every test passes for what moves a sensor by a tenth of its noise. That much is also what a given
constant leaves that is two percent off, the filter of an amplifier, the last digit of a converter or the form of a law
that was found before: all of them colour the errors, and some law of the dictionary follows that colour. On simulated
rigs and their clean twins, most with sensors, inputs and constants as good as real ones, right laws moved predictions
by 1.5 to 12 times the noise. Of thirteen false ones that were looked at ten moved them by less than a third of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bondgraph.correct.constants import FAINT, NOTICED
from bondgraph.correct.evidence.moves import smallness
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.shaping_filters import DISTURBANCE
from bondgraph.correct.shapes.forms import own_form
from bondgraph.estimate.fitted import Fit


def weighed(trial: Trial, laws: Sequence[Trial], without: Fit) -> Trial:
    """The trial; with how little it moves where that is too little for a name.

    ``laws`` are those that the model has beside its declaration, ``without`` is the fit that has all but the trial. A
    further part of a law at its place and a disturbance are not weighed, an event where it acts.
    """
    effect = trial.candidate.effect
    if trial.fit is None or trial.built is None or effect.kind == DISTURBANCE:
        return trial
    others = [one for one in laws if one is not trial and one.candidate.effect.kind != DISTURBANCE]
    graph = trial.built.graph
    if any(own_form(one, trial, graph) for one in others):
        return trial
    return replace(trial, small=smallness(without, trial.fit, least_beside(others, trial.gain), trial.gate))


def least_beside(laws: Sequence[Trial], gain: float) -> float:
    """Part of a sensor's noise by which something that gains so many nats must move it to be told beside laws."""
    named = (one.gain for one in laws if one.candidate.effect.kind != DISTURBANCE)
    return NOTICED if any(one > gain for one in named) else FAINT


def small_rest(trials: Sequence[Trial]) -> str:
    """A sentence on the largest small rest among the trials of a round; empty without one."""
    small = [one for one in trials if one.small]
    if not small:
        return ""
    most = max(small, key=lambda one: one.gain)
    return too_small(f"{most.candidate.label} gains {most.gain:.1f} nats", most.small)


def too_small(what: str, small: str) -> str:
    """A sentence on what is left, and how little it moves.

    Examples
    --------
    >>> print(too_small("creep at hub gains 21.0 nats", "over 2 s it moves no sensor by more than 0.1 of its noise"))
    what is left is too small for a name: creep at hub gains 21.0 nats, but over 2 s it moves no sensor by more than \
0.1 of its noise, and the form of a law, a given constant or a sensor may leave as much
    """
    return (
        f"what is left is too small for a name: {what}, but {small}, and the form of a law, a given constant or a "
        "sensor may leave as much"
    )


def as_well(what: str, given: str) -> str:
    """A sentence on what is left, and the given constants that explain it as well.

    Examples
    --------
    >>> print(as_well("a flow that gains 21 nats", "J = 0.5 kg m^2 (+4 %)"))
    what is left has no name: given constants that are slightly off explain as much as a flow that gains 21 nats, \
J = 0.5 kg m^2 (+4 %)
    """
    return f"what is left has no name: given constants that are slightly off explain as much as {what}, {given}"
