"""Programs read from generated modules mean what the modules mean, and their derivatives are exact."""

from __future__ import annotations

import ast

import numpy as np
import pytest

from bondgraph.compile.front.parse import Reader
from bondgraph.compile.ir.tape import Tape
from bondgraph.compile.passes.hoist import Hoister
from bondgraph.compile.passes.tangent import tangents
from bondgraph.errors import ModelError
from bondgraph.generate.module import render
from bondgraph.simulate.model import Model
from tests.derive.test_jacobian import exact, random_equations
from tests.generate.conftest import belt_drive
from tests.simulate.points import ALL, model_of, points_of

EQUATIONS = pytest.mark.parametrize("equations", ["rhs", "output"])
MEMBERS = 6


def leaves_of(point: tuple) -> dict:
    t, x, u, theta = point
    return {"t": (t,), "x": x, "u": u, "theta": theta}


@EQUATIONS
@pytest.mark.parametrize("name", ALL)
def test_a_program_gives_what_the_module_gives(name: str, equations: str) -> None:
    model, point = model_of(name), points_of(name, MEMBERS)
    program = model.program.tape.program(model.program.rows[equations])
    values = model.program.evaluate(program, leaves_of(point), (MEMBERS,))
    np.testing.assert_allclose(values, getattr(model, equations)(*point), rtol=1e-11, atol=1e-12)


@EQUATIONS
@pytest.mark.parametrize("by", ["x", "u", "theta"])
@pytest.mark.parametrize("name", ALL)
def test_jacobians_equal_central_differences(name: str, by: str, equations: str) -> None:
    model, point = model_of(name), points_of(name, MEMBERS, seed=3)
    jacobian = getattr(model, f"jacobian_{by}")(*point, of=equations)
    position = {"x": 1, "u": 2, "theta": 3}[by]
    pattern = model.program.jacobian(equations, by).pattern
    assert jacobian.shape[:2] == pattern.shape
    for column in range(pattern.shape[1]):
        step = 1e-6 * np.maximum(np.abs(point[position][column]), 1e-3)
        ends = []
        for sign in (1.0, -1.0):
            moved = [np.array(part) for part in point]
            moved[position][column] += sign * step
            ends.append(getattr(model, equations)(*moved))
        expected = (ends[0] - ends[1]) / (2.0 * step)
        size = (np.abs(ends[0]).max(axis=1, keepdims=True) + 1.0) * 1e-9 / step + np.abs(expected)
        assert np.all(np.abs(jacobian[:, column] - expected) <= 1e-6 * np.abs(expected) + 1e-6 * size)
        assert not jacobian[~pattern[:, column], column].any()


@pytest.mark.parametrize("linear", [True, False])
def test_jacobians_equal_the_symbolic_ones_on_random_graphs(linear: bool) -> None:
    compared = 0
    for seed, equations in random_equations(range(100, 112), linear=linear, mesh=0.1):
        model = Model.from_text(render(equations))
        rng = np.random.default_rng(seed)
        sizes = {"x": len(model.states), "u": len(model.inputs)}
        x, u = (rng.uniform(-0.8, 0.8, size) for size in sizes.values())
        theta = model.theta() * rng.uniform(0.8, 1.25, len(model.parameters))
        expected = exact(equations, {"x": x, "u": u, "theta": theta, "t": np.array([0.4])})[:, :-1]
        if not np.isfinite(expected).all():
            continue
        found = np.vstack(
            [
                np.hstack([model.program.dense_jacobian(of, by, 0.4, x, u, theta) for by in ("x", "u", "theta")])
                for of in ("rhs", "output")
            ]
        )
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(expected).max()))
        compared += 1
    assert compared >= 5


def test_tables_and_loops_of_a_machine_equal_the_symbolic_derivatives() -> None:
    """A table of one and of two arguments and a loop solved by Newton's method."""
    equations = belt_drive()
    model = Model.from_text(render(equations))
    rng = np.random.default_rng(5)
    for _ in range(10):
        x = np.array([rng.uniform(60.0, 380.0), rng.uniform(0.0, 30.0)])
        u, theta = (
            rng.uniform(1.0, 9.0, len(model.inputs)),
            model.theta() * rng.uniform(0.8, 1.2, len(model.parameters)),
        )
        expected = exact(equations, {"x": x, "u": u, "theta": theta, "t": np.array([0.4])})[:, :-1]
        rows = len(model.states)
        for of, part in (("rhs", expected[:rows]), ("output", expected[rows:])):
            found = [model.program.dense_jacobian(of, by, 0.4, x, u, theta) for by in ("x", "u", "theta")]
            np.testing.assert_allclose(np.hstack(found), part, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("name", ["orifices", "driveline", "generated/baja_launch", "pendulum"])
def test_a_tangent_can_be_differentiated_again(name: str) -> None:
    """The derivative of J v along w equals the difference of J v between neighbouring states."""
    model, (t, x, u, theta) = model_of(name), points_of(name, 1, seed=9)
    equations = model.program
    tape, n_x = equations.tape, len(model.states)
    v, w = np.random.default_rng(2).normal(size=(2, n_x))
    one_way = {tape.leaf("x", i): tape.leaf("v", i) for i in range(n_x)}
    other_way = {tape.leaf("x", i): tape.leaf("w", i) for i in range(n_x)}
    first = tangents(equations.reader, equations.rows["rhs"], one_way)
    second = tape.program(tangents(equations.reader, first, other_way))
    leaves = {"t": (t,), "x": x[:, 0], "u": u[:, 0], "theta": theta[:, 0], "v": v, "w": w}
    found = equations.evaluate(second, leaves, ())
    step = 1e-6
    ends = [model.jacobian_x(t, x[:, 0] + sign * step * w, u[:, 0], theta[:, 0]) @ v for sign in (1.0, -1.0)]
    expected = (ends[0] - ends[1]) / (2.0 * step)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


def test_equal_operations_are_stored_once_and_zeros_disappear() -> None:
    tape = Tape()
    x, y = tape.leaf("x", 0), tape.leaf("x", 1)
    assert tape.add(tape.mul(x, y), tape.mul(y, x)) == tape.add(*[tape.mul(x, y)] * 2)
    assert tape.is_zero(tape.mul(tape.sub(x, x), y))
    assert tape.power(x, 2.0) == tape.mul(x, x)
    assert tape.program([tape.mul(x, y)]).count() == 1


def test_what_depends_on_parameters_only_is_hoisted() -> None:
    model, (t, x, u, theta) = model_of("generated/driveline"), points_of("generated/driveline", 4)
    equations = model.program
    hoister = Hoister(equations.tape)
    rewritten = equations.tape.program(hoister.rewrite(equations.rows["rhs"]))
    hoisted = equations.evaluate(equations.tape.program(hoister.nodes), {"theta": theta}, (4,))
    leaves = {"t": (t,), "x": x, "u": u, "theta": theta, "hoisted": hoisted}
    np.testing.assert_allclose(equations.evaluate(rewritten, leaves, (4,)), model.rhs(t, x, u, theta), rtol=1e-11)
    kinds = {operation.kind for operation in rewritten.operations}
    assert {"div", "log", "cos"}.isdisjoint(kinds)
    assert rewritten.count() < equations.tape.program(equations.rows["rhs"]).count()


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("for i in range(3):\n        x = x", "'rhs' is a function without a value|statement that is not followed"),
        ("return _stack(x, (np.cbrt(x[0]),))", "'np.cbrt\\(x\\[0\\]\\)' is a call that is not followed"),
        ("return _stack(x, (unknown,))", "'unknown' is a name that is not known"),
    ],
)
def test_what_cannot_be_followed_is_told(body: str, message: str) -> None:
    tree = ast.parse(f"def rhs(t, x, u, theta):\n    {body}")
    with pytest.raises(ModelError, match=message):
        Reader(tree, {}, Tape()).equations("rhs")


def test_a_loop_without_named_residuals_cannot_be_differentiated() -> None:
    text = "def _solve_a(a, b):\n    for _ in range(3):\n        a = b\n    return a\n"
    text += "def rhs(t, x, u, theta):\n    return _stack(x, (_solve_a(0.0, x[0]),))"
    tape = Tape()
    reader = Reader(ast.parse(text), {}, tape)
    with pytest.raises(ModelError, match="_solve_a: the loop does not name its residuals _r0"):
        tangents(reader, reader.equations("rhs"), {tape.leaf("x", 0): tape.constant(1.0)})
