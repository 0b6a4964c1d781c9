"""Laws of one of several resistances at a place, of what has passed a resistance, and of a change of phase."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sympy import exp, tanh

import bondgraph as bg
from bondgraph import effects
from bondgraph.correct.models.candidates import candidates
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Place, Scale, members_of

CAPACITY, ROOM = 800.0, 293.15


def brake(fading: float = 0.0) -> bg.BondGraph:
    """A flywheel with bearings and pads, whose heat warms a disc; pads may fade with its temperature."""
    g = bg.BondGraph("brake")
    shaft, disc = g.one_junction("shaft", bg.ROTATION), g.zero_junction("disc", bg.THERMAL)
    g.effort_source("motor", g.input("torque", "N m"), at=shaft)
    g.inertance("wheel", g.parameter("J", 0.4, "kg m^2"), at=shaft, state="w")
    bearings, level = g.parameter("b", 0.02, "N m s"), g.parameter("level", 6.0, "N m")
    turns = g.parameter("turns", 1.0, "rad/s", "speed at which the pads hold")
    g.resistance("bearings", bearings, at=shaft)
    share = (
        exp(g.parameter("fading", fading, "K") * (1 / disc.effort - 1 / g.parameter("T_0", ROOM, "K"))) if fading else 1
    )
    pads = g.resistance("pads", lambda flow: level * share * tanh(flow / turns), at=shaft)
    g.flow_source("heat", pads.effort * pads.flow, at=disc)
    g.compliance("steel", lambda heat: heat / CAPACITY, at=disc, state="H", initial=CAPACITY * 300.0)
    conductance = g.parameter("G", 4.0, "W/K")
    air, way = g.effort_source("air", g.parameter("T_a", ROOM, "K")), g.one_junction("way", bg.THERMAL)
    g.bond(disc, way)
    g.bond(way, air)
    g.resistance("cooling", flow=lambda effort: conductance * effort, at=way)
    g.measure_flow("speed", shaft)
    return g


SHAFT, DISC = (
    Place(handle(brake(), name), Scale(*size)) for name, size in (("shaft", (8.0, 90.0)), ("disc", (400.0, 300.0)))
)


def rates(g: bg.BondGraph, speed: float, temperature: float, **theta: float) -> list[float]:
    model = bg.build(g).model
    x = np.array([speed, CAPACITY * temperature])
    return [float(one) for one in model.rhs(0.0, x[: len(model.states)], np.array([3.0]), model.theta(**theta))]


@pytest.mark.parametrize("name", ["bearings", "pads"])
def test_each_of_two_resistances_may_follow_the_temperature(name: str) -> None:
    """Pads that faded beside bearings were a product, a heat capacity that varies and radiation."""
    members = members_of(effects.temperature_dependence, brake(), {})
    found, _ = candidates(bg.build(brake()), members, [SHAFT])
    assert [one.label.partition("_of_")[2] for one in found] == ["bearings at shaft", "pads at shaft"]
    g = brake()
    effect = next(one for one in found if name in one.label).function(g, SHAFT)
    assert effect is not None
    factor = 1.0 - 2e-3 * (340.0 - ROOM)
    bearings, pads = (0.02 * 50.0, 6.0 * np.tanh(50.0))
    drag = bearings * (factor if name == "bearings" else 1.0) + pads * (factor if name == "pads" else 1.0)
    heat = pads * (factor if name == "pads" else 1.0) * 50.0 - 4.0 * (340.0 - ROOM)
    assert rates(g, 50.0, 340.0, **{effect.coefficients[0]: -2e-3}) == pytest.approx([(3.0 - drag) / 0.4, heat])


def test_a_law_whose_loop_has_no_solution_is_refused_and_ends_no_round() -> None:
    """A round ended, since the inside of a disc between its heat and a law of Arrhenius closes a loop from 1/0."""
    found, refused = candidates(bg.build(brake(60.0)), [effects.storage_resistance, effects.heat_loss], [DISC])
    assert [one.effect.name for one in found] == ["heat_loss"]
    assert [one.why for one in refused] == ["would have no rates at the declared values"]


@given(st.floats(0.0, 5e5), st.floats(280.0, 400.0))
def test_a_change_of_phase_takes_heat_where_it_is(latent: float, temperature: float) -> None:
    """The slope of heat over temperature is the capacity and that of the step, which is c/(2 w cosh^2)."""
    theta = {"c_latent_heat_disc": latent, "T_latent_heat_disc": 330.0, "w_latent_heat_disc": 2.0}
    slope = CAPACITY + latent / (4.0 * np.cosh((temperature - 330.0) / 2.0) ** 2)
    model = MELTING
    x = np.array([0.0, CAPACITY * temperature])
    found = model.rhs(0.0, x, np.array([0.0]), model.theta(**theta))[1] / CAPACITY
    assert found == pytest.approx(-4.0 * (temperature - ROOM) / slope, rel=1e-9, abs=1e-12)


def melting() -> bg.BondGraph:
    g = brake()
    assert effects.latent_heat(g, DISC) is not None
    return g


MELTING = bg.build(melting()).model


def test_a_filter_clogs_with_what_has_passed_it() -> None:
    g = bg.BondGraph("filter")
    line = g.zero_junction("line", bg.HYDRAULIC)
    g.flow_source("pump", g.input("inflow", "m^3/s"), at=line)
    k, r = g.parameter("k", 1e9, "Pa/m^3"), g.parameter("r", 1e8, "Pa s/m^3")
    g.compliance("hose", lambda volume: k * volume, at=line, state="V")
    g.resistance("mesh", flow=lambda effort: effort / r, at=line)
    g.measure_effort("pressure", line)
    effect = effects.clogging(g, Place(line, Scale(1e5, 1e-3)))
    assert effect is not None
    (name,) = effect.coefficients
    model = bg.build(with_values(g, {name: 0.5})).model
    assert model.names("state") == ("V", "passed_clogging_line")
    pressure, passed = 2e5, 3.0
    through = pressure / (1e8 * (1.0 + 0.5 * passed))
    found = model.rhs(0.0, np.array([pressure / 1e9, passed]), np.array([1e-3]), model.theta())
    np.testing.assert_allclose(found, [1e-3 - through, through], rtol=1e-12)
