"""Problems with fewer free parameters keep what is known of those that stay, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.errors import EstimationError
from bondgraph.estimate.design.manoeuvres import Manoeuvre, planned_problem
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.priors import Normal
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.reduced import reduced
from tests.estimate.linear import ExactLikelihood, lag, simulated


def posed() -> EstimationProblem:
    """Mass and the start of one log free, drag tied to a number of no model, priors on two of them."""
    free = ["mass", "x0(v, run1)", FreeParameter("share", 0.1, 2.0, 0.5)]
    priors = (Normal("mass", 2.0, 0.5), Normal("x0(v, run1)", 0.0, 0.1))
    log = simulated("run1", 3, {"mass": 2.6}, 30)
    return pose(lag(), log, free, likelihood=ExactLikelihood(), ties={"drag": "share*mass"}, priors=priors)


def test_what_goes_takes_its_prior_along_and_leaves_all_else_in_place() -> None:
    whole = posed()
    found = reduced(whole, lambda target: target.kind == "parameter")
    assert found.names == ("mass", "share") and [prior.names for prior in found.priors] == [("mass",)]
    here, there = found.batch(found.start[:, np.newaxis]), whole.batch(whole.start[:, np.newaxis])
    np.testing.assert_array_equal(here.theta, there.theta)


def test_a_number_that_acts_through_a_tie_alone_goes_with_the_tie() -> None:
    assert reduced(posed(), lambda target: target.name == "mass").names == ("mass",)
    with pytest.raises(EstimationError, match="at least one free parameter"):
        reduced(posed(), lambda target: False)


def test_a_planned_manoeuvre_knows_nothing_of_the_start_of_a_log() -> None:
    whole = posed()
    plan = Manoeuvre("still", np.arange(20) * 0.05, np.zeros((1, 20)), {"v": 1.0})
    planned = planned_problem(whole, plan, whole.start)
    assert planned.names == ("mass", "share") and [tie.name for tie in planned.ties] == ["drag"]
