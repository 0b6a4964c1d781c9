"""Efforts with a memory: friction that gives way before it slides, as Dahl, as Bouc and Wen, and as LuGre have it.

Each has a state h, the friction as a share of its level, which is an integral of the flow; so the effect vanishes with
its level. The way over which h turns round is a shape: no machine tells it beforehand.

A cell remembers in the same way whether it was charged or discharged.

References: Dahl (1976), AIAA Journal 14(12); Wen (1976), Journal of the Engineering Mechanics Division 102(2); Canudas
de Wit, Olsson, Astrom, Lischinsky (1995), IEEE Trans. Automatic Control 40(3), for LuGre; Plett (2015), Battery
Management Systems, volume 1, chapter 2, for cells.
"""

from __future__ import annotations

from collections.abc import Callable

from sympy import Abs, Expr, exp

from bondgraph.declare.domains import ELECTRICAL
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.places import coefficient, effort_unit, elements_at, flow_unit, has_flow, is_motion

_DAHL = "effort = c*h, dh/dt = (flow - |flow|*h)/g"
#: Ways of sliding that turn friction round, as times at the largest flow [s]: the shortest, as declared, the longest.
_WAYS = (0.005, 0.1, 0.5)
#: Powers of Bouc and Wen between which friction is tried: one is Dahl's, large ones are elastic until it slides.
_POWERS = (1.0, 6.0)
#: Share of the bending that depends on the direction; of the two it is the half that Wen calls beta.
_HALF = 0.5
#: Rise of friction towards standstill, as a share of its level, that LuGre begins with, and the largest.
_RISE, _HIGHEST = 0.5, 2.0


def hysteresis_loss(g: BondGraph, at: Place) -> Effect | None:
    """Dry friction that gives way before it slides: clutch linings, bushes; beside friction that is declared."""
    if not _fits(g, at):
        return None
    name, level = coefficient(g, at, "hysteresis_loss", "friction with hysteresis", effort_unit(at), power=0)
    give = _give(g, at, name)
    _bending(g, at, name, level, _turning_round(at, give))
    return Effect(
        "hysteresis_loss", name, _DAHL, (level.name,), shapes=(give.name,),
        reference="Dahl (1976), AIAA Journal 14(12)", dissipative=True,
        manoeuvre="small reversals that do not break loose",
    )  # fmt: skip


def voltage_hysteresis(g: BondGraph, at: Place) -> Effect | None:
    """A cell whose voltage at rest is higher after charging than after discharging: iron phosphate, nickel."""
    if not (has_flow(at) and at.domain == ELECTRICAL and elements_at(g, at, "C")):
        return None
    name, level = coefficient(g, at, "voltage_hysteresis", "voltage of the hysteresis", effort_unit(at), power=0)
    shortest, longest = at.times
    bounds = (shortest * at.scale.flow, 0.5 * longest * at.scale.flow)
    usual = (bounds[0] * bounds[1]) ** 0.5
    give = g.parameter(f"give_{name}", usual, ELECTRICAL.displacement_unit, "charge over which it turns round", bounds)
    _bending(g, at, name, level, _turning_round(at, give))
    return Effect(
        "voltage_hysteresis", name, _DAHL, (level.name,), shapes=(give.name,),
        reference="Plett (2015), Battery Management Systems, volume 1, chapter 2", dissipative=True,
        manoeuvre="charge and discharge about the same charge, with rests",
    )  # fmt: skip


def _turning_round(at: Place, give: Expr) -> Callable[[Expr], Expr]:
    """The rate of a share that turns round over a way, or a charge: Dahl's friction with an exponent of one."""
    flow = at.junction.flow
    return lambda h: (flow - Abs(flow) * h) / give


def bouc_wen_loss(g: BondGraph, at: Place) -> Effect | None:
    """Hysteresis whose bend is a matter of the material: rubber mounts, wire ropes, steel that yields."""
    if not _fits(g, at):
        return None
    name, level = coefficient(g, at, "bouc_wen_loss", "effort of the hysteresis", effort_unit(at), power=0)
    give = _give(g, at, name)
    power = g.parameter(f"n_{name}", 2.0, "1", "sharpness of the bend", _POWERS)
    flow = at.junction.flow

    def rate(h: Expr) -> Expr:
        bend = Abs(h) ** (power - 1)
        return (flow - _HALF * Abs(flow) * h * bend - (1 - _HALF) * flow * Abs(h) * bend) / give

    _bending(g, at, name, level, rate)
    return Effect(
        "bouc_wen_loss", name, "effort = c*h, dh/dt = (flow - |h|^(n-1)*(|flow|*h + flow*|h|)/2)/g", (level.name,),
        shapes=(give.name, power.name), grids=((power.name, (1.5, 3.0)),), dissipative=True,
        reference="Wen (1976), Journal of the Engineering Mechanics Division 102(2)",
        manoeuvre="swings of several sizes",
    )  # fmt: skip


def lugre_loss(g: BondGraph, at: Place) -> Effect | None:
    """Friction that gives way, breaks loose and falls with speed: bearings and seals that stick and slip."""
    if not _fits(g, at):
        return None
    name, level = coefficient(g, at, "lugre_loss", "friction at speed", effort_unit(at), power=0)
    give = _give(g, at, name)
    size = at.scale.flow
    rise = g.parameter(f"rise_{name}", _RISE, "1", "share that is added at standstill", (0.0, _HIGHEST))
    slow = g.parameter(
        f"v_{name}", 0.1 * size, flow_unit(at), "flow at which a third of that is left", (0.03 * size, 0.6 * size)
    )
    flow = at.junction.flow
    highest = 1 + rise * exp(-((flow / slow) ** 2))
    _bending(g, at, name, level, lambda h: (flow - Abs(flow) * h / highest) / give)
    return Effect(
        "lugre_loss", name, "effort = c*h, dh/dt = (flow - |flow|*h/(1 + r*exp(-(flow/v)^2)))/g", (level.name,),
        shapes=(give.name, rise.name, slow.name), grids=((rise.name, (_RISE,)),), dissipative=True,
        reference="Canudas de Wit, Olsson, Astrom, Lischinsky (1995), IEEE Trans. Automatic Control 40(3)",
        manoeuvre="slow motion with stops and reversals",
    )  # fmt: skip


def _fits(g: BondGraph, at: Place) -> bool:
    """Moving parts with friction of their own: what only stores force would be a spring."""
    return is_motion(at) and bool(elements_at(g, at, "R"))


def _give(g: BondGraph, at: Place, name: str) -> Expr:
    """The way over which the friction turns round."""
    shortest, usual, longest = (time * at.scale.flow for time in _WAYS)
    unit = "" if at.domain is None else at.domain.displacement_unit
    return g.parameter(f"give_{name}", usual, unit, "way over which it turns round", (shortest, longest))


def _bending(g: BondGraph, at: Place, name: str, level: Expr, rate: Callable[[Expr], Expr]) -> None:
    """The state of the friction, and its effort against the flow."""
    bent = g.integral(f"bent_{name}", rate, "1", f"share of the hysteresis at {at.label}")
    g.effort_source(name, -level * bent, at=at.junction)
