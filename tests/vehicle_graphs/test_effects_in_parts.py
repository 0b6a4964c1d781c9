"""Effects that revise what a part of the Ranger declares: they act there, vanish, and leave the graph alone."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import BuiltModel, build
from bondgraph.declare.editing import copy, handle, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.files import read_graph, write_graph
from bondgraph.declare.graph import BondGraph
from bondgraph.simulate.model import Model
from vehicle_graphs import ranger

SCALE = Scale(500.0, 20.0)


@functools.cache
def declared() -> BuiltModel:
    return build(ranger.full())


def added(function: EffectFunction, junction: str) -> tuple[BondGraph, Effect]:
    graph = copy(declared().graph)
    effect = function(graph, Place(handle(graph, junction), SCALE))
    assert isinstance(effect, Effect)
    return graph, effect


def driving(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """A state in which everything moves, and inputs."""
    x0 = model.x0(
        forward_velocity=8.0, rear_axle_speed=26.0, front_axle_speed=25.0, engine_speed=420.0,
        sheave_displacement=0.008, inclination=0.03,
    )  # fmt: skip
    return x0, model.u0(throttle=0.5, brake=0.1)


def rates(model: Model, **values: float) -> dict[str, float]:
    x, u = driving(model)
    found = model.rhs(0.0, x, u, model.theta(**values))
    return dict(zip(model.names("state"), map(float, found), strict=True))


VANISHING = (
    (effects.headwind, "body.forward"),
    (effects.actuator_scale, "engine.crank"),
    (effects.actuator_scale, "rear_axle.hub"),
    (effects.coulomb_loss, "primary.sheave"),
    (effects.hysteresis_loss, "primary.sheave"),
    (effects.centrifugal_tension, "rear_tyre.contact"),
)


@pytest.mark.parametrize(("function", "junction"), VANISHING, ids=lambda value: getattr(value, "__name__", value))
def test_an_effect_in_a_part_vanishes_with_its_coefficient_and_acts_with_it(
    function: EffectFunction, junction: str
) -> None:
    before = rates(declared().model)
    graph, effect = added(function, junction)
    model = build(graph).model
    absent = rates(model)
    for name, value in before.items():
        assert absent[name] == pytest.approx(value, rel=1e-9, abs=1e-9)
    info = model.parameters[model.index("parameter", effect.coefficients[0])]
    assert info.upper is not None
    own = {f"bent_{effect.element}": 0.5} if function is effects.hysteresis_loss else {}
    x, u = driving(model)
    for name, value in own.items():
        x[model.index("state", name)] = value
    there = model.rhs(0.0, x, u, model.theta(**{effect.coefficients[0]: 0.3 * info.upper}))
    acting = dict(zip(model.names("state"), map(float, there), strict=True))
    assert any(abs(acting[name] - value) > 1e-6 * max(1.0, abs(value)) for name, value in before.items())
    assert rates(declared().model) == before  # the declared graph was not touched


def test_wind_acts_on_the_declared_drag() -> None:
    graph, effect = added(effects.headwind, "body.forward")
    model = build(graph).model
    own = rates(model, **{effect.coefficients[0]: 5.0})["forward_velocity"] - rates(model)["forward_velocity"]
    assert own == pytest.approx(-1.225 * 1.4 / 2 * (13.0**2 - 8.0**2) / 1200.0, rel=1e-9)


def test_a_stronger_engine_turns_the_crankshaft() -> None:
    graph, effect = added(effects.actuator_scale, "engine.crank")
    model = build(graph).model
    weaker, stronger = (rates(model, **{effect.coefficients[0]: share})["engine_speed"] for share in (-0.1, 0.1))
    assert stronger - weaker > 50.0  # 0.2 of some 30 N m on 0.06 kg m^2


def test_a_late_throttle_is_one_state_that_everything_follows() -> None:
    graph, effect = added(effects.actuator_lag, "engine.crank")
    model = build(graph).model
    assert model.names("input") == declared().model.names("input")
    (own,) = set(model.names("state")) - set(declared().model.names("state"))
    x, u = driving(model)
    position = model.index("state", own)
    x[position] = u[model.index("input", "throttle")]
    settled = model.rhs(0.0, x, u, model.theta())
    before = rates(declared().model)
    for name, value in before.items():
        assert settled[model.index("state", name)] == pytest.approx(value, rel=1e-9, abs=1e-9)
    x[position] = 0.2
    late = model.rhs(0.0, x, u, model.theta(**{effect.coefficients[0]: 0.5}))
    assert late[position] == pytest.approx((0.5 - 0.2) / 0.5)
    assert late[model.index("state", "engine_speed")] < before["engine_speed"]


def test_dry_friction_holds_the_sheave_until_the_forces_exceed_it() -> None:
    graph, effect = added(effects.coulomb_loss, "primary.sheave")
    model = build(graph).model
    free = rates(model)["sheave_displacement"]
    force = abs(free) * 6000.0
    slower = rates(model, **{effect.coefficients[0]: 0.25 * force})["sheave_displacement"]
    assert slower == pytest.approx(0.75 * free, rel=1e-6)
    assert rates(model, **{effect.coefficients[0]: 1.5 * force})["sheave_displacement"] == 0.0


def test_a_corrected_vehicle_can_be_written_and_read(tmp_path: Path) -> None:
    graph, effect = added(effects.headwind, "body.forward")
    graph = with_values(graph, {effect.coefficients[0]: 3.0})
    write_graph(graph, tmp_path / "corrected.json")
    again = build(read_graph(tmp_path / "corrected.json")).model
    assert rates(again) == pytest.approx(rates(build(graph).model))
