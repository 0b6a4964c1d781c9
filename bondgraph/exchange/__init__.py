"""Exchange with other tools: C, FMUs, control, CasADi, filterpy, networkx, GraphML, BondGraphTools, DOT and Mermaid."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.exchange.bondgraphtools import read_bondgraphtools as read_bondgraphtools
    from bondgraph.exchange.c_source import c_source as c_source
    from bondgraph.exchange.casadi import to_casadi as to_casadi
    from bondgraph.exchange.control import from_control as from_control
    from bondgraph.exchange.control import to_control as to_control
    from bondgraph.exchange.diagrams import dot_text as dot_text
    from bondgraph.exchange.diagrams import mermaid_text as mermaid_text
    from bondgraph.exchange.fmu import export_fmu as export_fmu
    from bondgraph.exchange.fmu_import import fmu_outputs as fmu_outputs
    from bondgraph.exchange.fmu_variables import read_fmu as read_fmu
    from bondgraph.exchange.networks import from_networkx as from_networkx
    from bondgraph.exchange.networks import read_graphml as read_graphml
    from bondgraph.exchange.networks import write_graphml as write_graphml
    from bondgraph.filter.filterpy_bridge import filterpy_filter as filterpy_filter
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "exchange.bondgraphtools": "read_bondgraphtools",
            "exchange.c_source": "c_source",
            "exchange.casadi": "to_casadi",
            "exchange.control": "from_control to_control",
            "exchange.diagrams": "dot_text mermaid_text",
            "exchange.fmu": "export_fmu",
            "exchange.fmu_import": "fmu_outputs",
            "exchange.fmu_variables": "read_fmu",
            "exchange.networks": "from_networkx read_graphml write_graphml",
            "filter.filterpy_bridge": "filterpy_filter",
        },
    )
