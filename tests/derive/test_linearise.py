"""Values at a point, linear models, modes and equilibria against closed forms and differences."""

from __future__ import annotations

import numpy as np
import pytest
import sympy
from sympy import Integer, Piecewise, Rational, exp, sin, sqrt, tanh

from bondgraph.declare.functions import maximum, minimum, table_function
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Table, symbol
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import check_closed, derive
from bondgraph.derive.equations import ImplicitLoop
from bondgraph.derive.jacobian import jacobian
from bondgraph.derive.linearisation import (
    EquilibriumOutcome,
    LinearModel,
    Units,
    equilibrium,
    linearise,
    mode_table,
    modes,
)
from bondgraph.derive.transfer import transfer_function
from bondgraph.derive.values import Evaluator
from bondgraph.errors import BondGraphError, DerivationError
from tests.derive.compare import loaded
from tests.derive.linear_graphs import A, B, U, X, Y, assign, by_hand, derived, motor, oscillator
from tests.derive.random_graphs import RandomGraph

# ---------------------------------------------------------------------- values


def random_equations(seeds, **options):
    for seed in seeds:
        try:
            equations = derive(assign_causality(RandomGraph(seed, **options).graph), bonds=True)
            check_closed(equations)
        except BondGraphError:
            continue
        yield seed, equations


def test_values_equal_those_of_the_printed_module():
    compared = 0
    for seed, equations in random_equations(range(200, 214), linear=False, mesh=0.1):
        rng = np.random.default_rng(seed)
        x, u = rng.uniform(-0.7, 0.7, len(equations.states)), rng.uniform(-1, 1, len(equations.inputs))
        theta = [parameter.value for parameter in equations.parameters]
        module = loaded(equations)
        with np.errstate(all="ignore"):
            expected = module["output"](0.4, x, u, np.array(theta))
        if not np.isfinite(expected).all():
            continue
        evaluator = Evaluator(equations)
        values = evaluator.at(x, u, theta, 0.4)
        found = [evaluator.value(output.expression, values) for output in equations.outputs]
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)
        compared += 1
    assert compared >= 5


def test_every_function_and_table_has_the_value_of_the_printed_module():
    curve = Table("curve", (0.0, 1.0, 2.5, 4.0), (0.0, 2.0, 2.5, 1.0))
    line = Table("line", (0.0, 2.0), (1.0, 3.0))
    surface = Table("surface", (0.0, 1.0, 2.0), ((0.0, 1.0), (2.0, 5.0), (3.0, 4.0)), y=(0.0, 1.0))
    f, g = table_function("curve"), table_function("surface", 2)
    f1, g1, g2 = (
        table_function("curve", 1, (1,)),
        table_function("surface", 2, (1, 0)),
        table_function("surface", 2, (0, 1)),
    )
    outputs = [
        sin(X) + sympy.cos(Y) + sympy.tan(X) + sympy.asin(X / 9) + sympy.acos(Y / 9) + sympy.atan2(X, Y),
        sympy.sinh(X) * sympy.cosh(Y) * tanh(A) + exp(X) + sympy.log(5 + X) + sqrt(X**2 + 1) + (X**2 + 1) ** B,
        sympy.Abs(X) + sympy.sign(Y) + sympy.floor(3 * X) + minimum(X, Y) * maximum(X, A) + sympy.pi / 3 + X**-2,
        Piecewise((X, (X > Y) & (Y > 0)), (Y, sympy.Or(X < -1, sympy.Ne(Y, 0))), (A, True)),
        f(3 * X), f(X * 9), f1(3 * X), f1(-X), table_function("line")(X), g(X, Y), g(X + 1, Y), g1(2 * X, Y),
        g2(X, Y), g2(X, 3 * Y),
    ]  # fmt: skip
    equations = by_hand(derivatives=(X, Y), outputs=outputs, tables=(curve, line, surface))
    evaluator, module = Evaluator(equations), loaded(equations)
    for x in np.random.default_rng(3).uniform(-1.4, 1.4, (20, 2)):
        values = evaluator.at(x)
        found = [evaluator.value(output.expression, values) for output in equations.outputs]
        np.testing.assert_allclose(found, module["output"](0.0, x, [0.0], [1.5, 1.5]), rtol=1e-12, atol=1e-12)


def test_what_has_no_value_is_nan_or_inf_or_refused():
    equations = by_hand(derivatives=(sqrt(X), 1 / Y))
    evaluator = Evaluator(equations)
    values = evaluator.at([-1.0, 0.0])
    assert np.isnan(evaluator.value(equations.derivatives[0], values))
    assert np.isinf(evaluator.value(equations.derivatives[1], values))
    assert np.isnan(evaluator.value(Piecewise((A, X > 0)), values))
    with pytest.raises(DerivationError, match=r"by_hand: gamma\(x_1\) has no numeric value"):
        evaluator.value(sympy.gamma(X), values)


def test_points_are_given_by_name_or_in_order():
    evaluator = Evaluator(by_hand(assign("c", A * X + U), derivatives=(X, Y), initial=0.25))
    assert evaluator.at()[symbol("c")] == 1.5 * 0.25
    assert evaluator.at(x={"x_1": 2.0}, u=[1.0], theta={"a": 3.0})[symbol("c")] == 7.0
    assert evaluator.at(t=4.0)[symbol("t")] == 4.0
    with pytest.raises(DerivationError, match="by_hand: no state 'x_3'; did you mean 'x_2'"):
        evaluator.at(x={"x_3": 1.0})
    with pytest.raises(
        DerivationError, match="1 state values were given, the model has 2 - give one for each of x_1, x_2"
    ):
        evaluator.at(x=[1.0])


def loop_of(residuals, unknowns, guesses=None, body=()):
    guesses = guesses or (Integer(0),) * len(unknowns)
    loop = ImplicitLoop(
        "loop", tuple(unknowns), guesses, tuple(residuals), ("",) * len(unknowns), tuple(body), "a loop"
    )
    return Evaluator(by_hand(loop, derivatives=(X, Y)))


@pytest.mark.parametrize("steepness", [1.0, 1e3, 1e6])
def test_loops_with_saturating_laws_are_solved(steepness):
    z = symbol("z")
    values = loop_of([tanh(steepness * (z - 5)) + z / 1000 - X], [z]).at({"x_1": 0.3})
    assert abs(np.tanh(steepness * (values[z] - 5)) + values[z] / 1000 - 0.3) < 1e-9 * max(1.0, steepness * 1e-3)


def test_a_loop_of_two_unknowns_with_a_body_is_solved():
    z, w, s = symbol("z"), symbol("w"), symbol("s")
    values = loop_of([s + z - 2, w**3 + w - z - X], [z, w], body=[assign("s", z**3 * w)]).at({"x_1": 0.5})
    assert values[s] == pytest.approx(values[z] ** 3 * values[w])
    assert values[s] + values[z] == pytest.approx(2, rel=1e-12)
    assert values[w] ** 3 + values[w] == pytest.approx(values[z] + 0.5, rel=1e-12)


def test_loops_with_slopes_without_bounds_are_solved():
    z = symbol("z")
    assert loop_of([sqrt(z) - X], [z]).at({"x_1": 0.5})[z] == pytest.approx(0.25)
    assert loop_of([sqrt(z) - X], [z]).at({"x_1": 0.0})[z] == 0
    assert loop_of([sympy.log(z) - X], [z], (Integer(1),)).at({"x_1": 0.5})[z] == pytest.approx(np.exp(0.5))


def test_a_loop_without_a_solution_is_nan():
    z, w = symbol("z"), symbol("w")
    assert np.isnan(loop_of([z**2 + 1 + X**2], [z]).at()[z])
    assert np.isnan(loop_of([exp(z) + X**2], [z]).at([0.5, 0.0])[z])
    assert np.isnan(loop_of([z**2 + w**2 + 1, z - w], [z, w]).at()[w])


# ---------------------------------------------------------------------- linear models


def test_the_matrices_of_a_linear_graph_are_those_of_the_textbook():
    model = linearise(derived(motor()))
    np.testing.assert_array_equal(model.A, [[-1.0 / 0.01, -0.1 / 0.01], [0.1 / 0.02, -0.1 / 0.02]])
    np.testing.assert_array_equal(model.B, [[1 / 0.01], [0.0]])
    np.testing.assert_array_equal(model.C, [[0.0, 1.0]])
    np.testing.assert_array_equal(model.D, [[0.0]])
    assert (model.states, model.inputs, model.outputs) == (("i", "omega"), ("u_a",), ("speed",))
    assert model.units == Units(("A", "rad/s"), ("V",), ("rad/s",))


def test_a_nonlinear_output_is_linear_near_the_point():
    model = linearise(derived(oscillator()), x={"v": 3.0, "q": 0.1}, u={"F": 7.0})
    np.testing.assert_allclose(model.C, [[7.0, 0.0], [1.0, 0.0]])
    np.testing.assert_allclose(model.D, [[3.0], [0.0]])
    np.testing.assert_allclose(model.rates, [(7 - 8 * 0.1 - 0.5 * 3) / 2, 3.0])
    np.testing.assert_allclose(model.values, [21.0, 3.0])
    np.testing.assert_allclose(model.x, [3.0, 0.1])
    np.testing.assert_allclose(model.u, [7.0])


def test_random_nonlinear_graphs_are_linear_in_small_steps():
    compared = 0
    for seed, equations in random_equations(range(400, 412), linear=False, mesh=0.0):
        if not equations.states:
            continue
        rng = np.random.default_rng(seed)
        x, u = rng.uniform(-0.6, 0.6, len(equations.states)), rng.uniform(-1, 1, len(equations.inputs))
        try:
            model = linearise(equations, x, u)
        except DerivationError:
            continue
        dx, du = 1e-6 * rng.standard_normal(x.shape), 1e-6 * rng.standard_normal(u.shape)
        ends = [linearise(equations, x + sign * dx, u + sign * du) for sign in (1, -1)]
        rates, values = (getattr(ends[0], name) - getattr(ends[1], name) for name in ("rates", "values"))
        scale = 1e-11 * max(1.0, np.abs(model.A).max(), np.abs(model.C).max(initial=0.0))
        np.testing.assert_allclose(2 * (model.A @ dx + model.B @ du), rates, rtol=1e-5, atol=scale)
        np.testing.assert_allclose(2 * (model.C @ dx + model.D @ du), values, rtol=1e-5, atol=scale)
        compared += 1
    assert compared >= 4


def test_one_jacobian_serves_many_points():
    equations = derived(oscillator())
    slopes = jacobian(equations, by=("x", "u"))
    for v in (1.0, 2.0):
        model = linearise(equations, x={"v": v}, slopes=slopes)
        np.testing.assert_array_equal(model.D, linearise(equations, x={"v": v}).D)


def test_graphs_without_inputs_outputs_or_states():
    g = BondGraph("still")
    body = g.one_junction("body")
    g.inertance("mass", 2.0, at=body)
    model = linearise(derived(g))
    assert (model.A.shape, model.B.shape, model.C.shape, model.D.shape) == ((1, 1), (1, 0), (0, 1), (0, 0))
    g = BondGraph("divider")
    loop = g.one_junction("loop")
    g.effort_source("supply", g.input("u", "V"), at=loop)
    g.resistance("r", 4.0, at=loop)
    g.measure_flow("current", loop)
    model = linearise(derived(g))
    assert model.A.shape == (0, 0) and model.D.tolist() == [[0.25]] and modes(model) == ()
    assert equilibrium(derived(g)).outcome is EquilibriumOutcome.FOUND
    assert transfer_function(derived(g), "u", "current") == Rational(1, 4)


def test_a_point_without_a_linear_model_is_refused_by_name():
    equations = by_hand(assign("root", sqrt(X)), derivatives=(symbol("root"), Y))
    with pytest.raises(DerivationError, match="by_hand: root is nan at this operating point"):
        linearise(equations, [-1.0, 0.0])
    with pytest.raises(DerivationError, match="by_hand: d_root__x_1 is inf"):
        linearise(equations, [0.0, 0.0])


# ---------------------------------------------------------------------- modes


def linear_model(matrix, states=None):
    n = len(matrix)
    none = np.zeros((0, 0))
    names = tuple(states or (f"x_{i}" for i in range(n)))
    return LinearModel(
        np.array(matrix, dtype=float), none, none, none, names, (), (), Units((), (), ()), *[np.zeros(n)] * 4
    )


def test_modes_of_an_oscillator():
    (mode,) = modes(linearise(derived(oscillator())))
    assert mode.natural_frequency == pytest.approx(2.0)
    assert mode.damping == pytest.approx(0.5 / (2 * np.sqrt(2.0 * 8.0)))
    assert mode.time_constant == pytest.approx(2 * 2.0 / 0.5)


def test_modes_of_a_uniform_chain_are_known():
    stages, m, k = 12, 0.7, 50.0
    g = BondGraph("chain")
    before = g.flow_source("wall", 0)
    for i in range(stages):
        joint, body = g.zero_junction(f"joint{i}"), g.one_junction(f"body{i}")
        g.bond(before, joint)
        g.compliance(f"spring{i}", k, at=joint)
        g.bond(joint, body)
        g.inertance(f"mass{i}", m, at=body)
        before = body
    found = [mode.natural_frequency for mode in modes(linearise(derived(g)))]
    order = np.arange(1, stages + 1)
    expected = 2 * np.sqrt(k / m) * np.sin((2 * order - 1) * np.pi / (2 * (2 * stages + 1)))
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_modes_that_stay_grow_or_decay():
    found = modes(linear_model([[0.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, -0.5]], ("angle", "runaway", "slow")))
    assert [mode.state for mode in found] == ["angle", "slow", "runaway"]
    assert [mode.time_constant for mode in found] == [np.inf, 2.0, -0.25]
    assert np.isnan(found[0].damping) and [mode.damping for mode in found[1:]] == [1.0, -1.0]


def test_the_state_of_a_mode_does_not_depend_on_units():
    matrix = np.array([[-1.0, 0.2], [0.1, -30.0]])
    for scale in (1e-6, 1.0, 1e6):
        change = np.diag([1.0, scale])
        found = modes(linear_model(change @ matrix @ np.linalg.inv(change), ("slow", "fast")))
        assert [mode.state for mode in found] == ["slow", "fast"]


def test_the_table_has_one_row_per_mode():
    lines = mode_table(modes(linearise(derived(motor())))).splitlines()
    assert len(lines) == 3
    assert lines[0].split("  ")[0] == "eigenvalue [1/s]"
    assert lines[1].endswith("omega") and lines[2].endswith("  i")


# ---------------------------------------------------------------------- equilibria


def test_an_equilibrium_is_where_the_rates_vanish():
    steady = equilibrium(derived(motor()), u={"u_a": 12.0})
    assert steady.outcome is EquilibriumOutcome.FOUND and steady.found
    np.testing.assert_allclose(steady.x, [12 * 0.1 / (0.1 + 0.01), 12 * 0.1 / (0.1 + 0.01)], rtol=1e-12)
    assert np.abs(steady.rates).max() < 1e-9


def double_well():
    g = BondGraph("well")
    body = g.one_junction("body")
    g.effort_source("push", g.input("F", "N"), at=body)
    g.inertance("mass", 1.0, at=body, state="v")
    g.compliance("snap", lambda q: q**3 - q, at=body, state="q")
    g.resistance("damper", 0.1, at=body)
    return derived(g)


@pytest.mark.parametrize(("guess", "expected"), [(0.8, 1.0), (-0.7, -1.0), (0.1, 0.0), (30.0, 1.0)])
def test_the_guess_chooses_between_equilibria(guess, expected):
    steady = equilibrium(double_well(), guess={"q": guess})
    assert steady.outcome is EquilibriumOutcome.FOUND
    np.testing.assert_allclose(steady.x, [0.0, expected], atol=1e-12)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_equilibria_do_not_depend_on_units(scale):
    g = BondGraph("scaled")
    body = g.one_junction("body")
    g.effort_source("weight", 9.81 * scale, at=body)
    g.inertance("mass", scale, at=body, state="v")
    g.compliance("spring", lambda q: 1e4 * scale * q + 1e9 * scale * q**3, at=body, state="q")
    steady = equilibrium(derived(g), guess={"v": 2.0})
    assert steady.outcome is EquilibriumOutcome.FOUND
    assert 1e4 * steady.x[1] + 1e9 * steady.x[1] ** 3 == pytest.approx(9.81, rel=1e-12)
    assert abs(steady.x[0]) < 1e-9


def test_a_free_position_makes_a_family():
    g = BondGraph("car")
    body = g.one_junction("body")
    g.effort_source("push", g.input("F", "N"), at=body)
    g.inertance("mass", 900.0, at=body, state="v")
    g.resistance("drag", lambda v: 0.5 * v * sympy.Abs(v), at=body)
    g.integral("distance", body.flow, "m")
    parked = equilibrium(derived(g), guess={"v": 3.0, "distance": 70.0})
    assert (parked.outcome, parked.free) == (EquilibriumOutcome.FAMILY, ("distance",))
    assert parked.found and abs(parked.x[0]) < 1e-3
    driving = equilibrium(derived(g), u={"F": 50.0}, guess={"v": 3.0, "distance": 70.0})
    assert driving.outcome is EquilibriumOutcome.NONE and not driving.found
    steady = equilibrium(derived(g), u={"F": 50.0}, guess={"v": 3.0, "distance": 70.0}, moving=("distance",))
    assert steady.outcome is EquilibriumOutcome.FOUND
    np.testing.assert_allclose(steady.x, [10.0, 70.0], rtol=1e-12)
    np.testing.assert_allclose(steady.rates, [0.0, 10.0], atol=1e-12)
    with pytest.raises(DerivationError, match="no state 'distanc'; did you mean 'distance'"):
        equilibrium(derived(g), moving=("distanc",))


def test_where_there_is_none_none_is_claimed():
    pushed = BondGraph("pushed")
    body = pushed.one_junction("body")
    pushed.effort_source("push", pushed.input("F", "N"), at=body)
    pushed.inertance("mass", 2.0, at=body)
    assert equilibrium(derived(pushed), u=[3.0]).outcome is EquilibriumOutcome.NONE
    assert equilibrium(derived(pushed), u=[0.0]).outcome is EquilibriumOutcome.FAMILY
    for rate in (exp(-X), X**2 + 1, exp(-X) + X**2 / 10 + 1):
        assert equilibrium(by_hand(derivatives=(rate, -Y)), guess=[0.5, 1.0]).outcome is EquilibriumOutcome.NONE


def test_a_search_that_starts_outside_a_law_says_so():
    outside = equilibrium(by_hand(derivatives=(sqrt(X) - 2, -Y)), guess=[-1.0, 1.0])
    assert outside.outcome is EquilibriumOutcome.NON_FINITE
    inside = equilibrium(by_hand(derivatives=(sqrt(X) - 2, -Y)), guess=[1.0, 1.0])
    np.testing.assert_allclose(inside.x, [4.0, 0.0], atol=1e-12)


def test_forces_that_balance_at_the_start_are_an_equilibrium():
    equations = by_hand(derivatives=(0.1 * A + 0.2 * A - 0.3 * B - X, -Y))
    assert equilibrium(equations).outcome is EquilibriumOutcome.FOUND
