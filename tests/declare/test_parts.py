"""Parts that share quantities, states named one by one, and signals given by a residual."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.build import build
from bondgraph.declare.editing import with_values
from bondgraph.declare.expressions import signal
from bondgraph.declare.files import graph_from_json, graph_to_json
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.errors import DeclarationError, DerivationError
from bondgraph.report.evaluate import evaluate


def wheel(inertia: float = 2.0) -> BondGraph:
    g = BondGraph("wheel")
    load, radius = g.input("load", "N"), g.parameter("radius", 0.3, "m", "of every wheel")
    J = g.parameter("J", inertia, "kg m^2")
    hub = g.one_junction("hub")
    g.inertance("disc", J, at=hub)
    g.resistance("drag", lambda flow: 0.1 * load * radius * flow, at=hub)
    g.signal("moment", load * radius, "N m")
    return g


def car() -> BondGraph:
    g = BondGraph("car")
    weight = g.parameter("weight", 400.0, "N")
    g.include("front", wheel(), bind={"load": weight}, shared=True)
    g.include("rear", wheel(), bind={"load": weight}, shared=True)
    g.measure("sum", symbol("radius") * signal("flow", "front.hub"), "m/s")
    return g


def test_shared_parts_have_one_parameter_between_them() -> None:
    flat = car().flatten()
    assert [p.name for p in flat.parameters] == ["weight", "radius", "J"]
    assert [s.name for s in flat.signals] == ["moment"]
    assert build(car()).model.names("state") == ("f_front.disc", "f_rear.disc")


def test_a_shared_parameter_changes_in_every_part() -> None:
    changed = with_values(car(), {"J": 5.0})
    assert {p.name: p.value for p in changed.flatten().parameters}["J"] == 5.0


def test_parts_that_disagree_cannot_share() -> None:
    g = car()
    with pytest.raises(DeclarationError, match="its J and another of the same name differ"):
        g.include("spare", wheel(3.0), bind={"load": symbol("weight")}, shared=True)
    assert [part.name for part in g.subgraphs] == ["front", "rear"]


def test_shared_parts_survive_their_file() -> None:
    assert graph_from_json(graph_to_json(car())) == car()


def test_an_exchanged_part_shares_as_the_old_one_did() -> None:
    g = car()
    g.exchange("rear", wheel())
    assert g == car()


def two_springs(state: str | tuple[str, ...]) -> BondGraph:
    g = BondGraph("springs")
    a, b = g.one_junction("a"), g.one_junction("b")
    for end in (a, b):
        g.inertance(f"mass_{end.name}", 2.0, at=end)
    g.field("C", "field", energy=lambda x, y: 3 * x**2 + 2 * (x - y) ** 2, at=(a, b), state=state)
    return g


def test_states_of_a_field_have_names_of_their_own_or_numbers() -> None:
    assert build(two_springs(("heave", "pitch"))).model.names("state")[2:] == ("heave", "pitch")
    assert build(two_springs("q")).model.names("state")[2:] == ("q1", "q2")
    assert graph_from_json(graph_to_json(two_springs(("heave", "pitch")))) == two_springs(("heave", "pitch"))


def kepler(guess: object = symbol("turned")) -> BondGraph:
    from sympy import sin

    g = BondGraph("kepler")
    anomaly, e = g.input("anomaly", "rad/s"), g.parameter("e", 0.6, "1")
    turned = g.integral("turned", anomaly / 2, "rad", initial=1.0)
    body = g.one_junction("body")
    g.inertance("mass", 1.0, at=body)
    E = g.implicit_signal("E", lambda E: E - e * sin(E) - turned, "rad", "eccentric anomaly", guess=guess)
    g.effort_source("push", E, at=body)
    return g


def test_an_implicit_signal_is_solved_to_rounding() -> None:
    point = {"states": {"turned": 0.8}, "inputs": {"anomaly": 0.7}}
    found = evaluate(kepler(), [point])[0]["signals"]["E"]
    assert abs(found - 0.6 * np.sin(found) - 0.8) < 1e-15


def test_an_implicit_signal_survives_its_file() -> None:
    assert graph_from_json(graph_to_json(kepler())) == kepler()


def test_a_guess_must_be_known_before() -> None:
    with pytest.raises(DerivationError, match="the guess must follow from states, inputs and parameters"):
        build(kepler(signal("effort", "push")))


def test_a_residual_must_contain_its_signal() -> None:
    g = BondGraph("g")
    a = g.parameter("a", 1.0, "1")
    with pytest.raises(DeclarationError, match="does not contain b"):
        g.implicit_signal("b", lambda b: a - 1, "1")


def test_named_signals_are_evaluated_beside_outputs_and_states_of_the_same_name() -> None:
    g = BondGraph("mass")
    m = g.parameter("m", 2.0, "kg")
    body = g.one_junction("body")
    g.inertance("mass", m, at=body, state="speed")
    g.effort_source("push", g.signal("force", 3 * m, "kg"), at=body)
    g.measure("force", 2 * body.flow, "")
    g.measure("speed", body.flow + 1, "")
    answer = evaluate(g, [{"states": {"speed": 5.0}}])[0]
    assert answer["derivatives"] == {"speed": 3.0}
    assert answer["outputs"] == {"force": 10.0, "speed": 6.0}
    assert answer["signals"]["force"] == 6.0
