"""Which of several gradient searches go on, and what is told of those that do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.solvers.gauss_newton import GaussNewton, GaussNewtonState
from bondgraph.estimate.solvers.race import race_ends, raced
from tests.estimate.linear import ExactLikelihood, lag, simulated

TRUTH = {"mass": 2.6, "drag": 2.2, "process": 0.15, "speed": 0.08}


def problem() -> EstimationProblem:
    logs = [simulated("run1", 0, TRUTH), simulated("run2", 100, TRUTH, x0=1.0, load=1.5)]
    return pose(lag(), logs, ["mass", "drag", "std(speed)"], likelihood=ExactLikelihood())


def state(points: list[list[float]], values: list[float], pace: list[float], iteration: int = 5) -> GaussNewtonState:
    given = GaussNewton().init(problem(), np.array(points).T)
    outcomes = (None,) * len(values)
    return replace(given, iteration=iteration, values=np.array(values), pace=np.array(pace), outcomes=outcomes)


APART = [[2.6, 2.2, -2.5], [2.0, 2.0, -2.5], [2.60001, 2.20001, -4.0]]


def test_a_start_far_behind_is_given_up_unless_it_gains_fast_or_has_only_begun() -> None:
    for pace, iteration, outcome in (
        (1.0, 5, SearchOutcome.GIVEN_UP),
        (30.0, 5, None),
        (1.0, 2, None),
    ):
        after = raced(problem(), state(APART[:2], [10.0, 130.0], [0.0, pace], iteration))
        assert after.outcomes == (None, outcome)
    close = raced(problem(), state(APART[:2], [10.0, 19.0], [0.0, 0.0]))
    assert close.outcomes == (None, None)


def test_a_start_that_is_where_a_better_one_is_joins_it_whatever_the_noise() -> None:
    after = raced(problem(), state(APART, [10.0, 11.0, 12.0], [1.0, 1.0, 1.0]))
    assert after.outcomes == (None, None, SearchOutcome.JOINED)
    ended = replace(after, outcomes=(SearchOutcome.CONVERGED, SearchOutcome.GIVEN_UP, SearchOutcome.JOINED))
    ends = race_ends(problem(), ended)
    assert [value for _, value in ends] == [10.0, 10.0]
    np.testing.assert_array_equal(ends[0][0], ends[1][0])


def test_levels_of_noise_tell_starts_apart_where_nothing_else_is_free() -> None:
    one = problem()
    noise = pose(lag(), one.logs, ["std(speed)"], likelihood=ExactLikelihood())
    given = GaussNewton().init(noise, np.array([[-2.5, -4.0]]))
    after = raced(noise, replace(given, values=np.array([1.0, 2.0])))
    assert after.outcomes == (None, None)


def test_without_a_finite_value_nobody_leads() -> None:
    given = state(APART[:2], [np.inf, np.inf], [0.0, 0.0])
    assert raced(problem(), given).outcomes == (None, None)


def test_starts_that_agree_are_one_optimum_and_cost_less_than_each_of_them_would() -> None:
    alone = estimate(problem(), Settings(method="gradient", starts=1))
    several = estimate(problem(), Settings(method="gradient", starts=4))
    assert several.outcome is SearchOutcome.CONVERGED
    assert several.optima[0].starts >= 3 and len(several.optima) == 1
    assert several.evaluations < 3 * alone.evaluations
    for name, value in alone.values.items():
        assert abs(several.values[name] - value) < 0.01 * alone.std[name]
