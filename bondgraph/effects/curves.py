"""Curves of laws: what an effect adds to a bench, or changes there, as numbers over the variable it depends on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import sympy
from sympy import Expr, Symbol

from bondgraph.arrays import FloatArray
from bondgraph.declare.domains import THERMAL
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.expressions import signal_name
from bondgraph.declare.functions import numeric
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.effects.benches import BENCHES, Bench
from bondgraph.effects.catalogue import Entry, added, every_effect
from bondgraph.effects.thermal import ROOM

#: Own variables of elements, in the order in which a law is drawn over them.
_OWN = ("flow", "effort", "displacement", "momentum")
_POINTS = 201
#: Temperatures over which laws of heat are drawn [K].
_TEMPERATURES = (ROOM - 50.0, ROOM + 200.0)
#: Coefficients are drawn at this share of their largest value.
_SHARE = 0.25


@dataclass(frozen=True)
class Curve:
    """A law over one variable: ``law`` with the effect, ``declared`` without it where the effect changes an element."""

    variable: str
    gives: str
    x: FloatArray
    law: FloatArray
    declared: FloatArray | None


def curve_of(entry: Entry) -> Curve | None:
    """The curve of an effect, None where its law acts in time or over several variables.

    Examples
    --------
    >>> from bondgraph.effects.catalogue import named
    >>> curve = curve_of(named("orifice_loss")[0])
    >>> curve.variable, curve.gives, bool(np.all(curve.x * curve.law >= 0.0))
    ('flow', 'effort', True)
    """
    function = every_effect()[entry.function]
    for domain, make in BENCHES.items():
        bench = make()
        for place, effect, graph in added(function, bench):
            # laws of heat are drawn where temperatures are absolute
            if effect.name == entry.name and (place.domain != THERMAL or domain == "thermal"):
                drawn = _slip_curve if effect.adds_state else _curve
                return drawn(bench, place, effect, graph)
    return None


def _slip_curve(bench: Bench, place: Place, effect: Effect, graph: BondGraph) -> Curve | None:
    """The curve of a slip: what it lets go has states of its own, itself has no memory."""
    node = graph.nodes.get(effect.element)
    if node is None or node.kind != "R":
        return None
    known = {one.symbol for one in graph.parameters}
    over = {one.name for one in node.laws[0][1].free_symbols - known}
    curve = _curve(bench, place, effect, graph) if over <= {"flow"} else None
    return None if curve is None else replace(curve, variable="slip")


def _curve(bench: Bench, place: Place, effect: Effect, graph: BondGraph) -> Curve | None:
    bounds = {one.name: one.bounds or (0.0, 0.0) for one in graph.parameters}
    values = {one.symbol: one.value for one in graph.parameters}
    values |= {symbol(name): _SHARE * bounds[name][1] for name in effect.coefficients}
    found = _law(graph, effect, place)
    if found is None:
        return None
    gives, law = found
    before = _law(bench.graph, effect, place)
    free = sorted((law if before is None else before[1]).free_symbols - set(values), key=_rank)
    if not free:
        free = sorted(law.free_symbols - set(values), key=_rank)
    if not free and before is None:
        free = [symbol("effort" if gives == "flow" else "flow")]
    if not free or free[0] in _remembered(graph):
        return None
    over = free[0]
    x = np.linspace(*_ends(over, place, graph), _POINTS)
    known = values | {one: _size(one, place, graph) for one in law.free_symbols - set(values) - {over}}
    sign = -1.0 if before is None and graph.nodes[effect.element].kind in ("Se", "Sf") else 1.0
    declared = None if before is None else _numbers(before[1], over, known, x)
    return Curve(
        str(over).removesuffix(f"_{effect.name}_{place.name}"), gives, x, sign * _numbers(law, over, known, x), declared
    )


def _law(graph: BondGraph, effect: Effect, place: Place) -> tuple[str, Expr] | None:
    """What the law of an effect gives, and its expression; None in a graph without its element."""
    if place.output:
        return "shown", next(one.expression for one in graph.outputs if one.name == place.output)
    node = graph.nodes.get(effect.element)
    return None if node is None or not node.laws else node.laws[0]


def _rank(one: Symbol) -> tuple[int, str]:
    return (_OWN.index(one.name) if one.name in _OWN else len(_OWN), one.name)


def _size(one: Symbol, place: Place, graph: BondGraph) -> float:
    """How large a variable is at a place."""
    read = signal_name(one)
    variable = one.name if read is None else read.variable
    if variable == "effort" and read is not None and place.domain != THERMAL and _is_warm(read.node, graph):
        return _TEMPERATURES[1]
    if variable == "effort":
        return ROOM if place.domain == THERMAL else place.scale.effort
    if variable == "displacement":
        return _stretch(place, graph)
    return place.scale.flow if variable == "flow" else place.scale.effort if place.output or read is None else 1.0


def _is_warm(node: str, graph: BondGraph) -> bool:
    """True for a body beside a machine: its temperature is shown warm, so that a law of it is another one than cold."""
    return node in graph.nodes and graph.nodes[node].domain == THERMAL


def _ends(over: Symbol, place: Place, graph: BondGraph) -> tuple[float, float]:
    """Between which values of a variable a law is drawn: both signs, but temperatures of a room and an oven."""
    read = signal_name(over)
    if place.domain == THERMAL and (over.name if read is None else read.variable) == "effort":
        half = 0.5 * (_TEMPERATURES[1] - _TEMPERATURES[0])
        return _TEMPERATURES if place.other is None or read is not None else (-half, half)
    size = _size(over, place, graph)
    return -size, size


def _remembered(graph: BondGraph) -> set[Symbol]:
    """Integrals that follow something with a time of their own, over which a law says nothing of what it does."""
    return {symbol(one.name) for one in graph.integrals if symbol(one.name) in one.of.free_symbols}


def _stretch(place: Place, graph: BondGraph) -> float:
    """The displacement at which the compliance of a place carries its effort, one where it has none."""
    values = {one.symbol: one.value for one in graph.parameters}
    for bond in graph.bonds:
        node = graph.nodes[bond.target]
        if bond.source == place.junction.name and node.kind == "C" and node.law("effort") is not None:
            slope = node.laws[0][1].subs(values | {symbol("displacement"): 1.0})
            if slope.is_number and slope != 0:
                return place.scale.effort / abs(float(slope))
    return 1.0


def _numbers(law: Expr, over: Symbol, known: dict[Symbol, float], x: FloatArray) -> FloatArray:
    plain = law.xreplace({one: sympy.Float(value) for one, value in known.items()})
    with np.errstate(divide="ignore"):  # a pole is a gap in the curve
        found = numeric([over], plain)(x)
    return np.broadcast_to(np.asarray(found, dtype=np.float64), x.shape).copy()
