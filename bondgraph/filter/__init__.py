"""Filter: unscented Kalman filters over compiled models, innovations and consistency."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.filter.adaptive import AdaptiveNoise as AdaptiveNoise
    from bondgraph.filter.bands import FilterBands as FilterBands
    from bondgraph.filter.choice import choose_method as choose_method
    from bondgraph.filter.degrees import with_likeliest_degrees as with_likeliest_degrees
    from bondgraph.filter.detector import ChangeDetector as ChangeDetector
    from bondgraph.filter.detector import Detection as Detection
    from bondgraph.filter.filter_model import FilterModel as FilterModel
    from bondgraph.filter.filter_run import FilterRun as FilterRun
    from bondgraph.filter.noise import Noise as Noise
    from bondgraph.filter.online import OnlineFilter as OnlineFilter
    from bondgraph.filter.online_state import FilterStep as FilterStep
    from bondgraph.filter.online_state import OnlineState as OnlineState
    from bondgraph.filter.robust import Robust as Robust
    from bondgraph.filter.runs import run as run
    from bondgraph.filter.runs import run_bands as run_bands
    from bondgraph.filter.runs import run_smoothed as run_smoothed
    from bondgraph.filter.smoother import SmootherRun as SmootherRun
    from bondgraph.filter.smoother import smooth as smooth
    from bondgraph.filter.smoother_bands import SmootherBands as SmootherBands
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "filter.adaptive": "AdaptiveNoise",
            "filter.bands": "FilterBands",
            "filter.choice": "choose_method",
            "filter.degrees": "with_likeliest_degrees",
            "filter.detector": "ChangeDetector Detection",
            "filter.filter_model": "FilterModel",
            "filter.filter_run": "FilterRun",
            "filter.noise": "Noise",
            "filter.online": "OnlineFilter",
            "filter.online_state": "FilterStep OnlineState",
            "filter.robust": "Robust",
            "filter.runs": "run run_bands run_smoothed",
            "filter.smoother": "SmootherRun smooth",
            "filter.smoother_bands": "SmootherBands",
        },
    )
