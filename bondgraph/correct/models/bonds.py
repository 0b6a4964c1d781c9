"""A model that gives the effort and flow of every bond."""

from __future__ import annotations

from bondgraph.build import model_of
from bondgraph.derive.causality import CausalGraph
from bondgraph.derive.derivation import Derivation
from bondgraph.simulate.model import Model


def bond_model(causal: CausalGraph) -> Model:
    """The model of a graph whose outputs are followed by the effort of every bond, then by the flow of every bond.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> g = BondGraph("mass")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body)
    >>> bond_model(assign_causality(g)).names("output")
    ('effort(body->mass)', 'flow(body->mass)')
    """
    equations = Derivation(causal).equations(bonds=True)
    return model_of(equations, f"{causal.graph.name} (bonds)")
