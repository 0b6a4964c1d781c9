"""Impacts: rebounds, rest, several bodies, moving tables, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.modal import clutch, impact
from bondgraph.errors import ModelError
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.simulation import simulate
from tests.simulate.machines import ball, cradle, exact, room, shaker

FALL = np.sqrt(2.0 / 9.81)


def times_of(found):
    return np.array([event.time for event in found.events])


@pytest.mark.parametrize("floor", [0.0, 1.0])
def test_a_ball_bounces_at_the_known_times_to_the_known_heights_and_comes_to_rest(floor):
    times = np.linspace(0.0, 6.0, 6001)
    found = simulate(exact(ball(0.8, floor)), times)
    flights = 2.0 * FALL * 0.8 ** np.arange(1, 30)
    np.testing.assert_allclose(times_of(found)[:30], FALL + np.concatenate([[0.0], np.cumsum(flights)]), atol=1e-8)
    for bounce, (start, end) in enumerate(zip(times_of(found)[:8], times_of(found)[1:9], strict=True), start=1):
        inside = (times > start) & (times < end)
        assert np.max(found.state("height")[inside]) - floor == pytest.approx(0.64**bounce, abs=1e-5)
    assert found.outcome is Outcome.OK
    assert found.events[-1].what == "comes to rest"
    assert found.events[-1].time == pytest.approx(FALL * 1.8 / 0.2, abs=1e-5 if floor else 1e-6)
    assert found.state("v")[-1] == 0.0 and found.state("height")[-1] == pytest.approx(floor, abs=1e-12)
    assert found.output("floor_force")[-1] == pytest.approx(-2.0 * 9.81, rel=1e-12)


def test_without_loss_a_ball_bounces_for_ever_to_its_height():
    found = simulate(exact(ball(1.0)), np.linspace(0.0, 20.0, 2))
    np.testing.assert_allclose(times_of(found), FALL * (1.0 + 2.0 * np.arange(22)), atol=1e-8)
    height, v = found.state("height")[-1], found.state("v")[-1]
    assert 9.81 * height + v**2 / 2 == pytest.approx(9.81, rel=1e-9)


def test_without_rebound_a_ball_stays_where_it_falls():
    found = simulate(exact(ball(0.0)), np.linspace(0.0, 2.0, 3))
    assert [event.what for event in found.events] == ["comes to rest"]
    np.testing.assert_allclose(found.x[:, -1], 0.0, atol=1e-15)


def test_a_start_inside_the_floor_is_refused():
    with pytest.raises(ModelError, match=r"gap of floor is -0.5 at the start.* - start with the gap open or closed"):
        simulate(exact(ball()), [0.0, 1.0], x0={"height": -0.5})


def test_a_start_at_rest_on_the_floor_stays_there_without_events():
    found = simulate(exact(ball()), [0.0, 1.0], x0={"height": 0.0})
    assert found.events == () and found.output("floor_force")[-1] == pytest.approx(-19.62)


def test_the_last_ball_of_a_cradle_takes_all_the_speed():
    found = simulate(exact(cradle(5)), [0.0, 3.0])
    assert [event.element for event in found.events] == ["hit0", "hit1", "hit2", "hit3"]
    np.testing.assert_allclose(times_of(found), 1.0, atol=1e-12)
    np.testing.assert_allclose(found.x[:, -1], [0, 0, 0, 0, 1, 0, 0, 0, 0, 2], atol=1e-12)


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.7])
def test_impacts_keep_momentum_and_lose_energy(restitution):
    found = simulate(exact(cradle(4, restitution)), [0.0, 3.0])
    speeds = found.x[:4, -1]
    assert found.outcome is Outcome.OK
    assert speeds.sum() == pytest.approx(1.0, abs=1e-12)
    assert (np.diff(speeds) >= -1e-9).all()
    assert (speeds**2).sum() < 1.0
    if restitution == 0.0:
        np.testing.assert_allclose(speeds, 0.25, atol=1e-9)


def test_a_table_that_falls_faster_than_gravity_is_left_and_hit_again():
    found = simulate(exact(shaker()), np.linspace(0.0, 0.15, 16))
    leaves = np.arcsin(9.81 / (0.01 * 50.0**2)) / 50.0
    assert found.events[0].what == "opens"
    assert found.events[0].time == pytest.approx(leaves, abs=1e-9)
    height, speed = 0.01 * np.sin(50.0 * leaves), 0.5 * np.cos(50.0 * leaves)

    def gap(t):
        return height + speed * (t - leaves) - 9.81 / 2 * (t - leaves) ** 2 - 0.01 * np.sin(50.0 * t)

    assert found.events[1].what == "rebounds"
    assert found.events[1].time == pytest.approx(brentq(gap, 0.1, 0.12, xtol=1e-15), abs=1e-8)


def test_an_impact_on_a_body_behind_a_clutch_makes_the_clutch_slip():
    """The clutch is of finite strength: it passes no impulse, so only the body that is hit turns back."""
    g = BondGraph("crash")
    front, rear = g.one_junction("front", TRANSLATION), g.one_junction("rear", TRANSLATION)
    g.inertance("front_mass", g.parameter("m1", 1.0, "kg"), at=front, state="v1", initial=1.0)
    g.inertance("rear_mass", g.parameter("m2", 2.0, "kg"), at=rear, state="v2", initial=1.0)
    clutch(g, "grip", g.parameter("F", 4.0, "N"), rear, front, width=g.parameter("w", 1e-3, "m/s"))
    place = g.integral("place", front.flow, "m", initial=-1.0)
    wall = g.one_junction("wall", TRANSLATION)
    between = g.zero_junction("between", TRANSLATION)
    g.flow_source("fixed", 0, at=wall)
    g.bond(wall, between)
    g.bond(between, front)
    stiffness, depth = g.parameter("k", 1e6, "N/m"), g.parameter("d", 1e-6, "m")
    impact(g, "bumper", -place, g.parameter("e", 0.5, "1"), stiffness=stiffness, width=depth, at=between)
    found = simulate(exact(g), [0.0, 1.0 + 1e-9])
    assert [event.what for event in found.events] == ["rebounds"]
    np.testing.assert_allclose(found.x[:2, -1], [-0.5, 1.0], atol=1e-7)
    assert found.input("mode_grip")[-1] == 1.0


@pytest.mark.parametrize("seed", [3, 8])
def test_rough_bodies_between_walls_never_overlap_nor_gain_energy(seed):
    """Statically indeterminate in many of its modes: floor, walls and neighbours may hold the same body."""
    model = exact(room(seed))
    found = simulate(model, np.linspace(0.0, 5.0, 101))
    assert found.outcome is Outcome.OK and len(found.events) > 5
    places = np.stack([found.state(f"x{i}") for i in range(3)])
    walled = np.vstack([np.full(101, -1.0), places, np.full(101, 3.0)])
    assert np.diff(walled, axis=0).min() > -1e-9
    value = dict(zip(model.names("parameter"), model.theta(), strict=True))
    energy = value["k_spring"] * found.state("q_spring") ** 2 / 2
    energy = energy + sum(value[f"m{i}"] * found.state(f"v{i}") ** 2 / 2 for i in range(3))
    assert np.diff(energy).max() < 1e-8 < energy[0] - energy[-1]


def test_the_smooth_form_rebounds_like_the_exact_one():
    graph = ball(1.0)
    times = np.linspace(0.0, 1.2, 13)
    smooth = simulate(exact(graph, smooth=True), times, theta={"k": 1e8, "width": 1e-8})
    np.testing.assert_allclose(smooth.state("height"), simulate(exact(graph), times).state("height"), atol=2e-3)
