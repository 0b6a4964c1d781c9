"""Commands and levers: an input without a unit is a command where it takes more values than a lever has positions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bondgraph as bg
from bondgraph.correct.models.typical import graded_inputs, typical_inputs
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import EffectFunction, Place, Scale
from bondgraph.effects import actuator_dead_zone, actuator_lag


def valve() -> bg.BondGraph:
    """A chamber that a valve fills, by its travel of 0 to 1."""
    g = bg.BondGraph("valve")
    travel = g.input("travel", "1", hold=True)
    chamber = g.zero_junction("chamber", bg.HYDRAULIC)
    g.flow_source("edge", g.parameter("q", 1e-4, "m^3/s") * travel, at=chamber)
    g.compliance("oil", lambda v: 1e12 * v, at=chamber, state="V")
    g.resistance("leak", flow=lambda p: 1e-11 * p, at=chamber)
    g.measure_effort("pressure", chamber)
    return g


def moved(positions: int) -> bg.MatchedLog:
    """A log over which the travel takes so many values."""
    travel = np.tile(np.linspace(0.1, 1.0, positions), 40)
    return bg.MatchedLog("run", 0.1 * np.arange(travel.size), travel[np.newaxis], np.zeros((1, travel.size)))


@given(positions=st.integers(2, 60))
def test_a_lever_has_few_positions(positions: int) -> None:
    model = bg.build(valve()).model
    names = {"travel"} if positions > 9 else set()
    assert graded_inputs(model, [moved(positions)]) == names
    assert set(typical_inputs(model, [moved(positions)])) == names


@pytest.mark.parametrize("effect", [actuator_dead_zone, actuator_lag])
def test_a_valve_that_its_travel_opens_has_laws_of_an_actuator(effect: EffectFunction) -> None:
    """A spool or a duty cycle without a unit had none: neither a dead zone, nor a lag."""
    g = valve()
    place = Place(handle(g, "chamber"), Scale(1e7, 1e-4))
    assert effect(valve(), place) is None
    assert effect(g, Place(handle(g, "chamber"), Scale(1e7, 1e-4), commands=frozenset({"travel"}))) is not None
