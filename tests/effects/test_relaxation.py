"""Parts that follow with a time of their own: what they are, beside the same parts declared by hand."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.build import build
from bondgraph.declare.domains import Domain
from bondgraph.declare.editing import copy, handle, with_bounds, with_values
from bondgraph.declare.effect import Effect, Place, Scale
from bondgraph.effects.relaxation import dragged_mass, polarisation, slow_heat_capacity, sprung_mass, viscoelastic_drag
from bondgraph.report.closed_loop import found_effects
from bondgraph.simulate.simulation import simulate


def cell() -> bg.BondGraph:
    g = bg.BondGraph("cell")
    current = g.input("current", "A", "into the cell")
    wire = g.one_junction("wire", bg.ELECTRICAL)
    g.flow_source("cycler", current, at=wire)
    g.compliance("charge", lambda q: q / 6e5, at=wire, state="q")
    g.resistance("ohmic", g.parameter("R0", 0.003, "ohm", "tabs", (0.0005, 0.01)), at=wire)
    g.measure_effort("voltage", "cycler", "terminals")
    return g


def body() -> bg.BondGraph:
    g = bg.BondGraph("body")
    power = g.input("power", "W", "heater")
    plate = g.zero_junction("plate", bg.THERMAL)
    g.flow_source("heater", power, at=plate)
    g.compliance("heat", 1 / g.parameter("C", 500.0, "J/K", "plate"), at=plate, state="Q", initial=500.0 * 20.0)
    g.resistance("air", g.parameter("R", 2.0, "K/W", "to the room"), at=plate)
    g.measure_effort("temperature", plate, "plate")
    return g


def sled() -> bg.BondGraph:
    g = bg.BondGraph("sled")
    force = g.input("force", "N", "pull")
    runner = g.one_junction("runner", bg.TRANSLATION)
    g.effort_source("pull", force, at=runner)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=runner, state="v")
    g.resistance("oil", g.parameter("d", 0.5, "N s/m"), at=runner)
    g.measure_flow("speed", runner, "speed")
    return g


def with_effect(g: bg.BondGraph, function: bg.EffectFunction, at: str, c: float, time: float) -> bg.BondGraph:
    g = copy(g)
    effect = function(g, Place(handle(g, at), Scale(80.0, 160.0), times=(0.05, 2000.0)))
    assert isinstance(effect, Effect)
    return with_values(g, {effect.coefficients[0]: c, effect.shapes[0]: time})


def shown(g: bg.BondGraph, u: np.ndarray, dt: float) -> np.ndarray:
    """The first output along an input that is the same in every channel, (samples,)."""
    model = build(g).model
    time = dt * np.arange(u.size)
    return simulate(model, time, u[np.newaxis], rtol=1e-9).raise_if_failed().y[0]


def test_polarisation_is_a_condenser_across_a_resistance() -> None:
    by_hand = cell()
    wire = handle(by_hand, "wire")
    pair = by_hand.zero_junction("pair", bg.ELECTRICAL)
    by_hand.bond(wire, pair)
    by_hand.resistance("slow", by_hand.parameter("R1", 0.0012, "ohm"), at=pair)
    by_hand.compliance("layer", 1 / by_hand.parameter("C1", 45.0 / 0.0012, "A s/V"), at=pair, state="q_1")
    u = 10.0 * np.sign(np.sin(np.arange(300) / 20.0))
    own = shown(with_effect(cell(), polarisation, "wire", 0.0012, 45.0), u, 2.0)
    assert own == pytest.approx(shown(by_hand, u, 2.0), abs=1e-9)


def test_a_sprung_mass_is_a_mass_on_a_spring_and_a_damper() -> None:
    mass, hertz, ratio = 0.6, 1.7, 0.08
    omega = 2.0 * np.pi * hertz
    by_hand = sled()
    runner, mount = handle(by_hand, "runner"), by_hand.zero_junction("mount", bg.TRANSLATION)
    load, stretch = by_hand.one_junction("load", bg.TRANSLATION), by_hand.one_junction("stretch", bg.TRANSLATION)
    for first, second in ((runner, mount), (mount, load), (mount, stretch)):
        by_hand.bond(first, second)
    by_hand.inertance("liquid", by_hand.parameter("m2", mass, "kg"), at=load, state="v2")
    by_hand.compliance("spring", by_hand.parameter("k2", mass * omega**2, "N/m"), at=stretch, state="x2")
    by_hand.resistance("damper", by_hand.parameter("d2", 2.0 * ratio * omega * mass, "N s/m"), at=stretch)
    g = sled()
    effect = sprung_mass(g, Place(handle(g, "runner"), Scale(80.0, 160.0), times=(0.05, 40.0)))
    assert isinstance(effect, Effect)
    g = with_values(g, dict(zip((*effect.coefficients, *effect.shapes), (mass, hertz, ratio), strict=True)))
    u = 10.0 * np.sign(np.sin(np.arange(300) / 20.0))
    assert shown(g, u, 0.05) == pytest.approx(shown(by_hand, u, 0.05), abs=1e-6)


def test_a_sprung_mass_is_tried_between_the_length_of_logs_and_their_sampling() -> None:
    g = sled()
    effect = sprung_mass(g, Place(handle(g, "runner"), Scale(80.0, 160.0), times=(0.05, 40.0)))
    assert isinstance(effect, Effect)
    (_, tried), _ = effect.grids
    lower, upper = next((one.lower, one.upper) for one in build(g).model.parameters if one.name == effect.shapes[0])
    assert (lower, upper) == (1.0 / 40.0, 5.0)
    assert lower < tried[0] < 1.3 * lower and 0.75 * upper < tried[-1] < upper  # a start on a bound ended a loop
    assert max(b / a for a, b in itertools.pairwise(tried)) < 1.7  # two neighbours within one damping
    assert sprung_mass(cell(), Place(handle(cell(), "wire"), Scale(80.0, 160.0))) is None


def test_polarisation_answers_a_step_of_the_current_by_its_resistance_and_its_time() -> None:
    time = 2.0 * np.arange(200)
    step = np.full(time.size, 10.0)
    more = shown(with_effect(cell(), polarisation, "wire", 0.0012, 45.0), step, 2.0) - shown(cell(), step, 2.0)
    assert more == pytest.approx(0.012 * (1.0 - np.exp(-time / 45.0)), abs=1e-8)


def test_viscoelastic_drag_is_a_spring_in_series_with_a_damper() -> None:
    by_hand = sled()
    runner = handle(by_hand, "runner")
    rubber = by_hand.zero_junction("rubber", bg.TRANSLATION)
    by_hand.bond(runner, rubber)
    by_hand.resistance("damper", by_hand.parameter("b", 0.8, "N s/m"), at=rubber)
    by_hand.compliance("spring", by_hand.parameter("k", 0.8 / 0.4, "N/m"), at=rubber, state="stretch")
    u = 8.0 * np.sin(0.05 * np.arange(300))
    own = shown(with_effect(sled(), viscoelastic_drag, "runner", 0.8, 0.4), u, 0.05)
    assert own == pytest.approx(shown(by_hand, u, 0.05), abs=1e-6)


def test_a_slow_heat_capacity_is_a_second_body_behind_a_resistance() -> None:
    by_hand = body()
    plate = handle(by_hand, "plate")
    way, wall = by_hand.one_junction("way", bg.THERMAL), by_hand.zero_junction("wall", bg.THERMAL)
    by_hand.bond(plate, way)
    by_hand.resistance("filling", by_hand.parameter("R1", 1 / 0.8, "K/W"), at=way)
    by_hand.bond(way, wall)
    by_hand.compliance(
        "wall_heat", 1 / by_hand.parameter("C1", 240.0, "J/K"), at=wall, state="Q_1", initial=240.0 * 20.0
    )
    u = np.where(np.arange(400) % 200 < 100, 40.0, 0.0)
    own = shown(with_effect(body(), slow_heat_capacity, "plate", 0.8, 300.0), u, 5.0)
    assert own == pytest.approx(shown(by_hand, u, 5.0), abs=1e-5)


@pytest.mark.parametrize(("domain", "name"), [
    (bg.TRANSLATION, "dragged_mass"), (bg.ROTATION, "dragged_mass"), (bg.ELECTRICAL, "eddy_currents"),
    (bg.HYDRAULIC, "unsteady_friction"),
])  # fmt: skip
def test_a_dragged_mass_is_an_inertance_behind_a_resistance(domain: Domain, name: str) -> None:
    """Eddy currents behind a coil were a disturbance that wanders at random, and made held-out errors larger."""

    inertance, loss = f"({domain.effort_unit})*s/({domain.flow_unit})", f"({domain.effort_unit})/({domain.flow_unit})"

    def moved() -> bg.BondGraph:
        g = bg.BondGraph("moved")
        line = g.one_junction("line", domain)
        g.effort_source("drive", g.input("drive", domain.effort_unit), at=line)
        g.inertance("quick", g.parameter("I", 2.0, inertance), at=line, state="f")
        g.resistance("loss", g.parameter("R", 0.3, loss), at=line)
        g.measure_flow("shown", line)
        return g

    resistance, time = 0.8, 1.5
    by_hand = moved()
    film, other = by_hand.zero_junction("film", domain), by_hand.one_junction("other", domain)
    by_hand.bond(handle(by_hand, "line"), film)
    oil = by_hand.parameter("R_2", resistance, loss)
    by_hand.resistance("oil", flow=lambda effort: effort / oil, at=film)
    by_hand.bond(film, other)
    by_hand.inertance("dragged", by_hand.parameter("I_2", resistance * time, inertance), at=other, state="f_2")
    u = np.sign(np.sin(np.arange(300) / 20.0))
    own = shown(with_effect(moved(), dragged_mass, "line", resistance, time), u, 0.1)
    assert own == pytest.approx(shown(by_hand, u, 0.1), abs=1e-6)
    g = moved()
    effect = dragged_mass(g, Place(handle(g, "line"), Scale(1.0, 1.0)))
    assert isinstance(effect, Effect) and effect.name == name


def test_they_look_for_their_time_between_a_sample_and_the_length_of_the_logs() -> None:
    g = cell()
    effect = polarisation(g, Place(handle(g, "wire"), Scale(4.0, 20.0), times=(2.0, 2400.0)))
    assert effect is not None
    time = next(one for one in g.parameters if one.name == effect.shapes[0])
    assert time.bounds == (2.0, 2400.0)


def test_places_without_resistance_or_storage_take_none() -> None:
    g = bg.BondGraph("bare")
    wire = g.one_junction("wire", bg.ELECTRICAL)
    node = g.zero_junction("node", bg.THERMAL)
    assert polarisation(g, Place(wire, Scale(1.0, 1.0))) is None
    assert viscoelastic_drag(g, Place(wire, Scale(1.0, 1.0))) is None
    assert dragged_mass(g, Place(wire, Scale(1.0, 1.0))) is None
    assert slow_heat_capacity(g, Place(node, Scale(1.0, 1.0))) is None


@pytest.mark.slow
def test_a_cell_that_polarises_is_told_from_a_late_actuator() -> None:
    """It was called a lag of its current source, whose time was a thirtieth of the time between samples."""
    true = with_effect(cell(), polarisation, "wire", 0.0012, 45.0)
    logs = []
    for seed, name in enumerate(("first", "second", "later")):
        chance = np.random.default_rng(seed)
        u = np.repeat(chance.choice([-20.0, -10.0, 0.0, 10.0, 20.0], 16), 25)
        y = shown(true, u, 2.0) + 1e-3 * chance.standard_normal(u.size)
        logs.append(bg.MatchedLog(name, 2.0 * np.arange(u.size), u[np.newaxis], y[np.newaxis]))
    loop = bg.close_loop(cell(), logs[:2], logs[2:])
    assert loop.verdict == "effect found"
    (found,) = loop.added
    assert found.trial.candidate.label == "polarisation at wire"
    low, high = 0.0009, 0.0015  # 0.0012 ohm, within its scatter
    table = loop.to_dataframe()
    assert low < table.loc["c_polarisation_wire", "after"] < high
    assert 25.0 < table.loc["T_polarisation_wire", "after"] < 80.0
    (said,) = found_effects(loop)
    assert re.search(r"T = [\d.]+ s \[[\d.]+, [\d.]+\]", said.law)  # its time has an interval too


@pytest.mark.slow
def test_a_body_at_any_temperature_is_told_from_a_disturbance_by_the_wall_that_it_heats() -> None:
    """The wall began at 0 K where the log began at 310 K, so that a disturbance of 14 000 s was found in its place."""
    true = with_effect(body(), slow_heat_capacity, "plate", 0.8, 300.0)
    chance, logs = np.random.default_rng(0), []
    for name in ("first", "second", "later"):
        u = np.repeat(chance.choice([0.0, 20.0, 40.0], 8), 50)
        model = build(true).model
        x0 = model.x0(Q=500.0 * 310.0)
        y = simulate(model, 10.0 * np.arange(u.size), u[np.newaxis], x0=x0, rtol=1e-9).raise_if_failed().y[0]
        y = 0.1 * np.round((y + 0.1 * chance.standard_normal(u.size)) / 0.1)
        logs.append(bg.MatchedLog(name, 10.0 * np.arange(u.size), u[np.newaxis], y[np.newaxis]))
    free = with_bounds(body(), {"C": (300.0, 900.0), "R": (0.5, 8.0)})
    loop = bg.close_loop(free, logs[:2], logs[2:])
    assert [one.trial.candidate.label for one in loop.added] == ["slow_heat_capacity at plate"]
    assert loop.corrected.values["c_slow_heat_capacity_plate"] == pytest.approx(0.8, rel=0.2)
    assert loop.corrected.values["T_slow_heat_capacity_plate"] == pytest.approx(300.0, rel=0.2)
    assert "g.integral(" in loop.python_lines()


@pytest.mark.parametrize(("domain", "name"), [
    (bg.ELECTRICAL, "charge_redistribution"), (bg.HYDRAULIC, "gas_heat_exchange"), (bg.THERMAL, "slow_heat_capacity"),
])  # fmt: skip
def test_a_slow_storage_is_one_behind_a_resistance(domain: Domain, name: str) -> None:
    """Air that warms as it is compressed was a disturbance as long as the logs, a double layer an actuator's scale."""

    def vessel() -> bg.BondGraph:
        g = bg.BondGraph("vessel")
        node = g.zero_junction("node", domain)
        g.flow_source("feed", g.input("feed", domain.flow_unit), at=node)
        g.compliance("quick", lambda q: q / 5.0, at=node, state="q")
        g.resistance("leak", flow=lambda effort: 0.05 * effort, at=node)
        g.measure_effort("shown", node)
        return g

    conductance, time = 0.3, 12.0
    by_hand = vessel()
    way, slow = by_hand.one_junction("way", domain), by_hand.zero_junction("slow", domain)
    by_hand.bond(handle(by_hand, "node"), way)
    by_hand.bond(way, slow)
    by_hand.resistance("between", flow=lambda effort: conductance * effort, at=way)
    by_hand.compliance("second", lambda q: q / (conductance * time), at=slow, state="q_2")
    u = np.sign(np.sin(np.arange(300) / 20.0))
    own = shown(with_effect(vessel(), slow_heat_capacity, "node", conductance, time), u, 0.5)
    assert own == pytest.approx(shown(by_hand, u, 0.5), abs=1e-6)
    g = vessel()
    effect = slow_heat_capacity(g, Place(handle(g, "node"), Scale(1.0, 1.0)))
    assert isinstance(effect, Effect) and effect.name == name


def _coil(with_currents: bool) -> bg.BondGraph:
    """A coil behind a filter; with eddy currents as an inductance and a resistance side by side, by hand."""
    g = bg.BondGraph("coil")
    supply, node = g.one_junction("supply", bg.ELECTRICAL), g.zero_junction("node", bg.ELECTRICAL)
    coil = g.one_junction("coil", bg.ELECTRICAL)
    g.effort_source("amplifier", g.input("u", "V", hold=True), at=supply)
    g.resistance("filter_resistor", g.parameter("R_f", 2.3, "ohm", "", (0.9, 6.0)), at=supply)
    g.bond(supply, node)
    g.compliance("filter_capacitor", displacement=g.parameter("C_f", 2.4e-5, "F", "", (1e-5, 6e-5)), at=node)
    g.bond(node, coil)
    g.resistance("winding", g.parameter("R_c", 0.42, "ohm", "", (0.16, 1.0)), at=coil)
    g.inertance("inductance", g.parameter("L_c", 7.2e-4, "H", "", (3e-4, 1.8e-3)), at=coil, state="i")
    if with_currents:
        iron, yoke = g.zero_junction("iron", bg.ELECTRICAL), g.one_junction("yoke", bg.ELECTRICAL)
        loss = g.parameter("R_e", 0.03, "ohm")
        g.bond(coil, iron)
        g.resistance("loss", flow=lambda effort: effort / loss, at=iron)
        g.bond(iron, yoke)
        g.inertance("field", g.parameter("L_e", 4.5e-5, "H"), at=yoke, state="i_e")
    g.measure_flow("current", coil)
    g.measure_effort("voltage", node)
    return g


@pytest.mark.slow
@pytest.mark.parametrize("with_currents", [True, False])
def test_eddy_currents_of_a_coil_are_found_and_no_disturbance(with_currents: bool) -> None:
    model, logs = build(_coil(with_currents)).model, []
    for seed in (1, 2, 9):
        chance, time = np.random.default_rng(seed), 5e-5 * np.arange(600)
        u = np.repeat(chance.uniform(-20.0, 20.0, 12), 50)[np.newaxis]
        y = simulate(model, time, u, {"R_f": 2.0, "C_f": 2e-5, "R_c": 0.35, "L_c": 7.6e-4}, rtol=1e-9).y
        logs.append(bg.MatchedLog(f"run{seed}", time, u, y + np.array([[0.06], [0.12]]) * chance.normal(size=y.shape)))
    loop = bg.close_loop(_coil(False), logs[:2], logs[2:])
    if not with_currents:
        assert (loop.verdict, loop.added) == ("no missing effect", ())
        return
    assert [one.trial.candidate.label for one in loop.added] == ["eddy_currents at coil"]
    assert loop.corrected.values["c_eddy_currents_coil"] == pytest.approx(0.03, rel=0.1)
    assert loop.corrected.values["T_eddy_currents_coil"] == pytest.approx(1.5e-3, rel=0.15)
