"""The superset: the declared graph with all vanishing candidates in it, one model by which all are scored."""

from __future__ import annotations

from collections.abc import Sequence

from bondgraph.build import BuiltModel, build
from bondgraph.correct.models.candidates import Candidate
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import BondGraphError


def superset(built: BuiltModel, vanishing: Sequence[Candidate]) -> BuiltModel:
    """The declared graph with vanishing candidates in it, their coefficients zero: one model to test them all.

    Those that revise a declared element come first: it stands alone then, as it did when they were offered. One that
    fits nowhere among the others is left out.
    """
    declared = built.causal.graph.nodes
    graph = built.graph
    order: list[Candidate] = []
    for candidate in sorted(vanishing, key=lambda one: one.effect.element not in declared):
        for place in range(len(order), -1, -1):  # last, else before those that take its place
            wider = _all_applied(built.graph, [*order[:place], candidate, *order[place:]])
            if wider is not None:
                order.insert(place, candidate)
                graph = wider
                break
    return build(graph)


def _all_applied(graph: BondGraph, found: Sequence[Candidate]) -> BondGraph | None:
    """The graph with candidates added one after the other, None where one does not fit."""
    try:
        for candidate in found:
            graph = candidate.apply(graph)
    except BondGraphError:
        return None
    return graph
