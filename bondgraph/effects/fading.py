"""What changes as a machine runs: copper that warms, oil that thins, a hot brake, a battery that is drawn from.

Reference: Reddy, Linden (2011), Linden's Handbook of Batteries, chapter 3, for cells; Incropera, DeWitt, Bergman,
Lavine (2007), Fundamentals of Heat and Mass Transfer, appendix A, for metals and oils.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import networkx as nx
from sympy import Abs, Expr, Integer, exp

from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, THERMAL
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Effect, Place, Scale, family
from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_laws
from bondgraph.effects.families import each_resistance
from bondgraph.effects.places import commanded, elements_at, has_flow
from bondgraph.effects.thermal import ROOM, Around, surroundings

#: Largest relative change per kelvin that is tried; copper has 0.004, a thermistor 0.05.
_STEEPEST = 0.05
#: Relative change per kelvin of a source or of its reciprocal: up to five times that of copper, and down so far that it
#: stays positive over 800 K. A convention.
_CHANGES = (-1.2e-3, 0.02)
#: Largest activation energy over the gas constant that is tried [K], of 100 kJ/mol: a convention.
_MOST_ACTIVE = 12000.0
#: Clogged resistances are scaled by so many times the clean one at the end of the longest log: a convention.
_MOST_CLOGGED = 10.0
_FILTERS = "Ruth, Montillon, Montonna (1933), Industrial and Engineering Chemistry 25(2), for cakes of filters"
#: Time in which the largest current may bring a battery to nothing [s]: 36 times its capacity per hour.
SHORTEST_DISCHARGE = 100.0


@family(each_resistance("temperature_dependence", lambda g, at, k: _straight(g, at, k)))
def temperature_dependence(g: BondGraph, at: Place) -> Effect | None:
    """A resistance that changes with the temperature of the nearest body of the graph, straight around a reference.

    That is a room's temperature where temperatures are known to be absolute, else the one around that body. Of several
    resistances at a place a loop tries each.
    """
    return _straight(g, at, 0)


def _straight(g: BondGraph, at: Place, which: int) -> Effect | None:
    found = _beside_a_body(g, at, which)
    if found is None:
        return None
    node, body, known, effect = found.of("temperature_dependence")
    name = f"{effect}_{at.name}"
    a = g.parameter(f"a_{name}", 0.0, "1/K", f"relative rise of {node.name} per kelvin", (-_STEEPEST, _STEEPEST))
    around = Integer(0) if known is None else known.temperature
    reference = g.parameter(f"T0_{name}", ROOM, "K", "where it is as declared") if _is_absolute(known) else around
    revise_laws(g, node.name, lambda laws: multiplied(laws, 1 + a * (body.effort - reference)))
    return Effect(
        effect, node.name, "effort = declared*(1 + a*(T - T0))", (a.name,),
        reference="Incropera, DeWitt, Bergman, Lavine (2007), Fundamentals of Heat and Mass Transfer, appendix A",
        manoeuvre="the same run cold and warm",
    )  # fmt: skip


@family(each_resistance("thermal_activation", lambda g, at, k: _arrhenius(g, at, k)))
def thermal_activation(g: BondGraph, at: Place) -> Effect | None:
    """A resistance by the law of Arrhenius of the nearest body: a cell's electrolyte, a thermistor, oil, a reaction.

    None where temperatures are not known to be absolute. Of several resistances at a place a loop tries each.
    """
    return _arrhenius(g, at, 0)


def _arrhenius(g: BondGraph, at: Place, which: int) -> Effect | None:
    found = _beside_a_body(g, at, which)
    if found is None or not _is_absolute(found.around):
        return None
    node, body, _, effect = found.of("thermal_activation")
    name = f"{effect}_{at.name}"
    steepest = (-_MOST_ACTIVE, _MOST_ACTIVE)
    b = g.parameter(f"b_{name}", 0.0, "K", f"activation energy of {node.name} over the gas constant", steepest)
    reference = g.parameter(f"T0_{name}", ROOM, "K", "where it is as declared")
    revise_laws(g, node.name, lambda laws: multiplied(laws, exp(b * (1 / body.effort - 1 / reference))))
    return Effect(
        effect, node.name, "effort = declared*exp(b*(1/T - 1/T0))", (b.name,),
        reference="Atkins, de Paula (2010), Physical Chemistry, for the law of Arrhenius",
        manoeuvre="the same run cold and warm",
    )  # fmt: skip


def source_temperature_dependence(g: BondGraph, at: Place) -> Effect | None:
    """A commanded source that falls as the nearest body warms: a heater at a voltage, a lamp, magnets of an actuator.

    What is declared holds in a room where temperatures are known to be absolute, else at what is around the body.
    """
    return _with_its_body(g, at, "source_temperature_dependence", "declared/(1 + a*(T - T0))", "fall", -1)


def source_temperature_rise(g: BondGraph, at: Place) -> Effect | None:
    """A commanded source that grows as the nearest body warms: the heat of a current in copper.

    What is declared holds in a room where temperatures are known to be absolute, else at what is around the body.
    """
    return _with_its_body(g, at, "source_temperature_rise", "declared*(1 + a*(T - T0))", "rise", 1)


def _with_its_body(g: BondGraph, at: Place, effect: str, law: str, way: str, power: int) -> Effect | None:
    """A source times a power of what is straight in the temperature of the nearest body."""
    sources = [node for node, _ in commanded(g, at, ("Se", "Sf")) if "." not in node.name]
    body = _nearest_body(g, at) if len(sources) == 1 else None
    if body is None:
        return None
    node, around = sources[0], surroundings(g, Place(body, Scale(0.0, 0.0)))
    given = "effort" if node.kind == "Se" else "flow"
    name = f"{effect}_{at.name}"
    a = g.parameter(f"a_{name}", 0.0, "1/K", f"relative {way} of {node.name} per kelvin", _CHANGES)
    room = g.parameter(f"T0_{name}", ROOM, "K", "where it is as declared") if _is_absolute(around) else Integer(0)
    zero = around.temperature if around is not None and not _is_absolute(around) else room
    revise_laws(g, node.name, lambda laws: {given: laws[given] * (1 + a * (body.effort - zero)) ** power})
    return Effect(
        effect, node.name, f"{given} = {law}", (a.name,),
        reference="Incropera, DeWitt, Bergman, Lavine (2007), Fundamentals of Heat and Mass Transfer, appendix A",
        manoeuvre="the same command cold and hot",
    )  # fmt: skip


@dataclass(frozen=True)
class _Beside:
    """A resistance, the nearest body, and what is around that; ``alone``: there is no other resistance at its place."""

    node: Node
    body: Handle
    around: Around | None
    alone: bool

    def of(self, effect: str) -> tuple[Node, Handle, Around | None, str]:
        """The parts, and the name of an effect, which tells several resistances apart."""
        return self.node, self.body, self.around, effect if self.alone else f"{effect}_of_{self.node.name}"


def _beside_a_body(g: BondGraph, at: Place, which: int) -> _Beside | None:
    """One of the resistances at a place, the nearest body, and what is around that; None where there is no such."""
    resistances = elements_at(g, at, "R") if at.bond is None and at.domain != THERMAL else []
    body = _nearest_body(g, at) if which < len(resistances) else None
    if body is None or "." in resistances[which].name:
        return None
    around = surroundings(g, Place(body, Scale(0.0, 0.0)))
    return _Beside(resistances[which], body, around, len(resistances) == 1)


def _is_absolute(known: Around | None) -> bool:
    return known is not None and known.zero == 0.0


def multiplied(laws: Mapping[str, Expr], factor: Expr) -> dict[str, Expr]:
    """The laws of a resistance that is a factor larger."""
    effort = symbol("effort")
    return {
        given: factor * law if given == "effort" else law.xreplace({effort: effort / factor})
        for given, law in laws.items()
    }


def clogging(g: BondGraph, at: Place) -> Effect | None:
    """A resistance that grows with what has passed it since the log began: a filter, a screen, a nozzle that scales."""
    found = elements_at(g, at, "R") if at.bond is None and at.domain == HYDRAULIC else []
    if len(found) != 1 or "." in found[0].name:
        return None
    node, name = found[0], f"clogging_{at.name}"
    most = _MOST_CLOGGED / (at.scale.flow * at.times[1])
    c = g.parameter(f"c_{name}", 0.0, "1/(m^3)", f"relative rise of {node.name} per volume passed", (0.0, most))
    passed = g.integral(f"passed_{name}", Abs(signal("flow", node.name)), "m^3", f"volume that has passed {node.name}")
    revise_laws(g, node.name, lambda laws: multiplied(laws, 1 + c * passed))
    return Effect(
        "clogging", node.name, "effort = declared*(1 + c*volume passed)", (c.name,), reference=_FILTERS,
        manoeuvre="a long run at a steady flow, the same levels at its beginning and its end",
    )  # fmt: skip


def charge_fading(g: BondGraph, at: Place) -> Effect | None:
    """A voltage that falls with the charge that was drawn: a battery declared as an ideal source."""
    sources = elements_at(g, at, "Se") if has_flow(at) and at.domain == ELECTRICAL else []
    if len(sources) != 1 or "." in sources[0].name or not _is_constant(g, sources[0]):
        return None
    name = f"charge_fading_{at.name}"
    limit = at.scale.effort / (at.scale.flow * SHORTEST_DISCHARGE)
    c = g.parameter(f"c_{name}", 0.0, "V/C", f"fall of {sources[0].name} per charge drawn", (0.0, limit))
    drawn = g.integral(f"drawn_{name}", at.junction.flow, "C", f"charge drawn from {sources[0].name}")
    revise_laws(g, sources[0].name, lambda laws: {"effort": laws["effort"] - c * drawn})
    return Effect(
        "charge_fading", sources[0].name, "effort = declared - c*charge drawn", (c.name,),
        reference="Reddy, Linden (2011), Linden's Handbook of Batteries, chapter 3",
        manoeuvre="a long discharge, and rest before and after",
    )  # fmt: skip


def _is_constant(g: BondGraph, node: Node) -> bool:
    """True for an element whose laws are made of parameters: no source that follows an input, or stands for a loss."""
    known = {one.symbol for one in g.flatten().parameters}
    return all(law.free_symbols <= known for _, law in node.laws)


def _nearest_body(g: BondGraph, at: Place) -> Handle | None:
    """The thermal junction with a heat capacity that is fewest bonds away, the first where none is connected."""
    flat = g.flatten()
    handles = [handle(g, node.name) for node in flat.nodes.values() if node.kind == "0" and node.domain == THERMAL]
    bodies = [one for one in handles if elements_at(g, Place(one, Scale(0.0, 0.0)), "C")]
    if not bodies:
        return None
    network: nx.Graph[str] = nx.Graph((bond.source, bond.target) for bond in flat.bonds)
    away = nx.single_source_shortest_path_length(network, at.junction.name) if at.junction.name in network else {}
    return min(bodies, key=lambda one: away.get(one.name, len(flat.nodes)))
