"""Points that cannot be evaluated are refused in words; starts may be given in energy variables."""

from __future__ import annotations

import pytest

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
