"""From a declared graph to the text of its module: causality, derivation, checks, text.

graph -> strokes (:mod:`bondgraph.derive.causality`) -> equations (:mod:`bondgraph.derive.derivation`) -> checked for
foreign names and for dimensions -> text (:mod:`bondgraph.generate.module`). Every command that needs the module of a
graph comes through here; :func:`bondgraph.build.build` loads the text as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import CausalGraph, assign_causality
from bondgraph.derive.derivation import Derivation, check_closed
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.derive.equations import StateEquations
from bondgraph.generate.module import render


@dataclass(frozen=True)
class RenderedGraph:
    """A graph on its way to a module: strokes and variables, equations, and the ``text`` of the module."""

    derivation: Derivation
    equations: StateEquations
    text: str

    @property
    def causal(self) -> CausalGraph:
        """The graph with its strokes."""
        return self.derivation.causal


def render_graph(
    graph: BondGraph,
    command: str | None = None,
    *,
    name: str = "",
    smooth: bool = True,
    bonds: bool = False,
    signals: bool = False,
) -> RenderedGraph:
    """The module of a graph, with what it was made from.

    Parameters
    ----------
    graph
        The declared graph.
    command
        The command that regenerates the module, for its header.
    name
        Name of the model, the graph's where omitted.
    smooth
        Take switches, friction and impacts as smooth laws; else with modes.
    bonds, signals
        Add efforts and flows of all bonds, or the named signals, to the outputs.

    Raises
    ------
    BondGraphError
        If the graph is refused anywhere on the way; the message says where and why.

    Examples
    --------
    >>> g = BondGraph("free_mass")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body)
    >>> "def rhs(t, x, u, theta):" in render_graph(g).text
    True
    """
    derivation = Derivation(assign_causality(graph), smooth)
    equations = derivation.equations(bonds, signals)
    check_closed(equations)
    check_dimensions(equations)
    equations = replace(equations, name=name or equations.name)
    return RenderedGraph(derivation, equations, render(equations, command))
