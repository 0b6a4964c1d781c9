"""Exponents: resistances whose effort follows a power of their flow, where a straight line is declared.

Turbulent flow through a pipe takes a pressure by the power 1.75, through an orifice by the power two; a radiator gives
heat by the power 1.3 of its temperature difference; polymers, varistors and porous walls have powers of their own.

References: White (2011), Fluid Mechanics, chapter 6, for pipes; EN 442-2 (2014) for radiators; Bird, Stewart, Lightfoot
(2002), Transport Phenomena, section 8.3, for fluids that follow a power law.
"""

from __future__ import annotations

from sympy import Expr

from bondgraph.declare.effect import SMOOTHING, Effect, Place, family
from bondgraph.declare.elements import Node
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_laws
from bondgraph.derive.laws import linear_coefficient
from bondgraph.effects.families import each_resistance
from bondgraph.effects.places import BENT, effort_unit, elements_at, flow_unit, gives_flow

_PIPES = "White (2011), Fluid Mechanics, chapter 6"


@family(each_resistance("resistance_exponent", lambda g, at, k: _bent(g, at, k)))
def resistance_exponent(g: BondGraph, at: Place) -> Effect | None:
    """A resistance that is declared as a line and follows a power: a hose, an orifice, a radiator, a leak.

    Of several resistances at a place a loop tries each.
    """
    return _bent(g, at, 0)


def _bent(g: BondGraph, at: Place, which: int) -> Effect | None:
    lines = elements_at(g, at, "R") if at.bond is None and at.junction.kind in ("0", "1") else []
    node = lines[which] if which < len(lines) else None
    given = None if node is None or "." in node.name else _given(g, node)
    if node is None or given is None:
        return None
    usual = _usual(g, node, given, at)
    if not usual > 0.0:
        return None
    own = "flow" if given == "effort" else "effort"
    effect = "resistance_exponent" if len(lines) == 1 else f"resistance_exponent_of_{node.name}"
    name = f"{effect}_{at.name}"
    b = g.parameter(f"b_{name}", 0.0, "1", f"exponent of {node.name} beyond a straight line", BENT)
    unit = flow_unit(at) if own == "flow" else effort_unit(at)
    right = g.parameter(f"r_{name}", float(f"{usual:.3g}"), unit, f"{own} at which {node.name} is as declared")
    share: Expr = ((symbol(own) / right) ** 2 + SMOOTHING**4) ** (b / 2)
    revise_laws(g, node.name, lambda laws: {given: laws[given] * share})
    return Effect(
        effect, node.name, f"{given} = declared*|{own}/r|^b", (b.name,), reference=_PIPES,
        manoeuvre="the same run at small and large levels",
    )  # fmt: skip


def _given(g: BondGraph, node: Node) -> str | None:
    """Variable that the law of a straight resistance gives: of both the one that causality asks for."""
    laws = dict(node.laws)
    asked = "effort" if len(laws) > 1 and not gives_flow(g, node.name) else "flow"
    given = asked if asked in laws else next(iter(laws))
    own = symbol("flow" if given == "effort" else "effort")
    slope = linear_coefficient(laws[given], own)
    return given if slope is not None and not slope.has(own) else None


def _usual(g: BondGraph, node: Node, given: str, at: Place) -> float:
    """Size of the own variable of a resistance: that of its place, or what its declared values make of it."""
    if at.junction.kind == ("1" if given == "effort" else "0"):
        return at.scale.flow if given == "effort" else at.scale.effort
    own = symbol("flow" if given == "effort" else "effort")
    known = {one.symbol: one.value for one in g.flatten().parameters}
    slope = dict(node.laws)[given].xreplace({own: symbol("t")}).coeff(symbol("t")).subs(known)
    size = at.scale.flow if given == "flow" else at.scale.effort
    steep = abs(float(slope)) if slope.is_number else 0.0
    return size / steep if steep > 0.0 else 0.0
