"""Effects of measured machines: their laws, units and signs on a small bench."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.build import BuiltModel, build
from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale, effect_functions, is_for
from bondgraph.declare.graph import BondGraph
from vehicle_graphs import machine_effects as effects

LEAD = 0.01


def bench() -> BondGraph:
    """A motor that moves a carriage through a screw."""
    g = BondGraph("bench")
    torque = g.input("torque", "N m", "motor torque", hold=True)
    motor = g.one_junction("motor", ROTATION)
    carriage = g.one_junction("carriage", TRANSLATION)
    lead = g.parameter("screw_lead", LEAD, "m", "travel per turn")
    g.effort_source("drive", torque, at=motor)
    g.transformer("screw", lead / (2 * np.pi), motor, carriage)
    g.inertance("mass", g.parameter("mass", 20.0, "kg", "carriage", (5.0, 50.0)), at=carriage, state="v")
    x = g.integral("x", carriage.flow, "m", "position")
    g.measure("position", x, "m")
    return g


def place(g: BondGraph, at: str) -> Place:
    return Place.sensor(at, Scale(0.4, 0.2)) if at == "position" else Place(handle(g, at), Scale(100.0, 0.2))


def added(function: EffectFunction, at: str = "carriage") -> tuple[BondGraph, Effect]:
    g = bench()
    effect = function(g, place(g, at))
    assert effect is not None
    return g, effect


def force(built: BuiltModel, v: float, x: float = 0.0, torque: float = 0.0) -> float:
    """Force on the carriage [N]."""
    model = built.model
    state = model.x0(v=v, x=x)
    return 20.0 * float(model.rhs(0.0, state, np.array([torque]), model.theta())[model.index("state", "v")])


def shown(built: BuiltModel, x: float) -> float:
    """What the position sensor shows."""
    model = built.model
    return float(model.output(0.0, model.x0(x=x), model.u0(), model.theta())[0])


@pytest.mark.parametrize("function", effect_functions(effects), ids=lambda function: function.__name__)
def test_every_effect_derives_with_right_dimensions_and_vanishes_at_zero(function: EffectFunction) -> None:
    every = [at for at in ("motor", "carriage", "position") if is_for(function, place(bench(), at))]
    places = [at for at in every if function(g := bench(), place(g, at))]
    assert places
    for at in places:
        g, effect = added(function, at)
        built = build(g)
        if not effect.adds_state:
            assert force(built, 0.1, 0.003, 2.0) == pytest.approx(force(build(bench()), 0.1, 0.003, 2.0), abs=1e-12)
            assert shown(built, -0.3) == pytest.approx(-0.3)


@pytest.mark.parametrize("v", [-0.1, -0.003, 0.002, 0.15])
def test_cubic_loss_only_takes_energy(v: float) -> None:
    g, effect = added(effects.cubic_loss)
    assert force(build(with_values(g, {effect.coefficients[0]: 40.0})), v) * v < 0


def test_drag_differs_by_direction() -> None:
    g, effect = added(effects.direction_dependent_drag)
    built = build(with_values(g, {effect.coefficients[0]: 30.0}))
    assert force(built, 0.1) == pytest.approx(-3.0) and force(built, -0.1) == pytest.approx(-3.0)


def test_ripple_repeats_with_every_turn_and_has_two_phases() -> None:
    for function, where in ((effects.ripple_sine, LEAD / 4), (effects.ripple_cosine, 0.0)):
        g, effect = added(function)
        built = build(with_values(g, {effect.coefficients[0]: 2.0}))
        assert force(built, 0.0, where) == pytest.approx(-2.0)
        assert force(built, 0.0, where + 7 * LEAD) == pytest.approx(-2.0)
        assert force(built, 0.0, where + LEAD / 2) == pytest.approx(2.0)


def test_uncounted_inertia_is_felt_through_the_screw_and_offered_only_where_none_is_declared() -> None:
    g, effect = added(effects.uncounted_inertia, "motor")
    inertia, torque = 4e-5, 2.0
    built = build(with_values(g, {effect.coefficients[0]: inertia}))
    ratio = LEAD / (2 * np.pi)
    expected = 20.0 * (torque / ratio) / (20.0 + inertia / ratio**2)
    assert force(built, 0.0, torque=torque) == pytest.approx(expected)
    g = bench()
    assert effects.uncounted_inertia(g, place(g, "carriage")) is None


@pytest.mark.parametrize("v", [-0.1, -0.003, 0.002, 0.15])
def test_shear_thinning_loss_only_takes_energy_and_grows_by_the_logarithm(v: float) -> None:
    g, effect = added(effects.shear_thinning_loss)
    built = build(with_values(g, {effect.coefficients[0]: 4.0}))
    assert force(built, v) * v < 0
    # twice the speed, far above the 2 % of the scale where it bends: c log 2 more
    assert force(built, 0.2) - force(built, 0.4) == pytest.approx(4.0 * np.log(2.0), rel=1e-3)


def test_friction_along_the_travel_opposes_the_motion_either_way() -> None:
    g, effect = added(effects.travel_dependent_friction)
    built = build(with_values(g, {effect.coefficients[0]: 30.0}))
    assert force(built, 0.1, 0.5) == pytest.approx(-15.0) and force(built, -0.1, 0.5) == pytest.approx(15.0)
    assert force(built, 0.1, 0.0) == pytest.approx(0.0, abs=1e-12)


def test_position_stiffness_pulls_back() -> None:
    g, effect = added(effects.position_stiffness)
    assert force(build(with_values(g, {effect.coefficients[0]: 50.0})), 0.0, 0.2) == pytest.approx(-10.0)


def test_sensors_may_show_the_magnitude_or_the_square() -> None:
    for function, expected in ((effects.sensor_magnitude, 0.3), (effects.sensor_square, 0.09 / 0.4)):
        g, effect = added(function, "position")
        assert effect.channel == "position"
        built = build(with_values(g, {effect.coefficients[0]: 1.0}))
        assert shown(built, -0.3) == pytest.approx(expected) and shown(built, 0.3) == pytest.approx(expected)


def test_effects_are_offered_only_where_they_make_sense() -> None:
    g = bench()
    motor = Place(handle(g, "motor"), Scale(100.0, 0.2))
    before = len(g.parameters)
    assert effects.position_stiffness(g, motor) is None  # no position is integrated there
    assert len(g.parameters) == before
