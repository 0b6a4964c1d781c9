"""Storages with losses of their own: their equations in closed form, at any size and at none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bondgraph as bg
from bondgraph import effects
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import EffectFunction, Place, Scale
from bondgraph.estimate.initial import initial_states

SIZES = st.one_of(st.just(0.0), st.floats(1e-6, 5.0))


def filtered() -> bg.BondGraph:
    """A choke that feeds a condenser with a load in parallel."""
    g = bg.BondGraph("filtered")
    choke, out = g.one_junction("choke", bg.ELECTRICAL), g.zero_junction("out", bg.ELECTRICAL)
    g.effort_source("bridge", g.input("u", "V"), at=choke)
    g.inertance("coil", g.parameter("L", 0.2, "H"), at=choke, state="i")
    g.resistance("copper", g.parameter("R", 0.5, "V/A"), at=choke)
    g.bond(choke, out)
    g.compliance("condenser", 1 / g.parameter("C", 0.1, "A s/V"), at=out, state="q")
    load = g.parameter("G", 0.3, "A/V")
    g.resistance("load", flow=lambda effort: load * effort, at=out)
    g.measure_effort("voltage", out)
    g.measure_flow("current", choke)
    return g


def model_with(function: EffectFunction, junction: str) -> bg.Model:
    g = filtered()
    assert function(g, Place(handle(g, junction), Scale(10.0, 2.0))) is not None
    return bg.build(g).model


WITH_RESISTANCE = model_with(effects.storage_resistance, "out")
WITH_IRON = model_with(effects.core_loss, "choke")


@given(SIZES, st.floats(-3.0, 3.0), st.floats(-1.0, 1.0), st.floats(-9.0, 9.0))
def test_a_condenser_with_a_resistance_of_its_own(c: float, i: float, q: float, u: float) -> None:
    """v = q/C + c*(i - G*v), which is solved for v."""
    v = (q / 0.1 + c * i) / (1.0 + c * 0.3)
    theta = WITH_RESISTANCE.theta(c_equivalent_series_resistance_out=c)
    found = WITH_RESISTANCE.rhs(0.0, np.array([i, q]), np.array([u]), theta)
    np.testing.assert_allclose(found, [(u - 0.5 * i - v) / 0.2, i - 0.3 * v], rtol=1e-9, atol=1e-9)
    assert WITH_RESISTANCE.output(0.0, np.array([i, q]), np.array([u]), theta)[0] == pytest.approx(v, abs=1e-9)


@given(SIZES, st.floats(-3.0, 3.0), st.floats(-1.0, 1.0), st.floats(-9.0, 9.0))
def test_a_coil_whose_iron_takes_current_beside_it(c: float, i: float, q: float, u: float) -> None:
    """The iron takes c*e beside the coil, whose voltage e is what copper and condenser leave of the source."""
    v = q / 0.1
    e = (u - v - 0.5 * i) / (1.0 + 0.5 * c)
    theta = WITH_IRON.theta(c_core_loss_choke=c)
    found = WITH_IRON.rhs(0.0, np.array([i, q]), np.array([u]), theta)
    np.testing.assert_allclose(found, [e / 0.2, i + c * e - 0.3 * v], rtol=1e-9, atol=1e-9)


def test_a_state_begins_where_sensors_show_it_beside_another_one() -> None:
    """A condenser at 5 V began empty, since its voltage shows what its own resistance takes of the current too."""
    time, c = np.linspace(0.0, 1.9, 20), 0.7
    y = np.repeat([[5.0], [1.5]], time.size, axis=1)
    log = bg.MatchedLog("run", time, np.zeros((1, time.size)), y)
    theta = WITH_RESISTANCE.theta(c_equivalent_series_resistance_out=c)
    (x0,) = initial_states(WITH_RESISTANCE, [log], theta, "measured")
    assert x0.tolist() == pytest.approx([1.5, 0.1 * (5.0 - c * (1.5 - 0.3 * 5.0))])
    assert WITH_RESISTANCE.output(0.0, x0, np.zeros(1), theta).tolist() == pytest.approx([5.0, 1.5])
    y[1] = np.nan  # alone the voltage tells neither
    (x0,) = initial_states(WITH_RESISTANCE, [log], theta, "measured")
    assert x0.tolist() == [0.0, 0.0]
