"""The last word between refits that ended close to each other: each is searched once more, from where the best ended.

Searches on a stiff model may end some nats short of their optimum, in one valley of several; that decides nothing where
a hundred lie between two candidates, and names the wrong one where few do (a vehicle's gearbox: a loss at the crank
gained 50.5 nats, the true one 43.8 by its first search and 51.7 by another).
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace

from bondgraph.correct.fits.fit import Fit
from bondgraph.correct.models.failures import FAILURES
from bondgraph.correct.refits.decide import choose
from bondgraph.correct.refits.refit import Ground, refit_alone
from bondgraph.correct.refits.trials import Trial
from bondgraph.filter.compiled import in_threads

#: Nats behind the best within which a search may have been unlucky, and how many are searched again. A loss at a
#: gearbox by its direction ended 17 behind one at the crank, and 0.5 ahead of it when it was searched from there.
CLOSE, _MOST = 30.0, 4


def runoff(trials: Sequence[Trial], ground: Ground, abreast: int) -> list[Trial]:
    """The trials, those close to the best refitted once more; the best too, from where one that beats it ended."""
    done = list(trials)
    best = choose(done, ground.level)
    if best is None or best.fit is None:
        return done
    _again(done, [j for j in _close(done, best.fit) if done[j] is not best], best.fit, ground, abreast)
    winner = choose(done, ground.level)
    if winner is not None and winner.fit is not None and winner.candidate is not best.candidate:
        first = next(j for j, one in enumerate(done) if one.candidate is best.candidate and one.gate is best.gate)
        _again(done, [first], winner.fit, ground, abreast)
    return done


def _close(trials: Sequence[Trial], best: Fit) -> list[int]:
    """Those that act throughout, bring no storage, and are little behind, the nearest first."""
    behind = {
        j: one.fit.nll - best.nll
        for j, one in enumerate(trials)
        if one.fit is not None and one.gate is None and not one.candidate.effect.adds_state
    }
    return sorted((j for j in behind if behind[j] < CLOSE), key=lambda j: behind[j])[: _MOST + 1]


def _again(done: list[Trial], due: Sequence[int], best: Fit, ground: Ground, abreast: int) -> None:
    """Refits from where the best ended, put into the trials where they are better."""
    found: dict[int, Trial] = {}
    shared = best.point[: ground.base.point.size]

    def work(k: int) -> None:
        trial = done[due[k]]
        with contextlib.suppress(*FAILURES):  # it diverges there, and stays what it was
            found[due[k]] = refit_alone(trial, _estimates(trial), ground, points=[shared])

    in_threads(abreast, work, range(len(due)))
    for j in (k for k in due if k in found):  # not in the order in which threads ended
        again = found[j]
        known = done[j].fit
        if again.fit is None or known is None or again.fit.nll >= known.nll:
            continue
        done[j] = again
        for k, other in enumerate(done):
            if other.candidate.label in again.stands_for and other.fit is None:
                done[k] = replace(other, evidence=again.evidence)


def _estimates(trial: Trial) -> list[float]:
    values = {} if trial.fit is None else trial.fit.values
    return [values[name] for name in trial.candidate.effect.coefficients]
