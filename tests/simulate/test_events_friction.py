"""Friction that locks: clutches, stick-slip, several locked elements at once, against closed forms and enumeration."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.modal import clutch, friction
from bondgraph.simulate.modes import consistent_inputs
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.simulation import simulate
from tests.simulate.machines import belt, engagement, exact, geared, train


def times_of(found):
    return [event.time for event in found.events]


def test_two_rotors_lock_when_and_at_what_speed_momentum_says():
    found = simulate(exact(engagement()), np.linspace(0.0, 2.0, 21))
    assert [str(event) for event in found.events] == ["t = 0.714285714286 s: plates locks"]
    assert times_of(found) == pytest.approx([100.0 / (20.0 / 0.2 + 20.0 / 0.5)], abs=1e-12)
    locked = found.time > 0.72
    np.testing.assert_allclose(found.x[0, locked], found.x[1, locked], rtol=1e-15)
    np.testing.assert_allclose(found.x[0, locked], 0.2 * 100.0 / 0.7, rtol=1e-12)
    lost = 0.5 * 0.2 * 100.0**2 - 0.5 * 0.7 * found.x[0, -1] ** 2
    np.testing.assert_allclose(found.state("heat")[locked], lost, rtol=1e-12)
    np.testing.assert_array_equal(found.input("mode_plates"), np.where(locked, 0.0, 1.0))


def test_a_locked_clutch_carries_its_share_and_slips_when_the_pedal_takes_the_grip_away():
    grip = [1.0, 1.0, 1.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.5, 1.0, 1.0]
    found = simulate(exact(engagement()), np.linspace(0.0, 10.0, 11), {"grip": grip, "torque": np.full(11, 7.0)})
    share = 7.0 * 0.5 / 0.7
    speed = (20.0 / 0.2 + 20.0 / 0.5 - 7.0 / 0.2) ** -1 * 100.0
    assert times_of(found)[:2] == pytest.approx([speed, 4.0 + (0.5 - share / 20.0) / 0.5], abs=1e-9)
    assert [event.what for event in found.events] == ["locks", "slips forward", "locks"]
    np.testing.assert_allclose(found.output("clutch_torque")[[2, 3, 4, 10]], share, rtol=1e-9)


def test_stick_and_slip_alternate_as_in_the_textbook():
    """Sticking lasts 2 (F_static - F_sliding)/(k v); slipping by the closed form of the free oscillation."""
    found = simulate(exact(belt()), np.linspace(0.0, 10.0, 11))
    k, sliding, static, v, omega = 100.0, 2.0, 3.0, 0.1, 10.0
    stick = 2.0 * (static - sliding) / (k * v)
    slip = 2.0 / omega * (np.pi - np.arctan((static - sliding) / (v * np.sqrt(k))))
    durations = np.diff(times_of(found))
    assert times_of(found)[0] == pytest.approx(static / k / v, abs=1e-12)
    np.testing.assert_allclose(durations[0::2], slip, atol=1e-9)
    np.testing.assert_allclose(durations[1::2], stick, atol=1e-9)
    assert durations.size == 28


def test_chained_masses_part_at_the_weakest_joint_and_then_at_the_next():
    times = np.linspace(0.0, 40.0, 11)
    found = simulate(exact(train((1.0, 2.0, 3.0), (10.0, 1.0))), times, {"F0": times})
    assert [str(event) for event in found.events] == ["t = 2 s: grip1 slips forward", "t = 14.5 s: grip0 slips forward"]


def test_a_dependent_rotor_behind_a_gear_counts_as_part_of_the_load():
    found = simulate(exact(geared()), np.linspace(0.0, 20.0, 21))
    load, drag = 2.0 + 3.0 * 3.0**2, 3.0 * 0.5
    lock = 10.0 / (4.0 / 1.0 + (4.0 - drag) / load)
    stop = lock + (10.0 - 4.0 * lock) * (1.0 + load) / drag
    assert times_of(found) == pytest.approx([lock, stop], abs=1e-9)
    np.testing.assert_allclose(found.x[:, -1], 0.0, atol=1e-12)


def test_a_belt_whose_speed_is_an_input_carries_the_block_along():
    g = BondGraph("carried")
    width, level = g.parameter("width", 1e-3, "m/s"), g.parameter("F_c", 2.0, "N")
    drive, block = g.one_junction("drive", TRANSLATION), g.one_junction("block", TRANSLATION)
    g.flow_source("motor", g.input("v_belt", "m/s"), at=drive)
    g.inertance("mass", g.parameter("m", 1.0, "kg"), at=block, state="v")
    clutch(g, "belt", level, drive, block, width=width)
    g.measure_effort("force", "belt")
    found = simulate(exact(g), np.arange(6.0), {"v_belt": [0.0, 1.0, 2.0, 2.0, 5.0, 8.0]})
    assert [str(event) for event in found.events] == ["t = 3 s: belt slips forward"]
    np.testing.assert_allclose(found.state("v"), [0.0, 1.0, 2.0, 2.0, 4.0, 6.0], atol=1e-12)
    np.testing.assert_allclose(found.output("force"), [1.0, 1.0, 1.0, 0.0, 2.0, 2.0], atol=1e-12)


def test_a_block_that_passes_zero_speed_under_a_large_force_turns_without_locking():
    g = BondGraph("thrown")
    v = g.one_junction("v", TRANSLATION)
    g.inertance("mass", g.parameter("m", 1.0, "kg"), at=v, state="v", initial=6.0)
    g.effort_source("pull", -g.parameter("F", 5.0, "N"), at=v)
    friction(g, "floor", g.parameter("F_c", 1.0, "N"), width=g.parameter("w", 1e-3, "m/s"), at=v)
    found = simulate(exact(g), np.linspace(0.0, 3.0, 4))
    assert [str(event) for event in found.events] == ["t = 1 s: floor slips backward"]
    assert found.state("v")[-1] == pytest.approx(-8.0, abs=1e-12)


def by_enumeration(masses, capacities, ground, forces):
    """Accelerations of a train at rest: every combination of modes is tried, those that fit are kept."""
    n = len(masses)
    flows = np.array([[1.0 if j == i else -1.0 if j == i + 1 else 0.0 for j in range(n)] for i in range(n - 1)])
    flows = np.vstack([flows, np.eye(n)[:1]])
    levels = np.array([*capacities, *ground])
    gain = -flows @ np.diag(1.0 / masses) @ flows.T
    free = flows @ (forces / masses)
    found = []
    for modes in itertools.product((-1.0, 0.0, 1.0), repeat=levels.size):
        slips = np.array(modes) != 0
        efforts = levels * modes
        held = ~slips
        if held.any():
            efforts[held] = np.linalg.solve(gain[np.ix_(held, held)], -(free + gain[:, slips] @ efforts[slips])[held])
        rates = free + gain @ efforts
        if (np.abs(efforts[held]) <= levels[held]).all() and (rates[slips] * np.array(modes)[slips] >= 0).all():
            found.append((forces - flows.T @ efforts) / masses)
    return found


@pytest.mark.parametrize("seed", range(6))
def test_which_elements_lock_is_what_trying_all_combinations_gives(seed):
    rng = np.random.default_rng(seed)
    masses, levels, ground = rng.uniform(0.5, 3.0, 3), rng.uniform(0.2, 2.0, 2), rng.uniform(0.2, 2.0, 1)
    model = exact(train(masses, levels, ground))
    for forces in rng.uniform(-5.0, 5.0, (20, 3)):
        u = model.u0(**{f"F{i}": force for i, force in enumerate(forces)})
        u = consistent_inputs(model, 0.0, model.x0(), u, model.theta())
        rates = model.rhs(0.0, model.x0(), u, model.theta())
        (wanted,) = by_enumeration(masses, levels, ground, forces)
        np.testing.assert_allclose(rates, wanted, atol=1e-10)


@pytest.mark.parametrize("seed", range(2))
def test_the_smooth_form_tends_to_the_exact_one_as_its_width_shrinks(seed):
    rng = np.random.default_rng(100 + seed)
    graph = train(rng.uniform(0.5, 3.0, 3), rng.uniform(0.2, 2.0, 2), rng.uniform(0.2, 1.0, 1))
    times = np.linspace(0.0, 4.0, 9)
    forces = {f"F{i}": rng.uniform(-5.0, 5.0, 9) for i in range(3)}
    found = simulate(exact(graph), times, forces)
    assert found.outcome is Outcome.OK and len(found.events) > 1
    distances = []
    for width in (1e-2, 1e-3):
        smooth = simulate(exact(graph, smooth=True), times, forces, {"width": width}, method="Radau", rtol=1e-8)
        distances.append(np.abs(smooth.x - found.x).max())
    assert distances[1] < 2e-2 * max(1.0, np.abs(found.x).max())
    assert distances[1] < distances[0]


def test_a_static_capacity_holds_more_than_the_sliding_one():
    g = BondGraph("breakaway")
    v = g.one_junction("v", TRANSLATION)
    force = g.input("force", "N")
    g.inertance("mass", g.parameter("m", 1.0, "kg"), at=v, state="v")
    g.effort_source("pull", force, at=v)
    level = g.parameter("F_c", 1.0, "N")
    friction(g, "floor", level, static=1.5 * level, width=g.parameter("w", 1e-3, "m/s"), at=v)
    found = simulate(exact(g), np.linspace(0.0, 2.0, 3), {"force": [0.0, -1.0, -2.0]})
    assert [str(event) for event in found.events] == ["t = 1.5 s: floor slips backward"]
    assert found.state("v")[-1] == pytest.approx(-0.5 * (1.0**2 - 0.5**2), abs=1e-10)
