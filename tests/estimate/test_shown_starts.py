"""States that begin at what an output shows, where free parameters translate it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.data.log import MatchedLog
from bondgraph.estimate.analysis.hessian import exact_hessian, hessian
from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.derivatives.linearised import linear_expansion
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.filter.filter_model import FilterModel

_ROOM, _RESISTANCE, _CAPACITY, _NOISE = 293.0, 0.55, 4000.0, 0.05


def _oven() -> bg.BondGraph:
    """A heated body; its capacity is declared a quarter too small, and it starts warm."""
    g = bg.BondGraph("oven")
    power = g.input("power", "W", hold=True)
    air, wall = g.zero_junction("air", bg.THERMAL), g.one_junction("wall", bg.THERMAL)
    capacity = g.parameter("C", 3000.0, "J/K", "air and load", (800.0, 12000.0))
    g.flow_source("heater", power, at=air)
    g.compliance("heat", 1 / capacity, at=air, initial=3000.0 * 300.0)
    g.bond(air, wall)
    g.resistance("wool", g.parameter("R", 0.4, "K/W", "insulation", (0.1, 2.0)), at=wall)
    g.bond(wall, g.effort_source("room", _ROOM))
    g.measure_effort("temperature", air, unit="K")
    return g


def _logs(count: int = 2, samples: int = 240) -> list[MatchedLog]:
    """Warm ovens by scipy; each starts at a temperature of its own."""
    time, logs = 10.0 * np.arange(samples), []
    for k in range(count):
        chance = np.random.default_rng(k)
        power = np.repeat(chance.uniform(0.0, 400.0, samples // 40), 40)

        def rate(t: float, y: np.ndarray, power: np.ndarray = power) -> list[float]:
            return [(power[min(int(t / 10.0), samples - 1)] - (y[0] - _ROOM) / _RESISTANCE) / _CAPACITY]

        run = solve_ivp(rate, (0.0, time[-1]), [330.0 + 15.0 * k], t_eval=time, rtol=1e-8, max_step=5.0)
        shown = run.y[0] + _NOISE * chance.standard_normal(samples)
        logs.append(MatchedLog(f"run{k}", time, power[np.newaxis], shown[np.newaxis]))
    return logs


def _problem(logs: list[MatchedLog], free: tuple[str, ...] = ("C", "R"), **filtered: object) -> EstimationProblem:
    setup = filter_setup(bg.build(_oven()).model, ["q_heat"], logs)
    names = [one.name for one in setup.filter_model.model.states]
    used = FilterModel(
        setup.filter_model.model, dict.fromkeys(names, 5.0), {"temperature": _NOISE}, setup.filter_model.initial_std,
        **filtered,  # type: ignore[arg-type]
    )  # fmt: skip
    return bg.pose(used, logs, [*free])


def test_every_member_begins_at_the_temperature_that_was_measured() -> None:
    logs = _logs()
    problem = _problem(logs)
    points = np.array([[1000.0, 4000.0, 9000.0], [0.2, 0.5, 1.5]])
    found = problem.batch(points)  # coordinates are the values themselves
    for log, x0 in zip(logs, found.x0, strict=True):
        assert x0[0] / points[0] == pytest.approx([log.y[0, 0]] * 3, rel=1e-12)
    assert found.initial_std[0] / points[0] == pytest.approx([found.initial_std[0, 0] / points[0, 0]] * 3, rel=1e-12)


def test_a_capacity_is_found_that_the_declared_heat_contradicts() -> None:
    logs = _logs()
    found = bg.estimate(_problem(logs))
    for name, true in (("C", _CAPACITY), ("R", _RESISTANCE)):
        assert abs(found.values[name] - true) < 4.0 * found.std[name]
    assert found.std["C"] < 100.0


@pytest.mark.parametrize("at", [(3000.0, 0.4), (5200.0, 0.9)])
def test_gradients_know_that_starts_move(at: tuple[float, float]) -> None:
    problem = _problem(_logs())
    point = np.array([one.coordinate(value) for one, value in zip(problem.free, at, strict=True)])
    (found,) = exact_derivatives(problem, point[:, np.newaxis], np.full((2, 1), 1e-4))
    assert problem.beginnings.move
    for k in range(2):
        away = np.zeros(2)
        away[k] = 1e-5 * max(1.0, abs(point[k]))
        ahead, behind = problem.nll(np.stack([point + away, point - away], axis=1))
        assert found.gradient[k] == pytest.approx((ahead - behind) / (2.0 * away[k]), rel=1e-5, abs=1e-5)


def test_second_derivatives_know_that_starts_move() -> None:
    problem = _problem(_logs())
    point = np.array([one.coordinate(value) for one, value in zip(problem.free, (4100.0, 0.5), strict=True)])
    assert exact_hessian(problem, point).matrix == pytest.approx(hessian(problem, point).matrix, rel=1e-4)


def test_a_linearised_filter_begins_where_its_parameters_say() -> None:
    problem = _problem(_logs(1), method="ros3p", substeps=8)
    point = np.array([one.coordinate(value) for one, value in zip(problem.free, (5200.0, 0.9), strict=True)])
    found = linear_expansion(problem, point)
    assert found.terms is not None
    first = found.terms.innovations[0, 1:]  # what the first measurement shows does not depend on the capacity
    assert np.abs(first).max() < 1e-6 * np.abs(found.terms.innovations[:, 1:]).max()
    (exact,) = exact_derivatives(problem, point[:, np.newaxis], np.full((2, 1), 1e-4))
    assert found.gradient == pytest.approx(exact.gradient, rel=0.1)  # gains are held, which move with both


def test_what_is_known_of_a_log_translates_its_start() -> None:
    logs = _logs()
    logs[1] = bg.MatchedLog(logs[1].name, logs[1].time, logs[1].u, logs[1].y, {"C": 6000.0})
    problem = _problem(logs)
    point = problem.start
    assert problem.batch(point[:, np.newaxis]).x0[1][0, 0] == pytest.approx(6000.0 * logs[1].y[0, 0], rel=1e-12)
    assert problem.batch_slopes(point).x0[1][0].tolist() == [0.0, 0.0]


def test_a_state_whose_start_is_free_begins_there() -> None:
    problem = _problem(_logs(1), ("C",))
    free = FreeParameter("x0(q_heat)", 5e5, 2e6, 9.1e5)
    freed = EstimationProblem(problem.filter_model, problem.logs, (*problem.free, free))
    assert freed.batch(freed.start[:, np.newaxis]).x0[0][0, 0] == pytest.approx(9.1e5)
    assert not freed.beginnings.move
