"""Kernels compiled from their text do what Python does with the same text, and refuse what they do not have."""

from __future__ import annotations

import inspect
import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.compile.kernels.arguments import Kind, Number, Numbers, kind_of, width, words_of
from bondgraph.compile.kernels.calls import Kernel
from bondgraph.compile.kernels.compiler import kernel_module
from bondgraph.compile.lanes.object_code import load_functions
from bondgraph.compile.machine_code import load_translated
from bondgraph.errors import ModelError
from bondgraph.filter import kernel_algebra, kernel_alone, kernel_robust
from bondgraph.filter.kernel_types import Robustness
from tests.compile import spoken_kernel
from tests.compile.spoken_kernel import Inner, Outer


def spoken(seed: int) -> tuple[Outer, FloatArray, IntArray]:
    rng = np.random.default_rng(seed)
    inner = Inner(rng.normal(size=4), 3)
    outer = Outer(rng.normal(size=(5, 4)), rng.normal(size=(3, 2, 4)), rng.integers(0, 4, 5), 1.5, -7, inner)
    return outer, np.zeros(spoken_kernel.ROWS), np.zeros(spoken_kernel.ROWS, dtype=np.int64)


@pytest.mark.parametrize("seed", range(5))
def test_compiled_text_does_what_python_does(seed: int) -> None:
    run = load_translated("run", spoken_kernel)
    told, floats, integers = spoken(seed)
    compiled, own_floats, own_integers = spoken(seed)
    expected = spoken_kernel.run(told, told.matrix[2].copy(), floats, integers)
    assert run(compiled, compiled.matrix[2].copy(), own_floats, own_integers) == expected
    np.testing.assert_array_equal(own_integers, integers)
    np.testing.assert_allclose(own_floats, floats, rtol=1e-14)
    for one, other in zip(compiled[:3], told[:3], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-14)
    np.testing.assert_allclose(compiled.inner.values, told.inner.values, rtol=1e-14)
    assert np.count_nonzero(floats) == 12
    assert np.count_nonzero(integers) > 15


ROBUST = """
def scores(robust: Robustness, z: FloatArray, found: FloatArray) -> None:
    for i in range(z.size):
        found[0, i] = _loss(robust, z[i])
        found[1, i] = _score(robust, z[i])
        found[2, i] = _precision(robust, z[i])
        found[3, i] = _precision_slope(robust, z[i])
        found[4, i] = _residual(robust, z[i])
        found[5, i] = _residual_slope(robust, z[i])
"""


@settings(deadline=None)
@given(
    kind=st.sampled_from([1, 2, 3]),
    first=st.floats(0.5, 9.0),
    second=st.floats(0.1, 2.0),
    z=st.lists(st.floats(-40.0, 40.0), min_size=1, max_size=9),
)
def test_losses_are_those_of_their_text(kind: int, first: float, second: float, z: list[float]) -> None:
    robust = Robustness(kind, first, second, 0.0)
    found = np.zeros((6, len(z)))
    Kernel([ROBUST, inspect.getsource(kernel_robust)], "scores")(robust, np.array(z), found)
    names = ("_loss", "_score", "_precision", "_precision_slope", "_residual", "_residual_slope")
    expected = [[getattr(kernel_robust, name)(robust, one) for one in z] for name in names]
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-300)


def test_numbers_that_are_no_numbers_stay_so() -> None:
    text = """
def kinds(x: FloatArray, found: IntArray) -> int:
    for i in range(x.size):
        found[i] = int(math.isnan(x[i])) + 2 * int(math.isfinite(x[i])) + 4 * int(x[i] != x[i]) + 8 * int(x[i] > 1.0)
        x[i] = 1.0 / x[i]
    return x.size
"""
    x, found = np.array([0.0, -0.0, math.inf, -math.inf, math.nan, 2.0]), np.zeros(6, dtype=np.int64)
    assert Kernel([text], "kinds")(x, found) == 6
    assert found.tolist() == [2, 2, 8, 0, 5, 10]
    np.testing.assert_array_equal(x, [math.inf, -math.inf, 0.0, -0.0, math.nan, 0.5])


def test_nothing_behind_the_decision_is_read() -> None:
    text = """
def last(x: FloatArray, k: int, found: FloatArray) -> None:
    found[0] = x[k] if k < x.size else -1.0
    if k < x.size and x[k] > 0.0:
        found[1] = 1.0
    if k >= x.size or x[k] < 0.0:
        found[1] = -1.0
"""
    run, found = Kernel([text], "last"), np.zeros(2)
    run(np.array([5.0]), 0, found)
    assert found.tolist() == [5.0, 1.0]
    run(np.array([5.0]), 1 << 40, found)  # far outside of all memory
    assert found.tolist() == [-1.0, -1.0]


def test_functions_of_others_are_called_with_rows() -> None:
    text = "def double(w, n):\n    for l in range(n):\n        w[8 + l] = 2.0*w[0 + l]\n"
    own = load_functions(text, {"double": "void(float64[::1], int64)"})["double"]

    class Equations(NamedTuple):
        double: object

    kernel = "def run(equations: Equations, w: FloatArray) -> None:\n    equations.double(w[1], 8)\n"
    w = np.arange(48.0).reshape(3, 16)
    Kernel([kernel], "run")(Equations(own), w)
    np.testing.assert_array_equal(w[1, 8:], 2.0 * np.arange(16.0, 24.0))
    np.testing.assert_array_equal(w[[0, 2]], np.arange(48.0).reshape(3, 16)[[0, 2]])


def test_a_prepared_call_sees_new_contents_and_keeps_what_it_reads() -> None:
    run = Kernel(["def run(x: FloatArray, y: FloatArray) -> None:\n    y[0] = x[0]\n"], "run")
    x, y = np.array([1.0]), np.zeros(1)
    call = run.prepared(x, y)
    x[0] = 2.0
    call()
    assert y[0] == 2.0
    del x
    call()
    assert y[0] == 2.0


def test_each_kind_of_arguments_has_its_own_code() -> None:
    run = Kernel(["def run(x: FloatArray) -> None:\n    x[0] = x[0] / 2\n"], "run")
    floats = np.array([3.0])
    run(floats)
    assert floats[0] == 1.5
    read_only = np.array([1.0])
    read_only.flags.writeable = False
    copied = Kernel(["def run(x: FloatArray, y: FloatArray) -> None:\n    y[0] = x[0]\n"], "run")
    copied(read_only, floats)
    assert floats[0] == 1.0


@pytest.mark.parametrize(
    "array", [np.zeros((4, 6))[:, ::2], np.zeros((4, 6)).T, np.zeros(3, dtype=np.float32), np.zeros(2, dtype=np.int32)]
)
def test_an_array_that_kernels_cannot_read_is_refused(array: np.ndarray) -> None:
    with pytest.raises(ModelError, match=r"array \(.*\) of .* give float64 or int64, row by row"):
        words_of((array,))


@pytest.mark.parametrize(
    ("statement", "refused"),
    [
        ("x[0] = sum(x)", r"line 2: kernels do not have 'sum\(x\)'"),
        ("x[1:] = 0.0", "kernels do not have"),
        ("for value in x:\n        x[0] = value", "kernels do not have"),
        ("k = 1\n    k = 2.0", "line 3: k has two kinds of values"),
        ("k = 1\n    k += 0.5", "line 3: k has two kinds of values"),
        ("with x:\n        pass", "kernels do not have"),
        ("for i in range(3, 0, -1):\n        x[i] = 0.0", "kernels do not have"),
        ("x[0, 1] = 0.0", r"kernels do not have 'x\[0, 1\]'"),
        ("x[0] = x.mean", "kernels do not have 'x.mean'"),
        ("x[0] = 1.0 if 0.0 < x[0] < 1.0 else 2.0", "kernels do not have"),
    ],
)
def test_other_statements_are_refused(statement: str, refused: str) -> None:
    with pytest.raises(ModelError, match=refused):
        kernel_module([f"def run(x: FloatArray) -> None:\n    {statement}\n"], "run", [Numbers(True, 1)])


def test_words_are_as_many_as_their_kinds_say() -> None:
    told, floats, integers = spoken(0)
    values = (told, floats, 3, 2.5, integers)
    kinds: list[Kind] = [kind_of(value) for value in values]
    words, _ = words_of(values)
    assert len(words) == sum(map(width, kinds))
    assert kinds[2:4] == [Number(False), Number(True)]


def test_a_member_alone_and_beside_others_has_the_same_factor() -> None:
    """One recursion written twice, by rows and by lanes, to the last bit."""
    text = """
def both(lanes: FloatArray, one: FloatArray, work: Work) -> None:
    _factor(lanes, one.shape[0], 0, 0.0, work)
    _factor_alone(one, one.shape[0], 0, 0.0, work)
"""

    class Alone(NamedTuple):
        upper: FloatArray

    class Work(NamedTuple):
        mean: FloatArray
        pivot: FloatArray
        code: IntArray
        floored: IntArray
        alone: Alone

    rng = np.random.default_rng(4)
    root = rng.normal(size=(7, 9))
    one = root @ root.T
    lanes = np.repeat(one[..., np.newaxis], 8, axis=2)
    counts = (np.zeros(8, dtype=np.int64) for _ in range(2))
    work = Work(np.zeros((7, 8)), np.zeros(8), *counts, Alone(np.zeros((7, 7))))
    sources = [text, *map(inspect.getsource, (kernel_algebra, kernel_alone))]
    expected = np.linalg.cholesky(one)
    Kernel(sources, "both")(lanes, one, work)
    np.testing.assert_allclose(np.tril(one), expected, rtol=1e-12)
    for lane in range(8):
        np.testing.assert_array_equal(np.tril(lanes[..., lane]), np.tril(one))
