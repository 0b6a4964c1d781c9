"""Inertia that changes with a position: Lagrange's equation, energy that stays, and a chain that is found."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph import effects
from bondgraph.data.log import FloatArray
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale


def axis() -> bg.BondGraph:
    """A carriage that a linear motor moves, with guides that rub."""
    g = bg.BondGraph("axis")
    force = g.input("F", "N", "linear motor")
    m = g.parameter("m", 60.0, "kg", "carriage", (20.0, 200.0))
    rail = g.one_junction("rail", bg.TRANSLATION)
    g.effort_source("motor", force, at=rail)
    g.inertance("carriage", m, at=rail, state="v")
    g.resistance("guides", g.parameter("c", 90.0, "N s/m", "guides", (0.0, 500.0)), at=rail)
    place = g.integral("x", rail.flow, "m", "place")
    g.measure_flow("speed", rail)
    g.measure("place", place, "m")
    return g


def chained() -> bg.Model:
    g = axis()
    assert effects.inertia_by_position(g, Place(handle(g, "rail"), Scale(500.0, 2.0))) is not None
    return bg.build(g).model


CHAIN = chained()


def values(c1: float, c2: float) -> np.ndarray:
    return CHAIN.theta(c=0.0, c1_inertia_by_position_rail=c1, c2_inertia_by_position_rail=c2)


@given(st.floats(-5.0, 20.0), st.floats(-0.3, 3.0), st.floats(0.0, 7.0), st.floats(-3.0, 3.0), st.floats(-500.0, 500.0))
def test_it_moves_by_the_equation_of_lagrange(c1: float, c2: float, x: float, v: float, force: float) -> None:
    """d(m v)/dt - m' v^2/2 = F, where m is that of the place."""
    m, rise = 60.0 + c1 * x + c2 * x**2, c1 + 2.0 * c2 * x
    state = CHAIN.x0(v=v, x=x)
    expected = {"v": (force - 0.5 * rise * v**2) / m, "x": v}
    found = CHAIN.rhs(0.0, state, np.array([force]), values(c1, c2))
    np.testing.assert_allclose(found, [expected[name] for name in CHAIN.names("state")], rtol=1e-9, atol=1e-9)


def test_its_energy_stays() -> None:
    theta, names = values(11.0, 0.4), CHAIN.names("state")
    run = solve_ivp(
        lambda t, y: CHAIN.rhs(t, y, np.zeros(1), theta), (0.0, 3.0), CHAIN.x0(v=2.0, x=0.5), rtol=1e-10, atol=1e-12
    )
    v, x = run.y[names.index("v")], run.y[names.index("x")]
    energy = 0.5 * (60.0 + 11.0 * x + 0.4 * x**2) * v**2
    assert np.ptp(x) > 3.0
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)


def test_it_is_offered_where_a_position_is_known_and_an_inertia_declared() -> None:
    g = bg.BondGraph("bare")
    rail, damper = g.one_junction("rail", bg.TRANSLATION), g.one_junction("damper", bg.TRANSLATION)
    g.inertance("mass", 3.0, at=rail)
    g.integral("x", damper.flow, "m")
    for at in (rail, damper):
        assert effects.inertia_by_position(g, Place(at, Scale(1.0, 1.0))) is None


def drive(more: float, seed: int) -> bg.Log:
    """A log of 25 s at 50 Hz, by scipy; the carriage goes between places, its chain has so many kg/m."""
    chance = np.random.default_rng(seed)
    time: FloatArray = np.arange(1250) * 0.02
    force, state, states = np.zeros(time.size), np.array([0.0, 3.0]), []
    for k in range(time.size):
        if k % 40 == 0:
            aim = chance.uniform(0.3, 6.7)
        states.append(state)
        force[k] = np.clip(400.0 * (np.clip(2.0 * (aim - state[1]), -2.5, 2.5) - state[0]), -500.0, 500.0)

        def rates(t: float, y: np.ndarray, f: float = force[k]) -> list[float]:
            return [(f - 110.0 * y[0] - 0.5 * more * y[0] ** 2) / (48.0 + more * y[1]), y[0]]

        state = solve_ivp(rates, (0.0, 0.02), state, rtol=1e-8, atol=1e-10).y[:, -1]
    v, x = np.array(states).T + np.array([[0.02], [0.005]]) * chance.standard_normal((2, time.size))
    columns = {"F": ("N", force), "speed": ("m/s", v), "place": ("m", x)}
    return bg.Log(f"drive_{seed}", time, {name: bg.LogChannel(name, *own) for name, own in columns.items()})


@pytest.mark.slow
@pytest.mark.parametrize("more", [11.0, 0.0])
def test_a_chain_that_moves_along_is_found(more: float) -> None:
    """It was the product of two signals, and two more to mend it."""
    closed = bg.close_loop(axis(), [drive(more, seed) for seed in (1, 2)], [drive(more, 3)])
    assert [one.trial.candidate.label for one in closed.added] == (["inertia_by_position at rail"] if more else [])
    if more:
        assert closed.corrected.values["c1_inertia_by_position_rail"] == pytest.approx(more, rel=0.1)
