"""Heat that a body gives away or takes up: to what is around, by conduction, convection and radiation; its capacity.

Effort is a temperature and flow a heat flow, whose product is no power. Here a loss means that heat flows from hot to
cold: away from the body while it is warmer than what is around, into it while it is colder. What is around is the
temperature source next to the body in the graph, or the temperature at which a declared loss of the body vanishes;
where neither is declared it is zero for temperatures that are a rise, and a room for absolute ones. Temperatures may be
declared in kelvin, in degrees or as a rise above what is around; their size tells which.

Reference: Incropera, DeWitt, Bergman, Lavine (2007), Fundamentals of Heat and Mass Transfer.
"""

from __future__ import annotations

from dataclasses import dataclass

import networkx as nx
from sympy import Expr, Float, Integer, tanh

from bondgraph.declare.domains import THERMAL
from bondgraph.declare.effect import Effect, Place, between_junctions
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.derive.laws import affine_parts
from bondgraph.effects.between import path
from bondgraph.effects.places import conductance, effort_unit, elements_at, flow_unit, has_effort, over

_HEAT = "Incropera, DeWitt, Bergman, Lavine (2007), Fundamentals of Heat and Mass Transfer"
#: Temperatures whose size exceeds this are absolute: a body that is never warmer than this is not at room temperature,
#: and few are this much warmer than what is around [K].
ABSOLUTE_ABOVE = 200.0
#: Powers of the difference in temperature within which that of convection is searched: 5/4 and 4/3 of laminar and of
#: turbulent layers (Incropera et al., section 9.6) with as much room on either side. The room is a convention.
_POWERS = (1.1, 1.4)
#: Where a change of phase is looked for, as shares of the largest difference in temperature from what is around: as far
#: below as above, by steps that the width of a search spans. A convention.
_MELTING = (-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0)
#: Temperature of a room [K], and of the zero of the Celsius scale.
ROOM, CELSIUS_ZERO = 293.15, 273.15
#: Temperatures between which what is around is searched where nothing declares it [K]: those of a day in any climate.
#: A convention.
_OUTSIDE = (223.15, 323.15)


@dataclass(frozen=True)
class Around:
    """The surroundings of a body: their temperature in the graph's own scale, and what that scale's zero is in kelvin.

    ``assumed``: nothing declares it, and it is taken as that of a room.
    """

    temperature: Expr
    zero: float
    assumed: bool = False

    def declared(self, g: BondGraph, name: str) -> tuple[Expr, tuple[str, ...]]:
        """The temperature; where it is assumed as a parameter, and the name of that, which the logs may ask for."""
        if not self.assumed:
            return self.temperature, ()
        about = "what is around, a room where nothing says it"
        around = g.parameter(f"around_{name}", float(self.temperature), "K", about, _OUTSIDE)
        return around, (around.name,)

    def absolute(self, g: BondGraph, name: str) -> tuple[Expr, str]:
        """The zero as an expression, and its parameter; no parameter where temperatures are absolute."""
        if self.zero == 0.0:
            return Integer(0), ""
        zero = g.parameter(f"zero_{name}", self.zero, "K", "absolute temperature at the zero of the graph's scale")
        return zero, zero.name


def heat_loss(g: BondGraph, at: Place) -> Effect | None:
    """Heat given away in proportion to the difference in temperature: poor insulation, a support that conducts."""
    around = surroundings(g, at)
    if around is None:
        return None
    name, c = conductance(g, at, "heat_loss", "conductance", over(flow_unit(at), effort_unit(at)), 1)
    outside, asked = around.declared(g, name)
    g.resistance(name, flow=lambda effort: c * (effort - outside), at=at.junction)
    return Effect(
        "heat_loss", name, "flow = c*(effort - around)", (c.name,), reference=f"{_HEAT}, section 3.1",
        dissipative=True, widths=asked, manoeuvre="a body that cools with no heat added",
    )  # fmt: skip


def convection(g: BondGraph, at: Place) -> Effect | None:
    """Heat given to still air, which moves the faster the warmer the body is: the power 5/4 of the difference.

    Laminar layers give 5/4, turbulent ones 4/3, a little more where both meet.
    """
    around = surroundings(g, at)
    if around is None:
        return None
    name = f"convection_{at.name}"
    size = _difference(at)
    c = g.parameter(f"c_{name}", 0.0, flow_unit(at), f"heat flow at {size:g} K", (0.0, 0.5 * at.scale.flow))
    reach = g.parameter(f"e_{name}", size, "K", "difference in temperature of that flow")
    n = g.parameter(f"n_{name}", 1.25, "1", "power of the difference in temperature", _POWERS)
    w = at.smoothing
    outside, asked = around.declared(g, name)

    def law(effort: Expr) -> Expr:
        x = (effort - outside) / reach
        return c * x * (x**2 + w**2) ** ((n - 1) / 2)

    g.resistance(name, flow=law, at=at.junction)
    return Effect(
        "convection", name, "flow = c*x*(x^2 + w^2)^((n - 1)/2), x = (effort - around)/e", (c.name,),
        reference=f"{_HEAT}, sections 9.6 and 9.7", dissipative=True, widths=(n.name, *asked),
        manoeuvre="cooling from the highest temperature to that around",
    )  # fmt: skip


def radiation(g: BondGraph, at: Place) -> Effect | None:
    """Heat radiated: it grows with the fourth power of the absolute temperature."""
    around = surroundings(g, at)
    if around is None:
        return None
    name = f"radiation_{at.name}"
    c = _radiating(g, at, name, around.zero)
    zero, _ = around.absolute(g, name)
    outside, asked = around.declared(g, name)
    g.resistance(name, flow=lambda e: c * ((e + zero) ** 4 - (outside + zero) ** 4), at=at.junction)
    return Effect(
        "radiation", name, "flow = c*((effort + z)^4 - (around + z)^4)", (c.name,),
        reference=f"{_HEAT}, section 13.3; Stefan (1879)", dissipative=True, widths=asked,
        manoeuvre="hot and cool runs, each until the temperature settles",
    )  # fmt: skip


def varying_heat_capacity(g: BondGraph, at: Place) -> Effect | None:
    """Heat capacity that changes with temperature: metals, oils, a substance about to melt."""
    around = surroundings(g, at)
    stores = elements_at(g, at, "C") if around is not None else []
    law = stores[0].law("effort") if len(stores) == 1 else None
    parts = None if law is None else affine_parts(law, symbol("displacement"))
    if around is None or parts is None or "." in stores[0].name or symbol("displacement") in parts[0].free_symbols:
        return None
    name = f"varying_heat_capacity_{at.name}"
    limit = 0.5 / _difference(at)
    c = g.parameter(f"c_{name}", 0.0, "1/K", "relative rise of the heat capacity per kelvin", (-limit, limit))
    # an input, which moves, is no constant of the body: its capacity is then declared at the temperature of a room
    fixed = around.temperature.free_symbols <= _parameters(g)
    middle = around.temperature if fixed else Float(ROOM - around.zero)
    g.compliance(name, displacement=lambda e: c * (e - middle) ** 2 / (2 * parts[0]), at=at.junction)
    return Effect(
        "varying_heat_capacity", name, "capacity = declared*(1 + c*(effort - around))", (c.name,),
        reference=f"{_HEAT}, section 2.2.2", manoeuvre="equal steps of heat at low and high temperature",
    )  # fmt: skip


def latent_heat(g: BondGraph, at: Place) -> Effect | None:
    """Heat that a change of phase takes up around one temperature: ice, wax, solder, water in what dries."""
    around = surroundings(g, at)
    stores = elements_at(g, at, "C") if around is not None else []
    if around is None or len(stores) != 1 or "." in stores[0].name:
        return None
    name, size = f"latent_heat_{at.name}", _difference(at)
    values = {one.symbol: one.value for one in g.flatten().parameters}
    fixed = around.temperature.free_symbols <= set(values)
    middle = float(around.temperature.subs(values)) if fixed else ROOM - around.zero
    at_values = tuple(middle + share * size for share in _MELTING)
    limit = at.scale.flow * at.times[1]
    c = g.parameter(f"c_{name}", 0.0, "J", f"latent heat of {at.label}", (0.0, limit))
    melts = g.parameter(f"T_{name}", middle, "K", "middle of the change of phase", (at_values[0], at_values[-1]))
    width = g.parameter(f"w_{name}", at.smoothing * size, "K", "width of it", (1e-3 * size, size))
    g.compliance(name, displacement=lambda e: c * (1 + tanh((e - melts) / width)) / 2, at=at.junction)
    return Effect(
        "latent_heat", name, "heat = declared + c*(1 + tanh((effort - T)/w))/2", (c.name,), shapes=(melts.name,),
        widths=(width.name,), grids=((melts.name, at_values),), reference=_HEAT,
        manoeuvre="slow warming and cooling through the change of phase",
    )  # fmt: skip


@between_junctions
def radiation_between(g: BondGraph, at: Place) -> Effect | None:
    """Heat radiated from one body to another beside what conducts between them."""
    if at.other is None or at.junction.kind != "0" or at.domain != THERMAL or at.other.domain != THERMAL:
        return None
    name = f"radiation_between_{at.name}"
    first, second = at.junction.effort, at.other.effort
    known = [one for end in (at.junction, at.other) if (one := surroundings(g, Place(end, at.scale))) is not None]
    around = Around(Integer(0), min(one.zero for one in known))
    c = _radiating(g, at, name, around.zero)
    zero, _ = around.absolute(g, name)
    g.resistance(
        name, flow=lambda effort: c * ((first + zero) ** 4 - (second + zero) ** 4), at=path(g, at, name)
    )  # fmt: skip
    return Effect(
        "radiation_between", name, "flow = c*((first + z)^4 - (second + z)^4)", (c.name,),
        reference=f"{_HEAT}, section 13.3; Stefan (1879)", dissipative=True,
        manoeuvre="one body hot and the other cool, then both warm",
    )  # fmt: skip


def surroundings(g: BondGraph, at: Place) -> Around | None:
    """What is around a thermal 0-junction, None at any other place."""
    if not has_effort(at) or at.domain != THERMAL:
        return None
    absolute = max(at.scale.effort, _initial_temperature(g, at)) > ABSOLUTE_ABOVE
    source = _nearest_source(g, at.junction.name)
    if source is not None:
        return Around(source, 0.0 if absolute else CELSIUS_ZERO)
    for node in elements_at(g, at, "R"):
        law = node.law("flow")
        parts = None if law is None else affine_parts(law, symbol("effort"))
        if parts is not None and parts[1] != 0 and "." not in node.name:
            return Around(-parts[1] / parts[0], 0.0 if absolute else CELSIUS_ZERO)
    return Around(Float(ROOM), 0.0, assumed=True) if absolute else Around(Integer(0), ROOM)


def _initial_temperature(g: BondGraph, at: Place) -> float:
    """The temperature at which the heat stored at a junction starts, zero where nothing declares it."""
    values = {parameter.symbol: parameter.value for parameter in g.flatten().parameters}
    for node in elements_at(g, at, "C"):
        law = node.law("effort")
        start = None if law is None else law.subs({**values, symbol("displacement"): node.initial[0]})
        if start is not None and start.is_number:
            return abs(float(start))
    return 0.0


def _nearest_source(g: BondGraph, junction: str) -> Expr | None:
    """The temperature of the source nearest to a junction, through thermal junctions alone.

    It is as seen from there: a source whose bond points to a difference counts against the body on its other side.
    """
    flat = g.flatten()
    kept = {node.name for node in flat.nodes.values() if node.is_junction or node.kind == "Se"}
    network = nx.Graph((bond.source, bond.target) for bond in flat.bonds if {bond.source, bond.target} <= kept)
    if junction not in network:
        return None
    ways = nx.single_source_shortest_path(network, junction)
    found = [(len(way), name) for name, way in ways.items() if flat.nodes[name].kind == "Se"]
    if not found:
        return None
    nearest = min(found)[1]
    way, targets, turned = ways[nearest], {(bond.source, bond.target) for bond in flat.bonds}, False
    for before, at, after in zip(way, way[1:], way[2:], strict=False):
        # efforts at a 1-junction add up to nothing, those of bonds that leave it with a minus
        if flat.nodes[at].kind == "1" and ((before, at) in targets) == ((after, at) in targets):
            turned = not turned
    seen = signal("effort", nearest)
    return -seen if turned else seen


def _radiating(g: BondGraph, at: Place, name: str, zero: float) -> Expr:
    """A coefficient of radiation whose largest value gives off the heat flow of the place at its temperature."""
    hottest = max(at.scale.effort + zero, ROOM)
    limit = at.scale.flow / hottest**4
    return g.parameter(f"c_{name}", 0.0, over(flow_unit(at), "K", 4), "emissivity times area times sigma", (0, limit))


def _difference(at: Place) -> float:
    """A difference in temperature as it may occur: the size of a rise, or what absolute ones exceed a room by."""
    size = at.scale.effort
    return size if size <= ABSOLUTE_ABOVE else max(size - ROOM, 0.1 * ROOM)


def _parameters(g: BondGraph) -> set[Expr]:
    return {parameter.symbol for parameter in g.flatten().parameters}
