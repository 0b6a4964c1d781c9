"""Searches with exact derivatives find what those with differences find, and their expansions agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.estimate.derivatives import exact
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.derivatives.exact import derivatives, exact_derivatives
from bondgraph.estimate.free import FreeParameter, parse_target
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.solvers.gauss_newton import gauss_newton
from tests.filter.logs import driveline_filter, pendulum_filter, simulated_log

FREE = ("length", "damping", "std(deflection)", "process(rate)", "x0(angle)")


def swing_problem(**changes: object) -> EstimationProblem:
    model = pendulum_filter(**changes)
    logs = [simulated_log(model, np.arange(120) * 0.05, seed=seed, name=f"run{seed}") for seed in (1, 2)]
    from bondgraph.data.log import MatchedLog

    matched = [MatchedLog(log.name, log.time, log.u, log.y) for log in logs]
    return pose(model, matched, list(FREE))


def test_expansions_equal_those_by_differences() -> None:
    problem = swing_problem()
    steps = np.full((len(FREE), 2), 1e-4)
    points = np.column_stack([problem.start, problem.start + 0.02])
    exact = exact_derivatives(problem, points, steps)
    rough = central_differences(problem, points, steps)
    for one, other in zip(exact, rough, strict=True):
        np.testing.assert_allclose(one.gradient, other.gradient, rtol=1e-5, atol=1e-5 * np.abs(other.gradient).max())
        np.testing.assert_allclose(one.information, other.information, rtol=1e-4, atol=1e-4)
        assert one.sum == pytest.approx(other.sum, rel=1e-9)


def test_several_starts_at_once_give_each_the_numbers_it_has_alone() -> None:
    points = np.column_stack([swing_problem().start + 0.01 * k for k in range(4)])
    steps = np.full(points.shape, 1e-4)
    found = [
        exact_derivatives(replace(swing_problem(), likelihood=FilterLikelihood(threads=n)), points, steps)
        for n in (1, 2, 5)
    ]
    for others in found[1:]:
        for one, other in zip(found[0], others, strict=True):
            np.testing.assert_array_equal(one.gradient, other.gradient)
            np.testing.assert_array_equal(one.information, other.information)
    alone = [exact_derivatives(swing_problem(), points[:, [k]], steps[:, [k]])[0] for k in range(4)]
    for one, single in zip(found[0], alone, strict=True):
        np.testing.assert_allclose(one.gradient, single.gradient, rtol=1e-9, atol=1e-9)


def test_a_search_with_exact_derivatives_finds_the_same_optimum() -> None:
    problem = swing_problem()
    exact = gauss_newton(problem, problem.start, jacobian=exact_derivatives)
    rough = gauss_newton(problem, problem.start)
    assert exact.outcomes[0] is not None
    assert exact.outcomes[0].succeeded
    assert exact.values[0] == pytest.approx(rough.values[0], abs=1e-6)
    assert exact.evaluations < rough.evaluations


@pytest.mark.parametrize("changes", [{"appended": {"gravity": 0.0}}, {"method": "rk4"}])
def test_differences_serve_where_there_are_no_exact_derivatives(changes: dict) -> None:
    problem = swing_problem(**changes)
    if "method" in changes:
        problem = replace(problem, likelihood=FilterLikelihood(compiled=False))
        problem = replace(
            problem, logs=tuple(replace(log, time=log.time[:9], u=log.u[:, :9], y=log.y[:, :9]) for log in problem.logs)
        )
    steps = np.full((len(FREE), 1), 1e-4)
    (found,) = exact_derivatives(problem, problem.start[:, None], steps)
    (rough,) = central_differences(problem, problem.start[:, None], steps)
    np.testing.assert_array_equal(found.gradient, rough.gradient)


def test_derivatives_of_another_value_are_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the filter with derivatives goes another way than the filter, a search would gain from that for ever."""
    problem = swing_problem()
    steps, points = np.full((len(FREE), 1), 1e-4), problem.start[:, np.newaxis]
    (right,) = exact_derivatives(problem, points, steps)
    assert right.terms is not None
    scales = right.terms.log_scales.copy()
    scales[0, 0] += 0.01
    wrong = replace(right, terms=replace(right.terms, log_scales=scales), gradient=0.0 * right.gradient)
    monkeypatch.setattr(exact, "_expand", lambda *_: wrong)
    (found,) = exact_derivatives(problem, points, steps)
    (rough,) = central_differences(problem, points, steps)
    np.testing.assert_array_equal(found.gradient, rough.gradient)


def test_a_vehicle_and_its_priors() -> None:
    from bondgraph.data.log import MatchedLog

    model = driveline_filter()
    log = simulated_log(model, np.arange(60) * 0.02, seed=2)
    names = model.model.names("parameter")[:3]
    values = model.model.theta()[:3]
    free = [
        FreeParameter(name, 0.5 * value, 2.0 * value, value, prior_mean=1.1 * value, prior_std=0.2 * value)
        for name, value in zip(names, values, strict=True)
        if value > 0
    ]
    assert parse_target(names[0]).name == names[0]
    problem = pose(model, MatchedLog(log.name, log.time, log.u, log.y), free)
    steps = np.full((len(free), 1), 1e-5) * (problem.upper - problem.lower)[:, None]
    (one,) = exact_derivatives(problem, problem.start[:, None], steps)
    (other,) = central_differences(problem, problem.start[:, None], steps)
    np.testing.assert_allclose(one.gradient, other.gradient, rtol=1e-5, atol=1e-5 * np.abs(other.gradient).max())


@pytest.mark.parametrize(("substeps", "is_exact"), [(1, False), (200, True)])
def test_long_searches_take_exact_derivatives_and_short_ones_differences(substeps: int, is_exact: bool) -> None:
    problem = swing_problem(substeps=substeps)
    steps = np.full((len(FREE), 1), 1e-4)
    (taken,) = derivatives(problem, problem.start[:, None], steps)
    (other,) = (exact_derivatives if is_exact else central_differences)(problem, problem.start[:, None], steps)
    assert taken.evaluations == other.evaluations == (5 if is_exact else 1 + 2 * len(FREE))
    np.testing.assert_array_equal(taken.gradient, other.gradient)
