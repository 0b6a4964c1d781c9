"""Every effect at every place of a bench of each domain: it vanishes at zero, its units fit, a loss takes energy."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bondgraph as bg
from bondgraph import effects
from bondgraph.build import BuiltModel, build
from bondgraph.correct.models.bonds import bond_model
from bondgraph.correct.models.pairs import neighbours
from bondgraph.data.log import FloatArray
from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, ROTATION, THERMAL, TRANSLATION
from bondgraph.declare.editing import copy, handle, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale, is_for
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import bond_labels
from bondgraph.derive.derivation import Derivation
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.effects.benches import BENCHES, Bench, oven
from bondgraph.effects.catalogue import added, every_effect
from bondgraph.effects.thermal import CELSIUS_ZERO, ROOM, surroundings
from bondgraph.units import dimension
from tests.effects.machines.first import cylinder

#: Size of each state of the benches around where it starts; the heat of 500 J/K moves by some 100 K.
SIZES = {
    "omega": 20.0, "wound": 0.1, "omega_s": 10.0, "v": 0.5, "x": 0.2, "angle": 9.0, "i": 2.0, "q": 0.02, "q_2": 0.04,
    "pressed": 0.1, "Q": 4e4, "Q_wire": 2e3, "V": 0.1, "Q_pipe": 1e-3, "V_2": 0.05, "Q_2": 4e4, "n": 10.0, "n_2": 20.0,
}  # fmt: skip
#: Size of each input of the benches, around its default.
INPUTS = {
    "torque": 10.0, "ratio": 0.9, "current": 5.0, "voltage": 20.0, "inflow": 1e-3, "power": 300.0, "room": 10.0,
    "feed": 0.5,
}  # fmt: skip
#: Seeds of points at which laws are compared.
SEEDS = st.integers(0, 2**32 - 1)


@dataclass(frozen=True)
class Case:
    """An effect at a place of a bench, with the model that has it."""

    bench: Bench
    function: EffectFunction
    place: Place
    effect: Effect
    graph: BondGraph


@functools.cache
def bench(domain: str) -> Bench:
    return BENCHES[domain]()


@functools.cache
def declared(domain: str) -> BuiltModel:
    return build(bench(domain).graph)


def cases(domain: str) -> Iterator[Case]:
    """The first place of every kind that takes an effect; further ones have the same law."""
    for function in every_effect().values():
        seen = set()
        for place, effect, graph in added(function, bench(domain)):
            kind = (effect.name, place.junction.kind, place.domain, graph.nodes.get(effect.element) is None)
            if kind not in seen:
                seen.add(kind)
                yield Case(bench(domain), function, place, effect, graph)


@functools.cache
def built_cases(domain: str) -> tuple[tuple[Case, BuiltModel], ...]:
    """Models of the effects that a loop would try; it refuses a storage whose state has no size yet."""
    own = declared(domain).model
    found = []
    for case in cases(domain):
        built = build(case.graph)
        names = built.model.names("state")
        further = [one for one in built.equations.states if one.symbol.name not in own.names("state")]
        vanishes = set(own.names("state")) <= set(names) and all(one.variable == "integral" for one in further)
        same_inputs = built.model.names("input") == own.names("input")
        if same_inputs and (case.effect.adds_state or vanishes):
            found.append((case, built))
    return tuple(found)


def points(built: BuiltModel, seed: int, count: int = 20) -> tuple[FloatArray, FloatArray]:
    """States (n_x, count) and inputs (n_u, count) all over the range of a bench; states of an effect near one."""
    chance = np.random.default_rng(seed)
    model = built.model
    x = np.repeat(model.x0()[:, np.newaxis], count, axis=1)
    u = np.repeat(model.u0()[:, np.newaxis], count, axis=1)
    for row, name in enumerate(model.names("state")):
        x[row] += SIZES.get(name, 1.0) * chance.uniform(-1.0, 1.0, count)
    for row, name in enumerate(model.names("input")):
        u[row] += INPUTS[name] * chance.uniform(-1.0, 1.0, count)
    return x, u


@pytest.mark.parametrize("domain", BENCHES)
def test_every_effect_vanishes_with_its_coefficients(domain: str) -> None:
    own = declared(domain)
    names = own.model.names("state")
    assert len(built_cases(domain)) >= 15

    @settings(max_examples=5, deadline=None)
    @given(SEEDS)
    def same(seed: int) -> None:
        x, u = points(own, seed)
        rates = own.model.rhs(1.0, x, u, own.model.theta())
        shown = own.model.output(1.0, x, u, own.model.theta())
        for case, built in built_cases(domain):
            model = built.model
            if case.effect.adds_state:
                continue
            rows = [model.index("state", name) for name in names]
            states = np.full((len(model.states), x.shape[1]), 0.5)
            states[rows] = x
            off = model.theta(**dict.fromkeys(case.effect.coefficients, 0.0))
            size = np.abs(rates).max(axis=1, keepdims=True)
            away = np.abs(model.rhs(1.0, states, u, off)[rows] - rates)
            assert np.all(away <= 1e-9 * size), (case.effect.name, case.place.label)
            np.testing.assert_allclose(model.output(1.0, states, u, off), shown, rtol=1e-9, err_msg=case.effect.name)

    same()


@pytest.mark.parametrize("domain", BENCHES)
def test_every_effect_is_felt_and_has_units_bounds_and_a_reference(domain: str) -> None:
    own = declared(domain)
    x, u = points(own, 7, 60)
    rates = own.model.rhs(1.0, x, u, own.model.theta())
    shown = own.model.output(1.0, x, u, own.model.theta())
    for case, built in built_cases(domain):
        model, effect = built.model, case.effect
        assert effect.law and effect.reference and effect.manoeuvre, effect.name
        parameters = {one.name: one for one in case.graph.parameters}
        for name in effect.parameters:
            bounds = parameters[name].bounds
            assert bounds is not None and bounds[0] < bounds[1], name
            assert parameters[name].unit and parameters[name].meaning, name
            dimension(parameters[name].unit)
        rows = [model.index("state", name) for name in own.model.names("state")]
        states = np.full((len(model.states), x.shape[1]), 0.5)
        states[rows] = x
        on = model.theta(**{name: 0.4 * parameters[name].bounds[1] for name in effect.coefficients})  # type: ignore[index]
        moved = np.abs(model.rhs(1.0, states, u, on)[rows] - rates).max() > 0.0
        moved |= np.abs(model.output(1.0, states, u, on) - shown).max() > 0.0
        assert moved, (effect.name, case.place.label)


@pytest.mark.parametrize("domain", BENCHES)
def test_the_dimensions_of_every_law_fit(domain: str) -> None:
    for _, built in built_cases(domain):
        check_dimensions(Derivation(built.causal).equations())


@pytest.mark.parametrize("domain", BENCHES)
def test_a_loss_takes_energy_and_heat_flows_from_hot_to_cold(domain: str) -> None:
    losses = [
        (case, bond_model(built.causal), built)
        for case, built in built_cases(domain)
        if case.effect.dissipative and case.graph.nodes[case.effect.element].kind == "R"
        and case.effect.element not in declared(domain).graph.nodes
    ]  # fmt: skip
    assert losses

    @settings(max_examples=5, deadline=None)
    @given(SEEDS, st.floats(0.01, 1.0))
    def takes(seed: int, share: float) -> None:
        for case, model, built in losses:
            bounds = {one.name: one.bounds for one in case.graph.parameters}
            size = {name: share * bounds[name][1] for name in case.effect.coefficients}  # type: ignore[index]
            x, u = points(built, seed)
            outputs = model.output(1.0, x, u, model.theta(**size))[len(built.model.outputs) :]
            labels = bond_labels(built.causal)
            bond = next(k for k, label in enumerate(labels) if label.endswith(f"->{case.effect.element}"))
            effort, flow = outputs[bond], outputs[len(labels) + bond]
            if case.effect.name in ("heat_loss", "convection", "radiation"):
                room = 293.0 if domain == "electrical" else 0.0
                effort = effort - (u[model.index("input", "room")] if domain == "thermal" else room)
            power = effort * flow
            assert np.all(power >= -1e-12 * np.abs(power).max()), case.effect.name

    takes()


def test_what_is_around_a_body_is_known_in_kelvin_degrees_or_as_a_rise() -> None:
    absolute = surroundings(oven().graph, Place(handle(oven().graph, "plate"), Scale(400.0, 300.0)))
    assert absolute is not None and str(absolute.temperature) == "effort(hall)" and absolute.zero == 0.0
    for law, around, zero in (
        (lambda t: 2.0 * t, 0.0, ROOM),  # a rise above what is around
        (lambda t: 2.0 * (t - 20.0), 20.0, CELSIUS_ZERO),  # degrees
    ):
        g = BondGraph("body")
        body = g.zero_junction("body", THERMAL)
        g.compliance("heat", 0.01, at=body)
        g.resistance("air", flow=law, at=body)
        known = surroundings(g, Place(body, Scale(60.0, 100.0)))
        assert known is not None and float(known.temperature) == around and known.zero == zero


@pytest.mark.parametrize("function", [effects.heat_loss, effects.convection, effects.radiation])
def test_a_room_is_the_same_whichever_way_its_bond_points(function: EffectFunction) -> None:
    """A source of minus 293 K, with its bond towards the wall, was a room at minus 293 K to every law of heat."""

    def case(leaves: bool) -> bg.BondGraph:
        g = bg.BondGraph("case")
        body, wall = g.zero_junction("body", bg.THERMAL), g.one_junction("wall", bg.THERMAL)
        room = g.parameter("T_room", 293.0, "K")
        g.flow_source("heater", g.input("power", "W"), at=body)
        g.compliance("heat", 1 / g.parameter("C", 400.0, "J/K"), at=body, state="Q", initial=400.0 * 300.0)
        g.bond(body, wall)
        g.resistance("air", g.parameter("R", 0.5, "K/W"), at=wall)
        if leaves:
            g.bond(wall, g.effort_source("room", room))
        else:
            g.effort_source("room", -room, at=wall)
        g.measure_effort("shown", body)
        return g

    found = []
    for leaves in (True, False):
        g = case(leaves)
        effect = function(g, Place(handle(g, "body"), Scale(400.0, 300.0)))
        assert effect is not None
        largest = next(one.bounds for one in g.parameters if one.name == effect.coefficients[0])
        assert largest is not None
        model = bg.build(with_values(g, {effect.coefficients[0]: 0.3 * largest[1]})).model
        time = np.arange(0.0, 300.0, 5.0)
        found.append(bg.simulate(model, time, np.full((1, time.size), 60.0)).y[0])
    assert np.ptp(found[0]) > 5.0
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)


def test_an_absolute_temperature_that_nothing_surrounds_is_in_a_room() -> None:
    """It gave its heat away to absolute zero, and a loop named a slow heat capacity for a loss of 0.8 W/K."""
    g = BondGraph("body")
    body = g.zero_junction("body", THERMAL)
    g.compliance("heat", 0.01, at=body, state="H", initial=29600.0)
    place = Place(body, Scale(400.0, 100.0))
    for function, power, c in ((effects.heat_loss, 1.0, 0.1), (effects.radiation, 4.0, 1e-9)):
        found = copy(g)
        effect = function(found, place)
        assert effect is not None and effect.widths[-1:] == (f"around_{effect.element}",)
        model = build(with_values(found, {effect.coefficients[0]: c})).model
        heats = (np.array([100.0 * warm]) for warm in (ROOM, 353.15))
        rates = [float(model.rhs(0.0, heat, np.array([]), model.theta())[0]) for heat in heats]
        assert rates[0] == pytest.approx(0.0, abs=1e-9)
        assert rates[1] == pytest.approx(-c * (353.15**power - ROOM**power), rel=1e-9)


def test_laws_are_called_in_the_words_of_the_domain() -> None:
    names = {}
    for domain in (ELECTRICAL, HYDRAULIC, TRANSLATION):
        g = BondGraph("bare")
        flow, effort = g.one_junction("flow", domain), g.zero_junction("effort", domain)
        for function, at in ((effects.viscous_loss, flow), (effects.creep, effort)):
            effect = function(g, Place(at, Scale(1.0, 1.0)))
            assert effect is not None
            names[function.__name__, domain.name] = effect.name
    assert names["viscous_loss", "electrical"] == "series_resistance" and names["creep", "hydraulic"] == "leakage"
    assert names["viscous_loss", "translation"] == "viscous_loss" and names["creep", "translation"] == "creep"


def test_pairs_are_neighbours_that_are_not_tied() -> None:
    assert neighbours(bench("hydraulic").graph) == [("first", "second"), ("second", "drain")]
    assert neighbours(bench("thermal").graph) == [("plate", "case"), ("plate", "paint"), ("case", "paint")]
    assert ("rotor", "twist") not in neighbours(bench("mechanical").graph)  # the twist is a difference itself
    g = BondGraph("geared")
    motor, wheel = g.one_junction("motor", ROTATION), g.one_junction("wheel", ROTATION)
    g.transformer("gear", 3.0, motor, wheel)
    assert neighbours(g) == []
    assert neighbours(cylinder()) == [("front", "back")]  # the piston between them ties no pressures


def test_a_current_creeps_between_any_two_nodes() -> None:
    """A moist path from the first node of a ladder to the third was two leaks and a negative resistance."""
    g = BondGraph("ladder")
    nodes = [g.zero_junction(name, ELECTRICAL) for name in ("n1", "n2", "n3")]
    for k in (0, 1):
        branch = g.one_junction(f"r{k}", ELECTRICAL)
        g.resistance(f"resistor{k}", g.parameter(f"R{k}", 1e4, "ohm"), at=branch)
        _ = g.bond(nodes[k], branch), g.bond(branch, nodes[k + 1])
    assert neighbours(g.flatten()) == [("n1", "n2"), ("n1", "n3"), ("n2", "n3")]


def test_heat_passes_between_any_two_bodies() -> None:
    """A bridge of 0.35 W/K between two boards in one air stream was two formulas of the other board's heat flow."""
    g = BondGraph("rack")
    air = g.zero_junction("air", THERMAL)
    g.effort_source("inlet", g.input("T_air", "K"), at=air)
    for name in ("left", "right"):
        board, film = g.zero_junction(name, THERMAL), g.one_junction(f"film_{name}", THERMAL)
        g.compliance(f"heat_{name}", g.parameter(f"k_{name}", 0.01, "K/J"), at=board)
        g.bond(board, film)
        g.resistance(f"cooling_{name}", g.parameter(f"r_{name}", 1.0, "K/W"), at=film)
        g.bond(film, air)
    assert ("left", "right") in neighbours(g.flatten())


def test_an_effect_between_junctions_is_offered_pairs_alone() -> None:
    tank = Place(handle(bench("hydraulic").graph, "first"), Scale(1.0, 1.0))
    pair = next(place for place in bench("hydraulic").places if place.other is not None)
    assert is_for(effects.leak_between, pair) and not is_for(effects.leak_between, tank)
    assert is_for(effects.creep, tank) and not is_for(effects.creep, pair)


def test_no_place_is_offered_many_laws() -> None:
    """Each law more costs power; sources that follow a command have laws of their own."""
    for domain in BENCHES:
        for place in bench(domain).places:
            count = sum(
                1
                for function in effects_by_default()
                if not function.__name__.startswith("actuator") and is_for(function, place)
                and function(with_values(bench(domain).graph, {}), place) is not None
            )  # fmt: skip
            assert count <= 22, (domain, place.label)


def effects_by_default() -> tuple[EffectFunction, ...]:
    return tuple(f for f in every_effect().values() if hasattr(effects, f.__name__))
