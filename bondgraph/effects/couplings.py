"""Storages between two junctions, or between one and what stands still: coils that share a flux, springs, capacitors.

Two coils on one core, or beside each other, share a part of their flux: what one current builds up drives the other.
Two bodies may be joined by a spring that nobody declared, a body with the frame that it moves in, and two nodes of a
circuit by the capacitance between their wires. Reference: Karnopp, Margolis, Rosenberg (2012), System Dynamics,
chapters 4 and 7, the latter for fields of inertances.
"""

from __future__ import annotations

from math import sqrt

from bondgraph.declare.domains import ELECTRICAL
from bondgraph.declare.effect import Effect, Place, between_junctions
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.between import path
from bondgraph.effects.places import Words, effort_unit, elements_at, is_motion, over, position_at
from bondgraph.effects.storages import capacity_beside, inertance_beside

_FIELDS = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 7"
_STORAGES = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 4"
#: Springs between bodies, whose flow is a motion.
_SPRING = Words("spring_between")


def return_spring(g: BondGraph, at: Place) -> Effect | None:
    """A spring to the frame at a part that was declared as free: a return spring, a bellows, a cable that holds it.

    It is at rest where the position that the graph declares is zero, or else where the logs begin.
    """
    if not is_motion(at) or at.domain is None or elements_at(g, at, "C"):
        return None
    name = f"return_spring_{at.name}"
    known, way = position_at(g, at), at.domain.displacement_unit
    unit = over(effort_unit(at), way)
    c = g.parameter(f"c_{name}", 0.0, unit, f"stiffness towards the frame at {at.label}", (0.0, _stiffest(at)))
    position = g.integral(f"q_{name}", at.junction.flow, way, "way since the log began") if known is None else known[0]
    g.effort_source(name, -c * position, at=at.junction)
    law = "effort = c*q, dq/dt = flow" if known is None else "effort = c*position"
    return Effect(
        "return_spring", name, law, (c.name,), reference=_STORAGES,
        manoeuvre="a constant load, held until all is at rest",
    )  # fmt: skip


@between_junctions
def spring_between(g: BondGraph, at: Place) -> Effect | None:
    """A spring between two bodies that are declared as free of each other, or as joined by a damper alone."""
    word = _SPRING.at(at)
    if at.junction.kind != "1" or not word or at.domain is None or at.other is None:
        return None
    name = f"{word}_{at.name}"
    way = at.domain.displacement_unit
    unit = over(effort_unit(at), way)
    c = g.parameter(f"c_{name}", 0.0, unit, f"stiffness between {at.label}", (0.0, _stiffest(at)))
    between = path(g, at, name)
    apart = at.junction.flow - at.other.flow
    stretch = g.integral(f"q_{name}", apart, way, "stretch since the log began")
    g.effort_source(name, c * stretch, at=between)
    return Effect(
        word, name, "effort = c*q, dq/dt = first flow - second flow", (c.name,), reference=_STORAGES,
        manoeuvre="a blow to one of the two bodies",
    )  # fmt: skip


@between_junctions
def mutual_inductance(g: BondGraph, at: Place) -> Effect | None:
    """A flux that two coils share: windings on one core, two axes of a machine, wires beside each other.

    Three inertances make it: one of the sum of both currents, and one of each current that takes away its own part.
    """
    own = [inertance_beside(g, one) for one in (at.junction, at.other) if one is not None]
    first, second = own if len(own) == 2 else (None, None)
    if at.junction.kind != "1" or at.domain != ELECTRICAL or first is None or second is None:
        return None
    assert at.other is not None  # there are two
    name = f"mutual_inductance_{at.name}"
    most = sqrt(first[0] * second[0])
    m = g.parameter(f"M_{name}", 0.0, first[1], f"inductance that {at.label} share", (-most, most))
    both = g.zero_junction(f"sum_{name}", ELECTRICAL)
    for junction in (at.junction, at.other):
        g.bond(junction, both)
    g.inertance(name, m, at=both)
    for junction in (at.junction, at.other):
        g.inertance(f"own_{name}_{junction.name.replace('.', '_')}", -m, at=junction)
    return Effect(
        "mutual_inductance", name, "effort = c*d(other flow)/dt, at both", (m.name,), reference=_FIELDS,
        manoeuvre="steps of each voltage while the other is constant",
    )  # fmt: skip


@between_junctions
def capacitance_between(g: BondGraph, at: Place) -> Effect | None:
    """Capacitance between two nodes of a circuit: of wires, of a winding, of the gate of a transistor."""
    own = [capacity_beside(g, Place(one, at.scale)) for one in (at.junction, at.other) if one is not None]
    sizes = [one for one in own if one is not None]
    if at.junction.kind != "0" or at.domain != ELECTRICAL or not sizes:
        return None
    name = f"capacitance_between_{at.name}"
    size, unit = max(sizes)
    c = g.parameter(f"c_{name}", 0.0, unit, f"capacitance between {at.label}", (0.0, size))
    g.compliance(name, displacement=lambda effort: c * effort, at=path(g, at, name))
    return Effect(
        "capacitance_between", name, "flow = c*d(first effort - second effort)/dt", (c.name,), reference=_STORAGES,
        manoeuvre="quick changes of one voltage",
    )  # fmt: skip


def _stiffest(at: Place) -> float:
    """The stiffness that the search begins to scale by: it takes the largest effort over the way of a middling time."""
    shortest, longest = at.times
    return at.scale.effort / (at.scale.flow * sqrt(shortest * longest))
