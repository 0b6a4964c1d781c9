"""The last steps of a stiff fit, by exact derivatives of its filter.

Linearised along itself a filter tells each derivative to some percent, and in single intervals, where a belt grips
again, one of them may be off by a hundred. Where parameters stand in for each other their derivatives nearly cancel,
and what is left is then that error: along the ridge of a vehicle's clutch the information was a hundred times too
large, a search ended twenty standard deviations and 55 nats short, and said that a step promised 0.3.

Exact derivatives cost as much as half a dozen values of the likelihood. So several steps are taken with the same ones,
each with the gradient that they make with the innovations where it starts (simplified Newton steps: Deuflhard 2004,
Newton Methods for Nonlinear Problems, 2.1.2), and they are formed anew where these gain no more.

Such a ridge is curved, and narrow: a step along it leaves it, though it promises 19 nats, and a shorter one gains next
to nothing. Where steps stall, longer ones are followed by others back onto the ridge before it is said what they gained
(the second-order correction of constrained optimisation: Nocedal and Wright 2006, Numerical Optimization, 18.3). On
that clutch a search went 20 nats further.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bondgraph.estimate.derivatives.exact import exact_expansion
from bondgraph.estimate.derivatives.formed import Formed, Scheme
from bondgraph.estimate.objective import Expansion, SearchOutcome
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.linearised import Reached, longest_steps
from bondgraph.estimate.solvers.steps import damped_step, newton_decrement

#: Most exact expansions of one fit, and steps with each.
_MOST, _STEPS = 8, 6
#: Damping of the trials of a step relative to the information: as many at once as most machines have cores, at least.
_DAMPINGS = ((1e-5, 1e-2), (0.1, 1.0))
#: Damping of the steps that may leave a ridge, and how many steps lead back onto it.
_LONGER, _BACK = (1e-5, 1e-3, 1e-2, 0.1), 3
#: Where exact derivatives promise fewer nats than this, and steps with them took what they promised, the fit ends: on a
#: vehicle the likelihood has jumps of some tenths of a nat, so that further derivatives promise one for ever.
_LAST = 4.0
#: So many nats may then be left of that promise, which is what those jumps are worth, or this share of it was gained:
#: further derivatives were worth a tenth of a nat then.
ENOUGH, _KEPT = 0.5, 0.4
#: Along a ridge, where a step promises more than :data:`_LAST`, one that gains this little may still lead on.
_LEAST = 0.1


def polished(problem: EstimationProblem, found: Reached, tolerance: float) -> Reached:
    """Where a search went on to by exact derivatives; as it was where there are none.

    Parameters
    ----------
    problem
        The problem that was searched.
    found
        Where the search by the linearised filter ended.
    tolerance
        How many nats a further step with the same derivatives must promise, and gain.
    """
    reached = found
    for _ in range(_MOST):
        seen = reached.expansion.terms  # however its derivatives were formed, its terms are the filter's
        expansion = exact_expansion(problem, reached.point, seen and seen.members(np.array([0])))
        if expansion is None:
            return reached
        before = replace(
            reached, expansion=expansion, evaluations=reached.evaluations + expansion.evaluations,
            formed=Formed(Scheme.EXACT, reached.point),
        )  # fmt: skip
        promise = newton_decrement(problem, before.point, expansion)
        reached = newton_steps(problem, before, tolerance if promise < _LAST else max(tolerance, ENOUGH))
        gained = before.nll - reached.nll
        near = promise < _LAST
        left = newton_decrement(problem, reached.point, reached.expansion)
        if not near and gained < ENOUGH:
            reached = min(reached, _along_ridge(problem, before), key=lambda one: one.nll)
        if arrived(promise, gained, left) or before.nll - reached.nll < (ENOUGH if near else _LEAST):
            return replace(reached, outcome=SearchOutcome.CONVERGED)
    return replace(reached, outcome=SearchOutcome.ITERATION_LIMIT)


def arrived(promise: float, gained: float, left: float) -> bool:
    """True where steps with the same derivatives led to an optimum as far as the filter of a stiff model can tell.

    They promised, gained and leave so many nats.

    Examples
    --------
    >>> arrived(0.6, 0.5, 0.7), arrived(20.0, 19.9, 0.1)
    (True, False)
    """
    return promise < _LAST and (left < ENOUGH or gained > _KEPT * promise)


def newton_steps(
    problem: EstimationProblem, found: Reached, tolerance: float, known: Expansion | None = None
) -> Reached:
    """Where steps with the derivatives of ``found`` (or those ``known`` of a filter close by) lead, while they gain.

    After the first, one that promises no more than jumps may be is tried at two dampings, and not at all of them.
    """
    reached, known = found, known or found.expansion
    for count in range(_STEPS):
        promise = newton_decrement(problem, reached.point, reached.expansion)
        if promise < tolerance:
            break
        every = count == 0 or promise >= _LAST
        before, reached = reached, _step(problem, reached, known, _DAMPINGS if every else _DAMPINGS[:1])
        if before.nll - reached.nll < tolerance:
            break
    return reached


def _step(
    problem: EstimationProblem, found: Reached, known: Expansion, dampings: Sequence[tuple[float, float]]
) -> Reached:
    """One step, the better one of two dampings, which two threads try at once; more of them until one gains.

    It stays where it is if no trial gains.
    """
    longest, evaluations, here = longest_steps(problem), found.evaluations, found.expansion
    for pair in dampings:
        steps = [damped_step(problem, found.point, here, damping) - found.point for damping in pair]
        points = [np.clip(found.point + np.clip(s, -longest, longest), problem.lower, problem.upper) for s in steps]
        seen, evaluations = problem.terms(np.array(points).T), evaluations + len(pair)
        best = int(np.argmin(seen.sums()))
        gained = here.sum - float(seen.sums()[best])
        if gained > 0.0:
            terms = seen.members(np.array([best]))
            return replace(
                found, point=points[best], nll=found.nll - gained, expansion=known.around(terms),
                evaluations=evaluations,
            )  # fmt: skip
    return replace(found, evaluations=evaluations)


def _along_ridge(problem: EstimationProblem, found: Reached) -> Reached:
    """The best point on the ways of several steps, each followed by some with the same derivatives."""
    longest, known, best = longest_steps(problem), found.expansion, found
    ways = [(found.point, known, damping) for damping in _LONGER]
    evaluations = found.evaluations
    for _ in range(1 + _BACK):
        steps = [damped_step(problem, point, expansion, damping) - point for point, expansion, damping in ways]
        points = [
            np.clip(point + np.clip(step, -longest, longest), problem.lower, problem.upper)
            for (point, _, _), step in zip(ways, steps, strict=True)
        ]
        seen, evaluations = problem.terms(np.array(points).T), evaluations + len(ways)
        sums, reached = seen.sums(), []
        for k in map(int, np.flatnonzero(np.isfinite(sums))):
            carried = known.around(seen.members(np.array([k])))
            reached.append((points[k], carried, ways[k][2]))
            nll = found.nll - (known.sum - float(sums[k]))
            if nll < best.nll:
                best = replace(best, point=points[k], nll=nll, expansion=carried)
        if not reached:
            break
        ways = reached
    return replace(best, evaluations=evaluations)
