"""Declare: domains, units, quantities, elements, graphs, composition and graph files."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.declare.domains import CHEMICAL as CHEMICAL
    from bondgraph.declare.domains import DOMAINS as DOMAINS
    from bondgraph.declare.domains import ELECTRICAL as ELECTRICAL
    from bondgraph.declare.domains import HYDRAULIC as HYDRAULIC
    from bondgraph.declare.domains import ROTATION as ROTATION
    from bondgraph.declare.domains import THERMAL as THERMAL
    from bondgraph.declare.domains import TRANSLATION as TRANSLATION
    from bondgraph.declare.domains import Domain as Domain
    from bondgraph.declare.effect import Effect as Effect
    from bondgraph.declare.effect import Place as Place
    from bondgraph.declare.effect import Scale as Scale
    from bondgraph.declare.effect import effect_functions as effect_functions
    from bondgraph.declare.files import load_graph as load_graph
    from bondgraph.declare.files import read_graph as read_graph
    from bondgraph.declare.files import write_graph as write_graph
    from bondgraph.declare.graph import BondGraph as BondGraph
    from bondgraph.declare.modal import clutch as clutch
    from bondgraph.declare.modal import friction as friction
    from bondgraph.declare.modal import impact as impact
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "declare.domains": "CHEMICAL DOMAINS Domain ELECTRICAL HYDRAULIC ROTATION THERMAL TRANSLATION",
            "declare.effect": "Effect Place Scale effect_functions",
            "declare.files": "load_graph read_graph write_graph",
            "declare.graph": "BondGraph",
            "declare.modal": "clutch friction impact",
        },
    )
