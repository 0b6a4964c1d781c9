"""Effects that measured machines showed beyond the usual losses, each a function that extends a graph.

They follow the rules of ``vehicle_graphs.effects`` and come beside these: one element at a junction, one coefficient
that is zero when the effect is absent. References: Janot, Gautier, Brunot (2019), *Data Set and Reference Models of
EMPS*, for friction that differs by direction; Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7), for
friction that depends on position; Eyring (1936), J. Chem. Phys. 4, for lubricants that thin under shear.
"""

from __future__ import annotations

from sympy import Abs, Expr, asinh, cos, sin, tanh

from bondgraph.declare.effect import Effect, Place, sensor_fault
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_output
from vehicle_graphs.effects.common import (
    coefficient,
    direction,
    effort_unit,
    elements_at,
    flow_unit,
    is_speed,
    over,
)

_SURVEY = "Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7)"
_STORAGES = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 4"
_EYRING = "Eyring (1936), J. Chem. Phys. 4, 283"
#: Time in which a drifting load may become as large as the efforts at its place [s].
LONGEST_DRIFT = 100.0
#: Time in which the effort of a place brings an inertia to its flow that is as large as it may be [s].
LONGEST_RUN_UP = 2.0


def direction_dependent_drag(g: BondGraph, at: Place) -> Effect | None:
    """Viscous drag that differs by direction: what a screw or belt loses more in one direction than in the other."""
    if not is_speed(at):
        return None
    unit = over(effort_unit(at), flow_unit(at))
    name, c = coefficient(g, at, "direction_dependent_drag", "half the difference of drags", unit, 1, signed=True)
    g.resistance(name, lambda flow: c * Abs(flow), at=at.junction)
    return Effect("direction_dependent_drag", name, "effort = c*|flow|", (c.name,))


def cubic_loss(g: BondGraph, at: Place) -> Effect | None:
    """Drag that grows with the cube of the flow: a damping that stiffens with amplitude."""
    if not is_speed(at):
        return None
    unit = over(effort_unit(at), flow_unit(at), 3)
    name, c = coefficient(g, at, "cubic_loss", "cubic coefficient", unit, power=3)
    g.resistance(name, lambda flow: c * flow**3, at=at.junction)
    return Effect("cubic_loss", name, "effort = c*flow^3", (c.name,), dissipative=True)


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


def shear_thinning_loss(g: BondGraph, at: Place) -> Effect | None:
    """Friction of a lubricant that thins under shear: it grows with the flow, and ever less, as Eyring's law has it."""
    if not is_speed(at):
        return None
    name, c = coefficient(g, at, "shear_thinning_loss", "friction per e-fold of the flow", effort_unit(at), power=0)
    around = g.parameter(
        f"v_{name}", at.smoothing * at.scale.flow, flow_unit(at), "flow above which the friction grows by its logarithm"
    )
    g.resistance(name, lambda flow: c * asinh(flow / around), at=at.junction)
    return Effect(
        "shear_thinning_loss", name, "effort = c*asinh(flow/v)", (c.name,), reference=_EYRING, dissipative=True
    )


def travel_dependent_friction(g: BondGraph, at: Place) -> Effect | None:
    """Dry friction that changes along the travel: a guide out of true, a screw whose preload is uneven."""
    position = _position(g, at)
    if position is None:
        return None
    name = f"travel_dependent_friction_{at.name}"
    travel, unit = position
    limit = 10.0 * at.scale.effort
    rise = g.parameter(f"c_{name}", 0.0, over(effort_unit(at), unit), "dry friction gained per travel", (-limit, limit))
    w = direction(g, at, name)
    g.resistance(name, lambda flow: rise * travel * tanh(flow / w), at=at.junction)
    law = "effort = c*position*tanh(flow/w)"
    return Effect("travel_dependent_friction", name, law, (rise.name,), reference=_SURVEY, widths=(w.name,))


def position_stiffness(g: BondGraph, at: Place) -> Effect | None:
    """A load proportional to the position that a graph integrates from the flow here: a cable, an inclined bed."""
    position = _position(g, at)
    if position is None:
        return None
    name = f"position_stiffness_{at.name}"
    travel, unit = position
    limit = 10.0 * at.scale.effort
    rate = g.parameter(f"c_{name}", 0.0, over(effort_unit(at), unit), "load per position", (-limit, limit))
    g.effort_source(name, -rate * travel, at=at.junction)
    return Effect("position_stiffness", name, "effort = c*position", (f"c_{name}",))


def ripple_sine(g: BondGraph, at: Place) -> Effect | None:
    """The sine part of a load that repeats with every turn of a screw, whose parameter ``screw_lead`` the graph has."""
    return _ripple(g, at, "ripple_sine", sin)


def ripple_cosine(g: BondGraph, at: Place) -> Effect | None:
    """The cosine part of a load that repeats with every turn of a screw."""
    return _ripple(g, at, "ripple_cosine", cos)


def drifting_load(g: BondGraph, at: Place) -> Effect | None:
    """A load that grows with time: the zero of an amplifier that warms up, a leak, a slowly tightening bearing."""
    if not is_speed(at):
        return None
    name = f"drifting_load_{at.name}"
    limit = at.scale.effort / LONGEST_DRIFT
    unit = over(effort_unit(at), "s")
    rate = g.parameter(f"c_{name}", 0.0, unit, f"load gained per time at {at.label}", (-limit, limit))
    g.effort_source(name, -rate * symbol("t"), at=at.junction)
    return Effect("drifting_load", name, "effort = c*t", (f"c_{name}",))


@sensor_fault
def sensor_magnitude(g: BondGraph, at: Place) -> Effect | None:
    """A sensor that does not see the direction: a pulse counter, a tachometer behind a rectifier."""
    name = f"magnitude_{at.name}"
    share = g.parameter(name, 0.0, "1", f"share of {at.output} shown without its sign", (0.0, 1.5))
    revise_output(g, at.output, lambda shown: (1 - share) * shown + share * Abs(shown))
    return Effect(
        "sensor_magnitude", at.output, "shown = (1 - s)*true + s*|true|", (name,), amplitudes=(0.3, 0.67),
        channel=at.output, kind="magnitude",
    )  # fmt: skip


@sensor_fault
def sensor_square(g: BondGraph, at: Place) -> Effect | None:
    """A sensor that shows the square of what it senses: an orifice, a rectified and smoothed oscillation, a power."""
    name = f"square_{at.name}"
    unit = next((output.unit for output in g.outputs if output.name == at.output), "")
    share = g.parameter(name, 0.0, "1", f"share of {at.output} shown as its square", (0.0, 1.5))
    size = g.parameter(f"true_at_{at.name}", at.scale.effort, unit, f"where the square of {at.output} is right")
    revise_output(g, at.output, lambda shown: (1 - share) * shown + share * shown**2 / size)
    return Effect(
        "sensor_square", at.output, "shown = (1 - s)*true + s*true^2/size", (name,), amplitudes=(0.3, 0.67),
        channel=at.output, kind="square",
    )  # fmt: skip


def _position(g: BondGraph, at: Place) -> tuple[Expr, str] | None:
    """The declared integral of the flow of a junction, and its unit."""
    if not is_speed(at):
        return None
    found = next((i for i in g.integrals if i.of == signal("flow", at.junction.name)), None)
    return None if found is None else (symbol(found.name), found.unit)


def _ripple(g: BondGraph, at: Place, effect: str, wave: type[sin] | type[cos]) -> Effect | None:
    position = _position(g, at)
    lead = next((p for p in g.parameters if p.name == "screw_lead"), None)
    if position is None or lead is None:
        return None
    name = f"{effect}_{at.name}"
    limit = at.scale.effort
    size = g.parameter(f"c_{name}", 0.0, effort_unit(at), "amplitude of the load per turn", (-limit, limit))
    g.effort_source(name, -size * wave(6.283185307179586 * position[0] / lead.symbol), at=at.junction)
    return Effect(effect, name, f"effort = c*{wave.__name__}(2 pi position/lead)", (f"c_{name}",))
