"""A second exploration, where gradient searches from several starts do not agree on one optimum.

A short exploration finds the right valleys of most likelihoods, and gradient searches from its best points and from the
declared start then meet at one optimum. Where they do not, the likelihood has several valleys or does not follow its
gradient. Then L-SHADE looks for the deepest, as thoroughly as evaluations are cheap, and a gradient search ends there.
Several starts as a test for one optimum: Boender and Rinnooy Kan (1987), Bayesian stopping rules for multistart global
optimization methods, Mathematical Programming 37.
"""

from __future__ import annotations

from bondgraph.estimate.derivatives.exact import filtering_work
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.solvers.differential_evolution import Shade
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonState

#: Work of a second exploration, in integration steps times sigma points: four seconds of one core.
_CHEAP = 2e7
#: Evaluations of all searches for each coordinate: nine tenths of those over which searches are compared
#: (``python -m tests.benchmarks --only optimisers``), so that a tenth is left to the last gradient search.
_PER_COORDINATE = 1800
#: An exploration with fewer evaluations for each coordinate finds no deeper valley: a fifth of all. A convention.
_LEAST = 360
#: Evaluations for each of the first members, as where searches are compared, and the least members.
_STEPS, _MEMBERS = 200, 16
#: Nats to which all members agree at the end: what rounding leaves of a likelihood.
_SPREAD = 1e-12


def agree(state: GaussNewtonState) -> bool:
    """True where several gradient searches met at one optimum; a single one has nothing to disagree with.

    Examples
    --------
    >>> import numpy as np
    >>> from bondgraph.estimate.objective import Terms
    >>> from bondgraph.estimate.solvers.gauss_newton import gauss_newton
    >>> class Two:
    ...     lower, upper = np.full(1, -3.0), np.full(1, 3.0)
    ...     def terms(self, points):
    ...         return Terms(points**2 - 1.0, np.zeros(points.shape))
    ...     def nll(self, points):
    ...         return self.terms(points).sums()
    >>> agree(gauss_newton(Two(), np.array([[0.5]]))), agree(gauss_newton(Two(), np.array([[0.5, -0.5]])))
    (True, False)
    """
    others = [outcome for k, outcome in enumerate(state.outcomes) if k != state.best]
    met = all(outcome is SearchOutcome.JOINED for outcome in others)
    best = state.outcomes[state.best]
    return not others or (met and best is not None and best.succeeded)


def deeper_search(problem: Problem, state: GaussNewtonState, spent: int, seed: int) -> Shade | None:
    """The second exploration after gradient searches, None where they agree or few evaluations can be afforded.

    ``spent`` counts the evaluations so far.
    """
    if agree(state):
        return None
    size = len(problem.free)
    evaluations = min(_PER_COORDINATE * size - spent, int(_CHEAP / filtering_work(problem)))
    if evaluations < _LEAST * size:
        return None
    members = max(evaluations // _STEPS, _MEMBERS)
    return Shade(evaluations, members, tolerance=0.0, spread=_SPREAD, seed=seed)
