"""Transfer functions, poles and zeros against closed forms and the response of matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy
from sympy import Integer, Rational, sin, sqrt

from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.derive.equations import ImplicitLoop
from bondgraph.derive.linearisation import equilibrium, linearise
from bondgraph.derive.transfer import LAPLACE_S, poles_zeros, transfer_function
from bondgraph.errors import BondGraphError, DerivationError
from tests.derive.linear_graphs import A, B, U, X, Y, assign, by_hand, derived, motor, oscillator
from tests.derive.random_graphs import RandomGraph

S = LAPLACE_S


def test_transfer_functions_of_the_textbook():
    m, k, c, L, R, k_m, J, b = (symbol(name) for name in ("m", "k", "c", "L", "R", "k_m", "J", "b"))
    equations = derived(oscillator())
    assert sympy.cancel(transfer_function(equations, "F", "q") - 1 / (m * S**2 + c * S + k)) == 0
    assert sympy.cancel(transfer_function(equations, "F", "speed") - S / (m * S**2 + c * S + k)) == 0
    found = transfer_function(derived(motor()), "u_a", "speed")
    assert sympy.cancel(found - k_m / ((L * S + R) * (J * S + b) + k_m**2)) == 0


def test_a_direct_path_gives_as_many_zeros_as_poles():
    g = BondGraph("high_pass")
    R, C = g.parameter("R", 100.0, "ohm"), g.parameter("C", 1e-6, "F")
    loop = g.one_junction("loop")
    g.effort_source("supply", g.input("u", "V"), at=loop)
    g.compliance("capacitor", 1 / C, at=loop)
    r = g.resistance("load", R, at=loop)
    g.measure_effort("u_load", r)
    transfer = transfer_function(derived(g), "u", "u_load")
    assert sympy.cancel(transfer - R * C * S / (R * C * S + 1)) == 0
    found = poles_zeros(transfer, {"R": 100.0, "C": 1e-6})
    np.testing.assert_allclose(found.poles, [-1e4])
    assert found.zeros.tolist() == [0.0] and found.gain == pytest.approx(1.0)


def frequency_response(model, row, column, s):
    n = len(model.A)
    return (model.C @ np.linalg.solve(s * np.eye(n) - model.A, model.B) + model.D)[row, column]


def test_random_linear_graphs_have_the_response_of_their_matrices():
    compared = 0
    for seed in range(600, 680):
        try:
            equations = derived(RandomGraph(seed, linear=True, mesh=0.1, sizes=(2, 4)).graph)
        except BondGraphError:
            continue
        if not 1 <= len(equations.states) <= 3 or any(i.name != "u_0" for i in equations.inputs):
            continue
        values = {parameter.symbol: parameter.value for parameter in equations.parameters}
        model = linearise(equations)
        for row, name in enumerate(model.states):
            seen = replace(model, C=np.eye(len(model.states)), D=np.zeros(model.B.shape))
            for transfer in (transfer_function(equations, "u_0", name), transfer_function(model, "u_0", name)):
                for s in (0.7j, 0.3 + 2j):
                    got = complex(transfer.subs({**values, S: s}).evalf())
                    assert got == pytest.approx(frequency_response(seen, row, 0, s), rel=1e-9, abs=1e-9)
                compared += transfer != 0
    assert compared >= 15


def test_a_mode_that_is_not_seen_or_not_driven_is_left_out():
    g = BondGraph("two")
    one, other = g.one_junction("one"), g.one_junction("other")
    force = g.input("F", "N")
    for name, junction in (("one", one), ("other", other)):
        g.effort_source(f"push_{name}", force, at=junction)
        g.inertance(f"mass_{name}", g.parameter(f"m_{name}", 2.0, "kg"), at=junction, state=f"v_{name}")
        g.resistance(f"drag_{name}", g.parameter(f"c_{name}", 1.0, "N s/m"), at=junction)
    g.measure("relative", one.flow - one.flow / 2, "m/s")
    assert (
        sympy.cancel(transfer_function(derived(g), "F", "relative") * 2 * (symbol("m_one") * S + symbol("c_one"))) == 1
    )
    g.measure("same", one.flow + other.flow, "m/s")
    assert len(poles_zeros(transfer_function(linearise(derived(g)), "F", "same")).poles) == 1  # equal modes merge
    symbolic = transfer_function(derived(g), "F", "same")
    assert sympy.degree(sympy.fraction(symbolic)[1], S) == 2


def test_equal_poles_and_zeros_cancel_in_symbols_too():
    g = BondGraph("twins")
    one, other = g.one_junction("one"), g.one_junction("other")
    force, m, c = g.input("F", "N"), g.parameter("m", 2.0, "kg"), g.parameter("c", 1.0, "N s/m")
    for name, junction in (("one", one), ("other", other)):
        g.effort_source(f"push_{name}", force, at=junction)
        g.inertance(f"mass_{name}", m, at=junction)
        g.resistance(f"drag_{name}", c, at=junction)
    g.measure("both", one.flow + 3 * other.flow, "m/s")
    assert transfer_function(derived(g), "F", "both") == 4 / (m * S + c)


def test_constants_of_assigned_symbols_are_written_out():
    equations = by_hand(
        assign("angle", 2 * A),
        assign("turn", sympy.cos(symbol("angle")) * B),
        derivatives=(U * symbol("turn") - X * sympy.cos(symbol("angle")), -Y),
    )
    transfer = transfer_function(equations, "u", "x_1")
    assert sympy.simplify(transfer - B * sympy.cos(2 * A) / (S + sympy.cos(2 * A))) == 0


def test_an_input_that_does_not_reach_the_output_gives_zero():
    g = oscillator()
    g.input("idle", "N")
    assert transfer_function(derived(g), "idle", "v") == 0
    assert transfer_function(linearise(derived(g)), "idle", "v") == 0
    found = poles_zeros(transfer_function(derived(g), "idle", "v"))
    assert found.poles.size == 0 and found.zeros.size == 0 and found.gain == 0


def slope_car(law=lambda c, v: c * v, **flags):
    g = BondGraph("car")
    g.parameter("w", 2.0, "1/s")
    F, c, alpha = g.input("F", "N"), g.parameter("c", 0.4, "kg/m"), g.parameter("alpha", 0.1, "rad")
    body = g.one_junction("body")
    g.effort_source("engine", F * sympy.cos(alpha) / sqrt(c), at=body)
    g.inertance("mass", 800.0, at=body, state="v")
    g.resistance("aero", lambda v: law(c, v), at=body)
    g.integral("distance", body.flow, "m")
    g.measure("heat", body.flow**2, "W") if flags.get("heat") else None
    return derived(g)


def test_constants_that_are_not_rational_stay_as_they_are():
    c, alpha = symbol("c"), symbol("alpha")
    transfer = transfer_function(slope_car(), "F", "distance")
    expected = sympy.cos(alpha) / sqrt(c) / (S * (800 * S + c))
    assert sympy.simplify(transfer - expected) == 0
    assert poles_zeros(transfer, {"c": 0.4, "alpha": 0.1}).poles[-1] == pytest.approx(-0.4 / 800)


def test_nonlinear_and_varying_graphs_are_refused_with_the_term():
    message = r"car: there is no transfer function from F to v: c\*v\*\*2 in e_aero is not linear in v - linearise"
    with pytest.raises(DerivationError, match=message):
        transfer_function(slope_car(lambda c, v: c * v**2), "F", "v")
    with pytest.raises(DerivationError, match=r"in e_aero is not linear in [tv]"):
        transfer_function(slope_car(lambda c, v: (1 + sin(symbol("w") * symbol("t"))) * v), "F", "v")
    with pytest.raises(DerivationError, match=r"z \(of the a loop\) has no closed form"):
        z = symbol("z")
        loop = ImplicitLoop("loop", (z,), (Integer(0),), (z**3 + z - X,), ("",), (), "a loop")
        transfer_function(by_hand(loop, derivatives=(U - z, -Y)), "u", "x_1")


def test_what_is_nonlinear_elsewhere_does_not_matter():
    equations = slope_car(heat=True)
    assert sympy.degree(sympy.fraction(transfer_function(equations, "F", "v"))[1], S) == 1
    with pytest.raises(DerivationError, match=r"v\*\*2 in heat is not linear in v"):
        transfer_function(equations, "F", "heat")


def test_a_nonlinear_graph_has_one_at_an_operating_point():
    equations = slope_car(lambda c, v: c * v**2)
    steady = equilibrium(equations, u={"F": 100.0}, guess={"v": 10.0}, moving=("distance",))
    transfer = transfer_function(linearise(equations, steady.x, [100.0]), "F", "v")
    assert poles_zeros(transfer).poles[0] == pytest.approx(-2 * 0.4 * steady.x[0] / 800)


def ladder(stages):
    g = BondGraph("ladder")
    before = g.effort_source("supply", g.input("u", "V"))
    for i in range(stages):
        series, node = g.one_junction(f"series{i}"), g.zero_junction(f"node{i}")
        g.bond(before, series)
        g.resistance(f"r{i}", g.parameter(f"R{i}", 2.0 + i / 7, "ohm"), at=series)
        g.bond(series, node)
        g.compliance(f"c{i}", 1 / g.parameter(f"C{i}", 0.5 + i / 9, "F"), at=node, state=f"q{i}")
        before = node
    return derived(g)


def test_sizes_have_their_limits():
    assert len(poles_zeros(transfer_function(linearise(ladder(30)), "u", "q29")).poles) == 30
    with pytest.raises(DerivationError, match="11 states lie between u and q10, at most 10 can be expanded in symbols"):
        transfer_function(ladder(11), "u", "q10")
    with pytest.raises(DerivationError, match=r"61 states lie .* at most 60 can be computed"):
        transfer_function(linearise(ladder(61)), "u", "q60")


def test_the_symbolic_ladder_has_the_poles_of_its_matrix():
    equations = ladder(4)
    values = {parameter.name: parameter.value for parameter in equations.parameters}
    found = poles_zeros(transfer_function(equations, "u", "q3"), values)
    expected = np.sort(np.linalg.eigvals(linearise(equations).A).real)
    np.testing.assert_allclose(np.sort(found.poles.real), expected, rtol=1e-12)
    assert found.zeros.size == 0


def test_unknown_names_are_suggested():
    equations = derived(oscillator())
    for model in (equations, linearise(equations)):
        with pytest.raises(DerivationError, match="no output or state 'sped'; did you mean 'speed'"):
            transfer_function(model, "F", "sped")
        with pytest.raises(DerivationError, match="no input 'G'"):
            transfer_function(model, "G", "speed")


def test_roots_are_found_to_rounding_where_coefficients_are_sensitive():
    wilkinson = sympy.prod(S - i for i in range(1, 21))
    found = poles_zeros(1 / sympy.expand(wilkinson))
    np.testing.assert_allclose(found.poles, np.arange(1, 21), rtol=1e-13)
    assert found.zeros.size == 0 and found.gain == 1.0


def test_multiple_and_widely_spread_roots():
    transfer = 5 * S**2 * (S + 3) ** 3 / ((S**2 + Rational(1, 5) * S + 1) ** 2 * (S + 10**7) * (S + Rational(1, 10**6)))
    found = poles_zeros(sympy.expand(sympy.fraction(transfer)[0]) / sympy.expand(sympy.fraction(transfer)[1]))
    np.testing.assert_allclose(found.zeros, [0, 0, -3, -3, -3], atol=1e-12)
    pair = -0.1 + 1j * np.sqrt(0.99)
    expected = [-1e-6, pair.conjugate(), pair.conjugate(), pair, pair, -1e7]
    np.testing.assert_allclose(found.poles, expected, rtol=1e-12)
    assert found.gain == 5.0


def test_a_parameter_without_a_value_is_named():
    with pytest.raises(DerivationError, match="parameter m has no value"):
        poles_zeros(1 / (symbol("m") * S + 1))
