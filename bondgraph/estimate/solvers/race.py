"""Which of several gradient searches go on: those that lead, or may still overtake.

Several searches in lockstep cost several times one. Most of them soon come to where a better one is or has been, and
some fall behind by more than they could make up; both are ended. Reference for giving up by what is in reach: Jamieson
and Talwalkar (2016), Non-stochastic best arm identification and hyperparameter optimization, AISTATS.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.estimate.coordinates import AbstractProblem
from bondgraph.estimate.objective import BoolArray, FloatArray, Objective, SearchOutcome
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonState

#: Every start is given this many iterations.
_GRACE = 3

#: A start is behind when the gap is more than so many of its gains, and more than so many nats.
_GAINS, _NATS = 5.0, 10.0

#: Within this share of the bounds a start is where a better one is.
_TOGETHER = 0.01


def raced(problem: Objective, state: GaussNewtonState) -> GaussNewtonState:
    """The state after an iteration, without the starts that are where a better one is or will not overtake it.

    An objective that is no estimation problem does not say by which coordinates starts are told apart: all go on.
    """
    if not isinstance(problem, AbstractProblem):
        return state
    counted = _counted(problem)
    width = np.where(problem.upper > problem.lower, problem.upper - problem.lower, 1.0)
    best = state.best
    near = np.abs(state.points - state.points[:, [best]]) < _TOGETHER * width[:, np.newaxis]
    with np.errstate(invalid="ignore"):
        gaps = state.values - state.values[best]
    outcomes = list(state.outcomes)
    for start, outcome in enumerate(outcomes):
        if outcome is not None or start == best or not np.isfinite(state.values[best]):
            continue
        if near[counted, start].all():
            outcomes[start] = SearchOutcome.JOINED
        elif state.iteration >= _GRACE and gaps[start] > max(_NATS, _GAINS * float(state.pace[start])):
            outcomes[start] = SearchOutcome.GIVEN_UP
    return replace(state, outcomes=tuple(outcomes))


def race_ends(problem: AbstractProblem, state: GaussNewtonState) -> tuple[tuple[FloatArray, float], ...]:
    """Point (n,) and value where each start ended; one that joined a better one ended where the nearest did.

    Those that were given up, or never had a value, did not end anywhere.
    """
    counted = _counted(problem)
    apart = (SearchOutcome.GIVEN_UP, SearchOutcome.JOINED, SearchOutcome.NO_FINITE_POINT)
    ended = [start for start, outcome in enumerate(state.outcomes) if outcome not in apart]
    width = np.where(problem.upper > problem.lower, problem.upper - problem.lower, 1.0)
    found = []
    for start, outcome in enumerate(state.outcomes):
        home = start
        if outcome is SearchOutcome.JOINED and ended:
            away = [
                np.max(np.abs(state.points[:, start] - state.points[:, k])[counted] / width[counted]) for k in ended
            ]
            home = ended[int(np.argmin(away))]
        if home in ended and np.isfinite(state.values[home]):
            found.append((state.points[:, home], float(state.values[home])))
    return tuple(found)


def _counted(problem: AbstractProblem) -> BoolArray:
    """Coordinates by which starts are told apart: not by levels of noise, which follow from the others."""
    others = ~problem.noise_levels
    return others if others.any() else ~others
