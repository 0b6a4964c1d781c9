"""Fitting a model to logs on the way of a correction: the optimum with everything that tests and reports need of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from bondgraph.data.log import FloatArray
from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.formed import Formed, Scheme, formed_again
from bondgraph.estimate.derivatives.linearised import is_linearised
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.journal import Journal, Noted, fit_key
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.searches import ROUGH, WITHIN_REACH, Wish, carried_on, search
from bondgraph.estimate.solvers.linearised import Reached
from bondgraph.estimate.widening import MOST_WIDENINGS, widened
from bondgraph.filter.filter_model import FilterModel

#: Most iterations of a fit with other steps, and what a further one must promise: one that is worth 0.005 nats lies a
#: tenth of a standard deviation off by that alone.
_AGAIN, _FINISHED = 20, 1e-3

Report = Callable[[str, int, int], None]


def no_report(stage: str, done: int, total: int) -> None:
    """Report nothing."""


def fit(
    problem: EstimationProblem,
    iterations: int = 40,
    tolerance: float = 1e-3,
    starts: Sequence[FloatArray] = (),
    beat: float = np.inf,
    journal: Journal | None = None,
    first: FloatArray | None = None,
    reach: float = WITHIN_REACH,
    same: float = ROUGH,
) -> Fit:
    """Estimate the free parameters by Gauss-Newton, until a step promises less than ``tolerance`` or two gain less.

    Bounds that only scale a search (:attr:`FreeParameter.widens`) are widened, and the search continued, as long as it
    ends on one: a scale that was taken from a model without the effect may be far too small.

    Parameters
    ----------
    problem
        What is fitted to which logs, and what may move.
    iterations, tolerance
        Most iterations, and how many nats a further one must be worth.
    starts
        Coordinates to start from, each (n,); the best of them counts. None: the starts of the free parameters.
    beat
        A negative log-likelihood to be reached: the search ends early where it clearly will not be.
    journal
        Finished fits, from which this one is taken if it is there, and where it is noted if not.
    first
        Where a rough search begins (n,) whatever its value, of a stiff model on the beginnings of long logs; ``starts``
        are searched from only if one of them is better than where that ended.
    reach
        The search of a stiff model is finished by exact derivatives only if it ends behind ``beat`` by less than this
        (ahead of it by more, if negative), and by less than it gained or a further step promises: what hardly moved
        left little.
    same
        Nats by which longer integration steps, that lead to the optimum, may tell innovations otherwise.

    Raises
    ------
    EstimationError
        If the model diverges at every start.
    """
    return _widened(problem, Wish(iterations, tolerance, starts, beat, first, reach, same=same), journal)


def refitted(fitted: Fit, filter_model: FilterModel, journal: Journal | None = None) -> Fit:
    """The fit with a filter close to its own (shorter steps), from where it is.

    It is found with the derivatives that the fit has, which a filter close by shares: formed anew they cost ten values
    of the likelihood each. Where these do not lead to an optimum the whole search is done.

    Raises
    ------
    EstimationError
        If the model diverges there.
    """
    free = at_optimum(fitted)
    problem = replace(fitted.problem, filter_model=filter_model, free=free)
    journal = journal or Journal()
    key = fit_key(problem, ["by known derivatives", fitted.point])
    noted = journal.find(key)
    if noted is not None:
        around = fitted.expansion.around(problem.terms(noted.point[:, np.newaxis]))
        return Fit(problem, noted.point, noted.nll, around, noted.evaluations, SearchOutcome[noted.outcome])
    formed = Formed(Scheme.EXACT, fitted.point)  # not asked for: what is noted here takes the derivatives of the fit
    known = Reached(fitted.point, fitted.nll, fitted.expansion, 0, SearchOutcome.CONVERGED, formed)
    carried = carried_on(problem, known, _FINISHED)
    if carried is None or not carried[1]:  # longer steps were tried before: these are to lead further than others did
        starts = [] if carried is None else [carried[0].point]
        return _widened(problem, Wish(_AGAIN, _FINISHED, starts, longer=False), journal)
    found = carried[0]
    journal.note(key, Noted(found.point, found.formed, found.nll, found.evaluations, found.outcome.name))
    return _fit_of(problem, found)


def _widened(problem: EstimationProblem, wish: Wish, journal: Journal | None) -> Fit:
    """The end of searches in bounds that are widened as long as one ends on them."""
    found = _noted(problem, journal, wish)
    for _ in range(MOST_WIDENINGS):
        wider = widened(found.problem, found.point, found.held)
        if wider is None:
            break
        try:
            found = _noted(replace(problem, free=wider), journal, replace(wish, starts=(), first=None))
        except EstimationError:  # nothing is beyond the bound
            break
    return found


def left_open(problem: EstimationProblem) -> float:
    """Nats that a rough search may leave: by the linearised filter of a stiff model far more than by differences."""
    return WITHIN_REACH if is_linearised(problem) else ROUGH


def _noted(problem: EstimationProblem, journal: Journal | None, wish: Wish) -> Fit:
    """One search inside its bounds, taken from the journal if it is there and noted in it if not."""
    if journal is None:
        return _fit_of(problem, search(problem, wish))
    key = fit_key(problem, wish.content)
    known = journal.find(key)
    if known is not None:
        expansion = formed_again(problem, known.point, known.formed)
        return Fit(problem, known.point, known.nll, expansion, known.evaluations, SearchOutcome[known.outcome])
    found: Reached = journal.computed(search, problem, wish)
    journal.note(key, Noted(found.point, found.formed, found.nll, found.evaluations, found.outcome.name))
    return _fit_of(problem, found)


def _fit_of(problem: EstimationProblem, found: Reached) -> Fit:
    return Fit(problem, found.point, found.nll, found.expansion, found.evaluations, found.outcome)
