"""Steps are planned where a model needs them, once, and the likelihood is that of uniformly fine steps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.certify import finer_problems
from bondgraph.estimate.problem import pose
from bondgraph.filter.discretisation import discretisation_error, explicit_substeps, step_times_rate
from bondgraph.filter.draw import draw_logs
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.gradient import Directions, innovation_tangents
from bondgraph.filter.likelihood import likelihood
from bondgraph.filter.plan import IntervalSteps, StepPlan, log_key
from bondgraph.filter.planning import plan_cost, plan_steps
from bondgraph.filter.runs import run
from bondgraph.filter.samples import Samples
from bondgraph.filter.ukf import Member
from bondgraph.simulate.model import Model
from tests.filter.logs import PlainLog, pendulum_filter
from tests.simulate.samples import decay

#: A mass that presses on a stiff stop: smooth but for the moments at which it touches and leaves.
STOPPED = '''
"""A mass between soft springs that hits a stop."""
import numpy as np

NAME = "stopped"
FORMAT = "bondgraph-module/1"
STATES = (("x", "m", 0.0, "place"), ("v", "m/s", 0.0, "speed"))
INPUTS = (("push", "N", 0.0, "linear", None, "force"),)
PARAMETERS = (
    ("m", "kg", 1.0, 0.5, 2.0, "mass"),
    ("edge", "m", 0.3, 0.1, 0.6, "where the stop begins"),
)
OUTPUTS = (("place", "m", "place"),)


def rhs(t, x, u, theta):
    """dx/dt"""
    place = x[0]
    v = x[1]
    push = u[0]
    m = theta[0]
    edge = theta[1]
    pressed = np.maximum(place - edge, 0.0)
    F = push - 20.0*place - 5.0*v - 4e3*pressed
    dx0 = v
    dx1 = F/m
    return _stack(x, (dx0, dx1))


def output(t, x, u, theta):
    """y"""
    y0 = x[0]
    return _stack(x, (y0,))


def _stack(x, rows):
    stacked = np.empty((len(rows), *x.shape[1:]))
    for i, row in enumerate(rows):
        stacked[i] = row
    return stacked
'''


def stopped(**settings: object) -> tuple[FilterModel, PlainLog]:
    """The mass pushed against its stop again and again, and its filter."""
    model = Model.from_text(STOPPED)
    time = np.arange(120) * 0.02
    pattern = MatchedLog("hits", time, 20.0 * np.sin(4.0 * time)[None], np.zeros((1, time.size)))
    noise = {"process_noise": {"v": 0.05}, "measurement_noise": {"place": 0.01}, "initial_std": {"x": 0.01, "v": 0.02}}
    settings = {"noise_scheme": "sampled", **settings}
    filter_model = FilterModel(model, **noise, **settings)  # type: ignore[arg-type]
    log = draw_logs(filter_model, pattern, 1, seed=4, substeps=100).logs[0]
    return filter_model, PlainLog(log.name, log.time, log.u, log.y)


def test_steps_are_spent_where_the_model_bends() -> None:
    model, log = stopped(method="rodas4", substeps=16, grading=1.35)
    planned = plan_steps(model, [log], tolerance=1e-4)
    assert planned.plan is not None
    (steps,) = planned.plan.logs.values()
    place = run(planned, log).filtered_mean[0]
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(place, 3, mode="edge"), 7)
    free = windows.max(axis=1)[:-1] < 0.28
    assert steps.substeps[free].max() <= 4
    assert steps.substeps[~free].max() >= 16


@pytest.mark.parametrize("method", ["ros3p", "rodas4"])
def test_planned_steps_are_nearer_to_the_likelihood_of_fine_ones_than_as_many_even_ones(method: str) -> None:
    model, log = stopped(method=method, substeps=16, grading=1.35)
    planned = plan_steps(model, [log], methods=(method,), tolerance=1e-3)
    assert planned.plan is not None
    even = replace(model, substeps=math.ceil(planned.plan.mean_substeps), grading=1.0)
    edges = np.stack([model.model.theta(edge=edge) for edge in (0.298, 0.3, 0.302)], axis=1)
    exact = likelihood(replace(model, method="rodas4", substeps=1000, grading=1.0), log, edges).nll
    errors = [np.abs(likelihood(used, log, edges).nll - exact).max() for used in (planned, even)]
    assert errors[0] < 0.4
    assert errors[0] < 0.2 * errors[1]


def test_numpy_and_the_kernel_plan_the_same() -> None:
    model, log = stopped(method="rodas4", substeps=8)
    short = PlainLog(log.name, log.time[:30], log.u[:, :30], log.y[:, :30])
    assert plan_steps(model, [short]) == plan_steps(model, [short], compiled=False)


def test_a_smaller_tolerance_costs_more() -> None:
    model, log = stopped(method="rodas4", substeps=16)
    costs = []
    for tolerance in (1e-1, 1e-3, 1e-5):
        plan = plan_steps(model, [log], tolerance=tolerance).plan
        assert plan is not None
        costs.append(plan_cost(model.model, plan))
    assert costs[0] < costs[1] < costs[2]


def test_a_plan_belongs_to_its_method_and_logs() -> None:
    model, log = stopped(method="ros3p", substeps=5, grading=1.5)
    steps = IntervalSteps(np.full(119, 3), np.full(119, 1.2))
    plan = StepPlan.of("ros3p", {log_key(log.time, log.u, log.y, log.theta_overrides): steps})
    planned = replace(model, plan=plan)
    assert Samples.of(planned, log).substeps.tolist() == [3] * 119
    assert Samples.of(planned.with_halved_steps(), log).substeps.tolist() == [6] * 119
    assert Samples.of(planned.with_halved_steps(), log).grading == pytest.approx(np.sqrt(1.2))
    assert Samples.of(replace(planned, method="rodas4"), log).substeps.tolist() == [5] * 119
    other = PlainLog("other", log.time, 2.0 * log.u, log.y)
    assert set(Samples.of(planned, other).substeps) == {5}
    assert set(Samples.of(planned, other).grading) == {1.5}
    assert (planned.typical_substeps, replace(planned, method="rodas4").typical_substeps) == (3, 5)


def test_derivatives_follow_the_plan() -> None:
    model = pendulum_filter(method="ros3p", substeps=1, noise_scheme="sampled")
    time = np.arange(40) * 0.05
    log = PlainLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[None])
    steps = IntervalSteps(np.arange(39) % 4 + 1, 1.0 + np.arange(39) % 3)
    plan = StepPlan.of("ros3p", {log_key(log.time, log.u, log.y, log.theta_overrides): steps})
    planned, theta = replace(model, plan=plan), model.model.theta()
    directions = Directions(np.eye(3)[:, :2], *(np.zeros((size, 2)) for size in (2, 2, 2, 1)))
    member = Member.of(model, theta)
    (found,) = innovation_tangents(planned, [log], [member], [directions])
    h = 1e-5
    moved = theta[:, None] + h * np.concatenate([np.eye(3)[:, :2], -np.eye(3)[:, :2]], axis=1)
    nll, even = (likelihood(used, log, moved).nll for used in (planned, model))
    assert np.abs(nll - even).max() > 1e-6
    assert found.gradient == pytest.approx((nll[:2] - nll[2:]) / (2.0 * h), rel=1e-6)


def test_certification_halves_planned_steps_and_counts_those_of_runge_kutta_by_the_rate() -> None:
    time = np.arange(60) * 0.1
    log = PlainLog("fast", time, np.stack([400.0 * np.sin(time), 0.0 * time]), np.sin(time)[None])
    noise = {"process_noise": {"level": 0.1}, "measurement_noise": {"reading": 0.1}, "initial_std": {"level": 0.1}}
    model = FilterModel(decay(rate=400.0), **noise, method="ros3p", substeps=4, noise_scheme="sampled")  # type: ignore[arg-type]
    planned = plan_steps(model, [log], methods=("ros3p",))
    filtered = run(planned, log)
    assert explicit_substeps(filtered, log, None, 1.0) == pytest.approx(40.0)
    longest = (np.diff(time) / Samples.of(planned, log).substeps).max()
    assert 0.3 * 400.0 * longest < step_times_rate(filtered, log, None) <= 400.0 * 0.1
    free = next(info.name for info in model.model.parameters if info.lower is not None)
    finer = finer_problems(pose(planned, [log], [free]), np.array([400.0]), "full")
    halved, explicit = (one.parts[0].filter_model for one in finer)
    assert planned.plan is not None
    assert halved.plan == planned.plan.halved()
    assert (explicit.method, explicit.plan) == ("rk4", None)
    assert abs(explicit.substeps - 40) <= 1  # rounded up
    assert discretisation_error(planned, log).negligible
