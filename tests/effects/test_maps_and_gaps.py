"""Ceilings, bent maps, gaps, activation, delays and vessels that run over: values, nothing where they are zero."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sympy import Float

import bondgraph as bg
from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.models.pairs import neighbours
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.effects.ranges import ceiling, floor
from bondgraph.effects.sensors import sensor_delay
from bondgraph.simulate.model import Model

SIZE = Scale(20.0, 2.0)


def magnet() -> bg.BondGraph:
    """An armature on springs that a current pulls, with one constant wherever it is."""
    g = bg.BondGraph("magnet")
    current = g.input("current", "A")
    pull = g.parameter("pull", 5.0, "N/A")
    armature = g.one_junction("armature", bg.TRANSLATION)
    g.effort_source("coil", pull * current, at=armature)
    stiffness = g.parameter("k", 4000.0, "N/m")
    g.inertance("mass", g.parameter("m", 0.5, "kg"), at=armature, state="v")
    g.compliance("springs", lambda x: stiffness * x, at=armature, state="x")
    g.measure_flow("speed", armature)
    return g


def cell() -> bg.BondGraph:
    """A resistance whose heat warms a body."""
    g = bg.BondGraph("cell")
    current, room = g.input("current", "A"), g.input("room", "K")
    resistance = g.parameter("R", 0.03, "ohm")
    wire, core = g.one_junction("wire", bg.ELECTRICAL), g.zero_junction("core", bg.THERMAL)
    skin = g.one_junction("skin", bg.THERMAL)
    g.flow_source("load", current, at=wire)
    g.resistance("ohmic", lambda i: resistance * i, at=wire)
    capacity, film = g.parameter("C", 50.0, "J/K"), g.parameter("film_R", 2.0, "K/W")
    g.flow_source("heat", resistance * current**2, at=core)
    g.compliance("content", lambda q: q / capacity, at=core, initial=50.0 * 300.0, state="q")
    g.bond(core, skin)
    g.resistance("film", lambda h: film * h, at=skin)
    g.bond(skin, g.effort_source("around", room))
    g.measure("voltage", handle(g, "ohmic").effort, "V")
    return g


def tanks() -> bg.BondGraph:
    """Two tanks; a jet of the upper one falls into the lower."""
    g = bg.BondGraph("tanks")
    pump = g.input("pump", "m^3/s")
    upper, lower = g.zero_junction("upper", bg.HYDRAULIC), g.zero_junction("lower", bg.HYDRAULIC)
    g.flow_source("inflow", pump, at=upper)
    stiffness, leak = g.parameter("stiffness", 1e6, "Pa/m^3"), g.parameter("leak", 1e-7, "m^3/s/Pa")
    g.compliance("water1", lambda q: stiffness * q, at=upper, state="q1")
    g.resistance("orifice", flow=lambda p: leak * p, at=upper)
    g.flow_source("jet", leak * upper.effort, at=lower)
    g.compliance("water2", lambda q: stiffness * q, at=lower, state="q2")
    g.measure_effort("level", lower)
    return g


def changed(graph: bg.BondGraph, function: EffectFunction, place: Place, **values: float) -> Model:
    """The model of a graph with an effect, its parameters by the first letter of their names."""
    effect = function(graph, place)
    assert isinstance(effect, Effect)
    names = {name.partition("_")[0]: name for name in effect.parameters}
    return build(with_values(graph, {names[letter]: value for letter, value in values.items()})).model


@given(x=st.floats(-50.0, 50.0), c=st.floats(0.0, 3.0), n=st.floats(2.0, 20.0))
def test_a_ceiling_is_odd_below_its_end_and_itself_far_below(x: float, c: float, n: float) -> None:
    shown = float(ceiling(Float(x), Float(c), Float(n)))
    assert shown == pytest.approx(-float(ceiling(Float(-x), Float(c), Float(n))))
    assert abs(shown) <= abs(x) and abs(c * shown) <= 1.0 + 1e-9
    if c == 0.0:
        assert shown == pytest.approx(x, rel=1e-12)
    assert shown == pytest.approx(x / (1.0 + abs(c * x) ** n) ** (1.0 / n), rel=1e-9, abs=1e-9)


@given(x=st.floats(-2.0, 2.0), c=st.floats(0.0, 2.0), n=st.floats(2.0, 20.0))
def test_a_floor_is_below_neither_and_adds_as_radiations_do(x: float, c: float, n: float) -> None:
    added = float(floor(Float(x), Float(c), Float(n))) - x
    assert added == pytest.approx((abs(x) ** n + c**n) ** (1.0 / n) - abs(x), rel=1e-6, abs=1e-6)
    assert added + abs(x) >= max(abs(x), c) - 1e-6
    if c == 0.0:
        assert abs(added) < 1e-15


def test_a_hyperbolic_tangent_lies_between_the_ceilings() -> None:
    """The only form that was offered, of sharpness 4, left 2.2 times the noise of a sensor that saturates as a tanh."""
    x = np.linspace(-1.5, 1.5, 61)
    far = {n: float(np.abs(x / (1.0 + np.abs(x) ** n) ** (1.0 / n) - np.tanh(x)).max()) for n in (2.0, 2.7, 4.0)}
    assert far[2.7] < 0.3 * far[2.0] and far[2.7] < 0.3 * far[4.0]


def test_a_late_sensor_shows_a_slow_swing_later() -> None:
    """The transfer from what it should show to what it shows is that of the approximation."""
    graph = magnet()
    model = changed(graph, sensor_delay, Place.sensor("speed", SIZE), delay=0.1)
    states = model.names("state")
    x, u, theta = np.zeros(len(states)), np.zeros(1), model.theta()
    slopes, shown = model.jacobian_x(0.0, x, u, theta), np.zeros(len(states))
    for k in range(len(states)):
        shown[k] = float(model.output(0.0, np.eye(len(states))[k], u, theta)[0])
    own, v = [k for k, name in enumerate(states) if name in ("late_speed", "rising_speed")], states.index("v")
    s = 2j * math.pi * 1.0
    inner = np.linalg.solve(s * np.eye(len(own)) - slopes[np.ix_(own, own)], slopes[own, v])
    assert abs(shown[own] @ inner + shown[v] - cmath.exp(-0.1 * s)) < 5e-3


def test_a_gap_that_closes_pulls_by_the_square() -> None:
    bare, place = build(magnet()).model, Place(handle(magnet(), "armature"), SIZE)
    model = changed(magnet(), effects.gap_dependence, place, c=100.0)
    for x in (-0.004, 0.0, 0.005):
        state, u = np.array([0.0, x]) if bare.names("state") == ("v", "x") else np.array([x, 0.0]), np.array([2.0])
        row = bare.index("state", "v")
        force = 0.5 * (model.rhs(0.0, state, u, model.theta())[row] - bare.rhs(0.0, state, u, bare.theta())[row])
        assert force == pytest.approx(10.0 * (1.0 / (1.0 - 100.0 * x) ** 2 - 1.0), abs=1e-9)


@given(current=st.floats(0.1, 8.0), bent=st.floats(-0.6, 2.0))
def test_a_bent_map_is_right_at_one_value_and_a_power_elsewhere(current: float, bent: float) -> None:
    model = changed(magnet(), effects.actuator_exponent, Place(handle(magnet(), "armature"), SIZE), b=bent)
    x, row = np.zeros(2), model.index("state", "v")
    for sign in (1.0, -1.0):
        given_force = 0.5 * model.rhs(0.0, x, np.array([sign * current]), model.theta())[row]
        assert given_force == pytest.approx(sign * 20.0 * (5.0 * current / 20.0) ** (1.0 + bent), rel=1e-3)


def test_a_resistance_by_arrhenius_falls_with_temperature() -> None:
    model = changed(cell(), effects.thermal_activation, Place(handle(cell(), "wire"), SIZE), b=3000.0)
    for temperature in (280.0, 293.15, 330.0):
        shown = model.output(0.0, np.array([50.0 * temperature]), np.array([2.0, 293.0]), model.theta())
        expected = 0.06 * math.exp(3000.0 * (1.0 / temperature - 1.0 / 293.15))
        assert shown[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("function", "full"), [(effects.overflow_onward, 0), (effects.overflow_back, 1)])
def test_what_runs_over_from_one_vessel_arrives_in_the_other(function: EffectFunction, full: int) -> None:
    assert neighbours(tanks().flatten()) == [("upper", "lower")]  # the jet joins them, no bond does
    graph = tanks()
    place = Place.between(handle(graph, "upper"), handle(graph, "lower"), Scale(4000.0, 1e-3))
    model, bare = changed(graph, function, place, c=4e-4, e=3000.0), build(tanks()).model
    for level in (2000.0, 3000.0, 5000.0):
        x = np.array([1e-3, 1e-3])
        x[full] = 1e-6 * level
        more = model.rhs(0.0, x, np.zeros(1), model.theta()) - bare.rhs(0.0, x, np.zeros(1), bare.theta())
        flow = 4e-4 * (max(level - 3000.0, 0.0) / 4000.0) ** 1.5
        assert more[full] == pytest.approx(-flow, abs=1e-15) and more[1 - full] == pytest.approx(flow, abs=1e-15)
