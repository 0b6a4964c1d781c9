"""Estimate: parameters that maximise the likelihood of measured logs."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.estimate.estimation import Settings as Settings
    from bondgraph.estimate.estimation import estimate as estimate
    from bondgraph.estimate.free import FreeParameter as FreeParameter
    from bondgraph.estimate.joint import JointProblem as JointProblem
    from bondgraph.estimate.joint import pose_joint as pose_joint
    from bondgraph.estimate.objective import SearchOutcome as SearchOutcome
    from bondgraph.estimate.priors import LogNormal as LogNormal
    from bondgraph.estimate.priors import MultivariateNormal as MultivariateNormal
    from bondgraph.estimate.priors import Normal as Normal
    from bondgraph.estimate.priors import Uniform as Uniform
    from bondgraph.estimate.problem import EstimationProblem as EstimationProblem
    from bondgraph.estimate.problem import pose as pose
    from bondgraph.estimate.result import Estimate as Estimate
    from bondgraph.estimate.sensitivities import sensitivity as sensitivity
    from bondgraph.estimate.solvers.abstract import AbstractSearch as AbstractSearch
    from bondgraph.estimate.ties import Tie as Tie
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "estimate.estimation": "Settings estimate",
            "estimate.free": "FreeParameter",
            "estimate.joint": "JointProblem pose_joint",
            "estimate.objective": "SearchOutcome",
            "estimate.priors": "LogNormal MultivariateNormal Normal Uniform",
            "estimate.problem": "EstimationProblem pose",
            "estimate.result": "Estimate",
            "estimate.sensitivities": "sensitivity",
            "estimate.solvers.abstract": "AbstractSearch",
            "estimate.ties": "Tie",
        },
    )
