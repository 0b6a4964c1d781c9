"""Estimate: parameters that maximise the likelihood of measured logs."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.estimate.analysis.combinations import combinations as combinations
    from bondgraph.estimate.analysis.hessian import exact_hessian as exact_hessian
    from bondgraph.estimate.analysis.hessian import hessian as hessian
    from bondgraph.estimate.analysis.ranking import rank_parameters as rank_parameters
    from bondgraph.estimate.analysis.rates import rate_table as rate_table
    from bondgraph.estimate.analysis.screening import global_sensitivity as global_sensitivity
    from bondgraph.estimate.analysis.screening import likelihood_response as likelihood_response
    from bondgraph.estimate.analysis.screening import output_response as output_response
    from bondgraph.estimate.design.discrimination import Rival as Rival
    from bondgraph.estimate.design.discrimination import discriminate as discriminate
    from bondgraph.estimate.design.information import rank_manoeuvres as rank_manoeuvres
    from bondgraph.estimate.design.manoeuvres import Manoeuvre as Manoeuvre
    from bondgraph.estimate.estimation import Settings as Settings
    from bondgraph.estimate.estimation import estimate as estimate
    from bondgraph.estimate.free import FreeParameter as FreeParameter
    from bondgraph.estimate.joint import JointProblem as JointProblem
    from bondgraph.estimate.joint import pose_joint as pose_joint
    from bondgraph.estimate.likelihood_profile import likelihood_ratio as likelihood_ratio
    from bondgraph.estimate.likelihood_profile import profile_likelihood as profile_likelihood
    from bondgraph.estimate.objective import SearchOutcome as SearchOutcome
    from bondgraph.estimate.posterior import sample_posterior as sample_posterior
    from bondgraph.estimate.prediction import predict as predict
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
            "estimate.analysis.combinations": "combinations",
            "estimate.analysis.hessian": "exact_hessian hessian",
            "estimate.analysis.ranking": "rank_parameters",
            "estimate.analysis.rates": "rate_table",
            "estimate.analysis.screening": "global_sensitivity likelihood_response output_response",
            "estimate.design.discrimination": "Rival discriminate",
            "estimate.design.information": "rank_manoeuvres",
            "estimate.design.manoeuvres": "Manoeuvre",
            "estimate.estimation": "Settings estimate",
            "estimate.free": "FreeParameter",
            "estimate.joint": "JointProblem pose_joint",
            "estimate.likelihood_profile": "likelihood_ratio profile_likelihood",
            "estimate.objective": "SearchOutcome",
            "estimate.posterior": "sample_posterior",
            "estimate.prediction": "predict",
            "estimate.priors": "LogNormal MultivariateNormal Normal Uniform",
            "estimate.problem": "EstimationProblem pose",
            "estimate.result": "Estimate",
            "estimate.sensitivities": "sensitivity",
            "estimate.solvers.abstract": "AbstractSearch",
            "estimate.ties": "Tie",
        },
    )
