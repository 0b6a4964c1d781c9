"""Generate: readable numpy modules from state equations, and the check that they have not drifted."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.generate.drift import render_all as render_all
    from bondgraph.generate.module import render as render
    from bondgraph.generate.pipeline import RenderedGraph as RenderedGraph
    from bondgraph.generate.pipeline import render_graph as render_graph
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "generate.drift": "render_all",
            "generate.module": "render",
            "generate.pipeline": "RenderedGraph render_graph",
        },
    )
