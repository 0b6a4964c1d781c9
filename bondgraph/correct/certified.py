"""Is a fit of a loop free of its integration steps? One expansion with every step halved says how far it would move."""

from __future__ import annotations

import numpy as np

from bondgraph.correct.fit import Fit, expand, restricted
from bondgraph.correct.score import solve
from bondgraph.data.log import FloatArray
from bondgraph.estimate.certify import NEGLIGIBLE_SHIFT, Check, check
from bondgraph.estimate.objective import Expansion, Objective


def certify(fitted: Fit) -> Check:
    """What halved integration steps would change at a fit, see :func:`bondgraph.estimate.certify.check`.

    What rests on a bound is not expected to move.
    """
    problem, free = fitted.problem, ~fitted.held
    covariance = np.full((free.size, free.size), np.nan)
    information = restricted(fitted.expansion, free).information
    covariance[np.ix_(free, free)] = solve(information, np.eye(information.shape[0]))
    return check(problem, fitted.point, covariance, problem.filter_model.with_halved_steps(), _expansions)


def _expansions(objective: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
    return (expand(objective, points[:, 0], steps[:, 0]),)


def doubts(which: str, found: Check) -> list[str]:
    """What to say where steps do matter: nothing, or one sentence about the ``which`` model."""
    if found.shift <= NEGLIGIBLE_SHIFT:
        return []
    return [
        f"the {which} model is not certified: with every integration step halved, {found.parameter} would move by "
        f"{found.shift:.2g} standard deviations (likelihood {found.nats:+.3g} nats)"
    ]
