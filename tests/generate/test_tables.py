"""Tables: scipy's PCHIP in one argument, a C1 tensor product in two, held at the ends."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from bondgraph.declare.quantities import Table
from bondgraph.errors import GenerationError
from bondgraph.generate.tables import interpolant_text, pchip_slopes, table_text

Load = Callable[[str], SimpleNamespace]

CURVES = {
    "rising": ((0.0, 1.0, 2.5, 4.0), (0.0, 1.0, 1.5, 9.0)),
    "extrema": ((-2.0, -1.0, 0.5, 1.0, 3.0), (1.0, 4.0, -2.0, -2.0, 5.0)),
    "steep end": ((0.0, 1.0, 1.1), (0.0, 1.0, -5.0)),
    "two points": ((0.0, 4.0), (3.0, -1.0)),
}
X, Y = (0.0, 1.0, 2.5, 4.0), (-1.0, 0.0, 2.0)
VALUES = ((0.0, 1.0, 4.0), (2.0, 2.5, 2.0), (1.0, 5.0, 6.0), (3.0, -1.0, 0.5))
ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


def _module(table: Table, stem: str, orders: tuple[tuple[int, ...], ...]) -> str:
    return "\n\n".join(["import numpy as np", *map(interpolant_text, orders), table_text(table, stem, orders)])


def _curve(load: Load, name: str) -> SimpleNamespace:
    table = Table("t", *CURVES[name])
    return load(_module(table, "curve", ((0,), (1,), (2,))))


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_is_scipys_pchip(load: Load, name: str) -> None:
    x, values = CURVES[name]
    made, reference = _curve(load, name), PchipInterpolator(x, values)
    points = np.random.default_rng(1).uniform(x[0], x[-1], 200)
    np.testing.assert_allclose(made.curve(points), reference(points), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(made.curve_d1(points), reference(points, 1), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(made.curve_d11(points), reference(points, 2), rtol=1e-10, atol=1e-10)


@given(
    st.lists(st.tuples(st.floats(0.01, 10), st.integers(-3, 3)), min_size=2, max_size=8),
    st.sampled_from([1.0, 1e-6, 1e6]),
)
@settings(deadline=None)
def test_slopes_are_scipys(steps: list[tuple[float, int]], scale: float) -> None:
    x = np.cumsum([width for width, _ in steps])
    values = [scale * value for _, value in steps]
    expected = PchipInterpolator(x, values).derivative()(x)
    np.testing.assert_allclose(pchip_slopes(list(x), values), expected, rtol=1e-10, atol=1e-11 * scale)


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_passes_through_its_points_and_is_held_beyond_them(load: Load, name: str) -> None:
    x, values = CURVES[name]
    made = _curve(load, name)
    assert made.curve(np.array(x)).tolist() == list(values)
    assert made.curve(np.array([x[0] - 1e9, x[0] - 0.1])).tolist() == [values[0]] * 2
    assert made.curve(np.array([x[-1] + 0.1, np.inf])).tolist()[0] == values[-1]
    assert made.curve_d1(np.array([x[0] - 0.1, x[-1] + 0.1])).tolist() == [0.0, 0.0]
    assert np.isnan(made.curve(np.nan))


def test_a_constant_table_is_constant(load: Load) -> None:
    made = load(_module(Table("t", (0.0, 1.0, 2.0), (3.0, 3.0, 3.0)), "f", ((0,), (1,))))
    np.testing.assert_allclose(made.f(np.linspace(-1, 3, 50)), 3.0, rtol=5e-16)
    assert set(made.f_d1(np.linspace(-1, 3, 50))) == {0.0}


def _surface(load: Load, table: Table, stem: str = "surface") -> SimpleNamespace:
    return load(_module(table, stem, ORDERS))


def test_a_surface_passes_through_its_points_and_along_rows_and_columns_is_a_curve(load: Load) -> None:
    made = _surface(load, Table("t", X, VALUES, Y))
    grid = np.meshgrid(X, Y, indexing="ij")
    assert made.surface(*grid).tolist() == [list(row) for row in VALUES]
    x, y = np.linspace(0, 4, 60), np.linspace(-1, 2, 60)
    for j, at in enumerate(Y):
        np.testing.assert_allclose(made.surface(x, at), PchipInterpolator(X, np.array(VALUES)[:, j])(x), atol=1e-12)
    for i, at in enumerate(X):
        np.testing.assert_allclose(made.surface(at, y), PchipInterpolator(Y, VALUES[i])(y), atol=1e-12)


def test_a_surface_is_smooth_across_its_grid_lines(load: Load) -> None:
    made = _surface(load, Table("t", X, VALUES, Y))
    tiny = 1e-9
    for name in ("surface", "surface_d1", "surface_d2", "surface_d12"):
        function = getattr(made, name)
        y = np.linspace(-0.99, 1.99, 40)
        for at in X[1:-1]:
            np.testing.assert_allclose(function(at - tiny, y), function(at + tiny, y), atol=1e-6)
        x = np.linspace(0.01, 3.99, 40)
        np.testing.assert_allclose(function(x, -tiny), function(x, tiny), atol=1e-6)


def test_slopes_of_a_surface_are_its_derivatives(load: Load) -> None:
    made = _surface(load, Table("t", X, VALUES, Y))
    x, y = np.random.default_rng(2).uniform((0.01, -0.99), (3.99, 1.99), (300, 2)).T
    h = 1e-6

    def central(function: Callable[..., np.ndarray], dx: float, dy: float) -> np.ndarray:
        return (function(x + dx, y + dy) - function(x - dx, y - dy)) / (2 * h)

    np.testing.assert_allclose(made.surface_d1(x, y), central(made.surface, h, 0), atol=1e-7)
    np.testing.assert_allclose(made.surface_d2(x, y), central(made.surface, 0, h), atol=1e-7)
    np.testing.assert_allclose(made.surface_d12(x, y), central(made.surface_d1, 0, h), atol=1e-7)
    np.testing.assert_allclose(made.surface_d11(x, y), central(made.surface_d1, h, 0), atol=1e-6)
    np.testing.assert_allclose(made.surface_d22(x, y), central(made.surface_d2, 0, h), atol=1e-6)


def test_a_surface_is_held_beyond_its_ends(load: Load) -> None:
    made = _surface(load, Table("t", X, VALUES, Y))
    x = np.linspace(0, 4, 9)
    np.testing.assert_array_equal(made.surface(x, 5.0), made.surface(x, 2.0))
    np.testing.assert_array_equal(made.surface(-3.0, x), made.surface(0.0, x))
    assert not made.surface_d2(x, 5.0).any() and not made.surface_d12(x, -2.0).any()
    np.testing.assert_array_equal(made.surface_d1(x, 5.0), made.surface_d1(x, 2.0))


def test_a_transposed_table_is_the_same_surface(load: Load) -> None:
    made = _surface(load, Table("t", X, VALUES, Y))
    turned = _surface(load, Table("t", Y, tuple(zip(*VALUES, strict=True)), X))
    x, y = np.random.default_rng(3).uniform((-1, -2), (5, 3), (100, 2)).T
    np.testing.assert_allclose(made.surface(x, y), turned.surface(y, x), atol=1e-13)


def test_a_batch_equals_single_calls(load: Load) -> None:
    made = _surface(load, Table("t", X, VALUES, Y))
    x, y = np.random.default_rng(4).uniform((-1, -2), (5, 3), (50, 2)).T
    for name in ("surface", "surface_d1", "surface_d12"):
        function = getattr(made, name)
        assert function(x, y).tolist() == [float(function(a, b)) for a, b in zip(x, y, strict=True)]


def test_only_the_functions_that_are_used_are_written() -> None:
    text = table_text(Table("t", (0.0, 1.0), (0.0, 1.0), meaning='odd "text"\nin two lines'), "f", [(1,), (1,)])
    assert text.count("def ") == 1 and "def f_d1(x):" in text
    assert 'Table t: odd "text" in two lines; first derivative in x, zero beyond the ends.' in text


def test_long_tables_are_written_in_lines_a_person_can_read(load: Load) -> None:
    x = tuple(i / 7 for i in range(100))
    rows = tuple(tuple(a * b for b in x) for a in x[:3])
    for table, orders in ((Table("t", x, x), (0,)), (Table("t", x[:3], rows, x), (0, 0))):
        text = _module(table, "f", (orders,))
        assert max(map(len, text.splitlines())) <= 120
        made = load(text)
        np.testing.assert_array_equal(made.f_v, table.values)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (Table("t", (0.0,), (1.0,)), r"table t: x = \[0.0\] must have at least two points that increase"),
        (Table("t", (0.0, 0.0), (1.0, 2.0)), "must have at least two points that increase"),
        (Table("t", (0.0, float("nan")), (1.0, 2.0)), "must have at least two points that increase"),
        (Table("t", (0.0, 1.0), (1.0,)), "values must be 2 numbers, one for each x"),
        (Table("t", (0.0, 1.0), ((1.0,), (2.0,))), "values must be 2 numbers"),
        (Table("t", (0.0, 1.0), ((1.0, 2.0), (2.0,)), (0.0, 1.0)), "2 rows, one for each x, of 2 numbers each"),
        (Table("t", (0.0, 1.0), (1.0, 2.0), (0.0, 1.0)), "2 rows, one for each x"),
        (Table("t", (0.0, 1.0), ((1.0, 2.0), (2.0, 3.0)), (1.0, 0.0)), r"y = \[1.0, 0.0\] must have"),
        (Table("t", (0.0, 1.0), (1.0, float("nan"))), "a value of f_v is nan"),
    ],
)
def test_tables_that_are_none_are_refused(table: Table, message: str) -> None:
    with pytest.raises(GenerationError, match=message):
        table_text(table, "f", [(0, 0) if table.y else (0,)])


@pytest.mark.parametrize("orders", [(3,), (0, 0)])
def test_derivatives_that_are_not_there_are_refused(orders: tuple[int, ...]) -> None:
    with pytest.raises(GenerationError, match=r"table t: derivative of order .* is not available"):
        table_text(Table("t", (0.0, 1.0), (0.0, 1.0)), "f", [orders])
