"""Declared elements that a law takes the place of: their parameters leave the bounds that keep them there.

What is missing is often another law for an element that is declared: an orifice for the laminar flow through a cake of
coffee. Laws are added, so that the declared element stays beside the new one, and ends on the bound at which it does
least. As long as that bound holds it does something, and the law must bend around it: of the cake the orifice was 6 %
off at its largest pressure, and a function without a law was told beside it. Where a law makes a parameter of an
element at its own place rest on a bound the bound is moved so far out that the element has hardly any part left, and
it stays there if the logs are likelier.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from bondgraph.correct.constants import INDIFFERENT
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.models.shaping_filters import DISTURBANCE
from bondgraph.declare.effect import Place
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit

#: Factor by which a bound is moved: the element then does a hundredth of what it did on the bound. A convention.
_GONE = 100.0
_ITERATIONS, _TOLERANCE = 25, 0.05
#: Elements that a law may take the place of: a storage is none, since what it holds is there beside any law.
_REPLACED, _JUNCTIONS = ("R", "Se", "Sf"), ("0", "1")


def in_place_of_elements(fitted: Fit, law: Candidate, base: Fit, graph: BondGraph, journal: Journal) -> Fit:
    """The fit with a law, without the bounds of elements at its place if the logs are clearly likelier then.

    Parameters
    ----------
    fitted, law
        The fit, and the law that ``base`` does not have.
    base
        The fit without it. Parameters that rest on their bounds there stay as they are, see :mod:`.bounds`; what lies
        beyond a bound at zero is another thing. Of stiff models all bounds stay: their fits are costly.
    graph
        The graph without the law.
    journal
        Finished fits.
    """
    effect, stiff = law.effect, fitted.problem.filter_model.is_stiff
    if stiff or effect.channel or effect.kind == DISTURBANCE or not fitted.outcome.succeeded:
        return fitted
    rest = _resting(fitted) - _resting(base)
    further = _further(fitted, rest & parameters_beside(law.place, graph)) if rest else {}
    if not further:
        return fitted
    free = tuple(further.get(one.name, one) for one in at_optimum(fitted))
    found = fit(replace(fitted.problem, free=free), _ITERATIONS, _TOLERANCE, journal=journal)
    return found if found.nll < fitted.nll - INDIFFERENT else fitted


def beyond_declared(nominal: Fit, corrected: Fit) -> list[str]:
    """Names of the parameters that have left the bounds within which the declared model was fitted."""
    known = {one.name: one for one in nominal.problem.free if one.target.kind == "parameter"}
    values = corrected.values
    return [
        one.name
        for one in corrected.problem.free
        if one.name in known and not known[one.name].lower <= values[one.name] <= known[one.name].upper
    ]


def parameters_beside(place: Place, graph: BondGraph) -> frozenset[str]:
    """Names of the parameters of resistances and sources at a place, and at junctions that share a bond with it."""
    flat = graph.flatten()
    near = {place.junction.name} | ({place.other.name} if place.other is not None else set())
    ends = [(bond.source, bond.target) for bond in flat.bonds]
    pairs = [*ends, *((second, first) for first, second in ends)]
    junctions = near | {
        second for first, second in pairs if first in near and flat.nodes[second].kind in _JUNCTIONS
    }  # fmt: skip
    elements = {second for first, second in pairs if first in junctions and flat.nodes[second].kind in _REPLACED}
    used = {one.name for name in elements for _, law in flat.nodes[name].laws for one in law.free_symbols}
    return frozenset(used & {one.name for one in flat.parameters})


def _resting(fitted: Fit) -> set[str]:
    return {str(name) for name in np.array(fitted.problem.names)[fitted.held]}


def _further(fitted: Fit, names: Collection[str]) -> dict[str, FreeParameter]:
    """Parameters that rest on bounds, from where they are, with these bounds moved, by name; none at zero."""
    found = {}
    for one in at_optimum(fitted):
        at_upper = one.upper - one.start < one.start - one.lower
        end = one.upper if at_upper else one.lower
        if one.name in names and end != 0.0:
            moved = end * _GONE if (end > 0.0) == at_upper else end / _GONE
            found[one.name] = replace(one, upper=moved) if at_upper else replace(one, lower=moved)
    return found
