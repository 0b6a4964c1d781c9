"""Machines without states: a filter needs one, so a loop gives them one that stays at zero and acts on nothing."""

from __future__ import annotations

from bondgraph.declare.editing import copy
from bondgraph.declare.graph import BondGraph

#: The state that stays at zero.
RESTING = "rests_at_zero"


def with_resting_state(graph: BondGraph) -> BondGraph:
    """The graph with a state that stays at zero.

    Examples
    --------
    >>> g = BondGraph("divider")
    >>> [one.name for one in with_resting_state(g).integrals], without_resting_state(with_resting_state(g)) == g
    (['rests_at_zero'], True)
    """
    twin = copy(graph)
    twin.integral(RESTING, 0, "1", "nothing: a filter needs a state")
    return twin


def without_resting_state(graph: BondGraph) -> BondGraph:
    """The graph without that state; one that has none is returned itself."""
    if RESTING not in graph.quantities:
        return graph
    twin = copy(graph)
    del twin._quantities[RESTING]
    return twin
