"""Is a fit of a loop free of its integration steps? One expansion with every step halved says how far it would move.

Where it would move noticeably, the fit goes on with the halved steps from where it is.
"""

from __future__ import annotations

import numpy as np

from bondgraph.correct.fit import Fit, expand, fit, restricted
from bondgraph.correct.journal import Journal
from bondgraph.correct.refit import at_optimum
from bondgraph.correct.score import solve
from bondgraph.data.log import FloatArray
from bondgraph.errors import EstimationError
from bondgraph.estimate.certify import NEGLIGIBLE_SHIFT, Check, check
from bondgraph.estimate.objective import Expansion, Objective

#: How often steps are halved for a fit that its steps move: enough for a smoothed dry friction that explicit steps
#: follow, but do not resolve. Stiff models have their steps from a study of their own, and their fits are costly.
_MOST_HALVINGS = 4
#: A fit that still promises 0.005 nats lies a tenth of a standard deviation off by that alone.
_ITERATIONS, _TOLERANCE = 20, 1e-3


def refined(fitted: Fit, journal: Journal | None = None) -> tuple[Fit, Check]:
    """The fit with steps so short that halving them moves it no more, if few halvings do that, and its last check.

    A fit that its steps do not move is returned as it is, and so is that of a stiff model.
    """
    found = certify(fitted)
    for _ in range(_MOST_HALVINGS):
        problem = fitted.problem
        if found.shift <= NEGLIGIBLE_SHIFT or problem.filter_model.is_stiff:
            break
        finer = problem.filter_model.with_halved_steps()
        try:
            fitted = fit(finer, problem.logs, at_optimum(fitted), _ITERATIONS, _TOLERANCE, journal=journal)
        except EstimationError:
            break
        found = certify(fitted)
    return fitted, found


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
