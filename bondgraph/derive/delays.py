"""Delays in laws: every input in one becomes an input of its own, which follows the first.

A delay is no finite number of states. That of an input needs none: a log or a simulation knows what the input was.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import sympy
from sympy import Dummy, Expr, Symbol

from bondgraph.declare.expressions import to_text
from bondgraph.declare.functions import delay
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Input, symbol
from bondgraph.errors import DerivationError


@dataclass(frozen=True)
class LateInputs:
    """The inputs of a flat graph that follow others, and what stands in the place of each delay.

    ``unused`` makes a name that nothing else has.

    Examples
    --------
    >>> g = BondGraph("sled")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("rope", delay(g.input("pull", "N"), 0.25), at=body)
    >>> [one.meaning for one in LateInputs.of(g, str).inputs]
    ['pull of 0.25 s before']
    """

    graph: BondGraph
    unused: Callable[[str], str]
    _made: dict[tuple[str, float], Input] = field(default_factory=dict, repr=False)
    _instead: dict[Expr, Expr] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, graph: BondGraph, unused: Callable[[str], str]) -> LateInputs:
        """The late inputs that the laws of a flat graph need.

        Raises
        ------
        DerivationError
            If what is delayed is no expression of inputs and parameters, or a delay no positive number of seconds.
        """
        found = cls(graph, unused)
        for where, law in _laws(graph):
            for one in _outermost(law):
                if one not in found._instead:
                    found._instead[one] = found._later(one, 0.0, where)
        return found

    @property
    def inputs(self) -> tuple[Input, ...]:
        """The late inputs."""
        return tuple(self._made.values())

    def law(self, expression: Expr) -> Expr:
        """The same law without delays."""
        return expression.xreplace(self._instead) if self._instead else expression

    def _later(self, one: Expr, further: float, where: str) -> Expr:
        """The expression in the place of a delay that is so many seconds longer; delays inside are added to it."""
        value, seconds = one.args
        if not seconds.is_Number or not 0.0 < float(seconds) < math.inf:
            raise DerivationError(
                f"{self.graph.name}: {where}: {to_text(value)} is delayed by {to_text(seconds)} - give a number of "
                "seconds above zero",
                where=(where,),
            )
        inner = {inside: Dummy() for inside in _outermost(value)}
        outer = value.xreplace(inner)
        known = {item.symbol: item for item in self.graph.inputs}
        foreign = (
            outer.free_symbols - known.keys() - {item.symbol for item in self.graph.parameters} - {*inner.values()}
        )
        if foreign:
            raise DerivationError(
                f"{self.graph.name}: {where}: {to_text(one)} delays {min(map(str, foreign))}, which is no input - "
                "delay inputs alone, of what the machine does use a lag",
                where=(where,),
            )
        by = further + float(seconds)
        late = {used: self._late(known[used], by) for used in sorted(outer.free_symbols & known.keys(), key=str)}
        later: Expr = outer.xreplace(late | {stand_in: self._later(own, by, where) for own, stand_in in inner.items()})
        return later

    def _late(self, given: Input, seconds: float) -> Symbol:
        """The symbol of an input so many seconds later."""
        if (given.name, seconds) not in self._made:
            name = self.unused(f"late_{given.name}_{sum(of == given.name for of, _ in self._made) + 1}")
            self._made[given.name, seconds] = given.late(name, seconds)
        return symbol(self._made[given.name, seconds].name)


def _outermost(law: Expr) -> list[Expr]:
    """Delays in a law that stand in no other, each once, in order of their text."""
    found: dict[Expr, None] = {}
    walk = sympy.preorder_traversal(law)
    for part in walk:
        if isinstance(part, delay):
            found[part] = None
            walk.skip()
    return sorted(found, key=str)


def _laws(graph: BondGraph) -> Iterator[tuple[str, Expr]]:
    """Everything in a flat graph that may hold a delay, and where it stands."""
    for node in graph.nodes.values():
        yield from ((node.name, law) for _, law in node.laws)
    yield from ((one.name, one.of) for one in graph.integrals)
    for one in graph.signals:
        yield from ((one.name, law) for law in (one.expression, one.guess) if law is not None)
    yield from ((one.name, one.expression) for one in graph.outputs)
