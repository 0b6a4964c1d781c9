"""How the derivatives of a fit were formed, so that they can be formed again, in every bit, without its search.

A search takes several steps with the same derivatives, so that those of its end were often formed at another point.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.differences import forward_differences
from bondgraph.estimate.derivatives.exact import exact_expansion
from bondgraph.estimate.derivatives.linearised import filter_runs, kicks_along, linear_expansion
from bondgraph.estimate.longer_steps import doubled
from bondgraph.estimate.objective import Expansion, FloatArray
from bondgraph.estimate.problem import EstimationProblem


class Scheme(enum.Enum):
    """A way to form derivatives."""

    DIFFERENCES = "one-sided differences"
    EXACT = "exact derivatives"
    LINEARISED = "the filter linearised along itself"


@dataclass(frozen=True)
class Formed:
    """A scheme with an array (n,): its difference steps, the point of exact ones, or the point of the states' kicks.

    ``near`` (n,) is where they were formed with steps of the filter doubled ``doublings`` times; None: where they are
    used, or as the scheme says.
    """

    scheme: Scheme
    at: FloatArray
    near: FloatArray | None = None
    doublings: int = 0


def formed_again(problem: EstimationProblem, point: FloatArray, formed: Formed) -> Expansion:
    """The expansion at a point (n,) of a problem with derivatives as they were formed.

    Raises
    ------
    EstimationError
        If the problem has no exact derivatives any more, as where numba is gone.
    FilterError
        If the filter diverges.
    """
    if formed.near is not None:
        longer = doubled(problem, formed.doublings)
        known = formed_again(longer, formed.near, replace(formed, near=None, doublings=0))
        return known.around(problem.terms(point[:, np.newaxis]))
    if formed.scheme is Scheme.DIFFERENCES:
        return forward_differences(problem, point[:, np.newaxis], formed.at[:, np.newaxis])[0]
    here = np.array_equal(formed.at, point)
    if formed.scheme is Scheme.LINEARISED:
        runs = filter_runs(problem, point)
        return linear_expansion(
            problem, point, runs, kicks_along(problem, formed.at, runs if here else filter_runs(problem, formed.at))
        )
    expansion = exact_expansion(problem, formed.at)
    if expansion is None:
        raise EstimationError(
            f"{problem.name}: a fit that was kept has no exact derivatives on this machine - delete it to start anew",
            where=(problem.name,),
        )
    return expansion if here else expansion.around(problem.terms(point[:, np.newaxis]))
