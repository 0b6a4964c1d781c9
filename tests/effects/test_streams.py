"""Resistances that follow an input: exact in their factor, tried with each input that varies, found with its power."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph import effects
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.models.typical import typical_inputs
from bondgraph.data.log import FloatArray
from bondgraph.data.matching import match
from bondgraph.declare.editing import copy, handle
from bondgraph.declare.effect import SMOOTHING, Place, Scale, members_of

CAPACITY, CONDUCTANCE, POWER = 900.0, 8.0, 0.7


def sink() -> bg.BondGraph:
    """Fins of a converter in a stream of air, whose conductance is declared as a constant."""
    g = bg.BondGraph("sink")
    losses, around = g.input("losses", "W"), g.input("around", "K")
    g.input("speed", "m/s")
    g.input("lever", "", hold=True)
    body, fins = g.zero_junction("body", bg.THERMAL), g.one_junction("fins", bg.THERMAL)
    capacity = g.parameter("C", 700.0, "J/K", "", (300.0, 2000.0))
    g.compliance("heat", lambda content: content / capacity, at=body, state="H", initial=210000.0)
    g.flow_source("converter", losses, at=body)
    conductance = g.parameter("G", 6.0, "W/K", "", (2.5, 20.0))
    g.resistance("surface", flow=lambda effort: conductance * effort, at=fins)
    g.bond(body, fins)
    g.bond(fins, g.effort_source("air", around))
    g.measure_effort("temperature", body)
    return g


PLACE = Place(handle(sink(), "fins"), Scale(50.0, 300.0))


def stream(seed: int) -> bg.Log:
    """Fins by scipy, with a conductance that grows with the power 0.7 of the speed of the air."""
    chance, time = np.random.default_rng(seed), 2.0 * np.arange(700)
    u = np.stack([np.repeat(chance.uniform(*ends, 14), 50) for ends in ((20.0, 400.0), (0.6, 12.0))])

    def rate(t: float, x: FloatArray) -> FloatArray:
        heat, speed = u[:, min(int(t / 2.0 + 1e-9), time.size - 1)]
        return np.asarray((heat - CONDUCTANCE * (speed / 5.0) ** POWER * (x - 298.0)) / CAPACITY)

    x = solve_ivp(rate, (0.0, time[-1]), [300.0], t_eval=time, rtol=1e-8, atol=1e-8, max_step=2.0).y[0]
    table = {"time [s]": time, "losses [W]": u[0], "around [K]": 298.0, "speed [m/s]": u[1], "lever []": 0.0}
    table |= {"temperature [K]": x + chance.normal(0.0, 0.3, time.size)}
    return bg.Log.from_dataframe(pd.DataFrame(table), name=f"run{seed}")


@given(st.floats(-2.0, 2.0), st.floats(0.5, 9.0), st.floats(-40.0, 60.0))
def test_the_declared_law_is_multiplied_by_a_power_of_the_input(power: float, speed: float, warmer: float) -> None:
    content = 700.0 * (300.0 + warmer)
    u = np.array([0.0, 300.0, speed, 0.0])
    theta = FOLLOWING.theta(n_resistance_by_speed_fins=power)
    factor = ((speed / 5.0) ** 2 + SMOOTHING**2) ** (power / 2.0)
    expected = -6.0 * warmer / factor
    assert FOLLOWING.rhs(0.0, np.array([content]), u, theta)[0] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def following() -> bg.BondGraph:
    """The fins with the law of the member for the speed of the air."""
    g = sink()
    (member,) = members_of(effects.resistance_by_input, g, {"speed": 5.0})
    effect = member(g, PLACE)
    assert effect is not None and effect.name == "resistance_by_speed" == member.__name__
    return g


FOLLOWING = bg.build(following()).model


def test_a_member_is_tried_for_each_input_that_varies_and_none_for_levers() -> None:
    log = stream(1)
    model = bg.build(sink()).model
    typical = typical_inputs(model, [match(log, model)])
    assert set(typical) == {"losses", "speed"}
    assert typical["speed"] == pytest.approx(np.exp(np.log(log.to_dataframe()["speed [m/s]"]).mean()))
    members = members_of(effects.resistance_by_input, sink(), {"losses": 200.0, "speed": 5.0})
    found, _ = candidates(bg.build(sink()), members, [PLACE])
    assert [one.label for one in found] == ["resistance_by_losses at fins", "resistance_by_speed at fins"]


def test_a_resistance_that_follows_an_input_already_is_left_alone() -> None:
    g = following()
    before = copy(g)
    assert effects.resistance_by_input(g, PLACE) is None
    assert g == before


@pytest.mark.slow
def test_what_a_stream_makes_of_a_conductance_is_one_law_with_its_power() -> None:
    """It was convection above a speed, a product of flow and speed, and a disturbance, and "confirmed"."""
    closed = bg.close_loop(sink(), train=[stream(1), stream(2)], holdout=[stream(3)])
    assert [one.trial.candidate.label for one in closed.added] == ["resistance_by_speed at fins"]
    assert closed.corrected.values["n_resistance_by_speed_fins"] == pytest.approx(-POWER, abs=0.01)


GAIN, STIFFNESS, LEAK, SUPPLY = 3e-4, 5e11, 2e-11, 16e6


def chamber() -> bg.BondGraph:
    """Oil between a valve and a motor that turns it away, the valve as a gain."""
    g = bg.BondGraph("chamber")
    spool, taken = g.input("spool", "1", "share of its stroke", hold=True), g.input("taken", "m^3/s", hold=True)
    oil = g.zero_junction("oil", bg.HYDRAULIC)
    gain = g.parameter("gain", 2.5e-4, "m^3/s", "flow at full stroke", (5e-5, 2e-3))
    g.flow_source("valve", gain * spool, at=oil)
    g.flow_source("motor", -taken, at=oil)
    g.compliance("volume", g.parameter("k", 4e11, "Pa/m^3", "", (1e11, 4e12)), at=oil, state="V")
    leak = g.parameter("G", 3e-11, "m^3/(s Pa)", "", (1e-12, 1e-9))
    g.resistance("leak", flow=lambda effort: leak * effort, at=oil)
    g.measure_effort("pressure", oil)
    return g


def opened(seed: int) -> bg.Log:
    """The chamber by scipy: an opening under the drop that a supply of 16 MPa leaves."""
    chance, time = np.random.default_rng(seed), 0.02 * np.arange(1200)
    spool = np.repeat(chance.uniform(-0.8, 0.8, 60), 20)
    taken = GAIN * np.repeat(chance.uniform(-0.6, 0.6, 60), 20)

    def rate(t: float, x: FloatArray, opening: float, away: float) -> FloatArray:
        p = STIFFNESS * float(x[0])
        flow = GAIN * opening * np.sqrt(max(1.0 - np.sign(opening) * p / SUPPLY, 0.0))
        return np.array([flow - away - LEAK * p])

    v = np.zeros(time.size)
    for k in range(0, time.size, 20):  # both keep their values for 20 samples
        at = time[k : k + 21]
        given = (spool[k], taken[k])
        v[k : k + 21] = solve_ivp(
            rate, (at[0], at[-1]), v[k : k + 1], "Radau", at, args=given, rtol=1e-9, atol=1e-13
        ).y[0]
    shown = STIFFNESS * v + chance.normal(0.0, 2e4, time.size)
    table = {"time [s]": time, "spool [1]": spool, "taken [m^3/s]": taken, "pressure [Pa]": shown}
    return bg.Log.from_dataframe(pd.DataFrame(table), name=f"run{seed}")


OIL = Place(handle(chamber(), "oil"), Scale(8e6, 3e-4))


@given(st.floats(0.0, 0.9), st.floats(-1.0, 1.0), st.floats(-6e6, 6e6))
def test_flow_of_a_valve_is_that_of_an_opening_under_what_the_supply_leaves(
    share: float, spool: float, pressure: float
) -> None:
    u, x = np.array([spool, 0.0]), np.array([pressure / 4e11])
    theta = VALVE.theta(c_valve_load_flow_oil=share)
    expected = 2.5e-4 * spool * np.sqrt(1.0 - share * np.sign(spool) * pressure / 8e6) - 3e-11 * pressure
    assert VALVE.rhs(0.0, x, u, theta)[0] == pytest.approx(expected, rel=1e-9, abs=1e-15)


def valve() -> bg.BondGraph:
    """The chamber with the law of its valve."""
    g = chamber()
    effect = effects.valve_load_flow(g, OIL)
    assert effect is not None and effect.element == "valve"
    return g


VALVE = bg.build(valve()).model


def test_a_valve_against_more_than_its_supply_stays_a_number() -> None:
    flow = VALVE.rhs(0.0, np.array([9e6 / 4e11]), np.array([1.0, 0.0]), VALVE.theta(c_valve_load_flow_oil=0.95))
    assert flow[0] == pytest.approx(2.5e-4 * 0.1 - 3e-11 * 9e6)


def test_a_valve_is_one_at_a_hydraulic_node_with_a_source_that_follows_an_input() -> None:
    assert effects.valve_load_flow(sink(), PLACE) is None
    g = bg.BondGraph("still")
    node = g.zero_junction("node", bg.HYDRAULIC)
    g.flow_source("steady", g.parameter("q", 1e-4, "m^3/s"), at=node)
    assert effects.valve_load_flow(g, Place(node, Scale(1e5, 1e-4))) is None


@pytest.mark.slow
def test_a_valve_whose_flow_falls_with_the_load_is_found_with_its_supply() -> None:
    """It was a leak in proportion to the opening, and an unknown flow beside it."""
    closed = bg.close_loop(chamber(), train=[opened(1), opened(2)], holdout=[opened(3)])
    assert [one.trial.candidate.label for one in closed.added] == ["valve_load_flow at oil"]
    values = {one.name: one.value for one in closed.corrected_graph.flatten().parameters}
    supply = values["r_valve_load_flow_oil"] / values["c_valve_load_flow_oil"]
    assert supply == pytest.approx(SUPPLY, rel=0.01)
