"""Laws with a memory and laws of slip: what they give where it can be told by hand."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.build import BuiltModel, build
from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, ROTATION, TRANSLATION
from bondgraph.declare.editing import copy, handle, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.between import clutch_slip, fluid_coupling_between
from bondgraph.effects.fading import charge_fading
from bondgraph.effects.hysteresis import bouc_wen_loss, hysteresis_loss, lugre_loss
from bondgraph.effects.losses import overflow, tyre_relaxation
from bondgraph.simulate.simulation import simulate


def sled() -> BondGraph:
    g = BondGraph("sled")
    force = g.input("force", "N")
    body = g.one_junction("body", TRANSLATION)
    g.effort_source("pull", force, at=body)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body, state="v")
    g.resistance("oil", g.parameter("d", 0.5, "N s/m"), at=body)
    return g


def added(function: EffectFunction, **values: float) -> tuple[BuiltModel, Effect]:
    """The sled with an effect, whose parameters have values by the first part of their names."""
    g = sled()
    effect = function(g, Place(handle(g, "body"), Scale(20.0, 2.0)))
    assert effect is not None
    names = {f"{stem}_{effect.name}_body": value for stem, value in values.items()}
    return build(with_values(g, names)), effect


def bending(built: BuiltModel, effect: Effect, v: float, h: float) -> float:
    """Rate of change of the friction, as a share of its level, per way."""
    model = built.model
    state = f"bent_{effect.name}_body"
    rates = model.rhs(0.0, model.x0(v=v, **{state: h}), np.zeros(1), model.theta())
    return float(rates[model.index("state", state)]) / v


@pytest.mark.parametrize("h", [-0.6, 0.0, 0.3, 0.9])
def test_bouc_and_wen_with_a_power_of_one_are_dahl(h: float) -> None:
    """For loading alone: on the way back Dahl's law bends twice as fast."""
    dahl = added(hysteresis_loss, give=0.1)
    wen = added(bouc_wen_loss, give=0.1, n=1.0)
    v = 0.4 if h >= 0.0 else -0.4
    assert bending(*wen, v, h) == pytest.approx(bending(*dahl, v, h), rel=1e-12)


@pytest.mark.parametrize("power", [1.0, 4.5])
def test_hysteresis_of_bouc_and_wen_settles_at_its_level_and_takes_energy_round_a_loop(power: float) -> None:
    built, effect = added(bouc_wen_loss, give=0.05, n=power, c=6.0)
    assert bending(built, effect, 0.3, 1.0) == pytest.approx(0.0, abs=1e-12)
    assert bending(built, effect, -0.3, -1.0) == pytest.approx(0.0, abs=1e-12)
    time = np.linspace(0.0, 4.0, 201)
    run = simulate(built.model, time, (8.0 * np.sin(3.0 * time))[np.newaxis], rtol=1e-6).raise_if_failed()
    speed, h = (run.x[built.model.index("state", name)] for name in ("v", f"bent_{effect.name}_body"))
    assert np.abs(h).max() <= 1.0 + 1e-4
    assert np.trapezoid(6.0 * h * speed, time) > 0.2  # J


def test_friction_of_lugre_is_higher_at_standstill() -> None:
    built, effect = added(lugre_loss, give=0.01, rise=0.4, v=0.2)
    assert bending(built, effect, 1e-6, 1.4) == pytest.approx(0.0, abs=1e-8)
    assert bending(built, effect, 2.0, 1.0) == pytest.approx(0.0, abs=1e-8)
    assert bending(built, effect, 0.2, 1.2) < 0.0 < bending(built, effect, 0.2, 1.1)


def rolling() -> BondGraph:
    """A wheel whose tyre pushes a body by its slip."""
    g = BondGraph("rolling")
    speed = g.input("speed", "m/s")
    wheel, tyre = g.one_junction("wheel", TRANSLATION), g.zero_junction("tyre", TRANSLATION)
    body = g.one_junction("body", TRANSLATION)
    g.flow_source("drive", speed, at=wheel)
    g.bond(wheel, tyre)
    stiffness = g.parameter("grip", 4000.0, "N s/m")
    g.resistance("contact", lambda slip: stiffness * slip, at=tyre)
    g.bond(tyre, body)
    g.inertance("mass", g.parameter("m", 1e6, "kg"), at=body, state="v")
    g.measure_effort("force", tyre, "force of the tyre")
    return g


def test_the_force_of_a_tyre_builds_up_over_the_same_length_at_any_speed() -> None:
    g = rolling()
    effect = tyre_relaxation(g, Place(handle(g, "tyre"), Scale(4000.0, 20.0)))
    assert effect is not None and effect.adds_state
    model = build(with_values(g, {effect.coefficients[0]: 0.5})).model
    for speed in (2.0, 20.0):
        time = np.linspace(0.0, 1.5 / speed, 31)
        u = np.full((1, time.size), speed + 1.0)  # slip of 1 m/s, the wheel a little faster than the body
        run = simulate(model, time, u, x0=model.x0(v=speed), rtol=1e-9).raise_if_failed()
        expected = 4000.0 * (1.0 - np.exp(-(speed + 1.0) * time / 0.5))
        np.testing.assert_allclose(run.y[0], expected, rtol=0.02, atol=1.0)


def test_a_battery_falls_by_an_exponential() -> None:
    g = BondGraph("torch")
    loop = g.one_junction("loop", ELECTRICAL)
    g.effort_source("cell", g.parameter("E", 4.0, "V"), at=loop)
    g.inertance("wire", g.parameter("L", 1e-4, "H"), at=loop, state="i")
    g.resistance("bulb", g.parameter("R", 2.0, "ohm"), at=loop)
    effect = charge_fading(g, Place(loop, Scale(4.0, 2.0)))
    assert effect is not None
    model = build(with_values(g, {effect.coefficients[0]: 0.02})).model
    time = np.linspace(0.0, 40.0, 41)
    run = simulate(model, time, np.zeros((0, time.size)), rtol=1e-9).raise_if_failed()
    np.testing.assert_allclose(run.x[0][1:], 2.0 * np.exp(-0.02 / 2.0 * time[1:]), rtol=1e-4)


def test_a_source_that_stands_for_a_loss_is_no_battery() -> None:
    """A formula that was found before is a source by the current: it "fell with the charge drawn" as a second law."""
    g = BondGraph("torch")
    loop = g.one_junction("loop", ELECTRICAL)
    g.effort_source("formula", -0.3 * loop.flow, at=loop)
    g.inertance("wire", g.parameter("L", 1e-4, "H"), at=loop, state="i")
    before = copy(g)
    assert charge_fading(g, Place(loop, Scale(4.0, 2.0))) is None
    assert g == before


def shafts(rigid: bool) -> BondGraph:
    """Two flywheels, apart or tied."""
    g = BondGraph("shafts")
    torque = g.input("torque", "N m")
    first, second = g.one_junction("first", ROTATION), g.one_junction("second", ROTATION)
    g.effort_source("motor", torque, at=first)
    g.inertance("wheel", g.parameter("J", 2.0, "kg m^2"), at=first, state="omega")
    g.inertance("load", g.parameter("J_2", 3.0, "kg m^2"), at=second, state="omega_2")
    if rigid:
        g.bond(first, second)
    return g


def test_a_fluid_passes_a_torque_by_slip_times_speed() -> None:
    g = shafts(rigid=False)
    at = Place.between(handle(g, "first"), handle(g, "second"), Scale(50.0, 20.0))
    effect = fluid_coupling_between(g, at)
    assert effect is not None
    model = build(with_values(g, {effect.coefficients[0]: 0.01})).model
    rates = model.rhs(0.0, model.x0(omega=100.0, omega_2=80.0), np.zeros(1), model.theta())
    np.testing.assert_allclose(rates, [-20.0 / 2.0, 20.0 / 3.0])


def test_a_clutch_passes_its_largest_torque_and_is_rigid_below() -> None:
    g = shafts(rigid=True)
    (bond,) = [bond for bond in g.bonds if bond.target == "second"]
    effect = clutch_slip(g, Place(handle(g, "first"), Scale(10.0, 5.0), bond))
    assert effect is not None
    model = build(with_values(g, {effect.coefficients[0]: 9.0})).model
    time = np.linspace(0.0, 4.0, 41)
    rows = [model.index("state", name) for name in ("omega", "omega_2")]
    for torque, speeds in ((10.0, (8.0, 8.0)), (40.0, (31.0 / 2.0 * 4.0, 9.0 / 3.0 * 4.0))):
        run = simulate(model, time, np.full((1, time.size), torque), rtol=1e-8).raise_if_failed()
        np.testing.assert_allclose(run.x[rows, -1], speeds, rtol=0.02)


def test_what_runs_over_an_edge_grows_with_the_power_of_three_halves() -> None:
    g = BondGraph("tank")
    tank = g.zero_junction("tank", HYDRAULIC)
    g.compliance("water", g.parameter("k", 1e4, "Pa/m^3"), at=tank, state="V")
    effect = overflow(g, Place(tank, Scale(1e4, 1e-3)))
    assert effect is not None
    (c,), (edge,) = effect.coefficients, effect.shapes
    model = build(with_values(g, {c: 4e-4, edge: 6e3})).model
    leaving = [-float(model.rhs(0.0, model.x0(V=v), np.zeros(0), model.theta())[0]) for v in (0.5, 0.6, 0.85, 1.6)]
    assert leaving == pytest.approx([0.0, 0.0, 4e-4 * 0.25**1.5, 4e-4], abs=1e-12)
