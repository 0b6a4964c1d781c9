"""Starts at expressions of parameters in filters and estimations: they move with what is tried, and so do gradients."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.estimate import FreeParameter, exact_hessian
from bondgraph.estimate.analysis.hessian import hessian
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.free_simulation import simulated_logs
from bondgraph.estimate.objective import fitted_expansion
from bondgraph.filter.online import OnlineFilter

TIME = 2.0 * np.arange(150)
HEAT = np.where(TIME < 80.0, 300.0, 0.0)
TRUE = {"C": 600.0, "T0": 300.0, "R": 0.4}


def oven(start: object = "C*T0", shell: object = 300.0 * 293.15) -> bg.BuiltModel:
    """A heated core that nobody measures, behind a wall a shell whose temperature is measured."""
    g = bg.BondGraph("oven")
    C, C_s = g.parameter("C", 500.0, "J/K", "", (200.0, 1000.0)), g.parameter("C_s", 300.0, "J/K", "", (100.0, 900.0))
    g.parameter("T0", 293.15, "K", "", (273.0, 320.0))
    R = g.parameter("R", 0.5, "K/W", "", (0.1, 2.0))
    core, shell_node = (g.zero_junction(name, bg.THERMAL) for name in ("core", "shell"))
    g.flow_source("heater", g.input("heat", "W"), at=core)
    g.compliance("core_body", 1 / C, at=core, initial=start, state="q")
    g.compliance("shell_body", 1 / C_s, at=shell_node, initial=shell, state="q_s")
    wall = g.one_junction("wall", bg.THERMAL)
    g.bond(core, wall)
    g.bond(wall, shell_node)
    g.resistance("gap", R, at=wall)
    g.measure_effort("temperature", shell_node)
    return bg.build(g)


MODEL = oven()


def log(name: str = "warm", seed: int = 1, **known: float) -> bg.MatchedLog:
    truth = bg.simulate(MODEL, TIME, {"heat": HEAT}, theta={**TRUE, **known})
    y = truth.y + 0.05 * np.random.default_rng(seed).standard_normal(truth.y.shape)
    return bg.MatchedLog(name, TIME, HEAT[np.newaxis], y, known)


def known(model: bg.Model = MODEL, **more: object) -> bg.FilterModel:
    return bg.FilterModel(model, {"q": 20.0}, {"temperature": 0.05}, {"q": 50.0, "q_s": 30.0}, 2, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("initial", ["measured", "model", "given"])
@pytest.mark.parametrize("method", ["rk4", "auto"])
def test_gradients_follow_the_start(initial: str, method: str) -> None:
    rule = ({"q_s": 300.0 * 293.15},) if initial == "given" else initial
    filter_model = known() if method == "rk4" else known(method="auto")
    problem = bg.pose(filter_model, log(), ["C", "T0", "R", "C_s", "std(temperature)"], initial=rule)  # type: ignore[arg-type]
    point = problem.start + 0.02 * (problem.upper - problem.lower) * np.array([1.0, 1.0, -1.0, 0.3, 0.5])
    ours = fitted_expansion(problem, point, exact_derivatives)
    theirs = fitted_expansion(problem, point, central_differences)
    np.testing.assert_allclose(ours.gradient, theirs.gradient, rtol=2e-6, atol=1e-6 * np.abs(theirs.gradient).max())
    np.testing.assert_allclose(ours.information, theirs.information, rtol=1e-5, atol=1e-6 * theirs.information.max())


def test_second_derivatives_follow_the_start() -> None:
    """The start C T0 bends with both: d2q/dC dT0 = 1."""
    problem = bg.pose(known(), log(), ["C", "T0", "R"], initial="model")
    point = problem.start + 0.01 * (problem.upper - problem.lower)
    exact, near = exact_hessian(problem, point), hessian(problem, point)
    np.testing.assert_allclose(exact.matrix, near.matrix, rtol=1e-4, atol=1e-6 * np.abs(near.matrix).max())


def test_a_start_is_what_a_tie_said() -> None:
    logs = [log(), log("known", 2, T0=310.0)]
    ours = bg.pose(known(), logs[0], ["C", "T0", "R"])
    tied = bg.pose(known(oven(0.0)), logs[0], ["C", "T0", "R"], ties={"x0(q)": "C*T0"})
    points = ours.start[:, np.newaxis] + (ours.upper - ours.lower)[:, np.newaxis] * np.array([0.0, 0.05, -0.05])
    np.testing.assert_allclose(ours.nll(points), tied.nll(points), rtol=1e-9)
    both = bg.pose(known(), logs, ["C", "R"])
    begun = both.batch(both.start[:, np.newaxis] * np.array([1.0, 1.1])).x0
    capacity = both.batch(both.start[:, np.newaxis] * np.array([1.0, 1.1])).theta[0]
    np.testing.assert_allclose(begun[0][0], 293.15 * capacity, rtol=1e-12)
    np.testing.assert_allclose(begun[1][0], 310.0 * capacity, rtol=1e-12)  # which this log knows


def test_an_estimate_finds_what_the_start_was_made_of() -> None:
    fit = bg.estimate(
        bg.pose(known(), log(), ["C", "T0", "R"]), settings=bg.Settings(method="gradient", starts=1, certify="none")
    )
    for name, value in TRUE.items():
        assert abs(fit.values[name] - value) < 3.5 * fit.std[name], name
    assert fit.x0[0][0] == pytest.approx(fit.values["C"] * fit.values["T0"], rel=1e-12)


def test_measured_free_and_given_starts_come_first() -> None:
    shown = oven("C*T0", "C_s*T0")
    row = log().y[0, 0]
    problem = bg.pose(known(shown), log(), ["C", "C_s", "T0"])
    (begun,) = problem.batch(problem.start[:, np.newaxis]).x0
    assert begun[1, 0] == pytest.approx(300.0 * row) and begun[0, 0] == pytest.approx(500.0 * 293.15)
    free = bg.pose(known(), log(), ["C", FreeParameter("x0(q)", 1e5, 2e5, 1.5e5)])
    assert free.batch(free.start[:, np.newaxis] * 1.01).x0[0][0, 0] == pytest.approx(1.01 * 1.5e5)
    given = bg.pose(known(), log(), ["C"], initial=({"q": 1.4e5},))
    assert given.batch(given.start[:, np.newaxis] * np.array([1.0, 1.1])).x0[0][0].tolist() == [1.4e5, 1.4e5]
    settled = bg.pose(known(), log(), ["C"], initial="settled")
    assert len(set(settled.batch(settled.start[:, np.newaxis] * np.array([1.0, 1.1])).x0[0][0])) == 1


def test_free_simulation_moves_its_start() -> None:
    problem = bg.pose(known(), log(), ["C", "T0", "R"])
    at = problem.start
    (here,) = simulated_logs(problem, at)
    for k, step in enumerate(1e-4 * (problem.upper - problem.lower)):
        away = np.eye(at.size)[k] * step
        ahead, behind = (simulated_logs(problem, at + sign * away)[0].y for sign in (1.0, -1.0))
        slope = problem.values(at + away)[k] - problem.values(at - away)[k]
        np.testing.assert_allclose(here.slopes[..., k], (ahead - behind) / slope, rtol=1e-4, atol=1e-7)


def test_filters_begin_where_their_parameters_say() -> None:
    theta = MODEL.theta(**TRUE)
    run = bg.filter_log(known(), log(), TRUE, initial="model", compiled=False)
    assert run.predicted_mean[0, 0] == pytest.approx(600.0 * 300.0)
    appended = replace(known(), appended={"C": 0.0})
    assert bg.filter_log(appended, log(), TRUE, initial="model", compiled=False).predicted_mean[0, 0] == 180000.0
    online = OnlineFilter(known(), theta)
    assert online.member.x0[0] == pytest.approx(180000.0)
    members = np.stack([MODEL.theta(), theta], axis=1)
    from bondgraph.filter.runs import prepared

    _, _, (batch,) = prepared(known(), [log()], members, {}, False)
    np.testing.assert_allclose(batch.x0[0], [500.0 * 293.15, 180000.0], rtol=1e-12)
