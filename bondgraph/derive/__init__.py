"""Derive: causality, state equations, dependent storages, algebraic loops, dimensions, Jacobians."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.derive.causality import CausalGraph as CausalGraph
    from bondgraph.derive.causality import assign_causality as assign_causality
    from bondgraph.derive.derivation import derive as derive
    from bondgraph.derive.equations import StateEquations as StateEquations
    from bondgraph.derive.linearisation import LinearModel as LinearModel
    from bondgraph.derive.linearisation import linearise as linearise
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "derive.causality": "CausalGraph assign_causality",
            "derive.derivation": "derive",
            "derive.equations": "StateEquations",
            "derive.linearisation": "LinearModel linearise",
        },
    )
