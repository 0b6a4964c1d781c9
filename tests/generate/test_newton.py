"""Solvers of algebraic loops: to rounding where there is a solution, nan where there is none, batch or single."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy
from scipy.optimize import brentq, fsolve

from bondgraph.declare.functions import table_function
from bondgraph.declare.quantities import symbol
from bondgraph.derive.equations import Assignment, ImplicitLoop
from bondgraph.errors import GenerationError
from bondgraph.generate.expressions import ExpressionPrinter
from bondgraph.generate.names import identifiers
from bondgraph.generate.newton import linear_solver_text, loop_text

Load = Callable[[str], SimpleNamespace]
F, p, q, slip = map(symbol, ("F", "p", "q", "slip"))


def _loop(unknowns: tuple[Any, ...], residuals: tuple[Any, ...], **more: Any) -> ImplicitLoop:
    settings: dict[str, Any] = {
        "name": "belt",
        "guesses": (sympy.S.Zero,) * len(unknowns),
        "units": ("N",) * len(unknowns),
        "body": (),
        "meaning": "",
    }
    return ImplicitLoop(unknowns=unknowns, residuals=residuals, **{**settings, **more})


def _solver(load: Load, loop: ImplicitLoop, known: tuple[str, ...] = ("p", "q")) -> Callable[..., Any]:
    names = identifiers([*known, *(s.name for s in loop.unknowns), *(a.symbol.name for a in loop.body)])
    printer = ExpressionPrinter(names, known, {"torque": "_table_torque"}, "car")
    text = loop_text(loop, "solve", printer).function
    helpers = linear_solver_text(len(loop.unknowns)) if len(loop.unknowns) > 1 else ""
    return load(f"import numpy as np\n{helpers}\n{text}\n").solve


def _function(expression: sympy.Expr, *arguments: sympy.Symbol) -> Callable[..., float]:
    return sympy.lambdify(arguments, expression, "math")


SCALAR = {
    "saturating slip": F - 900 * sympy.tanh((p - F / 4000) / sympy.Float(0.01)) - q,
    "stiff saturation": F - 1e5 * sympy.tanh((p - F / 1e6) / sympy.Float(1e-4)) - q,
    "cubic spring": 1e3 * F + 1e9 * F**3 - 1e4 * p + q,
    "quadratic drag": 5 * F + 2 * F * sympy.Abs(F) - 100 * p - q,
    "root law": F + 30 * sympy.sign(F - p) * sympy.sqrt(sympy.Abs(F - p)) - q,
    "exponential": sympy.exp(F) + F - 50 * p - q,
    "clearance": F / 100 - sympy.Piecewise((p - F / 1e4, p > F / 1e4), (p / 10 - F / 1e5, True)) - q / 1e3,
}


@pytest.mark.parametrize("name", SCALAR)
def test_the_root_is_that_of_a_bracketing_search(load: Load, name: str) -> None:
    residual = SCALAR[name]
    solve, value = _solver(load, _loop((F,), (residual,))), _function(residual, F, p, q)
    points = np.random.default_rng(5).normal(0, (2.0, 30.0), (40, 2))
    found = solve(0.0, *points.T)
    for (at_p, at_q), root in zip(points, found, strict=True):
        low, high = (-1e3, 50.0) if name == "exponential" else (-1e7, 1e7)
        expected = brentq(value, low, high, args=(at_p, at_q), xtol=1e-14, rtol=1e-14, maxiter=500)
        assert root == pytest.approx(expected, rel=1e-12, abs=1e-11)


@pytest.mark.parametrize("name", SCALAR)
def test_a_batch_equals_single_calls_exactly(load: Load, name: str) -> None:
    solve = _solver(load, _loop((F,), (SCALAR[name],)))
    at_p, at_q = np.random.default_rng(6).normal(0, (2.0, 30.0), (30, 2)).T
    single = [float(solve(0.0, np.float64(a), np.float64(b))) for a, b in zip(at_p, at_q, strict=True)]
    np.testing.assert_allclose(solve(0.0, at_p, at_q), single, rtol=1e-15)
    np.testing.assert_array_equal(solve(0.0, at_p.reshape(5, 6), at_q.reshape(5, 6)).ravel(), solve(0.0, at_p, at_q))


def test_convergence_is_quadratic(load: Load) -> None:
    """A smooth loop takes a handful of evaluations from a guess that is far off."""
    counted = []
    body = loop_text(
        _loop((F,), (SCALAR["cubic spring"],)), "solve", ExpressionPrinter({"p": "p", "q": "q", "F": "F"}, ("p", "q"))
    ).function.replace("        _trial = ", "        _count(F)\n        _trial = ")
    namespace: dict[str, Any] = {"np": np, "_count": counted.append}
    exec(body, namespace)
    root = float(namespace["solve"](np.float64(0.05), np.float64(1.0), np.float64(0.0)))
    errors = [abs(float(value) - root) for value in counted]
    close = [(before, after) for before, after in itertools.pairwise(errors) if 1e-12 < after < before < 1e-3]
    assert len(counted) < 15
    assert close and all(after < 2e3 * before**2 for before, after in close)


def test_guesses_where_the_slope_is_zero_are_left(load: Load) -> None:
    solve = _solver(load, _loop((F,), (F * sympy.Abs(F) - p,)), ("p",))
    np.testing.assert_allclose(
        solve(0.0, np.array([1e6, 4.0, 1e-8, 0.0, -9.0])), [1e3, 2.0, 1e-4, 0.0, -3.0], rtol=1e-9
    )


def test_guesses_outside_the_domain_are_left(load: Load) -> None:
    solve = _solver(load, _loop((F,), (sympy.log(F) - p,)), ("p",))
    np.testing.assert_allclose(solve(-1.0, np.array([0.0, 2.0, -3.0])), np.exp([0.0, 2.0, -3.0]), rtol=1e-12)


def test_far_out_on_a_saturated_law_it_finds_its_way_back(load: Load) -> None:
    solve = _solver(load, _loop((F,), (sympy.tanh(F) - p,)), ("p",))
    assert float(solve(6.0, np.float64(0.3))) == pytest.approx(np.arctanh(0.3), rel=1e-13)
    assert float(solve(-40.0, np.float64(0.3))) == pytest.approx(np.arctanh(0.3), rel=1e-13)


def test_where_there_is_no_solution_the_member_is_nan_and_the_others_are_not(load: Load) -> None:
    solve = _solver(load, _loop((F,), (sympy.tanh(F) - p,)), ("p",))
    found = solve(0.0, np.array([0.5, 1.5, -0.9, np.nan]))
    assert np.isnan(found).tolist() == [False, True, False, True]
    above_zero = _solver(load, _loop((F,), (F**2 + 1 + 0 * p,)), ())
    assert np.isnan(above_zero(3.0))


def test_an_exact_guess_is_kept(load: Load) -> None:
    solve = _solver(load, _loop((F,), (F - p,)), ("p",))
    assert solve(np.array([3.0, 0.0]), np.array([3.0, 0.0])).tolist() == [3.0, 0.0]


def test_rounding_in_the_residual_is_no_failure(load: Load) -> None:
    """A root near zero among terms that cancel: the residual never gets below its own rounding."""
    law = F - 900 * sympy.tanh((p - F / 4000 - q) / sympy.Float(0.01))
    at_q = np.random.default_rng(7).uniform(10, 40, 2000)
    found = _solver(load, _loop((F,), (law,)))(0.0, at_q * (1 + 2e-16), at_q)
    assert np.all(np.isfinite(found)) and np.all(np.abs(found) < 1e-7)


def test_the_jacobian_goes_through_the_body(load: Load) -> None:
    ratio = symbol("ratio")
    body = (
        Assignment(slip, p - F / 4000, "m/s", ""),
        Assignment(symbol("unused"), slip**2, "", ""),
        Assignment(ratio, slip * sympy.Abs(slip) + 3 * slip, "1", ""),
    )
    loop = _loop((F,), (F - 900 * sympy.tanh(ratio / q),), body=body)
    inlined = loop.residuals[0].subs(ratio, body[2].expression).subs(slip, body[0].expression)
    points = np.random.default_rng(8).uniform(0.05, 2, (20, 2)).T
    with_body, without = _solver(load, loop), _solver(load, _loop((F,), (inlined,)))
    np.testing.assert_allclose(with_body(0.0, *points), without(0.0, *points), rtol=1e-12)


def test_tables_in_a_loop_use_their_slope() -> None:
    loop = _loop((F,), (F - table_function("torque")(p - F / 10),))
    printer = ExpressionPrinter({"p": "p", "F": "F"}, ("p",), {"torque": "_table_torque"})
    assert "_j0_0 = (1/10)*_table_torque_d1(p - (1/10)*F) + 1\n" in loop_text(loop, "solve", printer).function
    assert list(printer.used_tables) == [("torque", (0,)), ("torque", (1,))]


SYSTEMS: dict[str, tuple[Any, ...]] = {
    "two resistances": (F + slip**3 - p, 2 * slip - sympy.tanh(F) - q),
    "units far apart": (
        F - 1e6 * sympy.tanh(slip / sympy.Float(1e-3)),
        slip - p * sympy.Float(1e-3) + F / 1e10 - q / 1e9,
    ),
    "pivot is zero": (slip - p - 0.1 * F * sympy.Abs(F), F - q + slip),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_two_unknowns(load: Load, name: str) -> None:
    residuals = SYSTEMS[name]
    solve = _solver(load, _loop((F, slip), residuals))
    points = np.random.default_rng(9).normal(0, 2, (40, 2))
    found = np.array(solve(0.0, 0.0, *points.T))
    values = sympy.lambdify((F, slip, p, q), residuals)
    slopes = sympy.lambdify((F, slip, p, q), sympy.Matrix(residuals).jacobian([F, slip]))
    for k, (at_p, at_q) in enumerate(points):
        rows = np.abs(np.array(slopes(*found[:, k], at_p, at_q), float)) @ (1 + np.abs(found[:, k]))
        assert np.all(np.abs(np.array(values(*found[:, k], at_p, at_q), float)) <= 1e-13 * rows)


def test_three_unknowns_match_another_solver(load: Load) -> None:
    a, b, c = symbol("a"), symbol("b"), symbol("c")
    residuals = (a + sympy.tanh(a) + b / 2 - p, b + b**3 + a / 2 - c / 3 - q, c + sympy.sinh(c) - b / 3)
    solve = _solver(load, _loop((a, b, c), residuals, guesses=(sympy.S.One, sympy.S.One, sympy.S.Zero)))
    points = np.random.default_rng(11).normal(0, 5, (10, 2))
    found = np.array(solve(1.0, 1.0, 0.0, *points.T)).T
    values = sympy.lambdify((a, b, c, p, q), residuals)
    for z, (at_p, at_q) in zip(found, points, strict=True):
        expected = fsolve(lambda z, at: values(*z, *at), [1.0, 1.0, 0.0], args=((at_p, at_q),), xtol=1e-13)
        np.testing.assert_allclose(z, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("size", [2, 3, 5])
def test_elimination_solves_systems_with_zero_pivots(load: Load, size: int) -> None:
    solve = getattr(load("import numpy as np\n" + linear_solver_text(size)), f"_linear_{size}")
    rng = np.random.default_rng(10)
    matrices, right = rng.normal(size=(200, size, size)), rng.normal(size=(200, size))
    matrices[:, 0, 0] = 0.0
    arguments = [*matrices.reshape(200, -1).T, *right.T]
    expected = np.linalg.solve(matrices, right[..., None])[..., 0]
    np.testing.assert_allclose(np.array(solve(*arguments)).T, expected, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize(
    ("loop", "message"),
    [
        (_loop((F,), (F, F - p)), "loop belt: 1 unknowns, 1 guesses and 2 residuals"),
        (_loop((), ()), "loop belt: 0 unknowns"),
        (_loop((F,), (F - symbol("pp"),)), r"car: 'pp' is used but neither declared nor computed before"),
        (_loop((F,), (F - p,), guesses=(F,)), r"car: 'F' is used but neither declared nor computed before"),
        (_loop((p,), (p - q,)), "car: 'p' is declared or computed twice"),
    ],
)
def test_loops_that_are_none_are_refused(load: Load, loop: ImplicitLoop, message: str) -> None:
    with pytest.raises(GenerationError, match=message):
        _solver(load, loop)
