"""Exponents: resistances whose effort follows a power of their flow, or falls with it, where a line is declared.

Turbulent flow through a pipe takes a pressure by the power 1.75, through an orifice by the power two; a radiator gives
heat by the power 1.3 of its temperature difference; polymers, varistors and porous walls have powers of their own.

References: White (2011), Fluid Mechanics, chapter 6, for pipes; EN 442-2 (2014) for radiators; Bird, Stewart, Lightfoot
(2002), Transport Phenomena, section 8.3, for fluids that follow a power law; Wouterse (1991), IEE Proceedings B 138(4),
for brakes by eddy currents.
"""

from __future__ import annotations

from dataclasses import dataclass

from sympy import Expr

from bondgraph.declare.effect import SMOOTHING, Effect, Place, family
from bondgraph.declare.elements import Node
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_laws
from bondgraph.derive.laws import linear_coefficient
from bondgraph.effects.families import each_resistance
from bondgraph.effects.places import BENT, effort_unit, elements_at, flow_unit, gives_flow, is_motion

_PIPES = "White (2011), Fluid Mechanics, chapter 6"
_EDDY = "Wouterse (1991), IEE Proceedings B 138(4)"
#: Square of the usual speed over the critical one: from none, which is zero, to a critical speed of a third of the
#: usual one, a convention.
_CRITICAL = (0.0, 10.0)


@family(each_resistance("resistance_exponent", lambda g, at, k: _bent(g, at, k)))
def resistance_exponent(g: BondGraph, at: Place) -> Effect | None:
    """A resistance that is declared as a line and follows a power: a hose, an orifice, a radiator, a leak.

    Of several resistances at a place a loop tries each.
    """
    return _bent(g, at, 0)


@family(each_resistance("critical_speed", lambda g, at, k: _falling(g, at, k)))
def critical_speed(g: BondGraph, at: Place) -> Effect | None:
    """A drag that follows a command and falls beyond a critical speed: an eddy-current brake, a slip coupling.

    The critical speed is r over the root of c. Of several drags at a place a loop tries each; one that follows nothing
    has ``eddy_current_drag`` beside it.
    """
    return _falling(g, at, 0)


def _bent(g: BondGraph, at: Place, which: int) -> Effect | None:
    line = _line(g, at, which, "resistance_exponent")
    if line is None:
        return None
    b = g.parameter(f"b_{line.name}", 0.0, "1", f"exponent of {line.node} beyond a straight line", BENT)
    share: Expr = (line.share(g) ** 2 + SMOOTHING**4) ** (b / 2)
    revise_laws(g, line.node, lambda laws: {line.given: laws[line.given] * share})
    return Effect(
        line.effect, line.node, f"{line.given} = declared*|{line.own}/r|^b", (b.name,), reference=_PIPES,
        manoeuvre="the same run at small and large levels",
    )  # fmt: skip


def _falling(g: BondGraph, at: Place, which: int) -> Effect | None:
    line = _line(g, at, which, "critical_speed") if is_motion(at) else None
    if line is None or line.given != "effort" or not line.follows:
        return None
    c = g.parameter(f"c_{line.name}", 0.0, "1", f"square of r over the critical speed of {line.node}", _CRITICAL)
    fallen = 1 + c * line.share(g) ** 2
    revise_laws(g, line.node, lambda laws: {line.given: laws[line.given] / fallen})
    return Effect(
        line.effect, line.node, "effort = declared/(1 + c*(flow/r)^2)", (c.name,), reference=_EDDY,
        manoeuvre="slow and fast motion in one log",
    )  # fmt: skip


@dataclass(frozen=True)
class _Line:
    """A resistance declared as a line: its name, that of an effect on it, what it gives, and its own variable.

    ``follows`` is true for one whose slope is no constant: it follows an input, or a signal of the graph.
    """

    node: str
    effect: str
    name: str
    given: str
    usual: float
    unit: str
    follows: bool

    @property
    def own(self) -> str:
        """The variable that its law is a function of."""
        return "flow" if self.given == "effort" else "effort"

    def share(self, g: BondGraph) -> Expr:
        """Its own variable over the usual one, a parameter."""
        meaning = f"{self.own} at which {self.node} is as declared"
        return symbol(self.own) / g.parameter(f"r_{self.name}", float(f"{self.usual:.3g}"), self.unit, meaning)


def _line(g: BondGraph, at: Place, which: int, effect: str) -> _Line | None:
    """The resistance at a place that an effect bends; None where there is none, or it is no line."""
    lines = elements_at(g, at, "R") if at.bond is None and at.junction.kind in ("0", "1") else []
    node = lines[which] if which < len(lines) else None
    given = None if node is None or "." in node.name else _given(g, node)
    if node is None or given is None:
        return None
    usual = _usual(g, node, given, at)
    if not usual > 0.0:
        return None
    named = effect if len(lines) == 1 else f"{effect}_of_{node.name}"
    unit = flow_unit(at) if given == "effort" else effort_unit(at)
    slope = linear_coefficient(dict(node.laws)[given], symbol("flow" if given == "effort" else "effort"))
    constants = {one.symbol for one in g.flatten().parameters}
    follows = slope is not None and not slope.free_symbols <= constants
    return _Line(node.name, named, f"{named}_{at.name}", given, usual, unit, follows)


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
