"""Reasons: why each of the other candidates was not chosen, and which of them the logs do not tell from the chosen."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bondgraph.correct.constants import INDIFFERENT, MOSTLY
from bondgraph.correct.evidence.decide import (
    has_one_sensor,
    leaves_white,
    outdoes,
    passing,
    preferred_gain,
    within_a_sample,
)
from bondgraph.correct.evidence.trials import Alternative, Evidence, Trial
from bondgraph.correct.scores.score import Scores

#: How a reason begins of a trial that passes all hurdles.
_PASSES = "it passes the tests, but "


def alternatives(
    chosen: Trial | None, trials: Sequence[Trial], found: Scores, level: float, most: int = 12
) -> list[Alternative]:
    """The other candidates, best first, each with the reason it was not chosen."""
    ranked = sorted((t for t in trials if t is not chosen), key=lambda t: -t.gain)
    order = {trial.candidate.label: index for index, trial in enumerate(trials)}
    listed = [] if chosen is None or not chosen.candidate.effect.formula else _twins(chosen)
    for trial in ranked:
        close, why = _settled(trial) or _compared(chosen, trial, found, order)
        why = why or _unchosen(chosen, trial, trials, level)
        why = f"acting {trial.gate}, {why}" if trial.gate else why
        why += f"; {trial.remark}" if trial.remark else ""
        if close or trial.failed or len(listed) < most:
            place = trial.candidate.place.label
            listed.append(Alternative(trial.candidate.effect.described, place, trial.gain, close, why))
        if close and trial.gate is not None:
            listed += _twins(trial)
    return listed


def _twins(trial: Trial) -> list[Alternative]:
    """Candidates that show in the same way as a trial, for which it stands."""
    same = f"its response is that of {trial.candidate.label} to these sensors"
    names = [label.partition(" at ") for label in trial.stands_for]
    return [Alternative(name, where, trial.gain, True, same) for name, _, where in names]


def _settled(trial: Trial) -> tuple[bool, str] | None:
    """A reason that no comparison with another trial changes; None without one."""
    if trial.failed:
        return False, f"it could not be tried to the end: {trial.failed}"
    if trial.fit is not None and (within := within_a_sample(trial.fit, trial.candidate.effect)):
        return False, within
    if trial.candidate.effect.kind == "drift" and trial.fit is not None and has_one_sensor(trial):
        return False, "a drift of the only sensor is not told from what is slow in the machine"
    if trial.small:
        return False, f"{_PASSES}{trial.small}: too little for a name"
    if trial.transfer is not None and not trial.transfer.passes:
        return False, f"it does not transfer to data that it was not estimated from: {trial.transfer.why_not}"
    return None


def _compared(chosen: Trial | None, trial: Trial, found: Scores, order: dict[str, int]) -> tuple[bool, str]:
    """Closeness of a trial to the chosen one, and how it compares; no words where its own tests say more."""
    if chosen is not None and trial.words_for == chosen.candidate.label:
        return False, f"it says {trial.words_for} in other words"
    if chosen is None:
        if trial.evidence is not None:
            return False, ""
        little = "" if trial.remark else ", too little to be refitted"
        return False, f"its score promises {trial.score_gain:.1f} nats{little}"
    if trial.evidence is None:
        a, b = order[chosen.candidate.label], order[trial.candidate.label]
        size = found.correlation.shape[0]
        known = max(a, b) < size and not chosen.candidate.parts_from(trial.candidate)
        alike = float(found.correlation[a, b]) if known else 0.0
        lost = (1.0 - alike**2) * chosen.gain
        if trial.score_gain > 0.0 and lost < INDIFFERENT:
            return True, f"its response is the same to these sensors (correlation {alike:.4f}, {lost:.1f} nats less)"
    short = chosen.gain - trial.gain
    if trial.evidence is not None and short <= -INDIFFERENT:
        return False, ""
    if trial.evidence is not None and abs(short) < INDIFFERENT:
        return True, f"its likelihood is within {abs(short):.1f} nats, which these data do not tell apart"
    against = f"{_said(trial)} {_difference(short)} than {chosen.candidate.label}"
    parts = chosen.candidate.parts_from(trial.candidate)  # what a fit with small coefficients says of it is little
    told = trial.instead is not None and trial.instead[0] == chosen.candidate.label and not parts
    if told and trial.instead is not None and trial.instead[1] < INDIFFERENT:
        return True, _in_its_place(trial.instead[1], against if trial.evidence is not None else "")
    if short < 0.0:  # a promise alone: nobody knows whether a refit would have kept it
        against += ", but a score is a promise and no refit came to an end"
    return False, against


def _in_its_place(less: float, against: str) -> str:
    """Words on a trial that would do as well in the place of the chosen one, whatever a refit of its own gained."""
    told = f"in its place it would do as well ({_difference(less)}, from the fit with the other)"
    return f"{told}, although {against} from a start of its own" if against else told


def _difference(less: float) -> str:
    """A difference of nats in words: so many less, or more where it is negative.

    Examples
    --------
    >>> _difference(2.04), _difference(-138.7)
    ('2.0 nats less', '138.7 nats more')
    """
    return f"{abs(less):.1f} nats {'more' if less < 0.0 else 'less'}"


def _said(trial: Trial) -> str:
    if trial.evidence is None:
        return "its score promises"
    finished = trial.fit is None or trial.fit.outcome.succeeded
    return "refitted, it gains" if finished else "its refit was given up while it gained"


def _unchosen(chosen: Trial | None, trial: Trial, trials: Sequence[Trial], level: float) -> str:
    """Why a refitted trial was not chosen that gains as much as the chosen one, or where none was chosen."""
    assert trial.evidence is not None  # it was refitted
    why = _lost(trial) or hurdles(trial.evidence, level) or _put_back(chosen, trial, trials, level)
    if chosen is None:
        return why
    gains = f"it gains {_difference(chosen.gain - trial.gain)}"
    passes = why.startswith(_PASSES)
    return f"{gains} and passes the tests, but {why.removeprefix(_PASSES)}" if passes else f"{gains}, but {why}"


def _lost(trial: Trial) -> str:
    """That nothing is left of a refitted trial, if so; empty where something is."""
    names = trial.candidate.effect.coefficients
    if trial.fit is None or not names or any(trial.fit.values.get(name, 1.0) != 0.0 for name in names):
        return ""
    return "nothing is left of it: its refit ends with zero for it, and other parameters gain that"


def hurdles(evidence: Evidence, level: float) -> str:
    """The hurdles that a refit does not pass, each with its number; empty where it passes all.

    Examples
    --------
    >>> hurdles(Evidence(9.0, 1e-5, 0.41, 3.0, 20), 0.01)
    'its block-robust p = 0.41 is above 0.01 (p counts all 20 tried)'
    >>> hurdles(Evidence(2.0, 0.7, 0.5, -4.5, 20), 0.01)
    'its p = 0.7 by the likelihood ratio and its block-robust p = 0.5 are above 0.01 (p counts all 20 tried), and its \
parameters cost 4.5 nats more than it gains (BIC)'
    >>> hurdles(Evidence(9.0, 1e-5, 1e-5, 3.0, 20), 0.01)
    ''
    """
    high = [f"p = {evidence.p_value:.2g} by the likelihood ratio"] if not evidence.p_value < level else []
    high += [f"block-robust p = {evidence.p_robust:.2g}"] if not evidence.p_robust < level else []
    above = f"{'is' if len(high) == 1 else 'are'} above {level:g} (p counts all {evidence.tried} tried)"
    said = f"its {' and its '.join(high)} {above}" if high else ""
    if evidence.bic_gain > 0.0:
        return said
    price = f"its parameters cost {-evidence.bic_gain:.1f} nats more than it gains (BIC)"
    return f"{said}, and {price}" if said else price


def _put_back(chosen: Trial | None, trial: Trial, trials: Sequence[Trial], level: float) -> str:
    """Why a trial that passes all hurdles was not chosen: the rules of :func:`choose` beside them."""
    if trial.fit is not None and trial.candidate.effect.channel and has_one_sensor(trial):
        only = "it passes the tests, but a fault of the only sensor, which nothing contradicts, is believed only where"
        laws = [one for one in trials if not one.candidate.effect.channel]
        best = max(laws, key=preferred_gain, default=None)
        told = -math.inf if best is None else preferred_gain(best)
        if best is not None and preferred_gain(trial) <= told + INDIFFERENT:
            sizes = f"{told:.1f} nats against {preferred_gain(trial):.1f} after the price of parameters"
            return f"{only} no law explains as much: {best.candidate.label} has {sizes}"
        if not leaves_white(trial, level):
            return f"{only} nothing stays unexplained beside it: its innovations stay coloured"
    faults = (one for one in passing(trials, level) if outdoes(one) and one is not chosen)
    fault = max(faults, key=preferred_gain, default=None)
    if fault is not None and has_one_sensor(fault) and preferred_gain(trial) <= MOSTLY * preferred_gain(fault):
        half = "explains less than half of what the unproven"
        return f"it passes the tests, but {half} {fault.candidate.label} does ({fault.gain:.1f} nats)"
    if chosen is None:
        return "it passes the tests, but only as one that responds like another, which was refitted for both"
    if chosen.completes and not trial.completes:
        return f"it passes the tests, but a form of its own of {chosen.completes} is preferred to one more law"
    ahead = preferred_gain(chosen) - preferred_gain(trial)
    handicap = trial.candidate.effect.formula or trial.candidate.effect.regime
    rule = "a known law that acts everywhere is preferred" if handicap else "its parameters cost more"
    return f"it passes the tests, but {chosen.candidate.label} is {ahead:.1f} nats ahead: {rule} (BIC)"
