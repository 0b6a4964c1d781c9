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
