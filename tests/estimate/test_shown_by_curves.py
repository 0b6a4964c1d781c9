"""States that begin where an output shows them by a curve."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.data.log import MatchedLog
from bondgraph.declare.expressions import signal
from bondgraph.estimate.analysis.hessian import exact_hessian, hessian
from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.initial import first_shown, initial_states
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.estimate.shown_by_curves import inverted

_AREA, _WIDENS, _OUTLET, _NOISE = 4.5e-6, 3e-10, 1.7e8, 20.0


def hopper(widens: bool = True) -> bg.BondGraph:
    """A vessel whose area grows with its level, V = C p + k p^2, or is declared to be the same everywhere."""
    g = bg.BondGraph("hopper")
    inflow, vessel = g.input("q", "m^3/s", hold=True), g.zero_junction("vessel", bg.HYDRAULIC)
    g.flow_source("pump", inflow, at=vessel)
    capacity = g.parameter("C", 4e-6, "m^3/Pa", "", (1e-6, 2e-5))
    if widens:
        k = g.parameter("k", 1e-10, "m^3/Pa^2", "", (1e-11, 1e-8))
        g.compliance(
            "water", lambda V: (sp.sqrt(capacity**2 + 4 * k * V) - capacity) / (2 * k), at=vessel, state="V",
            initial=0.05,
        )  # fmt: skip
    else:
        g.compliance("water", 1 / capacity, at=vessel, state="V", initial=0.05)
    g.resistance("outlet", g.parameter("R", 2e8, "Pa*s/m^3", "", (2e7, 2e9)), at=vessel)
    g.measure("p", signal("effort", "water"), "Pa")
    return g


def emptied(seed: int, begins: float) -> MatchedLog:
    """A run of it by scipy from a pressure that nobody declared."""
    count, chance = 600, np.random.default_rng(seed)
    inflow = np.repeat(chance.uniform(0.0, 1e-4, count // 30), 30)

    def shown(volume: np.ndarray) -> np.ndarray:
        return (np.sqrt(_AREA**2 + 4.0 * _WIDENS * volume) - _AREA) / (2.0 * _WIDENS)

    volumes = [_AREA * begins + _WIDENS * begins**2]
    for flow in inflow[:-1]:
        run = solve_ivp(lambda t, v, flow=flow: flow - shown(v) / _OUTLET, (0.0, 1.0), volumes[-1:], rtol=1e-9)
        volumes.append(float(run.y[0, -1]))
    y = shown(np.array(volumes)) + _NOISE * chance.standard_normal(count)
    return MatchedLog(f"run{seed}", np.arange(float(count)), inflow[np.newaxis], y[np.newaxis])


@pytest.fixture(scope="module")
def logs() -> list[MatchedLog]:
    return [emptied(1, 3000.0), emptied(2, 6000.0)]


@pytest.fixture(scope="module")
def problem(logs: list[MatchedLog]) -> EstimationProblem:
    setup = filter_setup(bg.build(hopper()).model, ["C", "k", "R"], logs)
    return bg.pose(setup.filter_model, logs, ["C", "k", "R"])


def _point(problem: EstimationProblem, *values: float) -> np.ndarray:
    return np.array([one.coordinate(value) for one, value in zip(problem.free, values, strict=True)])


def test_every_member_begins_at_the_pressure_that_was_measured(problem: EstimationProblem) -> None:
    members = [(2e-6, 1e-11, 1e8), (4.5e-6, 3e-10, 1e8), (1.5e-5, 8e-9, 1e8)]
    found = problem.batch(np.stack([_point(problem, *one) for one in members], axis=1))
    for log, x0 in zip(problem.logs, found.x0, strict=True):
        p = log.y[0, 0]
        assert x0[0] == pytest.approx([c * p + k * p**2 for c, k, _ in members], rel=1e-9)
    p = problem.logs[0].y[0, 0]
    sensor = found.initial_std[0] / [c + 2.0 * k * p for c, k, _ in members]  # what it is in pressure
    assert sensor == pytest.approx(np.full(3, sensor[0]), rel=1e-6)


@pytest.mark.parametrize("at", [(4.5e-6, 3e-10, 1.7e8), (6e-6, 1e-10, 1.8e8)])
def test_gradients_know_that_starts_move_along_the_curve(problem: EstimationProblem, at: tuple[float, ...]) -> None:
    point = _point(problem, *at)
    (found,) = exact_derivatives(problem, point[:, np.newaxis], np.full((3, 1), 1e-4))
    for k in range(3):
        away = np.zeros(3)
        away[k] = 1e-5
        ahead, behind = problem.nll(np.stack([point + away, point - away], axis=1))
        assert found.gradient[k] == pytest.approx((ahead - behind) / 2e-5, rel=1e-4, abs=1e-3)


def test_second_derivatives_know_that_starts_move_along_the_curve(problem: EstimationProblem) -> None:
    point = _point(problem, 4.5e-6, 3e-10, 1.7e8)
    assert exact_hessian(problem, point).matrix == pytest.approx(hessian(problem, point).matrix, rel=1e-3)


@pytest.mark.slow
def test_an_estimate_finds_the_vessel_whose_start_is_declared_elsewhere(logs: list[MatchedLog]) -> None:
    found = bg.estimate(bg.build(hopper()), logs)
    for name, true in (("C", _AREA), ("k", _WIDENS), ("R", _OUTLET)):
        assert abs(found.values[name] - true) < 3.0 * found.std[name]


@given(st.floats(-3.0, 3.0), st.floats(-6.0, 6.0), st.sampled_from([1.0, -1.0]))
def test_a_curve_is_inverted_wherever_it_is_steep_enough(start: float, true: float, sign: float) -> None:
    """From any start, rising or falling, an asymmetric curve with no flat part is followed to the value it shows."""

    def curve(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return sign * (x + 0.1 * x**3 + np.exp(0.3 * x)), sign * (1.0 + 0.3 * x**2 + 0.3 * np.exp(0.3 * x))

    shown, steep = curve(np.array([true]))
    found, slope = inverted(curve, np.array([start, true]), float(shown[0]))
    assert found == pytest.approx([true, true], abs=1e-8)
    assert slope == pytest.approx([steep[0]] * 2, rel=1e-6)


def test_what_a_curve_never_shows_is_found_nowhere() -> None:
    above, _ = inverted(lambda x: (np.tanh(x), 1.0 / np.cosh(x) ** 2), np.array([0.0, 0.5]), 1.2)
    assert np.isnan(above).all()
    ceiling, _ = inverted(lambda x: (np.tanh(x), 1.0 / np.cosh(x) ** 2), np.array([0.0]), 0.99999)
    assert np.isnan(ceiling).all()  # so flat there that noise would put it anywhere
    flat, _ = inverted(lambda x: (x**2, 2.0 * x), np.array([0.0]), 4.0)
    assert np.isnan(flat).all()  # it may be on either side


def test_what_one_output_shows_lets_a_curve_show_another_state() -> None:
    """A pressure that falls with the flow as its square shows the head behind it once the flow is measured."""
    g = bg.BondGraph("line")
    tank, pipe = g.zero_junction("tank", bg.HYDRAULIC), g.one_junction("pipe", bg.HYDRAULIC)
    g.compliance("level", lambda V: 2e5 * V + 1e6 * V**3, at=tank, state="V", initial=0.1)
    g.bond(tank, pipe)
    g.inertance("water", 1e5, at=pipe, state="p")
    g.resistance("hose", lambda q: 5e8 * q * abs(q), at=pipe)
    g.measure("flow", signal("flow", "hose"), "m^3/s")
    g.measure("outlet", signal("effort", "level") - signal("effort", "hose"), "Pa")
    model = bg.build(g).model
    y = np.array([[0.002, 0.002], [28000.0, 28000.0]])
    log = MatchedLog("run", np.array([0.0, 1.0]), np.zeros((0, 2)), y)
    (x0,) = initial_states(model, [log], model.theta(), "measured")
    found = model.output(0.0, x0, model.u0(), model.theta())
    assert found == pytest.approx(y[:, 0], rel=1e-9)
    alone = first_shown(model, log, model.theta())
    assert [model.names("output")[output] for output in alone] == ["flow"]


@pytest.mark.slow
def test_a_vessel_that_widens_is_told_where_every_run_begins_elsewhere(logs: list[MatchedLog]) -> None:
    """The law of the storage began where the straight one does: it lost to a product of inflow and level."""
    closed = bg.close_loop(hopper(widens=False), logs, [emptied(3, 4500.0)])
    assert [one.trial.candidate.label for one in closed.added] == ["tapered_tank at vessel"]
    assert closed.verdict == "effect found"
