"""Faults of sensors in the unit in which the sensor is declared: pascals were said of a gauge in bar."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.build import build
from bondgraph.declare.domains import HYDRAULIC, THERMAL
from bondgraph.declare.editing import copy, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.sensors import sensor_bias, sensor_dead_zone, sensor_drift


def tank() -> BondGraph:
    g = BondGraph("tank")
    node = g.zero_junction("tank", HYDRAULIC)
    g.compliance("water", g.parameter("k", 1e6, "Pa/m^3"), at=node, state="V", initial=0.3)
    g.resistance("outlet", g.parameter("r", 1e9, "Pa s/m^3"), at=node)
    g.measure_effort("p", node, "pressure", "bar")
    return g


@pytest.mark.parametrize(
    ("function", "unit", "bound"),
    [(sensor_bias, "bar", 4.0), (sensor_drift, "bar/s", 1.0), (sensor_dead_zone, "bar", 2.0)],
)
def test_what_a_sensor_adds_is_told_in_its_own_unit(function: EffectFunction, unit: str, bound: float) -> None:
    graph = copy(tank())
    effect = function(graph, Place.sensor("p", Scale(2e5, 1.0)))
    assert isinstance(effect, Effect)
    (info,) = [one for one in build(graph).model.parameters if one.name == effect.coefficients[0]]
    assert info.display_unit == unit and info.shown(info.upper) == pytest.approx(bound)
    assert info.upper == pytest.approx(1e5 * bound)


def test_a_bias_acts_in_coherent_units() -> None:
    graph = copy(tank())
    effect = sensor_bias(graph, Place.sensor("p", Scale(2e5, 1.0)))
    assert isinstance(effect, Effect)
    model = build(with_values(graph, {effect.coefficients[0]: 0.25e5})).model
    y = model.output(0.0, np.array([0.3]), np.empty(0), model.theta())
    assert y[0] == pytest.approx(3.25e5)


def test_a_bias_of_a_thermometer_is_a_difference() -> None:
    g = BondGraph("room")
    node = g.zero_junction("room", THERMAL)
    g.compliance("air", g.parameter("k", 1e-4, "K/J"), at=node, state="Q", initial=3e6)
    g.resistance("wall", g.parameter("r", 0.1, "K/W"), at=node)
    g.measure_effort("T", node, "temperature", "K")
    effect = sensor_bias(g, Place.sensor("T", Scale(300.0, 1.0)))
    assert isinstance(effect, Effect)
    (info,) = [one for one in build(g).model.parameters if one.name == effect.coefficients[0]]
    assert info.display_unit == "K" and info.upper == pytest.approx(600.0)
