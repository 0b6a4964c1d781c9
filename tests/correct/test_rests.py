"""States that begin at rest, for every parameter that is tried: what a late sensor holds where a log begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.correct.models.followers import at_rest
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import with_values
from bondgraph.declare.effect import Place, Scale
from bondgraph.effects.sensors import sensor_lag
from bondgraph.estimate.analysis.hessian import exact_hessian, hessian
from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.simulation import simulate

_ROOM, _RESISTANCE, _CAPACITY, _LAG, _NOISE = 293.0, 0.5, 4000.0, 60.0, 0.1


def _oven(capacity: float = 3000.0) -> bg.BondGraph:
    """A heated body; its capacity is declared a quarter too small."""
    g = bg.BondGraph("oven")
    air, wall = g.zero_junction("air", bg.THERMAL), g.one_junction("wall", bg.THERMAL)
    c = g.parameter("C", capacity, "J/K", "air and load", (800.0, 12000.0))
    g.flow_source("heater", g.input("power", "W", hold=True), at=air)
    g.compliance("heat", 1 / c, at=air, initial=capacity * 330.0)
    g.bond(air, wall)
    g.resistance("wool", g.parameter("R", _RESISTANCE, "K/W", "insulation", (0.1, 2.0)), at=wall)
    g.bond(wall, g.effort_source("room", _ROOM))
    g.measure_effort("temperature", air, unit="K")
    return g


def _late(g: bg.BondGraph, lag: float = 30.0) -> bg.BondGraph:
    effect = sensor_lag(g, replace(Place.sensor("temperature", Scale(400.0, 60.0)), times=(10.0, 2400.0)))
    assert effect is not None
    return with_values(g, {effect.coefficients[0]: lag})


def _log() -> MatchedLog:
    chance = np.random.default_rng(3)
    time, power = 10.0 * np.arange(240.0), np.repeat(chance.uniform(0.0, 400.0, 6), 40)
    model = bg.build(_late(_oven(_CAPACITY), _LAG)).model
    own = model.x0(following_temperature=330.0)
    shown = simulate(model, time, power[np.newaxis], x0=own, rtol=1e-9).raise_if_failed().y
    return MatchedLog("run", time, power[np.newaxis], shown + _NOISE * chance.standard_normal(shown.shape))


@pytest.fixture(scope="module")
def problem() -> EstimationProblem:
    log, before, after = _log(), bg.build(_oven()), bg.build(_late(_oven()))
    setup = filter_setup(after.model, ["q_heat"], [log])
    follows = at_rest(before, after, np.array([3000.0 * 330.0]), log.u[:, 0], {"C": 3000.0})
    names = after.model.names("state")
    stds = {**setup.filter_model.initial_std, "q_heat": 3000.0}
    used = FilterModel(after.model, dict.fromkeys(names, 0.01), {"temperature": _NOISE}, stds, follows=follows)
    return bg.pose(used, [log], ["C", "R", "lag_temperature"])


def test_a_late_sensor_and_its_body_begin_at_one_temperature_for_every_capacity(problem: EstimationProblem) -> None:
    """It was the heat of the first fit for all of them: a search held the capacity there, 100 nats behind."""
    points = problem.start[:, np.newaxis] * np.ones(3)
    points[0] = [1000.0, 4000.0, 9000.0]
    found = problem.batch(points)
    first = problem.logs[0].y[0, 0]
    rows = {name: k for k, name in enumerate(problem.filter_model.model.names("state"))}
    assert found.x0[0][rows["q_heat"]] / points[0] == pytest.approx([first] * 3, rel=1e-9)
    assert found.x0[0][rows["following_temperature"]] == pytest.approx([first] * 3, rel=1e-9)
    said = found.initial_std[rows["q_heat"]] / points[0]
    assert said == pytest.approx([1.0] * 3, rel=1e-9)  # as uncertain in kelvins as it was said of the declared capacity


@pytest.mark.parametrize("capacity", [2000.0, 3500.0])
def test_gradients_know_that_what_rests_moves(problem: EstimationProblem, capacity: float) -> None:
    point = problem.start.copy()
    point[0] = problem.free[0].coordinate(capacity)
    (found,) = exact_derivatives(problem, point[:, np.newaxis], np.full((3, 1), 1e-4))
    for k in range(3):
        away = np.zeros(3)
        away[k] = 1e-5 * max(1.0, abs(point[k]))
        ahead, behind = problem.nll(np.stack([point + away, point - away], axis=1))
        assert found.gradient[k] == pytest.approx((ahead - behind) / (2.0 * away[k]), rel=1e-4, abs=1e-4)


def test_second_derivatives_know_that_what_rests_moves(problem: EstimationProblem) -> None:
    point = fit(problem).point
    assert exact_hessian(problem, point).matrix == pytest.approx(hessian(problem, point).matrix, rel=1e-3, abs=1e-6)


def test_the_capacity_and_the_lag_are_found(problem: EstimationProblem) -> None:
    found = fit(problem)
    for k, (name, true) in enumerate((("C", _CAPACITY), ("R", _RESISTANCE), ("lag_temperature", _LAG))):
        away = found.point[k] - problem.free[k].coordinate(true)
        assert abs(away) < 4.0 * found.std[name], name
    assert found.std["C"] < 0.02 * _CAPACITY and found.std["lag_temperature"] < 0.1  # of its logarithm
