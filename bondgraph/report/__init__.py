"""Report: plots, drawings, tables and the self-contained HTML page."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.report.comparison import Compared as Compared
    from bondgraph.report.comparison import compare as compare
    from bondgraph.report.correction import Correction as Correction
    from bondgraph.report.drawing import Drawing as Drawing
    from bondgraph.report.drawing import draw as draw
    from bondgraph.report.drawing import save_drawing as save_drawing
    from bondgraph.report.estimation import write_estimate as write_estimate
    from bondgraph.report.html import Provenance as Provenance
    from bondgraph.report.inspection import Inspection as Inspection
    from bondgraph.report.inspection import inspect as inspect
    from bondgraph.report.saved_correction import SavedCorrection as SavedCorrection
    from bondgraph.report.saved_correction import write_closed_loop as write_closed_loop
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "report.comparison": "Compared compare",
            "report.correction": "Correction",
            "report.drawing": "Drawing draw save_drawing",
            "report.estimation": "write_estimate",
            "report.html": "Provenance",
            "report.inspection": "Inspection inspect",
            "report.saved_correction": "SavedCorrection write_closed_loop",
        },
    )
