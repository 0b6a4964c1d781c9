"""Beneath the process noise: candidates of a stiff model that only show with little of it.

Noise that drives a state stands in for what the model lacks there, so well that no score may ask for it: a sensor that
shows 5 % too much gained 744 nats by its refit, of which its score had promised none. The quiet fit
(:mod:`.quiet`) sees it, and what is best there is refitted with the noise free again.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bondgraph.correct.fits.excerpts import excerpt
from bondgraph.correct.fits.fit import Fit, Report
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.refits.decide import choose
from bondgraph.correct.refits.gated_refits import gated_trials
from bondgraph.correct.refits.refit import Ground, worth_quiet
from bondgraph.correct.refits.stiff_refits import refit_quiet
from bondgraph.correct.refits.storages import search_storage
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.scores.gates import gate_samples
from bondgraph.correct.scores.quiet import Quiet, is_driven, quiet_fit, quiet_scores
from bondgraph.correct.scores.scoring import Linearisation, Scored, linearisation, score_candidates

#: So many lags and late sensors are refitted, and so many candidates that act in part of the data.
_LAGS, _GATED = 1, 4
#: The law that is best is searched at places where it scores, with little process noise, this share of what it scores
#: at its own.
_RIVALS = 0.6


def beneath_noise(
    trials: Sequence[Trial], scored: Scored, stateful: Sequence[Candidate], ground: Ground, report: Report
) -> tuple[list[Trial], Ground]:
    """The trials, and those of a stiff model that show only with little process noise; the ground with the quiet fit.

    They are looked for where the best that was found still leaves states to be driven by noise, for the quiet fit that
    it takes is the costly part of a round.
    """
    done = list(trials)
    best = choose(done, ground.level)
    if not is_driven(ground.base if best is None or best.fit is None else best.fit, ground.need):
        return done, ground
    report("look beneath the process noise", 0, 1)
    quiet = quiet_scores(ground.base, ground.train, scored.candidates, ground.journal, gate_samples(ground.train))
    report("look beneath the process noise", 1, 1)
    if quiet is None:
        return done, ground
    done = refit_quiet(done, scored, quiet, ground, report)
    own = quiet.of([one for one in stateful if one.followed])
    gains = own.scored.scores.gain
    for k in map(int, np.argsort(-gains)[:_LAGS]):
        index = [trial.candidate.label for trial in done].index(own.scored.candidates[k].label)
        if gains[k] >= worth_quiet(quiet.scored.scores, ground.need) and done[index].fit is None:
            done[index] = done[index].attempted(functools.partial(search_storage, done[index], ground, own, k))
    in_part = gated_trials([(quiet.linear, quiet.scored)], ground, report, most=_GATED)
    # the chance of a gated one is that of its score with little noise, which means nothing where noise is real
    return [*done, *(replace(one, score_p=1.0) for one in in_part)], replace(ground, quiet=quiet.fit)


def also_elsewhere(trials: Sequence[Trial], linear: Linearisation, ground: Ground, report: Report) -> list[Trial]:
    """The trials, and the best law of a stiff model refitted where it scores about as much with little process noise.

    Other scores hardly tell where it acts: a loss in a vehicle's gearbox by the direction of the torque had one of 0.7
    nats, at the crank 9, where it gained 116; another had 3.8, at the crank 55, where it gained 92. With little process
    noise both places score the same.
    """
    done = list(trials)
    best = choose(done, ground.level)
    if best is None or best.gate is not None or best.candidate.effect.adds_state:
        return done
    others = [
        j
        for j, one in enumerate(done)
        if one.evidence is None and one.gate is None and one.candidate.function is best.candidate.function
    ]
    fitted = _quiet_somewhere(ground) if others else None
    if fitted is None:
        return done
    silent = linearisation(fitted, fitted.problem.logs)
    own, *gains = score_candidates(silent, [best.candidate, *(done[j].candidate for j in others)]).scores.gain
    rivals = [j for j, gain in zip(others, gains, strict=True) if gain >= _RIVALS * own]
    rest = [done[j] for j in rivals]
    same = [one.candidate for one in rest]
    quiet = Quiet(fitted, silent, score_candidates(silent, same))
    for j, one in zip(rivals, refit_quiet(rest, score_candidates(linear, same), quiet, ground, report), strict=True):
        done[j] = one
    return done


def _quiet_somewhere(ground: Ground) -> Fit | None:
    """The quiet fit, that of the beginnings of long logs if none was made."""
    if ground.quiet is not None:
        return ground.quiet
    part = excerpt(ground.base.problem) or ground.base.problem
    return quiet_fit(replace(ground.base, problem=part), part.logs, ground.journal)
