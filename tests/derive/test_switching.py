"""Laws that switch: smooth or exact by one flag, with the same declaration."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.json_writer import graph_to_json
from bondgraph.declare.switching import closed, contact, dry_friction, end_stop, positive_part
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import check_closed, derive
from bondgraph.derive.dimensions import check_dimensions
from tests.derive.compare import compare, loaded


def clutch() -> BondGraph:
    """Two rotors joined by a dry clutch, the second against two stops."""
    g = BondGraph("clutch")
    torque, grip = g.input("torque", "N m"), g.input("grip", "1")
    J1, J2 = g.parameter("J1", 0.2, "kg m^2"), g.parameter("J2", 0.5, "kg m^2")
    capacity, width = g.parameter("capacity", 50.0, "N m"), g.parameter("width", 0.1, "rad/s")
    stiffness, angle = g.parameter("stiffness", 1e4, "N m / rad"), g.parameter("angle", 1e-4, "rad")
    drive, slip, load = (
        g.one_junction("drive", ROTATION),
        g.zero_junction("slip", ROTATION),
        g.one_junction("load", ROTATION),
    )
    difference = g.one_junction("difference", ROTATION)
    g.effort_source("engine", torque, at=drive)
    g.inertance("rotor_1", J1, at=drive)
    g.bond(drive, slip)
    g.bond(slip, difference)
    g.resistance("plates", lambda w: dry_friction(w, capacity * grip, width), at=difference)
    g.bond(slip, load)
    g.inertance("rotor_2", J2, at=load)
    g.compliance("stops", lambda q: end_stop(q, -1, 1, stiffness, angle), at=load)
    return g


def rates(equations, x, u, *sides):
    """State rates; switches whose sides are not given take that of their value."""
    module = loaded(equations)
    held = [*sides, *[0.0] * (len(equations.inputs) - len(u) - len(sides))]
    theta = np.array([given.value for given in equations.parameters])
    return module["rhs"](0.0, np.array(x), np.array([*u, *held]), theta)


def test_one_flag_chooses_between_smooth_and_exact():
    causal = assign_causality(clutch())
    smooth, exact = derive(causal), derive(causal, smooth=False)
    for equations in (smooth, exact):
        check_closed(equations)
        check_dimensions(equations)
    assert smooth.events == ()
    assert sorted(map(str, exact.events)) == ["-q_stops - 1", "omega_difference", "q_stops - 1"]
    for x in ([10.0, 4.0, 0.5], [4.0, 10.0, 1.2], [-3.0, 1.0, -1.5]):
        a, b = rates(smooth, x, [20.0, 0.7]), rates(exact, x, [20.0, 0.7])
        np.testing.assert_allclose(a, b, rtol=1e-9)
        grip = 35.0 * np.sign(x[0] - x[1])
        stop = 1e4 * (max(x[2] - 1, 0) - max(-1 - x[2], 0))
        np.testing.assert_allclose(b, [(20.0 - grip) / 0.2, (grip - stop) / 0.5, x[1]], rtol=1e-12)


def test_the_smooth_form_is_a_hyperbolic_tangent():
    equations = derive(assign_causality(clutch()))
    a = rates(equations, [5.05, 5.0, 0.0], [0.0, 1.0])
    assert a[0] == pytest.approx(-50.0 * np.tanh(0.5) / 0.2, rel=1e-12)


def test_switches_go_through_files():
    g = clutch()
    assert graph_from_json(graph_to_json(g)) == g


def test_smooth_switches_agree_with_the_oracle():
    assert [compare(clutch(), seed) for seed in range(3)] == [""] * 3


def test_a_junction_that_opens_passes_power_only_while_closed():
    g = BondGraph("switched")
    pedal = g.input("pedal", "1")
    a, b = g.one_junction("a", TRANSLATION), g.zero_junction("b", TRANSLATION)
    g.inertance("m", g.parameter("m", 2.0, "kg"), at=a)
    g.transformer("coupling", closed(pedal, 0.01), a, b)
    g.compliance("k", g.parameter("k", 100.0, "N/m"), at=b)
    causal = assign_causality(g)
    for smooth in (True, False):
        equations = derive(causal, smooth=smooth)
        np.testing.assert_allclose(rates(equations, [3.0, 0.2], [1.0]), [-10.0, 3.0], rtol=1e-9)
        np.testing.assert_allclose(rates(equations, [3.0, 0.2], [-1.0]), [0.0, 0.0], atol=1e-9)


def test_a_contact_pushes_and_never_pulls():
    g = BondGraph("ball")
    m, k, d = g.parameter("m", 0.5, "kg"), g.parameter("k", 1e5, "N/m"), g.parameter("d", 10.0, "N s/m^2")
    gravity, width = g.parameter("g", 9.81, "m/s^2"), g.parameter("w", 1e-6, "m")
    v = g.one_junction("v", TRANSLATION)
    g.inertance("ball", m, at=v, initial=0.0)
    g.effort_source("weight", -m * gravity, at=v)
    height = g.integral("height", v.flow, "m", initial=1.0)
    g.resistance("floor", lambda w: -contact(-height, -w, k, d, width), at=v)
    causal = assign_causality(g)
    exact = derive(causal, smooth=False)
    assert [str(event) for event in exact.events] == ["-height"]
    for equations in (exact, derive(causal)):
        check_dimensions(equations)
        np.testing.assert_allclose(rates(equations, [-1.0, 0.5], []), [-9.81, -1.0], rtol=1e-9)
        np.testing.assert_allclose(
            rates(equations, [-1.0, -0.01], [])[0], (0.01 * (1e5 + 10.0)) / 0.5 - 9.81, rtol=1e-9
        )


def test_a_diode_conducts_one_way():
    g = BondGraph("rectifier")
    u, G, C, w = g.input("u", "V"), g.parameter("G", 0.1, "S"), g.parameter("C", 1e-3, "F"), g.parameter("w", 1e-3, "V")
    loop, z = g.one_junction("loop"), g.zero_junction("z")
    g.effort_source("s", u, at=loop)
    g.resistance("diode", flow=lambda e: G * positive_part(e, w), at=loop)
    g.bond(loop, z)
    g.compliance("c", 1 / C, at=z)
    equations = derive(assign_causality(g), smooth=False)
    np.testing.assert_allclose(rates(equations, [1e-3], [5.0]), [0.4], rtol=1e-12)
    np.testing.assert_allclose(rates(equations, [1e-3], [-5.0]), [0.0], atol=1e-12)
