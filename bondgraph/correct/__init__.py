"""Correct: find the residual, locate it, explain it by a missing effect, add the effect to the graph."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.correct.loop import ClosedLoop as ClosedLoop
    from bondgraph.correct.loop import LoopSettings as LoopSettings
    from bondgraph.correct.loop import close_loop as close_loop
    from bondgraph.estimate.setup import filter_setup as filter_setup
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "estimate.setup": "filter_setup",
            "correct.loop": "ClosedLoop LoopSettings close_loop",
        },
    )
