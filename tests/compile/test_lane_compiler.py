"""Printed modules compiled from their text mean what numba makes of the same text."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from numba import njit

from bondgraph.compile.lanes.compiler import lane_module
from bondgraph.compile.lanes.load import load_lanes
from bondgraph.compile.lanes.object_code import load_functions
from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.machine_code import HEADER, load_compiled
from bondgraph.errors import ModelError
from tests.simulate.points import model_of

TIMED = "void(float64[::1], float64[::1], float64[::1], int64)"


def compiled(source: str, name: str) -> Callable[..., None]:
    """A function ``(clock, inputs, w, n)`` of a printed module as one that Python can call."""
    function = load_functions(source, {name: TIMED})[name]
    call = njit(lambda function, clock, inputs, w, n: function(clock, inputs, w, n))
    return lambda *arguments: call(function, *arguments)


def by_numba(source: str, name: str) -> Callable[..., None]:
    """The same as numba understands the text."""
    plain = re.sub(r"^def ", "@_jit\ndef ", source, flags=re.M).replace("FloatArray", "np.ndarray")
    return getattr(load_compiled(HEADER.format(title="plain") + plain), name)


@pytest.mark.parametrize("name", ["vocabulary", pytest.param("orifices", marks=pytest.mark.slow)])
def test_numba_makes_the_same_of_the_printed_text(name: str) -> None:
    lanes = load_lanes(model_of(name), stiff=False)
    clock, inputs = np.array([0.3, 1.0]), np.random.default_rng(1).uniform(-1.0, 1.0, 2 * len(model_of(name).inputs))
    rows = np.random.default_rng(2).uniform(-1.5, 2.5, lanes.rows * LANES)
    found = []
    for way in (compiled, by_numba):
        w = rows.copy()
        for function in ("rates", "measure"):
            way(lanes.text, function)(clock, inputs, w, LANES)
        found.append(w)
    assert np.count_nonzero(found[0] != rows) > 2 * LANES
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12, atol=1e-13)


KINDS = """
TABLE = np.array([[1.0, 2.0, 4.0], [8.0, 16.0, 32.0]])
def own(x):
    y = 2 * x
    return y if y > 1.0 else -y
def sums(clock, inputs, w, n):
    total = 0.5
    for i in range(inputs.size):
        total += inputs[i] / 3
    middle = inputs.size == 3 or total < 0.0
    count = int(total) // 2
    clock[0] = total
    clock[1] = (1 if middle else 0.25) + count
    if middle:
        clock[2] = -1.0
    elif total > 1e9:
        clock[2] = -2.0
    else:
        clock[2] = -3.0
    scale = clock[0]
    for l in range(n):
        a = w[0 + l]
        k = min(np.int64(np.floor(abs(a))), 2)
        w[16 + l] = TABLE[1, k] * scale + own(a)
        w[32 + l] = np.arctan2(scale, abs(a)) + np.arctan2(a, scale)
        w[48 + l] = a > 0.25
        w[64 + l] = np.int64(np.int64(k) + 1023 << 52).view(np.float64) if (a != a) | (a < 0.0) else math.sqrt(a)
"""


@pytest.mark.parametrize("size", [3, 4])
def test_every_kind_of_statement_means_what_python_says(size: int) -> None:
    """Kinds that only some models print, and those of the kernels that call what is printed."""
    rng = np.random.default_rng(5)
    inputs, clock, w = rng.uniform(0.5, 4.0, size), np.zeros(3), rng.uniform(-3.0, 3.0, 5 * LANES)
    expected_clock, expected = clock.copy(), w.copy()
    compiled(KINDS, "sums")(clock, inputs, w, LANES)
    for lane in range(LANES):  # Python runs the text for one lane after another
        scope = {"np": np, "math": math, "range": lambda n, lane=lane: [lane] if n == LANES else range(n)}
        exec(KINDS, scope)
        with np.errstate(invalid="ignore"):
            scope["sums"](expected_clock, inputs, expected, LANES)
    np.testing.assert_allclose(clock, expected_clock, rtol=1e-15)
    np.testing.assert_allclose(w, expected, rtol=1e-14)


DOUBLE = """
def double(clock, inputs, w, n):
    for l in range(n):
        w[16 + l] = 2.0 * w[0 + l]
"""

HALVE = """
def halve(clock, inputs, w, n):
    for _ in range(50):
        for l in range(n):
            w[0 + l] = 0.5 * w[0 + l] if w[0 + l] > 1.0 else w[0 + l]
            w[16 + l] = w[16 + l] + 1.0
        going = 0
        for l in range(n):
            going |= np.int64(w[0 + l] > 1.0)
        if going == 0:
            break
"""

ENDLESS = """
def endless(clock, inputs, w, n):
    while n > 0:
        n = n - 1
"""

UNKNOWN = """
def unknown(clock, inputs, w, n):
    for l in range(n):
        w[0 + l] = np.erf(w[0 + l])
"""


def test_a_count_of_lanes_means_whole_vectors() -> None:
    w = np.arange(32.0)
    compiled(DOUBLE, "double")(np.zeros(1), np.zeros(1), w, 3)
    np.testing.assert_array_equal(w[16:24], 2.0 * np.arange(8.0))
    np.testing.assert_array_equal(w[24:], np.arange(24.0, 32.0))


def test_turns_end_when_no_lane_goes_on() -> None:
    w = np.zeros(32)
    w[:8] = 2.0 ** np.arange(8)
    compiled(HALVE, "halve")(np.zeros(1), np.zeros(1), w, 8)
    np.testing.assert_array_equal(w[:8], 1.0)
    np.testing.assert_array_equal(w[16:24], 7.0)


@pytest.mark.parametrize(
    ("source", "name", "told"), [(ENDLESS, "endless", "while n > 0"), (UNKNOWN, "unknown", "np.erf")]
)
def test_what_is_never_printed_is_refused(source: str, name: str, told: str) -> None:
    with pytest.raises(ModelError, match=rf"{told}.*cannot be compiled for lanes"):
        lane_module(source, {name: TIMED})


@pytest.mark.parametrize("stiff", [False, True])
def test_arithmetic_of_lanes_is_that_of_vectors(stiff: bool) -> None:
    """Half of a step was once scalar: where a compiler gives up it does so silently, and everything takes longer."""
    text = load_lanes(model_of("generated/driveline"), stiff).text
    written = lane_module(text, {"rates": TIMED, **({"factor": TIMED} if stiff else {})})
    packed, single = (len(re.findall(rf"= (?:fmul|fadd|fsub|fdiv) contract {kind}", written)) for kind in ("<", "d"))
    assert packed > 20
    assert packed > 10 * single
