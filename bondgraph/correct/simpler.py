"""Simpler laws at the place of the best one, searched from where that ended: their scores may underrate them far."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from bondgraph.correct.candidates import Candidate
from bondgraph.correct.fit import WITHIN_REACH
from bondgraph.correct.refit import Ground, refit_alone
from bondgraph.correct.trials import Trial
from bondgraph.errors import EstimationError, FilterError


def also_simpler(trials: Sequence[Trial], ground: Ground) -> list[Trial]:
    """The trials; those of one coefficient at the place of the best refitted from there, if it is in a unit of its own.

    Friction that gives way before it slides, or slides the easier the faster, is soft, so that a search from little
    process noise finds it. Dry friction of a vehicle's sheave, which both of them were, had scores of 5 and 10 nats
    and gained 62 by a search of its own, where the others gained 281 and 982 and it gains 1084 and 1086 from there.
    """
    done = list(trials)
    best = max((one for one in done if one.fit is not None), key=lambda one: one.gain, default=None)
    if best is None or best.fit is None or best.gain < ground.need:
        return done
    shared = best.fit.point[: ground.base.point.size]
    for j, trial in enumerate(done):
        if trial.gate is not None or not _is_simpler(trial.candidate, best.candidate):
            continue
        unit = _unit(trial.candidate, trial.candidate.effect.coefficients[0])
        own = [name for name in best.candidate.effect.coefficients if _unit(best.candidate, name) == unit]
        if not own:
            continue
        level = max((best.fit.values[name] for name in own), key=abs)
        with contextlib.suppress(EstimationError, FilterError):  # it diverges there
            again = refit_alone(trial, [level], ground, worth=best.gain - WITHIN_REACH, points=[shared])
            done[j] = again if trial.fit is None or again.gain > trial.gain else trial
    return done


def _is_simpler(one: Candidate, best: Candidate) -> bool:
    if one.place.label != best.place.label or len(one.effect.parameters) != 1:
        return False
    return len(best.effect.parameters) > 1 or set(one.model.names("state")) < set(best.model.names("state"))


def _unit(candidate: Candidate, name: str) -> str:
    model = candidate.model
    return model.parameters[model.index("parameter", name)].unit
