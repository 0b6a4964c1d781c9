"""Points that cannot be evaluated are refused in words; starts may be given in energy variables."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.data.log import Log, LogChannel
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import DataError
from bondgraph.report.evaluate import evaluate
from bondgraph.report.simulation import SimulationOptions, simulate_graph


def oscillator() -> BondGraph:
    g = BondGraph("oscillator")
    body = g.one_junction("body")
    g.effort_source("push", g.input("F", "N"), at=body)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body, state="v")
    g.compliance("spring", g.parameter("k", 8.0, "N/m"), at=body, state="q")
    return g


@pytest.mark.parametrize(
    ("point", "words"),
    [
        (1, "expected an object with t, states"),
        ({"state": {}}, "unknown key 'state'; did you mean 'states'"),
        ({"states": [1.0]}, "states must be an object of names and numbers"),
        ({"inputs": None}, "inputs must be an object"),
        ({"t": "now"}, "t must be a number but is 'now'"),
        ({"states": {"momentum(mass)": "fast"}}, r"momentum\(mass\) must be a number"),
        ({"states": {"momentum(mass)": True}}, r"momentum\(mass\) must be a number"),
        ({"states": {"displacement(mass)": 1.0}}, r"no state 'displacement\(mass\)'"),
        ({"parameters": {"m": "2"}}, "m must be a number"),
        ({"inputs": {"f": 1.0}}, "no input 'f'"),
        ({"input_derivatives": {"f": 1.0}}, "no input 'f'"),
    ],
)
def test_a_point_that_says_nothing_is_refused_with_its_number(point, words):
    with pytest.raises(DataError, match=f"point 1: .*{words}"):
        evaluate(oscillator(), [{}, point])


def test_a_start_in_energy_variables_is_that_in_states():
    states, energies = (
        simulate_graph(oscillator(), None, SimulationOptions(until=0.5, step=0.5, values={"m": 4.0}, initial=start))
        for start in ({"v": 1.5, "q": 0.2}, {"momentum(mass)": 6.0, "displacement(spring)": 0.2})
    )
    assert states.x.tolist() == energies.x.tolist()


def test_the_rate_of_a_tabulated_input_is_its_slope():
    """A capacitor across a source: its current is the capacitance times the slope of the voltage, at bends the mean."""
    g = BondGraph("capacitor")
    z = g.zero_junction("z")
    source = g.effort_source("supply", g.input("u", "V"), at=z)
    g.compliance("C", 1 / g.parameter("C", 2.0, "F"), at=z)
    g.measure_flow("i", source, unit="A")
    time = np.array([0.0, 1.0, 2.0, 3.0])
    table = Log("u", time, {"u": LogChannel("u", "V", np.array([0.0, 3.0, 3.0, 2.0]))})
    found = simulate_graph(g, table, SimulationOptions(until=4.0, step=0.5))
    assert found.y[0].tolist() == pytest.approx([6.0, 6.0, 3.0, 0.0, -1.0, -2.0, -2.0, 0.0, 0.0])
    known = Log("u", time, {**table.channels, "d_u": LogChannel("d_u", "V/s", np.full(4, 7.0))})
    assert simulate_graph(g, known, SimulationOptions(until=2.5, step=0.5)).y[0].tolist() == pytest.approx([14.0] * 6)
