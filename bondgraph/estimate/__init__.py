"""Estimate: parameters that maximise the likelihood of measured logs."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.estimate.estimation import Settings as Settings
    from bondgraph.estimate.estimation import estimate as estimate
    from bondgraph.estimate.free import FreeParameter as FreeParameter
    from bondgraph.estimate.objective import SearchOutcome as SearchOutcome
    from bondgraph.estimate.problem import EstimationProblem as EstimationProblem
    from bondgraph.estimate.problem import pose as pose
    from bondgraph.estimate.result import Estimate as Estimate
    from bondgraph.estimate.sensitivities import sensitivity as sensitivity
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "estimate.estimation": "Settings estimate",
            "estimate.free": "FreeParameter",
            "estimate.objective": "SearchOutcome",
            "estimate.problem": "EstimationProblem pose",
            "estimate.result": "Estimate",
            "estimate.sensitivities": "sensitivity",
        },
    )
