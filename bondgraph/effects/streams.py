"""Streams: what an input makes of a resistance declared as a constant, and what pressure makes of a valve's flow.

Air that is blown over fins, water that runs through a jacket or a nozzle that opens change a resistance by a power of
their size. Reference: Incropera, DeWitt, Bergman, Lavine (2007), Fundamentals of Heat and Mass Transfer, chapters 7 and
8: heat passes into a stream by the power 0.5 of its speed where it is laminar, and up to 0.8 where it is turbulent;
Merritt (1967), Hydraulic Control Systems, for valves.
"""

from __future__ import annotations

from collections.abc import Mapping

from sympy import Expr, sign, sqrt

from bondgraph.declare.domains import HYDRAULIC
from bondgraph.declare.effect import SMOOTHING, Effect, EffectFunction, Place, family
from bondgraph.declare.elements import Node
from bondgraph.declare.functions import maximum
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Input
from bondgraph.declare.revision import revise_law, revise_laws
from bondgraph.effects.fading import multiplied
from bondgraph.effects.places import commands, effort_unit, elements_at, followed

_STREAMS = "Incropera, DeWitt, Bergman, Lavine (2007), Fundamentals of Heat and Mass Transfer, chapters 7 and 8"
#: Powers within which one is searched: that of a jet's pressure is two, that of a laminar layer half. A convention.
_SPAN = (-3.0, 3.0)
_VALVES = "Merritt (1967), Hydraulic Control Systems"
#: Share of the supply pressure that the largest pressure of the place may reach, and share of the drop that is left
#: beyond: a valve gives nothing against its whole supply, where the root has no slope. Conventions.
_REACHED, _LEFT = 0.95, 0.01


def _members(g: BondGraph, typical: Mapping[str, float]) -> list[EffectFunction]:
    """The law for each input that varies, by its typical size."""
    return [_following(one, size) for one in g.inputs if (size := typical.get(one.name, 0.0)) > 0.0]


@family(_members)
def resistance_by_input(g: BondGraph, at: Place) -> Effect | None:
    """A resistance that changes with a power of an input: of a stream, of an opening, of the speed of a fan.

    A loop tries it with every input that varies.
    """
    found = _constant_at(g, at)
    inputs = [one for one in g.inputs if not (one.is_held and one.unit in ("", "1"))]
    if found is None or not inputs:
        return None
    return _declared(g, at, found, inputs[0], inputs[0].default or 1.0, "resistance_by_input")


def _following(given: Input, size: float) -> EffectFunction:
    def following(g: BondGraph, at: Place) -> Effect | None:
        found = _constant_at(g, at)
        return None if found is None else _declared(g, at, found, given, size, following.__name__)

    following.__name__ = f"resistance_by_{given.name.replace('.', '_')}"
    return following


def _constant_at(g: BondGraph, at: Place) -> Node | None:
    """The only resistance at a place, if no input acts on it yet."""
    found = elements_at(g, at, "R") if at.bond is None and at.junction.kind in ("0", "1") else []
    return found[0] if len(found) == 1 and "." not in found[0].name and not commands(g, at, found[0]) else None


def _declared(g: BondGraph, at: Place, node: Node, given: Input, size: float, effect: str) -> Effect:
    name = f"{effect}_{at.name}"
    n = g.parameter(f"n_{name}", 0.0, "1", f"power of {given.name} in {node.name}", _SPAN)
    usual = g.parameter(
        f"r_{name}", float(f"{size:.3g}"), given.unit, f"{given.name} at which {node.name} is as declared"
    )
    share: Expr = ((given.symbol / usual) ** 2 + SMOOTHING**2) ** (n / 2)
    revise_laws(g, node.name, lambda laws: multiplied(laws, share))
    return Effect(
        effect, node.name, f"effort = declared*|x/r|^n, x = {given.name}", (n.name,), reference=_STREAMS,
        manoeuvre=f"the same run at several levels of {given.name}",
    )  # fmt: skip


def valve_load_flow(g: BondGraph, at: Place) -> Effect | None:
    """A valve whose flow falls as the load takes up the pressure of its supply: by the root of what is left.

    A source of flow that follows a command gives it whatever the pressure. At an opening the drop is what the supply
    has beyond the load; where the flow is turned round, the load helps.
    """
    if at.bond is not None or at.domain != HYDRAULIC or at.junction.kind != "0":
        return None
    # the stroke of a spool has no unit, and may be held between samples
    found = [one for one in elements_at(g, at, "Sf") if "." not in one.name and one.law("flow") and followed(g, one)]
    if not found:
        return None
    name, node = f"valve_load_flow_{at.name}", found[0].name
    c = g.parameter(f"c_{name}", 0.0, "1", "share of the supply that the largest pressure is", (0.0, _REACHED))
    most = g.parameter(f"r_{name}", at.scale.effort, effort_unit(at), "largest pressure")

    def law(declared: Expr) -> Expr:  # where the sign changes the flow is zero, so that it needs no width
        against = c * (at.junction.effort / most) * sign(declared)
        return declared * sqrt(maximum(1 - against, _LEFT))

    revise_law(g, node, "flow", law)
    return Effect(
        "valve_load_flow", node, "flow = declared*sqrt(1 - c*x*sign(declared)), x = effort/r", (c.name,),
        reference=_VALVES, manoeuvre="the same openings against small and large loads, either way",
    )  # fmt: skip
