"""Storages of lines and nodes that were declared without any: a column of fluid, a winding, a hose, a metal part.

A pipe that is declared as a mere resistance has no time of its own: its flow follows the pressure at once. The fluid in
a long one takes time to start and to stop. Such a storage has no zero at which a score could test it: without it a
resistance answers for the flow. Its size is searched by the time in which the flow, or the effort, settles. Reference:
Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 4.
"""

from __future__ import annotations

from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.places import Words, elements_at, has_effort, has_flow, lateness, over

_STORAGES = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 4"
#: Names of laws in each domain.
_INERTIA = Words("", "line_inductance", "line_inertia")
_CAPACITY = Words("", "node_capacitance", "node_volume", "node_heat_capacity")


def line_inertia(g: BondGraph, at: Place) -> Effect | None:
    """Inertia of a line that was declared as a mere resistance: water in a pipe or culvert, inductance of a winding."""
    word = _INERTIA.at(at)
    if not (has_flow(at) and word and at.domain) or not elements_at(g, at, "R") or elements_at(g, at, "I"):
        return None
    name = f"{word}_{at.name}"
    unit = over(at.domain.momentum_unit, at.domain.flow_unit)
    start, bounds = _sizes(at, at.scale.effort / at.scale.flow)
    inertia = g.parameter(f"inertia_{name}", start, unit, f"{word.replace('_', ' ')} at {at.label}", bounds)
    g.inertance(name, inertia, at=at.junction)
    return Effect(
        word, name, "effort = c*d(flow)/dt", (inertia.name,), adds_state=True, reference=_STORAGES,
        manoeuvre="quick changes of the effort",
    )  # fmt: skip


def node_capacity(g: BondGraph, at: Place) -> Effect | None:
    """Capacity of a node that was declared as a mere joint: a hose that swells, a filter's canister, a metal part."""
    word = _CAPACITY.at(at)
    if not (has_effort(at) and word and at.domain) or elements_at(g, at, "C"):
        return None
    name = f"{word}_{at.name}"
    unit = over(at.domain.displacement_unit, at.domain.effort_unit)
    start, bounds = _sizes(at, at.scale.flow / at.scale.effort)
    capacity = g.parameter(f"capacity_{name}", start, unit, f"{word.replace('_', ' ')} at {at.label}", bounds)
    g.compliance(name, displacement=lambda effort: capacity * effort, at=at.junction)
    return Effect(
        word, name, "flow = c*d(effort)/dt", (capacity.name,), adds_state=True, reference=_STORAGES,
        manoeuvre="quick changes of the flow",
    )  # fmt: skip


def _sizes(at: Place, resistance: float) -> tuple[float, tuple[float, float]]:
    """Where the search for a storage begins, and its bounds, by the times that it takes beside a resistance.

    From half an interval between samples, by which held inputs are late, to the longest lag that is looked for.
    """
    _, (_, longest) = lateness(at)
    shortest = 0.5 * at.times[0]
    return resistance * (shortest * longest) ** 0.5, (resistance * shortest, resistance * longest)
