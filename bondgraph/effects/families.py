"""Families of laws: one for each of several elements that lie at a place."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from bondgraph.declare.effect import Effect, EffectFunction, Members, Place
from bondgraph.declare.elements import Node
from bondgraph.declare.graph import BondGraph


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
        names = [one.name for one in flat.nodes.values() if one.is_junction]
        most = max((len(_resistances(flat, one)) for one in names), default=0)
        return [member(k) for k in range(max(most, 1))]

    def member(which: int) -> EffectFunction:
        def declared(g: BondGraph, at: Place) -> Effect | None:
            return law(g, at, which)

        declared.__name__ = f"{name}_{which + 1}" if which else name
        return declared

    return members


def _resistances(flat: BondGraph, junction: str) -> list[Node]:
    bonds = [(flat.bonds[index], inward) for index, inward in flat.incidence()[junction]]
    found = [flat.nodes[bond.source if inward else bond.target] for bond, inward in bonds]
    return [one for one in found if one.kind == "R" and one.ports == 1]
