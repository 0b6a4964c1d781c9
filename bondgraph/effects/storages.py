"""Storages that were not declared, and those whose law is not straight: inertia, elasticity, saturation.

References: Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 4; Duffing (1918), Erzwungene Schwingungen,
for springs that harden; Nayfeh, Mook (1979), Nonlinear Oscillations, chapter 4, for springs that soften; Trutt,
Erdelyi, Hopkins (1968), IEEE Trans. PAS 87(3), for the magnetisation of iron; Johnson (1985), Contact Mechanics,
chapter 4, for stops. Gas and vessels are in :mod:`bondgraph.effects.vessels`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from sympy import Abs, Expr, Rational, sign

from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, ROTATION, TRANSLATION
from bondgraph.declare.editing import split_bond
from bondgraph.declare.effect import SMOOTHING, Effect, Place
from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import signal
from bondgraph.declare.functions import clip, maximum
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_laws
from bondgraph.derive.laws import affine_parts, linear_coefficient, slope
from bondgraph.effects.places import (
    Words,
    effort_unit,
    elements_at,
    flow_unit,
    has_effort,
    has_flow,
    is_motion,
    is_speed,
    joins_speeds,
    over,
)

_STORAGES = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 4"
_DUFFING = "Duffing (1918), Erzwungene Schwingungen bei veränderlicher Eigenfrequenz"
_SOFTENING = "Nayfeh, Mook (1979), Nonlinear Oscillations, chapter 4"
_STOP = "Johnson (1985), Contact Mechanics, chapter 4"
#: Names of laws in each domain.
_INERTIA = Words("added_inertia", "added_inductance", "fluid_inertia")
_CAPACITY = Words("", "stray_capacitance", "added_volume", "added_heat_capacity")
_CUBIC = Words("hardening_spring", "voltage_dependent_capacitance", "stiffening_volume")
_PROGRESSIVE = Words("progressive_spring", "charge_dependent_capacitance", "tapered_tank")
#: The own variable of a compliance.
_STRETCH = symbol("displacement")
#: Times the straight part that the current of a core may be at the usual one of its node: iron at a hundredth of its
#: permeability.
_MOST_CURRENT = 100.0
#: Powers of the flux in a current of a core, less one: those of odd polynomials to the eleventh (Greenwood).
_POWERS = (2.0, 4.0, 6.0, 8.0, 10.0)
#: Time in which the effort of a place brings an inertia to its flow that is as large as it may be [s].
LONGEST_RUN_UP = 2.0


def added_inertia(g: BondGraph, at: Place) -> Effect | None:
    """Inertia that was not counted: payload, a flywheel, adhering oil, a leakage inductance, fluid in a hose."""
    declared = inertance_beside(g, at.junction) if is_speed(at) else None
    if declared is None:
        return None
    word = _INERTIA.at(at)
    name = f"{word}_{at.name}"
    size, unit = declared
    inertia = g.parameter(f"inertia_{name}", 0.0, unit, f"{word.replace('_', ' ')} at {at.label}", (0.0, size))
    g.inertance(name, inertia, at=at.junction)
    return Effect(
        word, name, "effort = c*d(flow)/dt", (f"inertia_{name}",), reference=_STORAGES,
        manoeuvre="quick changes of the flow",
    )  # fmt: skip


def added_capacity(g: BondGraph, at: Place) -> Effect | None:
    """Capacity that was not counted: a wall that takes up heat, a hose that swells, gas in oil, a stray capacitance."""
    word = _CAPACITY.at(at)
    declared = capacity_beside(g, at) if has_effort(at) and word else None
    if declared is None:
        return None
    name = f"{word}_{at.name}"
    size, unit = declared
    c = g.parameter(f"capacity_{name}", 0.0, unit, f"{word.replace('_', ' ')} at {at.label}", (0.0, size))
    g.compliance(name, displacement=lambda effort: c * effort, at=at.junction)
    return Effect(
        word, name, "flow = c*d(effort)/dt", (c.name,), reference=_STORAGES, manoeuvre="quick changes of the effort"
    )  # fmt: skip


def added_compliance(g: BondGraph, at: Place) -> Effect | None:
    """An elastic part in a connection declared as rigid: a spring with damping on a bond between two speeds.

    How much damping nobody knows of a part that was forgotten; a wrong one would show as a loss in the part itself.
    """
    if at.bond is None or not joins_speeds(g, at):
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
        shapes=(damping.name,), reference=_STORAGES, manoeuvre="a blow or step that makes both sides swing",
    )  # fmt: skip


def hardening_spring(g: BondGraph, at: Place) -> Effect | None:
    """A storage whose effort grows with the cube too: a leaf that bends far, a ceramic capacitor; it may soften."""
    word = _CUBIC.at(at)
    spring = spring_at(g, at) if word else None
    if spring is None:
        return None
    name = f"{word}_{at.name}"
    limit = spring.effort / spring.way**3
    c = g.parameter(f"c_{name}", 0.0, over(effort_unit(at), spring.unit, 3), "cubic coefficient", (-limit, limit))
    bend(g, spring, lambda old: old + c * _STRETCH**3)
    return Effect(
        word, spring.name, "effort = declared + c*displacement^3", (c.name,), reference=_DUFFING,
        manoeuvre="small and large swings in one log",
    )  # fmt: skip


def progressive_spring(g: BondGraph, at: Place) -> Effect | None:
    """A storage whose stiffness grows with its displacement: a conical spring, a tank that narrows upwards."""
    word = _PROGRESSIVE.at(at)
    spring = spring_at(g, at) if word else None
    if spring is None:
        return None
    name = f"{word}_{at.name}"
    limit = spring.effort / spring.way**2
    c = g.parameter(f"c_{name}", 0.0, over(effort_unit(at), spring.unit, 2), "rise of the stiffness", (-limit, limit))
    bend(g, spring, lambda old: old + c * _STRETCH * Abs(_STRETCH))
    return Effect(
        word, spring.name, "effort = declared + c*displacement*|displacement|", (c.name,), reference=_DUFFING,
        manoeuvre="small and large displacements in one log",
    )  # fmt: skip


def softening_spring(g: BondGraph, at: Place) -> Effect | None:
    """A spring whose force nears a limit: a rubber mount that buckles, a disc spring, a yielding support."""
    spring = spring_at(g, at) if is_motion(at) else None
    if spring is None:
        return None
    name = f"softening_spring_{at.name}"
    limit = 30.0 / spring.way**2
    meaning = "1 over the square of a displacement"
    c = g.parameter(f"c_{name}", 0.0, over("1", spring.unit, 2), meaning, (0.0, limit))
    bend(g, spring, lambda old: old / (1 + c * _STRETCH**2) ** Rational(1, 2))
    return Effect(
        "softening_spring", spring.name, "effort = declared/sqrt(1 + c*displacement^2)", (c.name,),
        reference=_SOFTENING, manoeuvre="small and large displacements in one log",
    )  # fmt: skip


def end_stop(g: BondGraph, at: Place) -> Effect | None:
    """Stops on both sides: beyond a displacement a second spring acts, straight or stiffening as it is pressed."""
    return _stop(g, at, "end_stop", lambda q, gap: q - clip(q, -gap, gap), "-g and g", both=True)


def one_sided_stop(g: BondGraph, at: Place) -> Effect | None:
    """A stop on one side, straight or stiffening: free below where its position is positive, above where negative."""
    return _stop(
        g, at, "one_sided_stop", lambda q, gap: sign(gap) * maximum(sign(gap) * (q - gap), 0),
        "g", both=False,
    )  # fmt: skip


def _stop(
    g: BondGraph, at: Place, effect: str, beyond: Callable[[Expr, Expr], Expr], law: str, both: bool
) -> Effect | None:
    known = (ROTATION, TRANSLATION, None) if not both else (ROTATION, TRANSLATION, HYDRAULIC, None)
    spring = spring_at(g, at) if at.domain in known else None
    if spring is None:
        return None
    name = f"{effect}_{at.name}"
    limit = 10.0 * spring.effort / spring.way
    c = g.parameter(f"c_{name}", 0.0, over(effort_unit(at), spring.unit), "stiffness of the stop", (0.0, limit))
    lower = 0.05 * spring.way if both else -spring.way
    gap = g.parameter(f"gap_{name}", 0.5 * spring.way, spring.unit, "where the stop begins", (lower, spring.way))
    n = g.parameter(f"n_{name}", 1.0, "1", "exponent of the stop: 1 straight, 1.5 of a ball", (0.5, 3.0))
    depth = g.parameter(f"r_{name}", 0.1 * spring.way, spring.unit, "depth at which its stiffness is c")

    def stopped(old: Expr) -> Expr:
        into = beyond(_STRETCH, gap)
        return old + c * into * ((into / depth) ** 2 + SMOOTHING**4) ** ((n - 1) / 2)

    bend(g, spring, stopped)
    return Effect(
        effect, spring.name, f"effort = declared + c*x*|x/r|^(n - 1), x the displacement beyond {law}", (c.name,),
        shapes=(gap.name,), widths=(n.name,), reference=_STOP,
        manoeuvre="swings into the stop and swings that do not reach it",
    )  # fmt: skip


def magnetic_saturation(g: BondGraph, at: Place) -> Effect | None:
    """An inductance that falls as its iron saturates: a linked flux L*i/sqrt(1 + c*i^2) instead of L*i.

    Of one at a node, as the core of a transformer is, the current gets a power of the flux: i = flux/L*(1 + ...).
    """
    coils = elements_at(g, at, "I") if at.bond is None and at.domain == ELECTRICAL else []
    law = coils[0].law("flow") if len(coils) == 1 else None
    reciprocal = None if law is None else linear_coefficient(law, symbol("momentum"))
    if reciprocal is None or "." in coils[0].name:
        return None
    name = f"magnetic_saturation_{at.name}"
    if not has_flow(at):
        return _saturating_core(g, at, coils[0].name, name)
    limit = 2.0 / at.scale.flow**2
    c = g.parameter(f"c_{name}", 0.0, over("1", flow_unit(at), 2), "1 over the square of a current", (0.0, limit))
    inductance = 1 / reciprocal
    g.inertance(name, momentum=lambda i: inductance * i * ((1 + c * i**2) ** Rational(-1, 2) - 1), at=at.junction)
    return Effect(
        "magnetic_saturation", name, "flux = L*flow/sqrt(1 + c*flow^2), L declared", (c.name,),
        reference="Trutt, Erdelyi, Hopkins (1968), IEEE Trans. PAS 87(3)",
        manoeuvre="steps or swings of small and of large current",
    )  # fmt: skip


def _saturating_core(g: BondGraph, at: Place, coil: str, name: str) -> Effect:
    """A current that grows with a power of the flux beside a straight part, as far as the usual current of the node."""
    limit = (0.0, _MOST_CURRENT)
    c = g.parameter(f"c_{name}", 0.0, "1", "current of the iron over that of the straight part, where it is r", limit)
    right = g.parameter(f"r_{name}", float(f"{at.scale.flow:.3g}"), flow_unit(at), "usual current of the node")
    m = g.parameter(f"m_{name}", _POWERS[1], "1", "power of the share that the iron takes", (1.0, 2.0 * _POWERS[-1]))
    flux = signal("flow", coil) / right  # by the straight part: L*flow, over that at the usual current
    g.flow_source(name, -c * signal("flow", coil) * (flux**2 + SMOOTHING**4) ** (m / 2), at=at.junction)
    return Effect(
        "magnetic_saturation", name, "flow = declared*(1 + c*|declared/r|^m)", (c.name,), shapes=(m.name,),
        grids=((m.name, _POWERS),), reference="Greenwood (1991), Electrical Transients in Power Systems",
        manoeuvre="steps or swings of small and of large voltage",
    )  # fmt: skip


@dataclass(frozen=True)
class Spring:
    """A compliance: its name, the displacement at the effort of its place, that effort, and the displacement's unit."""

    name: str
    way: float
    effort: float
    unit: str


def spring_at(g: BondGraph, at: Place, straight: bool = True) -> Spring | None:
    """The only compliance at a junction whose effort follows from its displacement; straight unless any law will do.

    A straight one may have a pretension, or be declared by its capacity. Where it is not straight its stiffness is that
    at the displacement at which it starts.
    """
    springs = [] if at.bond is not None else elements_at(g, at, "C")
    law = springs[0].law("effort") if len(springs) == 1 else None
    if law is None:
        return None
    if affine_parts(law, _STRETCH) is None and (straight or springs[0].law("displacement") is not None):
        return None
    values = {parameter.symbol: parameter.value for parameter in g.flatten().parameters}
    stiffness = slope(law, _STRETCH).subs({**values, _STRETCH: springs[0].initial[0]})
    if not stiffness.is_number or not stiffness.is_finite or stiffness == 0:
        return None
    unit = "" if at.domain is None else at.domain.displacement_unit
    return Spring(springs[0].name, at.scale.effort / abs(float(stiffness)), at.scale.effort, unit)


def bend(g: BondGraph, spring: Spring, law: Callable[[Expr], Expr]) -> None:
    """Give a compliance another effort, made of the old one; what gave its displacement holds no longer."""
    revise_laws(g, spring.name, lambda laws: {"effort": law(laws["effort"])})


def capacity_beside(g: BondGraph, at: Place) -> tuple[float, str] | None:
    """Size and unit of the linear compliance declared at a junction: the natural size of a capacity not counted."""
    values = {parameter.symbol: parameter.value for parameter in g.flatten().parameters}
    for node in elements_at(g, at, "C"):
        law = node.law("effort")
        parts = None if law is None else affine_parts(law, _STRETCH)
        if parts is not None and parts[0].free_symbols <= set(values):
            unit = "" if at.domain is None else over(at.domain.displacement_unit, at.domain.effort_unit)
            return 1.0 / abs(float(parts[0].subs(values))), unit
    return None


def inertance_beside(g: BondGraph, junction: Handle) -> tuple[float, str] | None:
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
    return Effect(
        "uncounted_inertia", name, law, (inertia.name,), reference=_STORAGES, manoeuvre="quick changes of the speed"
    )  # fmt: skip
