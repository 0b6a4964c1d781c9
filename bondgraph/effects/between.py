"""Laws between two junctions of one domain: what leaks from one chamber into another, or rubs between two shafts.

Between two 0-junctions, whose efforts differ, something flows; between two 1-junctions, whose flows differ, an effort
acts on both. What joins two speeds rigidly may slip. References: Karnopp, Margolis, Rosenberg (2012), System Dynamics,
chapters 3 and 4; Firbank (1970), Mechanics of the belt drive, Int. J. Mech. Sci. 12; Childs (2019), Mechanical Design
Engineering Handbook, for belts and couplings.
"""

from __future__ import annotations

from sympy import Abs, Rational, sqrt, tanh

from bondgraph.declare.domains import HYDRAULIC, ROTATION
from bondgraph.declare.editing import split_bond
from bondgraph.declare.effect import Effect, Place, between_junctions
from bondgraph.declare.elements import Node
from bondgraph.declare.functions import maximum
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.effects.places import (
    ROOT_LAW,
    Words,
    coefficient,
    conductance,
    direction,
    effort_unit,
    flow_unit,
    joins_speeds,
    over,
    root_flow,
)

_BOND_GRAPHS = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 4"
_ORIFICE = "Merritt (1967), Hydraulic Control Systems, chapter 3"
_COUPLING = "Naunheimer, Bertsche, Ryborz, Novak (2011), Automotive Transmissions, chapter 10"
_BELT_SLIP = "Firbank (1970), Int. J. Mech. Sci. 12; Childs (2019), Mechanical Design Engineering Handbook"
_SURVEY = "Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7)"
_WEIR = "White (2011), Fluid Mechanics, section 10.7"
#: An edge is looked for up to so many times the difference of two efforts, the only size that is known: a convention.
_HIGH = 4.0
#: What a flow in proportion to a difference of efforts is called.
_LEAK = Words("", "leakage_between", "leakage_between", "heat_bridge", "exchange_between")
#: What an effort in proportion to a difference of speeds is called.
_DRAG = Words("drag_between")


@between_junctions
def leak_between(g: BondGraph, at: Place) -> Effect | None:
    """Flow from the higher effort to the lower: a piston's leak, a bad insulation, a heat bridge, an exchange."""
    word = _LEAK.at(at)
    if at.junction.kind != "0" or not word:
        return None
    name, c = conductance(g, at, word, word.replace("_", " "), over(flow_unit(at), effort_unit(at)), 1)
    g.resistance(name, flow=lambda effort: c * effort, at=path(g, at, name))
    return Effect(
        word, name, "flow = c*(first effort - second effort)", (c.name,), reference=_BOND_GRAPHS, dissipative=True,
        manoeuvre="one effort held high, the other low",
    )  # fmt: skip


@between_junctions
def orifice_between(g: BondGraph, at: Place) -> Effect | None:
    """Flow through an opening between two chambers, with the root of the difference in pressure or a little more."""
    if at.junction.kind != "0" or at.domain != HYDRAULIC:
        return None
    name = f"orifice_between_{at.name}"
    leak = root_flow(g, at, name)
    g.resistance(name, flow=leak.law, at=path(g, at, name))
    return Effect(
        "orifice_between", name, f"{ROOT_LAW}, effort = first - second", (leak.coefficient,), reference=_ORIFICE,
        dissipative=True, widths=(leak.power,), manoeuvre="small and large differences in pressure",
    )  # fmt: skip


@between_junctions
def overflow_onward(g: BondGraph, at: Place) -> Effect | None:
    """Overflow of the first vessel that falls into the second: tanks in a row, a weir between two basins."""
    return _overflow_between(g, at, "overflow_onward", "first")


@between_junctions
def overflow_back(g: BondGraph, at: Place) -> Effect | None:
    """Overflow of the second vessel that falls into the first."""
    return _overflow_between(g, at, "overflow_back", "second")


def _overflow_between(g: BondGraph, at: Place, effect: str, full: str) -> Effect | None:
    """Flow by the power 3/2 of what stands above an edge in one vessel, whatever stands in the other."""
    if at.junction.kind != "0" or at.domain != HYDRAULIC or at.other is None:
        return None
    name, size = f"{effect}_{at.name}", at.scale.effort
    effort, sign = (at.junction.effort, 1) if full == "first" else (at.other.effort, -1)
    largest = (0.0, 0.5 * at.scale.flow)
    c = g.parameter(f"c_{name}", 0.0, flow_unit(at), f"flow at {size:.3g} {effort_unit(at)} above the edge", largest)
    # the difference of two efforts is the only size that is known here: an edge may stand higher than that
    edge = g.parameter(f"e_{name}", 0.5 * size, effort_unit(at), "effort at the edge", (0.05 * size, _HIGH * size))
    unit = g.parameter(f"p_{name}", size, effort_unit(at), "effort of that flow")
    over_it = maximum((effort - edge) / unit, 0) ** Rational(3, 2)
    g.flow_source(name, sign * c * over_it, at=path(g, at, name))
    return Effect(
        effect, name, f"flow = c*(max({full} effort - e, 0)/p)^1.5", (c.name,), shapes=(edge.name,), reference=_WEIR,
        manoeuvre="a slow rise of the effort to its largest value",
    )  # fmt: skip


@between_junctions
def drag_between(g: BondGraph, at: Place) -> Effect | None:
    """Drag in proportion to the difference of two speeds: oil between two discs, the damping of a coupling."""
    word = _DRAG.at(at)
    if at.junction.kind != "1" or not word:
        return None
    unit = over(effort_unit(at), flow_unit(at))
    name, c = coefficient(g, at, word, "drag per difference of speeds", unit, power=1)
    g.resistance(name, lambda flow: c * flow, at=path(g, at, name))
    return Effect(
        word, name, "effort = c*(first flow - second flow)", (c.name,), reference=_BOND_GRAPHS, dissipative=True,
        manoeuvre="runs in which both speeds differ much and little",
    )  # fmt: skip


@between_junctions
def friction_between(g: BondGraph, at: Place) -> Effect | None:
    """Dry friction between two speeds: a dragging clutch, a seal that turns with one part, a synchroniser."""
    if at.junction.kind != "1" or not _DRAG.at(at):
        return None
    name, level = coefficient(g, at, "friction_between", "dry friction between them", effort_unit(at), power=0)
    w = direction(g, at, name)
    g.resistance(name, lambda flow: level * tanh(flow / w), at=path(g, at, name))
    return Effect(
        "friction_between", name, "effort = c*tanh(flow/w), flow = first - second", (level.name,), reference=_SURVEY,
        dissipative=True, widths=(w.name,), manoeuvre="each of the two speeds the faster one in turn",
    )  # fmt: skip


@between_junctions
def fluid_coupling_between(g: BondGraph, at: Place) -> Effect | None:
    """A torque that slip makes in a fluid, the larger the faster the first part turns: a coupling, a converter."""
    if at.junction.kind != "1" or at.domain != ROTATION:
        return None
    unit = over(effort_unit(at), flow_unit(at), 2)
    name, c = coefficient(g, at, "fluid_coupling_between", "torque over speed times slip", unit, power=2)
    drive = at.junction.flow
    g.resistance(name, lambda flow: c * Abs(drive) * flow, at=path(g, at, name))
    return Effect(
        "fluid_coupling_between", name, "effort = c*|first flow|*(first flow - second flow)", (c.name,),
        reference=_COUPLING, dissipative=True, manoeuvre="slip at low and high speed of the driving part",
    )  # fmt: skip


def clutch_slip(g: BondGraph, at: Place) -> Effect | None:
    """A connection declared as rigid that passes no more than a largest effort: a clutch, a fit, a belt."""
    if at.bond is None or not joins_speeds(g, at):
        return None
    name = f"clutch_slip_{at.name}"
    size = at.scale.effort
    limit = g.parameter(
        f"c_{name}", 0.6 * size, effort_unit(at), f"largest effort that {at.label} passes", (0.05 * size, 2.0 * size)
    )
    w = direction(g, at, name)
    middle = split_bond(g, at.bond, Node(f"z_{name}", "0", at.domain))
    g.resistance(name, lambda flow: limit * tanh(flow / w), at=middle)
    return Effect(
        "clutch_slip", name, "effort = c*tanh(slip/w)", (limit.name,), adds_state=True, reference=_SURVEY,
        amplitudes=(0.5, 0.7, 0.85), manoeuvre="loads up to the largest",
    )  # fmt: skip


def coupling_slip(g: BondGraph, at: Place) -> Effect | None:
    """Slip of a connection declared as rigid: a belt, a viscous or friction coupling, a clutch, a tyre.

    Under small loads it slips in proportion to the effort; beyond its largest effort it passes no more.
    """
    if at.bond is None or not joins_speeds(g, at):
        return None
    name = f"coupling_slip_{at.name}"
    size, loosest = at.scale.effort, 0.5 * at.scale.flow / at.scale.effort
    c = g.parameter(
        f"c_{name}", 1e-2 * loosest, over(flow_unit(at), effort_unit(at)), f"slip per effort of {at.label}",
        (2e-3 * loosest, loosest),
    )  # fmt: skip
    # a start well above the load: what slips without end says nothing of how it slips under less
    limit = g.parameter(
        f"m_{name}", 2.0 * size, effort_unit(at), f"largest effort that {at.label} passes", (0.5 * size, 10.0 * size)
    )
    middle = split_bond(g, at.bond, Node(f"z_{name}", "0", at.domain))
    g.resistance(name, lambda flow: flow / c / sqrt(1 + (flow / (c * limit)) ** 2), at=middle)
    return Effect(
        "coupling_slip", name, "effort = x/sqrt(1 + (x/m)^2), x = slip/c", (c.name,), adds_state=True,
        shapes=(limit.name,), reference=_BELT_SLIP, dissipative=True,
        manoeuvre="light and heavy loads, with a sensor on each side",
    )  # fmt: skip


def path(g: BondGraph, at: Place, name: str) -> Handle:
    """The junction at which the difference of two junctions acts, bonded from the first and to the second."""
    assert at.other is not None  # such effects are offered pairs alone
    add = g.one_junction if at.junction.kind == "0" else g.zero_junction
    middle = add(f"path_{name}", at.domain)
    g.bond(at.junction, middle)
    g.bond(middle, at.other)
    return middle
