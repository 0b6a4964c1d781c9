"""Losses at a 1-junction: what takes an effort that depends on the flow there.

References: Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7), a survey of models; Stribeck (1902),
VDI-Zeitschrift 46; Wong (2008), Theory of Ground Vehicles, section 1.2, for rolling resistance; Heywood (1988),
Internal Combustion Engine Fundamentals, chapter 13, for warm oil; Eyring (1936), J. Chem. Phys. 4, for lubricants that
thin under shear; Janot, Gautier, Brunot (2019), Data Set and Reference Models of EMPS, for drag that differs by
direction.
"""

from __future__ import annotations

from collections.abc import Mapping

from sympy import Abs, Expr, Rational, asinh, exp, tanh

from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, ROTATION, TRANSLATION
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.elements import Node
from bondgraph.declare.functions import clip
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_laws
from bondgraph.derive.laws import linear_coefficient
from bondgraph.effects.places import (
    Words,
    coefficient,
    direction,
    effort_unit,
    flow_unit,
    has_flow,
    is_motion,
    over,
    position_at,
    yielding,
)

#: Where laws of friction are compared.
_SURVEY = "Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7)"
_ORIFICE = "Merritt (1967), Hydraulic Control Systems, chapter 3"
_EMPS = "Janot, Gautier, Brunot (2019), Data Set and Reference Models of EMPS"
_EYRING = "Eyring (1936), J. Chem. Phys. 4, 283"
_BUTLER = "Bard, Faulkner (2001), Electrochemical Methods, chapter 3"
#: Share of the largest flow up to which a logarithm may begin: an e-fold of it is hardly seen beyond. A convention.
_CURVED = 1.0
_PIPES = "White (2011), Fluid Mechanics, chapter 6"
_EDDY = "Wouterse (1991), IEE Proceedings B 138(4)"
#: Powers of the flow in turbulent pipes: 7/4 by Blasius, 1.852 by Hazen and Williams, a square where walls are rough.
_TURBULENT = (1.75, 1.95)
#: Speed to which speed-dependent rolling resistance is referred, m/s (100 km/h).
_ROLLING_SPEED = 100.0 / 3.6
_BOND_GRAPHS = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 3"
#: Names of laws in each domain.
_PROPORTIONAL = Words("viscous_loss", "series_resistance", "laminar_loss", "contact_resistance", "transport_resistance")
_CONSTANT = Words("coulomb_loss", "contact_drop", "opening_pressure")
_SQUARE = Words("quadratic_loss", hydraulic="orifice_loss")
_REACTION = Words("", "activation_drop", chemical="activation_loss")
_REVERSALS = "reversals and starts from rest under a slowly rising load"


def viscous_loss(g: BondGraph, at: Place) -> Effect | None:
    """Effort lost in proportion to the flow: bearing oil, a longer wire, a narrow pipe, a poor thermal contact."""
    word = _PROPORTIONAL.at(at)
    if not has_flow(at) or not word:
        return None
    unit = over(effort_unit(at), flow_unit(at))
    name, c = coefficient(g, at, word, f"coefficient of {word.replace('_', ' ')}", unit, power=1)
    g.resistance(name, lambda flow: c * flow, at=at.junction)
    return Effect(
        word, name, "effort = c*flow", (c.name,), reference=_SURVEY if word == "viscous_loss" else _BOND_GRAPHS,
        dissipative=True, manoeuvre="steady runs at several flows, or a decay without drive",
    )  # fmt: skip


def coulomb_loss(g: BondGraph, at: Place) -> Effect | None:
    """Effort of constant size against the flow: dry friction, a brush's or diode's drop, a valve that must open."""
    word = _CONSTANT.at(at)
    if not has_flow(at) or not word:
        return None
    if (held := yielding(g, at)) is not None:
        return _holding(g, at, word, *held)
    name, level = coefficient(g, at, word, _level(word), effort_unit(at), power=0)
    w = direction(g, at, name)
    g.resistance(name, lambda flow: level * tanh(flow / w), at=at.junction)
    return Effect(
        word, name, "effort = c*tanh(flow/w)", (level.name,), reference=_SURVEY, dissipative=True,
        widths=(w.name,), manoeuvre=_REVERSALS,
    )  # fmt: skip


def _level(word: str) -> str:
    return "dry friction" if word == "coulomb_loss" else word.replace("_", " ")


def _holding(g: BondGraph, at: Place, word: str, drag: Node, slope: Expr) -> Effect:
    """Dry friction beside the drag that decides the flow: nothing moves until the effort exceeds it.

    A valve opens over some width about its pressure, and leaks a little below.
    """
    name, level = coefficient(g, at, word, _level(word), effort_unit(at), power=0)
    effort, law = symbol("effort"), "flow = (effort - clip(effort, -c, c))/d, d declared"
    held: Expr = clip(effort, -level, level)
    widths: tuple[str, ...] = ()
    if word == _CONSTANT.hydraulic:
        meaning = "pressure over which it opens"
        w = g.parameter(f"w_{name}", at.smoothing * at.scale.effort, effort_unit(at), meaning)
        held = (_length(effort + level, w) - _length(effort - level, w)) / 2
        widths = (w.name,)
        law = "flow = (effort - held)/d, d declared, held = effort within -c and c, round over w"

    def moving(laws: Mapping[str, Expr]) -> dict[str, Expr]:
        if "flow" in laws:
            return {"flow": laws["flow"].xreplace({effort: effort - held})}
        inner = linear_coefficient(laws["effort"], symbol("flow"))
        return {"flow": slope * (effort - held) if inner is None else (effort - held) / inner}

    revise_laws(g, drag.name, moving)
    return Effect(
        word, drag.name, law, (level.name,), amplitudes=(0.01, 0.03, 0.1, 0.3), widths=widths, reference=_SURVEY,
        dissipative=True, manoeuvre=_REVERSALS,
    )  # fmt: skip


def _length(one: Expr, other: Expr) -> Expr:
    return (one**2 + other**2) ** Rational(1, 2)


def stribeck_loss(g: BondGraph, at: Place) -> Effect | None:
    """Dry friction that rises towards standstill: lubricated bearings, brake linings, seals."""
    if not is_motion(at):
        return None
    name = f"stribeck_loss_{at.name}"
    limit, size = 2.0 * at.scale.effort, at.scale.flow
    level = g.parameter(f"c_{name}", 0.0, effort_unit(at), f"dry friction at {at.label}", (0.0, limit))
    rise = g.parameter(f"rise_{name}", 0.0, effort_unit(at), "what is added towards standstill", (0.0, limit))
    width = g.parameter(
        f"v_{name}", 0.1 * size, flow_unit(at), "flow at which a third of that is left", (0.03 * size, 0.6 * size)
    )
    w = direction(g, at, name)
    g.resistance(
        name, lambda flow: (level + rise * exp(-((flow / width) ** 2))) * tanh(flow / w), at=at.junction
    )  # fmt: skip
    law = "effort = (c + r*exp(-(flow/v)^2))*tanh(flow/w)"
    return Effect(
        "stribeck_loss", name, law, (rise.name, level.name), shapes=(width.name,),
        reference="Stribeck (1902), VDI-Zeitschrift 46", dissipative=True, widths=(w.name,),
        manoeuvre="slow motion through standstill, and fast runs to compare",
    )  # fmt: skip


def quadratic_loss(g: BondGraph, at: Place) -> Effect | None:
    """Effort lost with the square of the flow: air, churned oil, an orifice."""
    word = _SQUARE.at(at)
    if not has_flow(at) or not word:
        return None
    unit = over(effort_unit(at), flow_unit(at), 2)
    name, c = coefficient(g, at, word, "quadratic coefficient", unit, power=2)
    g.resistance(name, lambda flow: c * flow * Abs(flow), at=at.junction)
    return Effect(
        word, name, "effort = c*flow*|flow|", (c.name,), dissipative=True,
        reference=_SURVEY if word == "quadratic_loss" else _ORIFICE, manoeuvre="small and large flows in one log",
    )  # fmt: skip


def turbulent_loss(g: BondGraph, at: Place) -> Effect | None:
    """Pressure lost in a long pipe: the power 7/4 of the flow in a smooth one, and nearly its square in a rough one."""
    if not has_flow(at) or at.domain != HYDRAULIC:
        return None
    name = f"turbulent_loss_{at.name}"
    c = g.parameter(f"c_{name}", 0.0, effort_unit(at), "pressure at the largest flow", (0.0, 2.0 * at.scale.effort))
    most = g.parameter(f"r_{name}", at.scale.flow, flow_unit(at), "flow of that pressure")
    n = g.parameter(f"n_{name}", _TURBULENT[0], "1", "power of the flow", _TURBULENT)
    w = at.smoothing

    def law(flow: Expr) -> Expr:
        x = flow / most
        return c * x * (x**2 + w**2) ** ((n - 1) / 2)

    g.resistance(name, law, at=at.junction)
    return Effect(
        "turbulent_loss", name, "effort = c*x*(x^2 + w^2)^((n - 1)/2), x = flow/r", (c.name,), dissipative=True,
        widths=(n.name,), reference=_PIPES, manoeuvre="small and large flows in one log",
    )  # fmt: skip


def eddy_current_drag(g: BondGraph, at: Place) -> Effect | None:
    """Drag of a conductor in a magnet's field: it grows up to a critical speed, and falls beyond it.

    So does the slip of an induction motor, by the same law of Kloss.
    """
    if not is_motion(at) or at.domain is None:
        return None
    name, c = coefficient(g, at, "eddy_current_drag", "largest drag", effort_unit(at), power=0)
    bounds = (0.05 * at.scale.flow, at.scale.flow)
    v = g.parameter(f"v_{name}", 0.3 * at.scale.flow, flow_unit(at), "flow at the largest drag", bounds)
    g.resistance(name, lambda flow: 2 * c * (flow / v) / (1 + (flow / v) ** 2), at=at.junction)
    return Effect(
        "eddy_current_drag", name, "effort = 2*c*x/(1 + x^2), x = flow/v", (c.name,), shapes=(v.name,),
        reference=_EDDY, dissipative=True, manoeuvre="slow and fast motion in one log",
    )  # fmt: skip


def rolling_speed_loss(g: BondGraph, at: Place) -> Effect | None:
    """Rolling resistance that grows with speed, by the power 2.5: tyres on a hard road."""
    if not is_motion(at) or at.domain != TRANSLATION:
        return None
    name = f"rolling_speed_loss_{at.name}"
    limit = 2.0 * at.scale.effort * max(1.0, _ROLLING_SPEED / at.scale.flow) ** 2.5
    c = g.parameter(
        f"c_{name}", 0.0, effort_unit(at), f"rolling resistance added at 100 km/h at {at.label}", (0, limit)
    )
    fast = g.parameter(f"v_{name}", _ROLLING_SPEED, flow_unit(at), "100 km/h")
    g.resistance(name, lambda flow: c * (flow / fast) * Abs(flow / fast) ** 1.5, at=at.junction)
    return Effect(
        "rolling_speed_loss", name, "effort = c*(flow/v)*|flow/v|^1.5", (c.name,),
        reference="Wong (2008), Theory of Ground Vehicles, section 1.2", dissipative=True,
        manoeuvre="a coast-down from high speed",
    )  # fmt: skip


def warm_up_loss(g: BondGraph, at: Place) -> Effect | None:
    """Viscous drag of cold oil that fades with time from the start of a log on."""
    if not is_motion(at) or at.domain != ROTATION:
        return None
    unit = over(effort_unit(at), flow_unit(at))
    name, c = coefficient(g, at, "warm_up_loss", "viscous coefficient when cold", unit, power=1)
    warm = g.parameter(f"T_{name}", 60.0, "s", "time in which it falls to a third", (5.0, 600.0))
    g.resistance(name, lambda flow: c * exp(-symbol("t") / warm) * flow, at=at.junction)
    return Effect(
        "warm_up_loss", name, "effort = c*exp(-t/T)*flow", (c.name,), shapes=(warm.name,),
        reference="Heywood (1988), Internal Combustion Engine Fundamentals, chapter 13", dissipative=True,
        manoeuvre="a run from a cold start",
    )  # fmt: skip


def direction_dependent_drag(g: BondGraph, at: Place) -> Effect | None:
    """Viscous drag that differs by direction: a shock absorber with softer valves one way, a screw, a belt."""
    if not is_motion(at):
        return None
    unit = over(effort_unit(at), flow_unit(at))
    name, c = coefficient(g, at, "direction_dependent_drag", "half the difference of drags", unit, 1, signed=True)
    w = direction(g, at, name)
    g.resistance(name, lambda flow: c * flow * tanh(flow / w), at=at.junction)
    return Effect(
        "direction_dependent_drag", name, "effort = c*flow*tanh(flow/w)", (c.name,), reference=_EMPS,
        widths=(w.name,), manoeuvre="the same run in both directions",
    )  # fmt: skip


def cubic_loss(g: BondGraph, at: Place) -> Effect | None:
    """Drag that grows with the cube of the flow: a damping that stiffens with amplitude."""
    if not is_motion(at):
        return None
    unit = over(effort_unit(at), flow_unit(at), 3)
    name, c = coefficient(g, at, "cubic_loss", "cubic coefficient", unit, power=3)
    g.resistance(name, lambda flow: c * flow**3, at=at.junction)
    return Effect(
        "cubic_loss", name, "effort = c*flow^3", (c.name,), dissipative=True, reference=_SURVEY,
        manoeuvre="small and large flows in one log",
    )  # fmt: skip


def shear_thinning_loss(g: BondGraph, at: Place) -> Effect | None:
    """Friction of a lubricant that thins under shear: it grows with the flow, and ever less, as Eyring's law has it."""
    meaning = "friction per e-fold of the flow"
    return _logarithmic(g, at, "shear_thinning_loss", meaning, _EYRING, False) if is_motion(at) else None


def electrode_loss(g: BondGraph, at: Place) -> Effect | None:
    """Effort that grows with the logarithm of the flow: the reaction at an electrode, as Butler and Volmer have it."""
    word = _REACTION.at(at)
    return _logarithmic(g, at, word, "effort per e-fold of the flow", _BUTLER, True) if has_flow(at) and word else None


def _logarithmic(g: BondGraph, at: Place, word: str, meaning: str, reference: str, bends: bool) -> Effect:
    """The law; where it ``bends`` is estimated, else it begins far below what the logs reach."""
    name, c = coefficient(g, at, word, meaning, effort_unit(at), power=0)
    least, most = at.smoothing * at.scale.flow, _CURVED * at.scale.flow  # one that begins below that is a step
    around = g.parameter(
        f"v_{name}", least, flow_unit(at), "flow above which the loss grows by its logarithm",
        (least, most) if bends else None,
    )  # fmt: skip
    g.resistance(name, lambda flow: c * asinh(flow / around), at=at.junction)
    return Effect(
        word, name, "effort = c*asinh(flow/v)", (c.name,), shapes=(around.name,) if bends else (),
        reference=reference, dissipative=True, manoeuvre="flows over several powers of ten",
    )  # fmt: skip


def heating_resistance(g: BondGraph, at: Place) -> Effect | None:
    """A voltage that grows with the cube of the current: a wire or filament that its own current warms."""
    if not has_flow(at) or at.domain != ELECTRICAL:
        return None
    unit = over(effort_unit(at), flow_unit(at), 3)
    name, c = coefficient(g, at, "heating_resistance", "cubic coefficient", unit, power=3)
    g.resistance(name, lambda flow: c * flow**3, at=at.junction)
    return Effect(
        "heating_resistance", name, "effort = c*flow^3", (c.name,), dissipative=True, reference=_BOND_GRAPHS,
        manoeuvre="small and large currents held until they settle",
    )  # fmt: skip


def travel_dependent_friction(g: BondGraph, at: Place) -> Effect | None:
    """Dry friction that changes along the travel: a guide out of true, a screw whose preload is uneven."""
    position = position_at(g, at)
    if position is None:
        return None
    name = f"travel_dependent_friction_{at.name}"
    travel, unit = position
    limit = 10.0 * at.scale.effort
    rise = g.parameter(f"c_{name}", 0.0, over(effort_unit(at), unit), "dry friction gained per travel", (-limit, limit))
    w = direction(g, at, name)
    g.resistance(name, lambda flow: rise * travel * tanh(flow / w), at=at.junction)
    law = "effort = c*position*tanh(flow/w)"
    return Effect(
        "travel_dependent_friction", name, law, (rise.name,), reference=_SURVEY, widths=(w.name,),
        manoeuvre="slow motion over the whole travel, there and back",
    )  # fmt: skip
