"""The last steps of a stiff fit, by exact derivatives of its filter.

Linearised along itself a filter tells each derivative to some percent, and in single intervals, where a belt grips
again, one of them may be off by a hundred. Where parameters stand in for each other their derivatives nearly cancel,
and what is left is then that error: along the ridge of a vehicle's clutch the information was a hundred times too
large, a search ended twenty standard deviations and 55 nats short, and said that a step promised 0.3. Exact derivatives
cost several times as much, so that they come last; the expansion of the fit is then exact too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.correct.linear_steps import Reached, longest_steps
from bondgraph.estimate.exact import exact_expansion
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.steps import damped_step, newton_decrement

#: Most exact expansions of one fit, and trials of a step from each.
_MOST, _TRIALS = 8, 4
#: Damping of the first trial relative to the information, and by how much it rises where that gains nothing.
_DAMPING, _DAMP_MORE = 1e-5, 30.0


def polished(problem: EstimationProblem, found: Reached, tolerance: float) -> Reached:
    """Where a search went on to by exact derivatives; as it was where there are none.

    Parameters
    ----------
    problem
        The problem that was searched.
    found
        Where the search by the linearised filter ended.
    tolerance
        How many nats a further step must promise.
    """
    reached, longest = found, longest_steps(problem)
    for _ in range(_MOST):
        expansion = exact_expansion(problem, reached.point)
        if expansion is None:
            return reached
        reached = replace(reached, expansion=expansion, evaluations=reached.evaluations + expansion.evaluations)
        if newton_decrement(problem, reached.point, expansion) < tolerance:
            return replace(reached, outcome=SearchOutcome.CONVERGED)
        steps = (
            np.clip(damped_step(problem, reached.point, expansion, damping) - reached.point, -longest, longest)
            for damping in _DAMPING * _DAMP_MORE ** np.arange(_TRIALS)
        )
        before = reached
        for step in steps:
            point = np.clip(before.point + step, problem.lower, problem.upper)
            value = float(problem.nll(point[:, np.newaxis])[0])
            reached = replace(reached, evaluations=reached.evaluations + 1)
            if value < before.nll:
                reached = replace(reached, point=point, nll=value)
                break
        if reached.nll >= before.nll - 0.5 * tolerance:
            return replace(reached, outcome=SearchOutcome.CONVERGED)
    expansion = exact_expansion(problem, reached.point)
    return replace(reached, expansion=expansion or reached.expansion, outcome=SearchOutcome.ITERATION_LIMIT)
