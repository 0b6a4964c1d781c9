"""Refits of candidates that act in part of the data only, from a time on or until it."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bondgraph.correct.fits.fit import Report
from bondgraph.correct.models.candidates import Candidate, candidates
from bondgraph.correct.refits.refit import Ground, refit_alone, remoteness
from bondgraph.correct.refits.stiff_picks import attainable
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.scores.gates import Gate, Gated, Peer, best_gated, gated, refined, with_gate
from bondgraph.correct.scores.scoring import Linearisation, Scored
from bondgraph.data.log import FloatArray

#: A gated candidate must promise this many nats more than the best that acts throughout, beyond its number.
_GATE_MARGIN = 6.0
#: Of those that act in part of the data the best are those that gain at least this share of the very best.
_AS_GOOD = 0.9


def gated_trials(
    scores: Sequence[tuple[Linearisation, Scored]],
    ground: Ground,
    report: Report,
    ahead: float = 0.0,
    most: int | None = None,
) -> list[Trial]:
    """The best candidates that act in part of the data, if they promise clearly more than those that act throughout.

    They are looked for at the fit and at the quiet fit, which sees what noise hides (``scores``). Nor do those count
    that cannot reach what a storage of a stiff model gained (``ahead``). Of the best in a part ``most`` are refitted.
    """
    made: dict[str, Trial] = {}
    for own, known in scores:
        best = best_gated(own, known)
        if best is None:
            continue
        throughout = float(known.scores.gain.max(initial=0.0))
        margin = _GATE_MARGIN + float(np.log(best.tested / max(len(known.candidates), 1)))
        if best.gain < max(throughout + margin, ground.need) or best.p_value * best.tested > 0.05:
            continue
        if attainable(best.gain, known.candidates[best.index].effect) < ahead:
            continue
        report("refit effects that act in part of the data", 0, 1)
        best = refined(own, best, known.candidates[best.index], known.variants[best.index])
        for peer in best.peers[:most]:
            for trial in _gated_refit(best, peer, known, ground):
                kept = made.get(trial.candidate.label)
                if kept is None or (not trial.failed and (kept.failed or trial.gain > kept.gain)):
                    made[trial.candidate.label] = trial
    return list(made.values())


def _gated_refit(best: Gated, peer: Peer, known: Scored, ground: Ground) -> list[Trial]:
    """One of the candidates that act in part of the data, refitted; none where its graph is refused."""
    index, step = min(peer, key=lambda one: (*remoteness(known.candidates[one[0]], (one[1],)), one[0]))
    step = best.step if index == best.index else step
    twins = tuple(known.candidates[k].label for k, _ in peer if k != index)
    chance = min(1.0, best.p_value * best.tested)
    trial = Trial(known.candidates[index], best.gain, (step,), score_p=chance, stands_for=twins, gate=best.gate)
    return refit_in_part(trial, ground, best.tested, 0.5 * ground.need)


def refit_in_part(
    trial: Trial, ground: Ground, tried: int, worth: float, points: Sequence[FloatArray] = ()
) -> list[Trial]:
    """A trial of a candidate, made to act in the part of its gate and refitted; none where that cannot be done."""
    assert trial.gate is not None  # else there is no part
    function = gated(trial.candidate.function, trial.gate, ground.train)
    made, _ = candidates(ground.built, [function], [trial.candidate.place])
    if not made:
        return []
    own, within = replace(trial, candidate=made[0]), ground_in_part(made[0], trial.gate, ground)
    return [own.attempted(lambda: refit_alone(own, trial.step, within, tried=tried, worth=worth, points=points))]


def ground_in_part(made: Candidate, gate: Gate, ground: Ground) -> Ground:
    """The ground with logs that know when a candidate acts."""
    return replace(ground, train=with_gate(ground.train, made.effect, gate))


def also_throughout(trials: Sequence[Trial], ground: Ground) -> list[Trial]:
    """The trials, and those that do best in part of the data refitted as acting throughout, if that was not done.

    A fit far from the truth may show an effect in a part of the data alone (creep of a vehicle's tyre: 565 nats until
    the eleventh second, 20 by all of them, and 877 by a refit).
    """
    done = list(trials)
    parts = [one for one in done if one.gate is not None and one.gain > ground.need]
    least = _AS_GOOD * max((one.gain for one in parts), default=0.0)
    for part in parts:
        if part.fit is None or part.gain < least:
            continue
        for j, trial in enumerate(done):
            if trial.candidate.label == part.candidate.label and trial.gate is None and trial.fit is None:
                values = [part.fit.values[name] for name in part.candidate.effect.coefficients]
                done[j] = trial.attempted(functools.partial(refit_alone, trial, values, ground))
    return done
