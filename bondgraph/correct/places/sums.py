"""Outputs that add the efforts of elements at one 1-junction, or the flows of those at one 0-junction.

An effect that is added at the junction is another element there. Such an output lacks it, though a sensor of all that
acts there does not: what that shows of the effect has to be noise then, and the sizes of all else come out wrong.
"""

from __future__ import annotations

from collections.abc import Iterable

from sympy import Expr, Symbol

from bondgraph.declare.expressions import signal_name
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol

#: Variable that elements at a junction of each kind add up to, and the kind of the junction that has the sum.
_ADDED = {"1": ("effort", "0"), "0": ("flow", "1")}


def summed_outputs(graph: BondGraph, measured: Iterable[str]) -> tuple[str, ...]:
    """A sentence on each measured output that is a sum over elements at one junction, and what to declare instead.

    Examples
    --------
    >>> g = BondGraph("suspension")
    >>> mount, gap = g.zero_junction("mount"), g.one_junction("gap")
    >>> _ = g.flow_source("road", 1.0, at=mount), g.bond(mount, gap)
    >>> spring, damper = g.compliance("spring", 2e4, at=gap), g.resistance("damper", 1e3, at=gap)
    >>> g.measure("force", spring.effort + damper.effort, "N")
    >>> print(*summed_outputs(g, ["force"]))
    force is declared as the sum of the efforts of spring and damper, which lacks an effect that is added at gap: if the
    sensor sees that effect, the loop finds a wrong size or nothing there - declare the output as the effort of mount,
    which has all that acts at gap
    """
    flat = graph.flatten()
    wanted = set(measured)
    found = []
    for output in flat.outputs:
        if output.name not in wanted:
            continue
        for junction, node in flat.nodes.items():
            if node.kind in _ADDED:
                elements = _summed(flat, _written_out(flat, output.expression), junction)
                found += [_said(flat, output.name, junction, elements)] if len(elements) > 1 else []
    return tuple(found)


def _written_out(graph: BondGraph, expression: Expr) -> Expr:
    """An expression with what named signals stand for, which may use one another; implicit ones stay."""
    values = {symbol(one.name): one.expression for one in graph.signals if one.guess is None}
    for _ in values:
        if values.keys().isdisjoint(expression.free_symbols):
            break
        expression = expression.xreplace(values)
    return expression


def _summed(graph: BondGraph, expression: Expr, junction: str) -> list[str]:
    """Elements at a junction whose efforts (or flows) an expression adds with one factor; none if it differs."""
    variable = _ADDED[graph.nodes[junction].kind][0]
    inwards = {bond.source for bond in graph.bonds if bond.target == junction}
    own = inwards | {bond.target for bond in graph.bonds if bond.source == junction}
    used: dict[str, Symbol] = {}
    for one in expression.free_symbols:
        read = signal_name(one)
        if read is not None and read.variable == variable and read.node in own:
            node = graph.nodes[read.node]
            if node.ports == 1 and not node.is_junction:
                used[read.node] = one
    if len(used) < 2:
        return []
    factors = {expression.diff(one) * (-1 if name in inwards else 1) for name, one in used.items()}
    linear = all(one.free_symbols.isdisjoint(used.values()) for one in factors)
    return [name for name in graph.nodes if name in used] if len(factors) == 1 and linear else []


def _said(graph: BondGraph, output: str, junction: str, elements: list[str]) -> str:
    variable, other = _ADDED[graph.nodes[junction].kind]
    ends = [
        bond.source if bond.target == junction else bond.target
        for bond in graph.bonds
        if junction in (bond.source, bond.target)
    ]
    rest = [name for name in ends if name not in elements]
    if len(rest) == 1 and graph.nodes[rest[0]].kind == other:
        advice = f"declare the output as the {variable} of {rest[0]}, which has all that acts at {junction}"
    else:
        own = f"a {graph.nodes[junction].kind}-junction of their own behind a {other}-junction"
        advice = f"give these {own}, and measure the {variable} of that"
    listed = f"{', '.join(elements[:-1])} and {elements[-1]}"
    return (
        f"{output} is declared as the sum of the {variable}s of {listed}, which lacks an effect that is added at "
        f"{junction}: if the sensor sees that effect, the loop finds a wrong size or nothing there - {advice}"
    )
