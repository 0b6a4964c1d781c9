"""Estimations whose members workers evaluate: every number is that of one process."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.data.log import MatchedLog
from bondgraph.estimate.analysis.screening import (
    global_sensitivity,
    likelihood_response,
    output_response,
    problem_bounds,
)
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.joint import Problem, pose_joint
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.likelihood_profile import profile_likelihood
from bondgraph.estimate.likelihoods import Batch, FilterLikelihood
from bondgraph.estimate.local import fit
from bondgraph.estimate.objective import FloatArray, Terms
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.solvers.particle_swarm import SwarmSettings
from bondgraph.estimate.spread import spread
from bondgraph.execute import open_executor
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.example import pendulum

SETTINGS = Settings(starts=3, swarm=SwarmSettings(members=20, iterations=6), seed=2)
SWING = FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)


def _log(seed: int, name: str = "swing") -> MatchedLog:
    time = np.arange(200) * 0.05
    measured = 0.45 * np.cos(3.1 * time) + np.random.default_rng(seed).normal(0.0, 0.05, time.size)
    return MatchedLog(name, time, np.zeros((1, time.size)), measured[np.newaxis])


def _problem() -> EstimationProblem:
    return pose(SWING, _log(1), ["length", "damping", "std(deflection)"])


@pytest.fixture(scope="module")
def processes() -> Iterator[Executor]:
    with open_executor("processes:2") as executor:
        assert executor is not None
        yield executor


def test_an_estimate_its_profiles_and_a_fit_are_the_same_in_processes(processes: Executor) -> None:
    problem = _problem()
    here = estimate(problem, SETTINGS)
    there = estimate(problem, SETTINGS, executor=processes)
    assert replace(there, seconds=0.0).to_dict() == replace(here, seconds=0.0).to_dict()
    assert there.trace == here.trace and there.problem == problem
    for own, other in zip(profile_likelihood(here), profile_likelihood(here, executor=processes), strict=True):
        assert own.interval == other.interval and own.evaluations == other.evaluations
        assert own.deviance.tolist() == other.deviance.tolist() and own.values.tolist() == other.values.tolist()
    free = problem.free
    alone = fit(EstimationProblem(SWING, problem.logs, tuple(free)))
    shared = fit(EstimationProblem(SWING, problem.logs, tuple(free)), journal=Journal(executor=processes))
    assert shared.point.tolist() == alone.point.tolist() and shared.outcome is alone.outcome
    assert shared.expansion.information.tolist() == alone.expansion.information.tolist()


def test_global_sensitivities_are_the_same_in_processes(processes: Executor) -> None:
    pytest.importorskip("SALib")
    problem = _problem()
    bounds = problem_bounds(problem)
    for response in (likelihood_response(problem), output_response(problem, "deflection", "last")):
        here, there = (
            global_sensitivity(response, bounds, "morris", samples=12, executor=who) for who in (None, processes)
        )
        assert here.indices["mu_star"].tolist() == there.indices["mu_star"].tolist()
        assert here.failed == there.failed and here.evaluations == there.evaluations


def test_an_interrupted_search_goes_on_with_other_workers(tmp_path: Path) -> None:
    problem, seen = _problem(), []

    def stop(row: object) -> None:
        seen.append(row)
        if len(seen) == 5:
            raise KeyboardInterrupt

    with ThreadPoolExecutor(3) as executor:
        cut = estimate(problem, SETTINGS, progress=stop, folder=tmp_path, executor=executor)
        assert cut.outcome.name == "INTERRUPTED"
    resumed = estimate(problem, SETTINGS, folder=tmp_path, resume=True)
    whole = estimate(problem, SETTINGS)
    assert resumed.point.tolist() == whole.point.tolist() and resumed.trace == whole.trace


def test_values_terms_and_ceilings_of_members_are_those_of_one_batch() -> None:
    other = pose(SWING, [_log(2, "b")], ["length"])
    joint: Problem = pose_joint([pose(SWING, [_log(1)], ["length", "damping"]), other])
    rng = np.random.default_rng(3)
    for problem in (_problem(), joint):
        points = rng.uniform(problem.lower[:, np.newaxis], problem.upper[:, np.newaxis], (problem.lower.size, 37))
        values = problem.nll(points)
        with ThreadPoolExecutor(2) as executor:
            there = spread(problem, executor)
            assert there.nll(points).tolist() == values.tolist()
            terms, own = there.terms(points), problem.terms(points)
            assert np.array_equal(terms.innovations, own.innovations, equal_nan=True)
            assert np.array_equal(terms.log_scales, own.log_scales, equal_nan=True)
            below, expected = (one.nll_below(points, np.full(37, np.median(values))) for one in (there, problem))
            assert below.abandoned.tolist() == expected.abandoned.tolist() and below.abandoned.any()
            assert below.nll.tolist() == expected.nll.tolist()
    assert spread(joint, None) is joint


class _Plain:
    """A likelihood of one's own, which knows no ceilings."""

    def nll(self, filter_model: FilterModel, logs: object, batch: Batch) -> FloatArray:
        return batch.theta[0] ** 2

    def terms(self, filter_model: FilterModel, logs: object, batch: Batch) -> Terms:
        return Terms(batch.theta[:1], np.zeros((1, batch.theta.shape[1])))


def test_a_likelihood_of_ones_own_is_spread_too() -> None:
    problem = replace(_problem(), likelihood=_Plain())
    points = np.linspace(problem.lower, problem.upper, 20).T
    with ThreadPoolExecutor(2) as executor:
        there = spread(problem, executor)
        assert there.nll(points).tolist() == problem.nll(points).tolist()
        assert not there.nll_below(points, np.zeros(20)).abandoned.any()
    assert isinstance(_problem().likelihood, FilterLikelihood)


def test_the_verb_takes_an_executor_by_its_text() -> None:
    given = (SWING, [_log(1)], ["length"], Settings(method="gradient", starts=2))
    assert bg.estimate(*given, executor="threads:2").values == bg.estimate(*given).values
    with pytest.raises(bg.BondGraphError, match="no such executor"):
        bg.estimate(*given, executor="cloud")
