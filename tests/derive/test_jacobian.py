"""Jacobians: equal to central differences and to sympy on expanded equations, sparse, closed and homogeneous."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy import Abs, Integer, Piecewise, cos, exp, sin, sqrt, tanh

from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.functions import maximum, minimum, table_function
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Input, Parameter, Table, symbol
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import check_closed, derive
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.derive.equations import Assignment, ImplicitLoop, OutputEquation, State, StateEquations
from bondgraph.derive.jacobian import gradient, jacobian
from bondgraph.derive.values import Evaluator
from bondgraph.errors import BondGraphError, DerivationError
from tests.derive.compare import loaded
from tests.derive.random_graphs import RandomGraph

KINDS = ("x", "u", "theta", "t")
X, Y, Z, A, B = (symbol(name) for name in ("x_1", "x_2", "x_3", "a", "b"))


def equations_of(*assignments, derivatives=(), outputs=(), states=(X, Y), parameters=(A, B), tables=()):
    """Equations written down by hand."""
    return StateEquations(
        "by_hand", "", "", tuple(State(s, "", 0.3, "", "", "flow") for s in states), (Input("u", ""),),
        tuple(Parameter(p.name, 1.5, "") for p in parameters), tuple(tables), tuple(assignments), tuple(derivatives),
        tuple(OutputEquation(symbol(f"y_{i}"), value, "", "") for i, value in enumerate(outputs)),
    )  # fmt: skip


def assign(name, expression):
    return Assignment(symbol(name), expression, "", "")


def point_of(equations, seed):
    """Random values in the order t, x, u, theta, near 1 for parameters."""
    rng = np.random.default_rng(seed)
    sizes = (1, len(equations.states), len(equations.inputs), len(equations.parameters))
    t, x, u = (rng.uniform(-0.8, 0.8, size) for size in sizes[:3])
    theta = np.array([p.value for p in equations.parameters]) * rng.uniform(0.8, 1.25, sizes[3])
    return {"x": x, "u": u, "theta": theta, "t": t}


def values_at(equations, point):
    evaluator = Evaluator(equations)
    values = evaluator.at(point["x"], point["u"], point["theta"], point["t"][0])
    rows = (*equations.derivatives, *(output.expression for output in equations.outputs))
    return np.array([evaluator.value(row, values) for row in rows])


def exact(equations, point):
    """The Jacobian of derivatives and outputs by x, u, theta and t at a point."""
    found = jacobian(equations, by=KINDS)
    evaluator = Evaluator(equations)
    values = evaluator.run(found.assignments, evaluator.at(point["x"], point["u"], point["theta"], point["t"][0]))
    blocks = []
    for of in ("derivatives", "outputs"):
        parts = []
        for by in KINDS:
            block = found.block(of, by)
            matrix = np.zeros(block.shape)
            for entry in block.entries:
                matrix[entry.row, entry.column] = evaluator.value(entry.value, values)
            parts.append(matrix)
        blocks.append(np.hstack(parts))
    return np.vstack(blocks)


def differences(equations, point, step=1e-5):
    columns = []
    for by in KINDS:
        for i in range(point[by].size):
            ends = []
            for sign in (1, -1):
                moved = {key: value.copy() for key, value in point.items()}
                moved[by][i] += sign * step
                ends.append(values_at(equations, moved))
            columns.append((ends[0] - ends[1]) / (2 * step))
    return np.array(columns).T


def check(equations, seed=0, tolerance=1e-6):
    point = point_of(equations, seed)
    expected = differences(equations, point)
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(exact(equations, point), expected, atol=tolerance * max(1.0, np.abs(expected).max()))


def random_equations(seeds, **options):
    """Those of the random graphs that derive, with the effort and flow of every bond as outputs."""
    for seed in seeds:
        try:
            equations = derive(assign_causality(RandomGraph(seed, **options).graph), bonds=True)
            check_closed(equations)
        except BondGraphError:
            continue
        if equations.states:
            yield seed, equations


# ---------------------------------------------------------------------- whole graphs


@pytest.mark.parametrize("linear", [True, False])
def test_random_graphs_agree_with_central_differences(linear):
    compared = 0
    for seed, equations in random_equations(range(100, 124), linear=linear, mesh=0.1):
        if np.isfinite(differences(equations, point_of(equations, seed))).all():
            check(equations, seed)
            compared += 1
    assert compared >= 8


def test_partials_are_printed_and_mean_the_same_in_a_generated_module():
    compared = 0
    for seed, equations in random_equations(range(900, 912), linear=False, mesh=0.1):
        found = jacobian(equations)
        entries = [entry.value for block in found.blocks for entry in block.entries]
        rows = tuple(OutputEquation(symbol(f"entry_{i}"), value, "", "") for i, value in enumerate(entries))
        module = loaded(replace(equations, assignments=equations.assignments + found.assignments, outputs=rows))
        point = point_of(equations, seed)
        evaluator = Evaluator(equations)
        values = evaluator.run(found.assignments, evaluator.at(point["x"], point["u"], point["theta"], point["t"][0]))
        with np.errstate(all="ignore"):
            printed = module["output"](point["t"][0], point["x"], point["u"], point["theta"])
        np.testing.assert_allclose(printed, [evaluator.value(entry, values) for entry in entries], rtol=1e-6, atol=1e-8)
        compared += len(entries)
    assert compared >= 200


def expanded(equations):
    known = {}
    for step in equations.assignments:
        assert isinstance(step, Assignment)
        known[step.symbol] = step.expression.xreplace(known)
    return known


def test_small_graphs_agree_with_sympy_on_the_expanded_equations():
    compared = 0
    for _, equations in random_equations(range(300, 320), linear=False, mesh=0.0, sizes=(2, 4)):
        if any(isinstance(step, ImplicitLoop) for step in equations.assignments):
            continue
        full = expanded(equations)
        found = jacobian(equations)
        partials = dict(full)
        for step in found.assignments:
            partials[step.symbol] = step.expression.xreplace(partials)
        for block in found.blocks:
            rows = equations.derivatives if block.of == "derivatives" else [o.expression for o in equations.outputs]
            entries = {(entry.row, entry.column): entry.value.xreplace(partials) for entry in block.entries}
            for i, row in enumerate(rows):
                for j, column in enumerate(block.columns):
                    expected = row.xreplace(full).diff(column)
                    got = entries.get((i, j), Integer(0))
                    point = {
                        used: sympy.Rational(7 + 3 * k, 11)
                        for k, used in enumerate(sorted(expected.free_symbols | got.free_symbols, key=str))
                    }
                    assert abs((expected - got).xreplace(point).evalf(30)) < 1e-25
                    compared += 1
    assert compared >= 200


def driveline():
    """Engine, slipping belt, elastic shaft and car: tables, kinks, a modulated transformer and units."""
    g = BondGraph("driveline")
    throttle, grade = g.input("throttle", "1"), g.input("grade", "1")
    J, m, k = g.parameter("J", 0.02, "kg m^2"), g.parameter("m", 260.0, "kg"), g.parameter("k", 900.0, "N m/rad")
    c, grip, slip = g.parameter("c", 0.6, "kg/m"), g.parameter("grip", 95.0, "N m"), g.parameter("slip", 4.0, "rad/s")
    radius, gain = g.parameter("radius", 0.28, "m"), g.parameter("gain", 0.01, "s/rad")
    slow, gravity = g.parameter("slow", 9.0, "m/s"), g.parameter("gravity", 9.81, "m/s^2")
    torque = g.table("torque", [0.0, 150.0, 300.0, 400.0], [18.0, 25.0, 21.0, 5.0], "N m", "rad/s")
    primary, belt = g.one_junction("primary", ROTATION), g.zero_junction("belt", ROTATION)
    shaft, body = g.zero_junction("shaft", ROTATION), g.one_junction("body", TRANSLATION)
    engine = g.inertance("engine", J, at=primary, state="omega", initial=220.0)
    g.effort_source("combustion", throttle * torque(engine.flow), at=primary)
    g.modulated_transformer("variator", 1 / (1 + gain * engine.flow / 4), primary, belt)
    g.resistance("belt_slip", lambda w: grip * tanh(w / slip), at=belt)
    output = g.one_junction("output", ROTATION)
    g.bond(belt, output)
    g.inertance("secondary", J, at=output)
    g.bond(output, shaft)
    g.compliance("shaft_spring", k, at=shaft)
    g.transformer("wheel", radius, shaft, body)
    car = g.inertance("car", m, at=body, state="v", initial=4.0)
    g.resistance("aero", lambda v: c * v * Abs(v), at=body)
    g.effort_source("hill", -m * gravity * grade * minimum(1, maximum(0, car.flow / slow)), at=body)
    g.measure_effort("tau_belt", "belt")
    g.measure_flow("speed", "body")
    return derive(assign_causality(g))


def test_the_driveline_agrees_with_central_differences():
    equations = driveline()
    point = {
        "x": np.array([state.initial for state in equations.states]) + np.array([0.0, 3.0, 0.02, 0.0]),
        "u": np.array([0.7, 0.05]), "theta": np.array([p.value for p in equations.parameters]), "t": np.zeros(1),
    }  # fmt: skip
    np.testing.assert_allclose(exact(equations, point), differences(equations, point), rtol=1e-6, atol=1e-5)


def test_partials_are_closed_and_homogeneous():
    equations = driveline()
    found = jacobian(equations)
    unknown = [str(assignment.symbol) for assignment in found.assignments if not assignment.unit]
    assert len(unknown) < len(found.assignments) / 2
    assert all("m_variator" in name or name.startswith("part_") for name in unknown)  # a modulus has no declared unit
    units = {parameter.name: parameter.unit for parameter in equations.parameters}
    rows = []
    block = found.block("outputs", "theta")
    for entry in block.entries:
        unit = f"({equations.outputs[entry.row].unit})/({units[block.columns[entry.column].name]})"
        rows.append(OutputEquation(symbol(f"y_{entry.row}_{entry.column}"), entry.value, unit, ""))
    extended = replace(equations, assignments=equations.assignments + found.assignments, outputs=tuple(rows))
    check_closed(extended)
    check_dimensions(extended)


def chain(stages):
    g = BondGraph("chain")
    before = None
    for i in range(stages):
        m, k, c = (g.parameter(f"{letter}_{i}", 1.0 + i, "") for letter in "mkc")
        body = g.one_junction(f"body_{i}")
        g.inertance(f"mass_{i}", m, at=body)
        joint, between = g.zero_junction(f"joint_{i}"), g.one_junction(f"between_{i}")
        g.bond(body, joint)
        g.bond(joint, between)
        g.compliance(f"spring_{i}", k, at=between)
        g.resistance(f"damper_{i}", lambda v, c=c: c * v**3, at=between)
        if before is not None:
            g.bond(before, body)
        before = joint
    g.flow_source("wall", 0, at=before)
    return derive(assign_causality(g))


def test_effort_and_entries_grow_with_the_number_of_nonzeros_only():
    sizes = []
    for stages in (5, 10, 15):
        equations = chain(stages)
        found = jacobian(equations)
        entries = sum(len(block.entries) for block in found.blocks)
        operations = sum(int(sympy.count_ops(a.expression)) for a in found.assignments)
        sizes.append((len(found.assignments), entries, operations))
    assert [b - a for a, b in zip(sizes[0], sizes[1], strict=True)] == [
        b - a for a, b in zip(sizes[1], sizes[2], strict=True)
    ]
    # a mass sees 3 speeds and 2 springs, a spring 2 speeds, less at the ends
    entries = jacobian(chain(10), by=("x",)).block("derivatives", "x").entries
    assert len(entries) == (10 * 3 - 2) + (10 * 2 - 1) + (10 * 2 - 1)


# ---------------------------------------------------------------------- expressions

SMOOTH = (sin, cos, tanh, exp, lambda e: sqrt(1 + e**2), lambda e: sympy.log(2 + e**2), sympy.atan, lambda e: e**3)
KINKED = (
    Abs, lambda e: maximum(e, A), lambda e: minimum(e * B, 1 - e), sympy.sign, sympy.floor,
    lambda e: Piecewise((e**2, e > B), (A * e, e > -1), (sin(e), True)),
)  # fmt: skip


def expressions(functions):
    leaves = st.sampled_from([X, Y, A, B, Integer(2), sympy.Rational(1, 3)])
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.tuples(inner, inner).map(lambda pair: pair[0] + pair[1]),
            st.tuples(inner, inner).map(lambda pair: pair[0] * pair[1]),
            st.tuples(inner, inner).map(lambda pair: pair[0] / (2 + pair[1] ** 2)),
            st.tuples(inner, st.sampled_from(functions)).map(lambda pair: pair[1](pair[0])),
        ),
        max_leaves=8,
    )


@settings(max_examples=60, deadline=None, derandomize=True)
@given(expressions(SMOOTH))
def test_gradient_equals_sympys_derivative(expression):
    found = gradient(expression, {X, Y})
    assert found.keys() <= {X, Y} & expression.free_symbols
    point = {X: 0.37, Y: -0.61, A: 1.2, B: 0.45}
    for used in (X, Y):
        expected = float(expression.diff(used).evalf(subs=point))
        assert float(found.get(used, Integer(0)).evalf(subs=point)) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(expressions(KINKED))
def test_gradient_of_kinks_is_the_slope_beside_them(expression):
    equations = equations_of(derivatives=(expression, Integer(0)))
    point = {"x": np.array([0.3713, -0.6171]), "u": np.zeros(1), "theta": np.array([1.2345, 0.4567]), "t": np.zeros(1)}
    wide, narrow = (differences(equations, point, step) for step in (2e-6, 1e-6))
    if np.allclose(wide, narrow, rtol=1e-4, atol=1e-4):  # no kink or step between
        np.testing.assert_allclose(exact(equations, point), narrow, rtol=1e-4, atol=1e-4)


def test_a_constant_or_inactive_expression_has_no_gradient():
    assert gradient(A * sin(B) + 2, {X}) == {}
    assert gradient(X - X + A, {X}) == {}
    assert gradient(sympy.floor(X) + sympy.sign(X), {X}) == {}
    assert gradient(Piecewise((A, X > 0), (B, True)), {X}) == {}


def test_extrema_of_sympy_and_symbolic_exponents_have_slopes():
    assert gradient(sympy.Max(X, 2 * Y, 0), {X})[X].xreplace({X: Integer(3), Y: Integer(1)}) == 1
    assert gradient(A**X, {X, A}) == {X: A**X * sympy.log(A), A: X * A ** (X - 1)}


def test_tables_have_the_slope_of_their_interpolant():
    curve = Table("curve", (0.0, 1.0, 2.0, 4.0), (0.0, 2.0, 2.5, 1.0))
    surface = Table("surface", (0.0, 1.0, 2.0), ((0.0, 1.0), (2.0, 5.0), (3.0, 4.0)), y=(0.0, 1.0))
    f, h = table_function("curve"), table_function("surface", 2)
    assert gradient(f(A * X), {X}) == {X: A * table_function("curve", 1, (1,))(A * X)}
    equations = equations_of(
        assign("g", f(2 * X + 1) * h(X + 1, Y / 2 + B / 3)), derivatives=(symbol("g"), f(X - 9) + h(X, Y + 9)),
        tables=(curve, surface),
    )  # fmt: skip
    for seed in range(5):
        check(equations, seed)


# ---------------------------------------------------------------------- loops


def looped(unknowns, residuals, body=(), **rest):
    loop = ImplicitLoop(
        "belt", unknowns, (Integer(0),) * len(unknowns), residuals, ("",) * len(unknowns), body, "a loop"
    )
    return equations_of(assign("c", A * X + symbol("u")), loop, **rest)


def test_loops_follow_the_implicit_function_theorem():
    z, c = symbol("z"), symbol("c")
    one = looped((z,), (z + B * z**3 - c * Y,), derivatives=(z, z * X), outputs=(sin(z),))
    local = symbol("local")
    bodied = looped(
        (z,), (z + local - c,), (Assignment(local, B * tanh(z * Y + A), "", ""),), derivatives=(z, X), outputs=(z**2,)
    )
    for equations in (one, bodied):
        for seed in range(4):
            check(equations, seed)


def test_the_derivative_of_a_loop_is_exact():
    z = symbol("z")
    equations = looped((z,), (z**3 + z - symbol("c"),), derivatives=(z, Integer(0)))
    found = jacobian(equations, by=("x",))
    value = found.block("derivatives", "x").entries[0].value
    for step in reversed(found.assignments):
        value = value.xreplace({step.symbol: step.expression})
    assert sympy.simplify(value - A / (3 * z**2 + 1)) == 0


@pytest.mark.parametrize("size", [2, 3, 4, 5])
def test_loops_of_several_unknowns(size):
    z = [symbol(f"z_{i}") for i in range(size)]
    c = symbol("c")
    residuals = tuple(
        3 * z[i] + z[i] ** 3 - B * z[(i + 1) % size] * Y - c * (i + 1) + sin(z[i - 1]) / 2 for i in range(size)
    )
    check(looped(tuple(z), residuals, derivatives=(sum(z), z[0] * z[-1])), seed=size)


@pytest.mark.parametrize("size", [2, 3])
def test_a_loop_whose_pivot_vanishes_has_finite_derivatives(size):
    """Held laws have slope zero where the matrix as a whole is regular."""
    z = [symbol(f"z_{i}") for i in range(size)]
    residuals = tuple(maximum(z[i] - 50, 0) + z[(i + 1) % size] - symbol("c") * (i + 1) for i in range(size))
    check(looped(tuple(z), residuals, derivatives=(z[0], z[1])))


def test_a_loop_that_determines_nothing_is_refused():
    z, w = symbol("z"), symbol("w")
    with pytest.raises(DerivationError, match=r"by_hand: a loop does not determine .*residuals depend on each other"):
        jacobian(looped((z, w), (z + w - X, z + w - Y), derivatives=(z, w)))


def test_what_does_not_depend_on_the_variables_has_no_partials():
    z = symbol("z")
    equations = looped((z,), (z**3 + z - A,), derivatives=(z * X, Integer(1)))
    assert jacobian(equations, by=("x",)).assignments == ()
    assert [e.value for e in jacobian(equations, by=("x",)).block("derivatives", "x").entries] == [z]


# ---------------------------------------------------------------------- choices, names, text


def test_columns_rows_and_parameters_can_be_chosen():
    equations = driveline()
    found = jacobian(equations, by=("theta",), of=("outputs",), parameters=("grip", "J"))
    (block,) = found.blocks
    assert [str(column) for column in block.columns] == ["grip", "J"]
    assert block.shape == (2, 2)
    assert {(entry.row, entry.column) for entry in block.entries} == {(0, 0)}
    with pytest.raises(DerivationError, match="the Jacobian of outputs by x was not computed, only outputs by theta"):
        found.block("outputs", "x")
    with pytest.raises(DerivationError, match="no parameter 'grib'; did you mean 'grip'"):
        jacobian(equations, parameters=("grib",))


def test_rows_and_columns_have_the_names_of_what_they_stand_for():
    equations = driveline()
    block = jacobian(equations).block("derivatives", "u")
    assert [str(row) for row in block.rows] == [state.symbol.name for state in equations.states]
    assert [str(column) for column in block.columns] == ["throttle", "grade"]
    assert block.shape == (4, 2)


def test_partials_give_way_to_declared_names():
    equations = equations_of(
        assign("F", A * X**2), derivatives=(symbol("F") * B, symbol("F") * symbol("d_F__x_1")),
        parameters=(A, B, symbol("d_F__x_1"), symbol("d_F__x_1_")),
    )  # fmt: skip
    names = [str(a.symbol) for a in jacobian(equations, by=("x",)).assignments]
    assert names == ["d_F__x_1__"]
    check(equations)


def test_the_result_is_frozen_and_the_same_under_every_hash_seed():
    program = (
        "from tests.derive.test_jacobian import chain, driveline\n"
        "from bondgraph.derive.jacobian import jacobian\n"
        "for equations in (driveline(), chain(4)):\n"
        "    found = jacobian(equations)\n"
        "    print(found.assignments, found.blocks)\n"
    )
    expected = "".join(f"{found.assignments} {found.blocks}\n" for found in map(jacobian, (driveline(), chain(4))))
    environment = {**os.environ, "PYTHONHASHSEED": "4711", "PYTHONPATH": os.getcwd()}
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True)
    assert run.stdout == expected
    with pytest.raises(AttributeError):
        jacobian(chain(2)).assignments = ()
