"""Rivals of the best: what would do as well in its place, told at its refit for every candidate there is.

Scores at the fit without any effect single out what is refitted, and tell too little of its neighbours: drag of a
vehicle's body had 4 nats, on its front axle 27, where both gain 61; of a law that acts in part of the data its place
and kind are hardly told at all. At the refit they are (:mod:`.exchange`). What promises to be better is refitted from
there, what promises to be as good belongs to the group that the data do not tell apart. That is asked also of what was
refitted and ended somewhat behind, for only the foremost are searched until nothing is left: friction in a front axle
ended 5.7 nats behind that in the rear one, was promised 2.6 there, and was 3.4 behind when searched from there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from bondgraph.correct.fits.fit import WITHIN_REACH
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.refits.decide import CLOSE, choose
from bondgraph.correct.refits.exchange import Exchange, exchanges
from bondgraph.correct.refits.gated_refits import refit_in_part
from bondgraph.correct.refits.refit import Ground, refit_alone, remoteness
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.scores.score import SAME
from bondgraph.correct.scores.scoring import Scored

#: Those that promise so many nats more than the best are refitted, and at most so many of them.
_MORE, _AGAIN = 1.0, 3
#: So are as many with the law of the best in a part of the data, whose place scores hardly tell, that seem to lose no
#: more than so many nats: friction of a vehicle's rear axle was to lose 5.1 of 49.9 at the ground, and gained 7.2 more.
_SAME_LAW = 10.0
#: At so many others that ended within these nats of the best it is told what would do as well at their places.
_ENDS, _NEAR = 4, 10.0
#: Of responses more alike than this one is refitted.
_ALIKE = 0.99
#: What is less alike than this, without any effect, is not asked for: drag of a body and of its front axle are by 0.35.
_STRANGE = 0.2


def rivals(trials: Sequence[Trial], scored: Scored, ground: Ground) -> list[Trial]:
    """The trials, those that would do as well in the place of the best marked so, those that promise more refitted.

    Parameters
    ----------
    trials
        Candidates of a round, some refitted; those that act in part of the data beside them.
    scored
        Scores of the candidates.
    ground
        What the refits start from.
    """
    done = [_untold(one) for one in trials]
    best = choose(done, ground.level)
    if best is None or best.fit is None:
        return done
    refitted = _compare(done, best, scored, ground, _AGAIN)
    better = choose(done, ground.level)
    if refitted and better is not None:
        _compare(done, better, scored, ground, 0)
    return done


def _untold(trial: Trial) -> Trial:
    """A trial without what was told before its refit."""
    return trial if trial.evidence is None or trial.instead is None else replace(trial, instead=None)


def _compare(done: list[Trial], best: Trial, scored: Scored, ground: Ground, most: int) -> bool:
    """What candidates would do in the place of the best, told at its refit, and at others near it of their places.

    Whether any was refitted.
    """
    again: dict[int, float] = {}
    for end in (best, *_ends(done, best)):
        comparable = _comparable(scored, end, best)
        others = [j for j in _others(done, best, scored) if comparable[j]]
        for one, j in _told(end, others, scored, ground):
            loss = one.loss + best.gain - end.gain
            twin = next((k for k in again if _alike(scored, j, k) > _ALIKE), None)
            due = twin is None and _worth(loss, scored.candidates[j], best, again, most)
            if loss >= CLOSE and not due and twin is None:
                continue
            index = _index(done, Trial(scored.candidates[j], best.gain - loss, gate=best.gate))
            if twin is not None:  # what an expansion says of both is off by the same
                done[index] = replace(done[index], instead=(scored.candidates[twin].label, loss - again[twin]))
                continue
            done[index] = replace(done[index], instead=(best.candidate.label, loss))
            if due:
                again[j] = loss
                done[index] = _again(done[index], one, best, ground)
    return bool(again)


def _worth(loss: float, candidate: Candidate, best: Trial, again: Mapping[int, float], most: int) -> bool:
    """Whether a candidate is refitted that would lose so much in the place of the best; ``again``: those that were."""
    if loss < -_MORE:
        return sum(other < -_MORE for other in again.values()) < most
    same = best.gate is not None and candidate.effect.name == best.candidate.effect.name
    return same and CLOSE <= loss < _SAME_LAW and sum(other >= CLOSE for other in again.values()) < most


def _told(end: Trial, others: Sequence[int], scored: Scored, ground: Ground) -> list[tuple[Exchange, int]]:
    """Candidates in the place of one that was refitted, the best first, as far as anything can be said of them."""
    assert end.fit is not None  # else it is no end
    told = exchanges(
        end, [scored.candidates[j] for j in others], [scored.variants[j] for j in others], end.fit.problem.logs,
        ground.base.point.size,
    )  # fmt: skip
    known = [(one, j) for one, j in zip(told, others, strict=True) if one is not None]
    return sorted(known, key=lambda pair: (round(pair[0].loss, 3), remoteness(scored.candidates[pair[1]])))


def _ends(done: Sequence[Trial], best: Trial) -> list[Trial]:
    """Others that ended close to the best, one at each place, the best of them first."""
    close = [one for one in done if one.fit is not None and one.gate == best.gate and one.gain > best.gain - _NEAR]
    by_place = {best.candidate.place.label: best}
    for one in sorted(close, key=lambda one: -one.gain):
        by_place.setdefault(one.candidate.place.label, one)
    return list(by_place.values())[1 : 1 + _ENDS]


def _others(done: Sequence[Trial], best: Trial, scored: Scored) -> list[int]:
    """The candidates that act when the best does, were not compared yet, and were not refitted, alone or with others.

    Nor those that were, if they ended within some nats behind.
    """
    known = set[str]()
    for one in done:
        compared = one.instead is not None and one.instead[0] == best.candidate.label
        ended = one.evidence is not None and not CLOSE <= best.gain - one.gain < _NEAR
        if one.gate == best.gate and (ended or compared):
            known |= {one.candidate.label, *(one.stands_for if one.fit is not None else ())}
    return [
        j
        for j, one in enumerate(scored.candidates)
        if one.label not in known
        and (best.gate is None or (len(one.effect.parameters) == 1 and not one.effect.channel))
    ]


def _comparable(scored: Scored, end: Trial, best: Trial) -> list[bool]:
    """Of each candidate whether it may do as well as one that was refitted: of another than the best at its place.

    What responses throughout have in common tells nothing of those in a part.
    """
    labels = [one.label for one in scored.candidates]
    if end.candidate.label not in labels:  # a storage has no score
        return [end is best] * len(labels)
    own = labels.index(end.candidate.label)
    return [
        (best.gate is not None or _alike(scored, own, j) > _STRANGE)
        and (end is best or _is_at(scored, j, end.candidate.place.label))
        for j in range(len(labels))
    ]


def _is_at(scored: Scored, j: int, place: str) -> bool:
    """Whether a candidate acts at a place, or at one that is rigidly tied to it."""
    same = [k for k, one in enumerate(scored.candidates) if one.place.label == place]
    name = scored.candidates[j].effect.name
    return any(k == j or (scored.candidates[k].effect.name == name and _alike(scored, j, k) > SAME) for k in same)


def _alike(scored: Scored, j: int, k: int) -> float:
    return abs(float(scored.scores.correlation[j, k]))


def _index(done: list[Trial], trial: Trial) -> int:
    """Where the trial of the same candidate is that acts at the same times; it is added if there is none."""
    for index, one in enumerate(done):
        if one.candidate.label == trial.candidate.label and one.gate == trial.gate:
            return index
    done.append(trial)
    return len(done) - 1


def _again(trial: Trial, one: Exchange, best: Trial, ground: Ground) -> Trial:
    """A trial refitted from where it would take the place of the best, or as it is if that leads nowhere."""
    assert best.evidence is not None  # it was chosen
    shared = ground.base.point.size
    steps = [float(value) for value in one.starts[0][shared : shared + len(trial.candidate.effect.coefficients)]]
    points = [start[:shared] for start in one.starts]
    worth = best.gain - WITHIN_REACH
    found: list[Trial] = []
    if trial.gate is not None:
        found = refit_in_part(replace(trial, step=tuple(steps)), ground, best.evidence.tried, worth, points)
    else:
        found = [trial.attempted(lambda: refit_alone(trial, steps, ground, worth=worth, points=points))]
    return next((again for again in found if not again.failed and again.gain > worth), trial)
