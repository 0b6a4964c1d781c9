"""From a declared graph to a model that can be run: the whole design-time half in one call."""

from __future__ import annotations

from dataclasses import dataclass

from bondgraph.declare.domains import ROTATION, TRANSLATION, Domain
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.validation import node_domains
from bondgraph.derive.causality import CausalGraph, assign_causality
from bondgraph.derive.derivation import check_closed, derive
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.derive.equations import ImplicitLoop, State, StateEquations
from bondgraph.generate.module import render
from bondgraph.simulate.model import Model
from bondgraph.units import dimension


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
        """States that process noise drives by default.

        Unknown efforts act on flows and momenta. A displacement in mechanics follows from flows and nothing drives it
        alone; in other domains (charge, volume, heat) it has its own leaks and sources. Where that leaves none, all.
        """
        domains = node_domains(self.causal.graph)
        chosen = tuple(
            state.symbol.name
            for state in self.equations.states
            if state.variable in ("flow", "momentum") or not _is_mechanical(state, domains.get(state.element))
        )
        return chosen or tuple(state.symbol.name for state in self.equations.states)

    @property
    def implicit_loops(self) -> int:
        """Nonlinear algebraic loops that every evaluation solves."""
        return sum(isinstance(step, ImplicitLoop) for step in self.equations.assignments)


def _is_mechanical(state: State, domain: Domain | None) -> bool:
    """Whether a state is one of mechanics, by its unit where no domain is known; heat in J is no torque in N m."""
    mechanical = (TRANSLATION, ROTATION)
    if domain is not None:
        return domain in mechanical
    units = {dimension(unit) for one in mechanical for unit in (one.displacement_unit, one.effort_unit)}
    return dimension(state.unit) in units


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
