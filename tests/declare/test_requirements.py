"""What must be positive for a machine to be possible: checked where it is declared and wherever values change."""

from __future__ import annotations

import pytest

from bondgraph.declare.editing import copy, with_values
from bondgraph.declare.files import graph_from_json, graph_to_json
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.errors import DeclarationError
from bondgraph.report.evaluate import evaluate
from bondgraph.report.simulation import SimulationOptions, simulate_graph


def rotor(J: float = 2.0) -> BondGraph:
    g = BondGraph("rotor")
    inertia, share = g.parameter("J", J, "kg m^2"), g.parameter("share", 0.5, "1")
    g.require(inertia, "a rotor without inertia obeys no torque")
    g.require(1 - share, "it cannot pass on more than it gets")
    shaft = g.one_junction("shaft")
    g.inertance("disc", inertia, at=shaft)
    g.effort_source("drive", share, at=shaft)
    return g


def test_it_is_refused_where_it_is_declared() -> None:
    with pytest.raises(DeclarationError, match=r"rotor: a rotor without .*: J = -1 kg m\^2 - it must be positive"):
        rotor(-1.0)


def test_it_is_refused_where_a_value_is_changed() -> None:
    with pytest.raises(DeclarationError, match=r"more than it gets: 1 - share is -0.2 with share = 1.2 1 - it must"):
        with_values(rotor(), {"share": 1.2})
    with pytest.raises(DeclarationError, match="obeys no torque"):
        evaluate(rotor(), [{"parameters": {"J": 0.0}}])
    with pytest.raises(DeclarationError, match="obeys no torque"):
        simulate_graph(rotor(), None, SimulationOptions(1.0, values={"J": -2.0}))


def test_requirements_survive_copies_and_files() -> None:
    assert copy(rotor()).requirements == rotor().requirements
    assert graph_from_json(graph_to_json(rotor())) == rotor()


def test_a_part_keeps_its_requirements_under_its_own_names() -> None:
    g = BondGraph("pair")
    g.include("left", rotor())
    g.include("right", rotor())
    assert [str(requirement.positive) for requirement in g.flatten().requirements][:2] == ["left.J", "1 - left.share"]
    with pytest.raises(DeclarationError, match=r"obeys no torque: J = -3 kg m\^2"):
        with_values(g, {"right.J": -3.0})


def test_a_bound_parameter_is_checked_as_long_as_it_follows_from_parameters() -> None:
    g = BondGraph("outer")
    g.include("part", rotor(), bind={"J": 2 * g.parameter("half", 1.0, "kg m^2")})
    with pytest.raises(DeclarationError, match=r"2\*half is -6 with half = -3"):
        with_values(g, {"half": -3.0})
    h = BondGraph("driven")
    h.include("part", rotor(), bind={"share": h.input("given", "1", default=7.0)})
    h.validate()  # an input may be anything: nothing is known of it


def test_what_has_no_real_value_is_not_positive() -> None:
    from sympy import sqrt

    g = BondGraph("g")
    g.parameter("a", -1.0, "1")
    with pytest.raises(DeclarationError, match=r"no root: sqrt\(a\) is nan"):
        g.require(sqrt(symbol("a")), "no root")
