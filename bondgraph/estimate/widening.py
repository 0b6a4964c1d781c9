"""Bounds that only scale a search, and go further out where it ends on one.

The scale of an effect is taken from a model that may lack almost all of it: of a buggy that coasts down the viscous
loss was bound by 0.08 where 1.22 was true.
"""

from __future__ import annotations

from dataclasses import replace

from bondgraph.data.log import FloatArray
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.objective import BoolArray
from bondgraph.estimate.problem import EstimationProblem

#: A bound goes this much further out each time that a search ends on it, so often at most: a scale may miss much, but
#: no twelve orders of magnitude.
_WIDENING, MOST_WIDENINGS = 10.0, 12


def widened(problem: EstimationProblem, point: FloatArray, held: BoolArray) -> tuple[FreeParameter, ...] | None:
    """The free parameters from where a search ended, those on bounds that only scale it with wider ones.

    None where there is no such bound, or nothing beyond it. ``held`` (n,) says which coordinates of the ``point`` (n,)
    rest on a bound.
    """
    ended = [
        replace(one, start=min(max(float(value), one.lower), one.upper))
        for one, value in zip(problem.free, problem.values(point), strict=True)
    ]
    due = [bool(rests) and _may_widen(one) for rests, one in zip(held, ended, strict=True)]
    wider = tuple(one.wider(_WIDENING) if rests else one for rests, one in zip(due, ended, strict=True))
    return wider if any(due) else None


def _may_widen(one: FreeParameter) -> bool:
    """Whether there is something beyond the bound at which a parameter starts: not where that is zero, or near it."""
    at_upper = one.upper - one.start < one.start - one.lower
    return one.widens and (one.upper > 0.0 if at_upper else one.lower < 0.0)
