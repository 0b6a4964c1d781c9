"""Events of switches: found to rounding, integrated on the right side, and recognised where they have no end."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Integral, symbol
from bondgraph.declare.switching import closed, dry_friction, end_stop, switch
from bondgraph.errors import ModelError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.batch import simulate_batch
from bondgraph.simulate.crossing import first_crossing
from bondgraph.simulate.model import Model
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.simulation import simulate
from tests.simulate.machines import belt, exact, rectifier


def rows(*functions):
    return lambda t: np.stack([function(t) for function in functions])


def test_the_first_of_several_crossings_is_found_to_rounding():
    found = first_crossing(rows(lambda t: np.cos(t), lambda t: 3.0 - t, lambda t: t + 1.0), 0.0, 4.0, np.full(3, 1e-12))
    assert (found.row, found.time) == (0, pytest.approx(np.pi / 2, abs=1e-15))


def test_a_dip_between_two_samples_is_found_and_one_that_stays_above_is_not():
    for depth in (1e-3, 1e-6):
        found = first_crossing(rows(lambda t, d=depth: (t - 0.53) ** 2 - d), 0.0, 1.0, np.full(1, 1e-12))
        assert found.time == pytest.approx(0.53 - np.sqrt(depth), abs=1e-9)
    assert first_crossing(rows(lambda t: (t - 0.53) ** 2 + 1e-6), 0.0, 1.0, np.full(1, 1e-12)) is None


def test_a_flight_that_starts_at_zero_ends_where_it_comes_down():
    for height in (1.0, 1e-3, 1e-6):
        found = first_crossing(rows(lambda t, h=height: t * (h - t)), 0.0, 2.0, np.full(1, 1e-30))
        assert found.time == pytest.approx(height, rel=1e-9)
    falls_at_once = first_crossing(rows(lambda t: 0.5 - t), 0.5, 1.0, np.full(1, 1e-12))
    assert falls_at_once.time == 0.5


def test_a_stop_is_left_after_half_a_period_of_its_spring():
    g = BondGraph("stop")
    v = g.one_junction("v", TRANSLATION)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=v, state="v", initial=3.0)
    k, width = g.parameter("k", 2e6, "N/m"), g.parameter("width", 1e-5, "m")
    lower, upper = g.parameter("lower", -0.1, "m"), g.parameter("upper", 0.2, "m")
    g.compliance("stops", lambda x: end_stop(x, lower, upper, k, width), at=v, state="x")
    found = simulate(exact(g), np.linspace(0.0, 0.5, 11))
    instants, flight, contact = [0.2 / 3.0], 0.3 / 3.0, np.pi / 1e3
    while len(instants) < len(found.events):
        instants.append(instants[-1] + (contact if len(instants) % 2 else flight))
    assert len(instants) == 10
    np.testing.assert_allclose([event.time for event in found.events], instants, atol=1e-8, rtol=0)
    assert found.events[0].what == "switches, -upper + x becomes positive"


@pytest.mark.parametrize("method", ["adaptive", "Radau", "RK45"])
def test_an_ideal_diode_begins_and_ends_to_conduct_where_the_closed_form_says(method):
    found = simulate(exact(rectifier()), np.linspace(0.0, 0.01, 11), method=method)
    G, R, C, omega = 10.0, 10.0, 1e-3, 314.0
    on = brentq(lambda t: np.sin(omega * t) - 0.5 * np.exp(-t / (R * C)), 0.0, np.pi / 2 / omega, xtol=1e-16)
    rate, start = (G + 1.0 / R) / C, 0.5 * np.exp(-on / (R * C))

    def forced(t):
        return G / C * (rate * np.sin(omega * t) - omega * np.cos(omega * t)) / (rate**2 + omega**2)

    def conducting(t):
        return forced(t) + (start - forced(on)) * np.exp(-rate * (t - on))

    off = brentq(lambda t: np.sin(omega * t) - conducting(t), np.pi / 2 / omega, 0.009, xtol=1e-16)
    assert [event.time for event in found.events[:2]] == pytest.approx([on, off], abs=1e-8)
    assert found.output("u")[-1] == pytest.approx(conducting(off) * np.exp(-(0.01 - off) / (R * C)), rel=1e-7)


def test_compiled_equations_give_the_same_events():
    model, times = exact(belt()), np.linspace(0.0, 2.0, 21)
    numpy, compiled = simulate(model, times), simulate(model, times, compiled=True)
    assert [str(event) for event in numpy.events] == [str(event) for event in compiled.events]
    np.testing.assert_allclose(numpy.x, compiled.x, atol=1e-12)


def test_a_relay_that_opens_leaves_the_spring_as_it_was():
    g = BondGraph("relay")
    command = g.input("command", "1")
    a, b = g.one_junction("a", TRANSLATION), g.zero_junction("b", TRANSLATION)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=a, state="v", initial=1.0)
    g.transformer("coupling", closed(command, 0.01), a, b)
    g.compliance("spring", g.parameter("k", 200.0, "N/m"), at=b, state="q")
    times = np.linspace(0.0, 1.0, 11)
    found = simulate(exact(g), times, {"command": 3.0 - 10.0 * np.minimum(times, 1.2 - times)})
    assert [event.time for event in found.events] == pytest.approx([0.3, 0.9], abs=1e-10)
    closed_for = np.where(times < 0.3, times, np.where(times < 0.9, 0.3, times - 0.6))
    np.testing.assert_allclose(found.state("v"), np.cos(10 * closed_for), atol=1e-7)
    np.testing.assert_allclose(found.state("q"), np.sin(10 * closed_for) / 10, atol=1e-8)


def test_a_stiff_model_is_handed_over_and_keeps_its_events():
    """A fast pole (1e6/s) follows a charge that turns round when its clock has run for a second."""
    g = BondGraph("saw")
    fast, slow = g.zero_junction("fast"), g.zero_junction("slow")
    g.compliance("c_fast", 1e6, at=fast, state="q_fast")
    g.resistance("r_fast", 1.0, at=fast)
    g.flow_source("charge", 1 - 3 * switch(g.integral("clock", 1, "") - 1, 1e-3), at=slow)
    g.compliance("c_slow", 1.0, at=slow, state="q_slow")
    g.flow_source("follow", slow.effort, at=fast)
    found = simulate(exact(g), np.linspace(0.0, 2.0, 5))
    assert [event.time for event in found.events] == pytest.approx([1.0], abs=1e-8)
    np.testing.assert_allclose(found.state("q_slow"), [0.0, 0.5, 1.0, 0.0, -1.0], atol=1e-8)
    np.testing.assert_allclose(found.state("q_fast")[1:], 1e-6 * (found.state("q_slow")[1:]), atol=3e-12)


def test_a_held_input_that_jumps_switches_at_its_own_time():
    g = BondGraph("valve")
    v = g.one_junction("v", TRANSLATION)
    gate = g.input("gate", "1", hold=True)
    g.inertance("mass", g.parameter("m", 1.0, "kg"), at=v, state="v")
    g.effort_source("push", g.parameter("F", 2.0, "N") * switch(gate, 0.1), at=v)
    found = simulate(exact(g), np.linspace(0.0, 1.0, 5), {"gate": [-1.0, 1.0, 1.0, -1.0, -1.0]})
    assert [event.time for event in found.events] == [0.25, 0.75]
    np.testing.assert_allclose(found.state("v"), [0.0, 0.0, 0.5, 1.0, 1.0], atol=1e-12)


def test_a_sliding_mode_is_told_with_the_ways_out():
    g = BondGraph("sliding")
    v = g.one_junction("v")
    g.inertance("mass", 1.0, at=v, state="v", initial=1.0)
    g.resistance("rub", lambda flow: dry_friction(flow, 2.0, 0.01), at=v)
    found = simulate(exact(g), np.linspace(0.0, 1.0, 11))
    assert found.outcome is Outcome.CHATTER and found.ended_at == pytest.approx(0.5, abs=1e-9)
    with pytest.raises(ModelError, match="declare it as a friction"):
        found.raise_if_failed()


def test_events_ever_faster_are_told_as_a_zeno_point():
    """Two comparators that drive a spiral into the origin, which it reaches after infinitely many turns."""
    g = BondGraph("spiral")
    x, y, rate = symbol("x"), symbol("y"), g.parameter("rate", 1.0, "1/s")

    def side(value):
        return rate * (2 * switch(value, 1e-3) - 1)

    g._declare(Integral("x", -side(x) + 2 * side(y), "1", "", 1.0))
    g._declare(Integral("y", -2 * side(x) - side(y), "1", "", 0.5))
    v = g.one_junction("v")
    g.inertance("mass", 1.0, at=v)
    g.resistance("rub", 1.0, at=v)
    found = simulate(exact(g), np.linspace(0.0, 3.0, 4))
    assert found.outcome is Outcome.ZENO and found.ended_at == pytest.approx(0.75, abs=1e-9)
    np.testing.assert_allclose([event.time for event in found.events[:3]], [1 / 6, 5 / 9, 37 / 54], atol=1e-10)


def test_fixed_steps_are_refused_with_the_way_out():
    model = exact(belt())
    for refused in (
        lambda: simulate(model, [0.0, 1.0], method="rk4"),
        lambda: simulate_batch(model, [0.0, 1.0]),
        lambda: FilterModel(model, {}, {}, {}),
    ):
        with pytest.raises(ModelError, match=r"grip changes its modes at events.* - derive the graph smooth"):
            refused()


def test_a_smooth_model_has_neither_modes_nor_events():
    model = exact(belt(), smooth=True)
    assert model.modes == () and "EVENTS" not in model.text
    assert model.events(0.0, model.x0(), model.u0(), model.theta()).shape == (0,)
    assert simulate(model, np.linspace(0.0, 0.1, 3)).events == ()


def test_zero_functions_take_a_batch_as_the_equations_do():
    model = exact(belt())
    x = np.array([[0.1, 0.3], [0.0, 0.02]])
    batch = model.events(0.0, x, model.u0(), model.theta())
    single = [model.events(0.0, x[:, k], model.u0(), model.theta()) for k in range(2)]
    np.testing.assert_array_equal(batch, np.stack(single, axis=1))


def test_a_module_without_a_function_that_its_modes_need_is_refused():
    text = exact(belt()).text
    with pytest.raises(ModelError, match="has modes but no reset_grip"):
        Model.from_text(text.replace("def reset_grip(", "def reset_other("))
    with pytest.raises(ModelError, match="does not change the states"):
        Model.from_text(text).reset("mode", 0.0, [0.1, 0.0], [0.0], [1.0])
