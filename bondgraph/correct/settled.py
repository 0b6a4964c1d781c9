"""What a law with a state of its own settles to: the law without it, which a score may underrate far more."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from bondgraph.correct.candidates import Candidate
from bondgraph.correct.refit import Ground, refit_alone
from bondgraph.correct.trials import Trial
from bondgraph.errors import EstimationError, FilterError


def also_settled(trials: Sequence[Trial], ground: Ground) -> list[Trial]:
    """The trials; where a law with a state did best, those of its place refitted whose coefficient is in its unit.

    They start from where it ended. Friction that gives way before it slides is soft, so that a search from little
    process noise finds it; dry friction of a vehicle's sheave, which it was, had a score of 5 nats where this gained
    281. An exchange (:mod:`.exchange`) does not know what a state of one is to another without it.
    """
    done = list(trials)
    best = max((one for one in done if one.fit is not None), key=lambda one: one.gain, default=None)
    if best is None or best.fit is None or best.gain < ground.need:
        return done
    size, name = ground.base.point.size, best.candidate.effect.coefficients[0]
    for j, trial in enumerate(done):
        if trial.fit is None and _is_simpler(trial, best):
            with contextlib.suppress(EstimationError, FilterError):  # it diverges there
                done[j] = refit_alone(trial, [best.fit.values[name]], ground, points=[best.fit.point[:size]])
    return done


def _is_simpler(trial: Trial, best: Trial) -> bool:
    one, other = trial.candidate, best.candidate
    alike = one.place.label == other.place.label and _unit(one) == _unit(other)
    return alike and trial.gate is None and len(one.effect.parameters) == 1 and _states(one) < _states(other)


def _states(candidate: Candidate) -> set[str]:
    return set(candidate.model.names("state"))


def _unit(candidate: Candidate) -> str:
    model = candidate.model
    return model.parameters[model.index("parameter", candidate.effect.coefficients[0])].unit
