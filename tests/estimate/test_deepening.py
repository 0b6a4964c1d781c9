"""A second exploration where gradient searches do not agree: what it finds, when it is spared, and how it goes on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.estimate.deepening import agree, deeper_search
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.derivatives.exact import filtering_work
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.objective import SearchOutcome, TraceRow
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.result import Estimate
from bondgraph.estimate.solvers.gauss_newton import gauss_newton
from bondgraph.execute import open_executor
from tests.benchmarks.optimiser_rows import EVALUATIONS, FUNCTIONS, by_default, by_scipy, function_problem
from tests.estimate.linear import ExactLikelihood, lag, simulated

SETTINGS = Settings(certify="none")


def waves(start: float = 3.0) -> EstimationProblem:
    """Rastrigin's function of ten coordinates as a likelihood: 11^10 valleys, the deepest at zero."""
    return function_problem(FUNCTIONS["rastrigin"], np.full(10, start), EVALUATIONS)[0]


def searched(problem: EstimationProblem, settings: Settings = SETTINGS, **given: object) -> Estimate:
    return estimate(problem, settings, jacobian=central_differences, **given)  # type: ignore[arg-type]


def test_the_deepest_valley_is_found_where_a_swarm_and_gradients_miss_it() -> None:
    without, found = searched(waves(), replace(SETTINGS, method="pso+gradient")), searched(waves())
    assert without.nll > 1.0
    assert abs(found.nll) < 1e-6 and np.abs(found.point).max() < 1e-4
    stages = list(dict.fromkeys(row.stage for row in found.trace))
    assert stages == ["swarm", "gauss-newton", "differential evolution", "gauss-newton from there"]
    counts = [row.evaluations for row in found.trace]
    assert counts == sorted(counts) and found.evaluations >= counts[-1]


@pytest.mark.parametrize("name", ["rastrigin", "rosenbrock", "griewank"])
def test_the_default_is_at_least_as_good_as_the_public_differential_evolution(name: str) -> None:
    ours, public = ([run(FUNCTIONS[name], EVALUATIONS, seed) for seed in range(3)] for run in (by_default, by_scipy))
    assert np.median(ours) <= np.median(public)


def test_it_goes_on_where_it_was_interrupted(tmp_path: Path) -> None:
    whole, seen = searched(waves()), 0

    def stop(row: TraceRow) -> None:
        nonlocal seen
        seen += row.stage == "differential evolution"
        if seen == 5:
            raise KeyboardInterrupt

    early = searched(waves(), folder=tmp_path, progress=stop)
    assert early.outcome is SearchOutcome.INTERRUPTED and early.nll > whole.nll
    again = searched(waves(), folder=tmp_path, resume=True)
    np.testing.assert_array_equal(again.point, whole.point)
    assert (again.nll, again.evaluations, again.trace) == (whole.nll, whole.evaluations, whole.trace)


def test_workers_change_no_number() -> None:
    alone = searched(waves())
    with open_executor("threads:2") as workers:
        spread = searched(waves(), executor=workers)
    np.testing.assert_array_equal(spread.point, alone.point)
    assert spread.trace == alone.trace


def test_it_is_spared_where_gradient_searches_agree() -> None:
    logs = [simulated("run1", 0, {}), simulated("run2", 100, {}, x0=1.0, load=1.5)]
    problem = pose(lag(), logs, ["mass", "drag"], likelihood=ExactLikelihood())
    default, without = (estimate(problem, Settings(method=name)) for name in ("both", "pso+gradient"))
    np.testing.assert_array_equal(default.point, without.point)
    assert default.trace == without.trace


def test_it_is_spared_where_evaluations_are_spent_or_dear_or_it_is_not_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = waves()
    ends = gauss_newton(problem, np.array([np.full(10, 3.0), np.full(10, -2.0)]).T)
    assert not agree(ends)
    search = deeper_search(problem, ends, 1000, 0)
    assert search is not None and search.most_evaluations == 17_000
    assert deeper_search(problem, ends, 15_000, 0) is None
    monkeypatch.setitem(deeper_search.__globals__, "_CHEAP", 3000.0 * filtering_work(problem))
    assert deeper_search(problem, ends, 1000, 0) is None
    assert Settings().deepens and not Settings(method="pso+gradient").deepens
    assert not Settings(search=search).deepens
