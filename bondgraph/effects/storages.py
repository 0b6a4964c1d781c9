"""Storages that were not declared, and play: inertia, elasticity, backlash.

References: Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 4; Nordin, Gutman (2002), Automatica 38(10),
for backlash as a dead zone of an elastic shaft.
"""

from __future__ import annotations

from bondgraph.declare.domains import CHEMICAL, THERMAL
from bondgraph.declare.editing import split_bond
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.elements import Node
from bondgraph.declare.functions import clip
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_law
from bondgraph.derive.laws import linear_coefficient
from bondgraph.effects.places import effort_unit, elements_at, flow_unit, is_speed, over

_STORAGES = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 4"
#: Time in which the effort of a place brings an inertia to its flow that is as large as it may be [s].
LONGEST_RUN_UP = 2.0


def added_inertia(g: BondGraph, at: Place) -> Effect | None:
    """Inertia that was not counted: payload, a flywheel, adhering oil; a storage that follows the flow."""
    declared = _inertance_beside(g, at.junction) if is_speed(at) else None
    if declared is None:
        return None
    name = f"added_inertia_{at.name}"
    size, unit = declared
    inertia = g.parameter(f"inertia_{name}", 0.0, unit, f"inertia added to {at.label}", (0.0, size))
    g.inertance(name, inertia, at=at.junction)
    return Effect(
        "added_inertia", name, "effort = c*d(flow)/dt", (f"inertia_{name}",), reference=_STORAGES
    )  # fmt: skip


def added_compliance(g: BondGraph, at: Place) -> Effect | None:
    """An elastic part in a connection declared as rigid: a spring with damping on a bond between two speeds.

    How much damping nobody knows of a part that was forgotten; a wrong one would show as a loss in the part itself.
    """
    if at.bond is None or not _joins_speeds(g, at):
        return None
    name = f"added_compliance_{at.name}"
    domain = at.domain
    unit = "" if domain is None else f"{domain.displacement_unit}/({domain.effort_unit})"
    softest = 0.5 * at.scale.flow / at.scale.effort
    bounds = (1e-4 * softest, softest)
    compliance = g.parameter(f"compliance_{name}", 1e-2 * softest, unit, f"compliance of {at.label}", bounds)
    matched = at.scale.effort / at.scale.flow
    damping = g.parameter(
        f"damping_{name}", 0.05 * matched, over(effort_unit(at), flow_unit(at)), "damping beside that compliance",
        (1e-3 * matched, matched),
    )  # fmt: skip
    junction = split_bond(g, at.bond, Node(f"z_{name}", "0", domain))
    stretch = g.one_junction(f"stretch_{name}", domain)
    g.bond(junction, stretch)
    g.compliance(name, 1 / compliance, at=stretch)
    g.resistance(f"damper_{name}", damping, at=stretch)
    return Effect(
        "added_compliance", name, "effort = displacement/c + d*flow", (f"compliance_{name}",), adds_state=True,
        shapes=(damping.name,), reference=_STORAGES,
    )  # fmt: skip


def backlash(g: BondGraph, at: Place) -> Effect | None:
    """Play in front of a declared spring: it carries nothing until the gap is taken up."""
    if not is_speed(at):
        return None
    springs = [node for node in elements_at(g, at, "C") if [given for given, _ in node.laws] == ["effort"]]
    if len(springs) != 1:
        return None
    spring, stretch = springs[0], symbol("displacement")
    values = {parameter.symbol: parameter.value for parameter in g.flatten().parameters}
    stiffness = linear_coefficient(spring.law("effort"), stretch)
    if stiffness is None or not stiffness.free_symbols <= set(values):
        return None
    name = f"backlash_{at.name}"
    limit = 2.0 * at.scale.effort / abs(float(stiffness.subs(values)))
    unit = "" if at.domain is None else at.domain.displacement_unit
    gap = g.parameter(f"gap_{name}", 0.0, unit, f"half of the play at {at.label}", (0.0, limit))
    revise_law(g, spring.name, "effort", lambda old: old.xreplace({stretch: stretch - clip(stretch, -gap, gap)}))
    return Effect(
        "backlash", spring.name, "effort = k*(displacement - clip(displacement, -b, b))", (gap.name,),
        amplitudes=(0.03, 0.1, 0.3), reference="Nordin, Gutman (2002), Automatica 38(10)",
    )  # fmt: skip


def _joins_speeds(g: BondGraph, at: Place) -> bool:
    """Whether a bond rigidly joins two speeds, directly or through a transformer (then only its first bond counts)."""
    if at.bond is None or at.domain in (THERMAL, CHEMICAL):
        return False
    flat = g.flatten()
    first, second = (flat.nodes[end] for end in (at.bond.source, at.bond.target))
    if first.kind == "TF":
        before = next(bond.source for bond in flat.bonds if bond.target == first.name)
        return second.kind == "1" and flat.nodes[before].kind != "1"
    return first.kind == "1" and second.kind in ("1", "TF")


def _inertance_beside(g: BondGraph, junction: Handle) -> tuple[float, str] | None:
    """Size and unit of the linear inertance declared at a junction: the natural size of one that was forgotten."""
    flat = g.flatten()
    declared = {parameter.symbol: parameter for parameter in flat.parameters}
    values = {symbol: parameter.value for symbol, parameter in declared.items()}
    for index, _ in flat.incidence()[junction.name]:
        bond = flat.bonds[index]
        other = flat.nodes[bond.target if bond.source == junction.name else bond.source]
        law = other.law("flow") if other.kind == "I" and other.ports == 1 else None
        reciprocal = None if law is None else linear_coefficient(law, symbol("momentum"))
        if reciprocal is not None and reciprocal.free_symbols <= set(values) and reciprocal.subs(values).is_finite:
            used = [declared[name] for name in reciprocal.free_symbols]
            domain = junction.domain
            unit = "" if domain is None else f"{domain.momentum_unit}/({domain.flow_unit})"
            return 1.0 / float(reciprocal.subs(values)), used[0].unit if len(used) == 1 else unit
    return None


def uncounted_inertia(g: BondGraph, at: Place) -> Effect | None:
    """Inertia where none was declared: a crankshaft at a measured speed, a rotor taken as a mere source.

    ``added_inertia`` is for junctions that have one; here the efforts and flows of the place say how large it can be:
    an inertia that the effort would bring to the flow in ``LONGEST_RUN_UP``.
    """
    if not is_speed(at) or elements_at(g, at, "I"):
        return None
    name = f"uncounted_inertia_{at.name}"
    unit = "" if at.domain is None else f"{at.domain.momentum_unit}/({at.domain.flow_unit})"
    limit = LONGEST_RUN_UP * at.scale.effort / at.scale.flow
    inertia = g.parameter(f"inertia_{name}", 0.0, unit, f"inertia of what turns or moves at {at.label}", (0.0, limit))
    g.inertance(name, inertia, at=at.junction)
    law = "effort = c*d(flow)/dt"
    return Effect("uncounted_inertia", name, law, (inertia.name,), reference=_STORAGES)
