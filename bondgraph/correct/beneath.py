"""Beneath the process noise: candidates of a stiff model that only show with little of it.

Noise that drives a state stands in for what the model lacks there, so well that no score may ask for it: a sensor that
shows 5 % too much gained 744 nats by its refit, of which its score had promised none. The quiet fit
(:mod:`.quiet`) sees it, and what is best there is refitted with the noise free again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bondgraph.correct.candidates import Candidate
from bondgraph.correct.decide import choose
from bondgraph.correct.fit import Report
from bondgraph.correct.gated_refits import gated_trials
from bondgraph.correct.gates import gate_samples
from bondgraph.correct.quiet import is_driven, quiet_scores
from bondgraph.correct.refit import Ground, worth_quiet
from bondgraph.correct.scoring import Scored
from bondgraph.correct.stiff_refits import refit_quiet
from bondgraph.correct.storages import try_storage
from bondgraph.correct.trials import Trial

#: So many candidates that act in part of the data are refitted.
_GATED = 3


def beneath_noise(
    trials: Sequence[Trial], scored: Scored, stateful: Sequence[Candidate], ground: Ground, report: Report
) -> tuple[list[Trial], Ground]:
    """The trials, and those of a stiff model that show only with little process noise; the ground with the quiet fit.

    They are looked for where the best that was found still leaves states to be driven by noise, for the quiet fit that
    it takes is the costly part of a round.
    """
    done = list(trials)
    best = choose(done, ground.level)
    if not is_driven(ground.base if best is None or best.fit is None else best.fit):
        return done, ground
    report("look beneath the process noise", 0, 1)
    quiet = quiet_scores(ground.base, ground.train, scored.candidates, ground.journal, gate_samples(ground.train))
    report("look beneath the process noise", 1, 1)
    if quiet is None:
        return done, ground
    done = refit_quiet(done, scored, quiet, ground, report)
    least = worth_quiet(quiet.scored.scores, ground.need)
    own = quiet.of([one for one in stateful if one.followed])
    for k, one in enumerate(own.scored.candidates):
        index = next(j for j, trial in enumerate(done) if trial.candidate.label == one.label)
        if own.scored.scores.gain[k] >= least and done[index].fit is None:
            best = choose(done, ground.level)
            beat = np.inf if best is None or best.fit is None else best.fit.nll
            done[index] = try_storage(done[index], ground, beat, (own, k))
    done = [
        replace(one, hidden=one.fit is not before.fit and one.score_p > ground.level)
        for one, before in zip(done, trials, strict=True)
    ]
    in_part = gated_trials([(quiet.linear, quiet.scored)], ground, report, most=_GATED)
    return [*done, *(replace(one, hidden=True) for one in in_part)], replace(ground, quiet=quiet.fit)
