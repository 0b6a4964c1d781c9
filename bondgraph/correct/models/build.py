"""From a declared graph to a model that can be run: the whole design-time half in one call."""

from __future__ import annotations

from dataclasses import dataclass

from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import CausalGraph, assign_causality
from bondgraph.derive.derivation import check_closed, derive
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.derive.equations import ImplicitLoop, StateEquations
from bondgraph.generate.module import render
from bondgraph.simulate.model import Model


@dataclass(frozen=True)
class BuiltModel:
    """A graph and what was made of it; ``text`` is the generated module."""

    graph: BondGraph
    causal: CausalGraph
    equations: StateEquations
    text: str
    model: Model

    @property
    def driven(self) -> tuple[str, ...]:
        """States that process noise drives: flows and momenta, on which unknown efforts act."""
        return tuple(s.symbol.name for s in self.equations.states if s.variable in ("flow", "momentum"))

    @property
    def implicit_loops(self) -> int:
        """Nonlinear algebraic loops that every evaluation solves."""
        return sum(isinstance(step, ImplicitLoop) for step in self.equations.assignments)


def build(graph: BondGraph, command: str | None = None) -> BuiltModel:
    """Assign causality, derive, check dimensions, render and load.

    Parameters
    ----------
    graph
        The declared graph.
    command
        The command that regenerates the module, for its header.

    Raises
    ------
    BondGraphError
        If the graph is refused anywhere on the way; the message says where and why.

    Examples
    --------
    >>> g = BondGraph("free_mass")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body)
    >>> build(g).model.names("state")
    ('f_mass',)
    """
    causal = assign_causality(graph)
    equations = derive(causal)
    check_closed(equations)
    check_dimensions(equations)
    text = render(equations, command)
    return BuiltModel(graph, causal, equations, text, Model.from_text(text, source=graph.name))
