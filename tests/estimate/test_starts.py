"""Declared starts at signals of a log: in initial states, filters, estimates and simulations."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.build import build
from bondgraph.data.log import Log, LogChannel, MatchedLog
from bondgraph.declare.domains import ROTATION
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.initial import initial_states
from bondgraph.estimate.problem import pose
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import likelihood
from bondgraph.filter.runs import run
from bondgraph.report.simulation import SimulationOptions, simulate_graph
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from bondgraph.simulate.starts import starts_in

B, SOFT, START = 0.1, 5.0, 40.0


def pair(initial: object = 0.0) -> BondGraph:
    """A rotor whose speed is measured drags a second one through oil; the second one's speed is not measured."""
    g = BondGraph("pair")
    torque = g.input("torque", "N m")
    first, oil, second = (
        g.one_junction("first", ROTATION), g.zero_junction("oil", ROTATION), g.one_junction("second", ROTATION)
    )  # fmt: skip
    b = g.parameter("b", 0.15, "N m s", "oil", (0.01, 1.0))
    g.effort_source("drive", torque, at=first)
    g.inertance("rotor", g.parameter("J", 0.2, "kg m^2"), at=first, state="w_first")
    g.bond(first, oil)
    g.bond(oil, second)
    g.resistance("shear", flow=1 / b, at=oil)
    g.inertance("wheel", g.parameter("J_w", 0.5, "kg m^2"), at=second, state="w_second", initial=initial)
    g.measure_flow("speed", first, "")
    return g


def model(initial: object = 0.0) -> Model:
    return build(pair(initial)).model


def running(size: int = 60) -> MatchedLog:
    """Both roll at 40 rad/s when the log begins, and a torque sets in."""
    time = 0.05 * np.arange(size)
    u = np.where(time > 0.5, 2.0, 0.0)[np.newaxis]
    own = model()
    run = simulate(own, time, u, own.theta(b=B), {"w_first": START, "w_second": START}, rtol=1e-9)
    noise = 0.02 * np.random.default_rng(4).standard_normal(run.y.shape)
    return MatchedLog("rolling", time, u, run.y + noise)


def filtering(own: Model) -> FilterModel:
    return FilterModel(own, {}, {"speed": 0.02}, {"w_first": 0.02}, substeps=2)


@pytest.mark.parametrize("rule", ["measured", "settled", "model", ({"w_first": 1.0},)])
def test_the_declared_start_holds_under_every_rule(rule):
    log, own = running(), model("speed")
    x0 = initial_states(own, [log], own.theta(), rule)[0]
    expected = {"model": 0.0}.get(rule, log.y[0, 0]) if isinstance(rule, str) else 1.0
    assert x0.tolist() == pytest.approx([expected, log.y[0, 0]])
    assert model().x0().tolist() == own.x0().tolist() == [0.0, 0.0]


def test_a_given_state_comes_before_the_declared_signal():
    log, own = running(), model("speed")
    assert initial_states(own, [log], own.theta(), ({"w_second": 2.0},))[0].tolist() == [0.0, 2.0]


def test_an_output_that_comes_late_gives_no_start():
    log, own = running(), model(("0.5*speed", 3.0))
    assert initial_states(own, [log], own.theta(), "model")[0][1] == 0.5 * log.y[0, 0]
    late = MatchedLog("late", log.time, log.u, np.where(np.arange(60) < 10, np.nan, log.y))
    assert initial_states(own, [late], own.theta(), "model")[0].tolist() == [0.0, 3.0]
    alone = MatchedLog("alone", log.time[:1], log.u[:, :1], log.y[:, :1])
    assert starts_in(own, alone.time, alone.u, alone.y)[0][1] == 0.5 * log.y[0, 0]


def test_filter_and_likelihood_begin_there_without_being_told():
    log, own = running(), model("speed")
    told = run(filtering(own), log, x0=[log.y[0, 0], log.y[0, 0]])
    assert run(filtering(own), log, x0=None).nll != told.nll  # the first rotor is declared at zero
    x0 = [0.0, log.y[0, 0]]
    assert run(filtering(own), log).nll == run(filtering(own), log, x0=x0).nll
    assert likelihood(filtering(own), log).nll[0] == pytest.approx(run(filtering(own), log, x0=x0).nll, rel=1e-12)


def test_an_estimate_is_right_where_the_start_is():
    """Started at its declared zero, the second rotor drags the first, and b came out at 0.010, its lower bound."""
    log = running()
    found = {
        name: estimate(pose(filtering(own), log, ["b"]), Settings(method="gradient", certify="none")).values["b"]
        for name, own in (("zero", model()), ("signal", model("speed")))
    }
    assert found["signal"] == pytest.approx(B, abs=0.002)
    assert found["zero"] < 0.02


def measured_table(size: int = 60) -> Log:
    log = running(size)
    channels = {
        "torque": LogChannel("torque", "N m", log.u[0]),
        "speed": LogChannel("speed", "rpm", log.y[0] * 30.0 / np.pi),
    }
    return Log("rolling", log.time, channels)


def test_a_simulation_of_a_log_starts_where_the_log_does():
    started = simulate_graph(pair("speed"), measured_table(), SimulationOptions())
    assert started.x[:, 0].tolist() == pytest.approx([0.0, running().y[0, 0]])
    assert simulate_graph(pair(), measured_table(), SimulationOptions()).x[:, 0].tolist() == [0.0, 0.0]
    given = simulate_graph(pair("speed"), measured_table(), SimulationOptions(initial={"w_second": 5.0}))
    assert given.x[:, 0].tolist() == [0.0, 5.0]


def test_a_simulation_without_values_starts_at_the_number():
    def by_input(share: float = 1.0) -> BondGraph:
        g = pair()
        g.integral("given", 1.0 * g.quantities["torque"].symbol, "N m s", initial=("before", 4.0))
        g.input("before", "N m s", default=7.0)
        return g

    until = SimulationOptions(until=0.1, step=0.1)
    assert simulate_graph(by_input(), None, until).x[2, 0] == 4.0
    told = SimulationOptions(until=0.1, step=0.1, values={"before": 9.0})
    assert simulate_graph(by_input(), None, told).x[2, 0] == 9.0
