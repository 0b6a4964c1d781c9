"""Storages that lose energy themselves: a capacitor's own resistance, the iron of a coil, the inside of a body.

A capacitor has leads and an electrolyte, an accumulator a neck, a body an inside that heat has to reach; the iron of a
coil carries eddy currents beside its flux. Reference: Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 4;
Krause, Wasynczuk, Sudhoff, Pekarek (2013), Analysis of Electric Machinery and Drive Systems, for losses in iron.
"""

from __future__ import annotations

from bondgraph.declare.domains import ELECTRICAL
from bondgraph.declare.editing import split_bond
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.elements import Bond, Node
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.places import (
    Words,
    coefficient,
    conductance,
    effort_unit,
    elements_at,
    flow_unit,
    has_effort,
    has_flow,
    over,
)

_STORAGES = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 4"
_MACHINERY = "Krause, Wasynczuk, Sudhoff, Pekarek (2013), Analysis of Electric Machinery and Drive Systems"
#: Names of the resistance on the way into a storage.
_WAY_IN = Words("spring_damping", "equivalent_series_resistance", "neck_resistance", "inner_resistance")


def storage_resistance(g: BondGraph, at: Place) -> Effect | None:
    """A resistance on the way into a storage: leads of a capacitor, neck of an accumulator, inside of a body."""
    word = _WAY_IN.at(at)
    way = _way_to(g, at, "C") if has_effort(at) and word else None
    if way is None:
        return None
    unit = over(effort_unit(at), flow_unit(at))
    name, c = coefficient(g, at, word, word.replace("_", " "), unit, power=1)
    inside = split_bond(g, way, Node(f"way_{name}", "1", at.domain))
    g.effort_source(name, -c * inside.flow, at=inside)  # no resistance: it is never asked for its flow, which is 1/c
    return Effect(
        word, name, "effort = stored + c*flow", (c.name,), reference=_STORAGES, dissipative=True,
        manoeuvre="quick changes of what flows into the storage",
    )  # fmt: skip


def core_loss(g: BondGraph, at: Place) -> Effect | None:
    """Current beside the flux of a coil, in proportion to its voltage: eddy currents and hysteresis of its iron."""
    way = _way_to(g, at, "I") if has_flow(at) and at.domain == ELECTRICAL else None
    if way is None:
        return None
    name, c = conductance(g, at, "core_loss", "conductance of the iron", over(flow_unit(at), effort_unit(at)), 1)
    inside = split_bond(g, way, Node(f"way_{name}", "0", at.domain))
    g.flow_source(name, -c * inside.effort, at=inside)
    return Effect(
        "core_loss", name, "flow = that of the coil + c*effort", (c.name,), reference=_MACHINERY, dissipative=True,
        manoeuvre="quick and slow changes of the voltage",
    )  # fmt: skip


def _way_to(g: BondGraph, at: Place, kind: str) -> Bond | None:
    """The bond to the only storage of a kind at a junction."""
    found = elements_at(g, at, kind)
    if len(found) != 1 or "." in found[0].name:
        return None
    ends = {at.junction.name, found[0].name}
    return next((bond for bond in g.bonds if {bond.source, bond.target} == ends), None)
