"""Families of laws: one for each of several elements that lie at a place."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Effect, EffectFunction, Members, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.places import elements_at


def each_resistance(name: str, law: Callable[[BondGraph, Place, int], Effect | None]) -> Members:
    """The members of a family of laws for a resistance: for the first at a place, the second, and so on.

    Parameters
    ----------
    name
        Name of the effect function; the others add their number.
    law
        The effect of the k-th resistance at a place, None where there is none.
    """

    def members(g: BondGraph, typical: Mapping[str, float]) -> list[EffectFunction]:
        flat = g.flatten()
        places = [Place(handle(flat, one.name), Scale(0.0, 0.0)) for one in flat.nodes.values() if one.is_junction]
        most = max((len(elements_at(flat, at, "R")) for at in places), default=0)
        return [member(k) for k in range(max(most, 1))]

    def member(which: int) -> EffectFunction:
        def declared(g: BondGraph, at: Place) -> Effect | None:
            return law(g, at, which)

        declared.__name__ = f"{name}_{which + 1}" if which else name
        return declared

    return members
