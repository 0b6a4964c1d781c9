"""Loops over lanes compiled from their text mean what numba makes of the same text."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numba import njit

from bondgraph.compile.lanes.compiler import lane_loops
from bondgraph.compile.lanes.load import load_lanes
from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.machine_code import load_compiled
from bondgraph.errors import ModelError
from tests.simulate.points import model_of


def called(function):
    """A function over lanes as one that Python can call."""
    return njit(fastmath={"contract"})(lambda clock, inputs, w, n: function(clock, inputs, w, n))


@pytest.mark.parametrize("name", ["vocabulary", pytest.param("orifices", marks=pytest.mark.slow)])
def test_numba_makes_the_same_of_the_printed_text(name: str) -> None:
    lanes = load_lanes(model_of(name), stiff=False)
    plain = re.sub(r"\ndef _lane_", r"\n@_jit\ndef _lane_", lanes.text.replace("@lane_loops", "@_jit"))
    modules = [load_compiled(lanes.text), load_compiled(plain.partition("def call_")[0])]
    clock, inputs = np.array([0.3, 1.0]), np.random.default_rng(1).uniform(-1.0, 1.0, 2 * len(model_of(name).inputs))
    rows = np.random.default_rng(2).uniform(-1.5, 2.5, lanes.rows * LANES)
    found = []
    for module in modules:
        w = rows.copy()
        for function in ("rates", "measure"):
            called(getattr(module, function))(clock, inputs, w, LANES)
        found.append(w)
    assert np.count_nonzero(found[0] != rows) > 2 * LANES
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12, atol=1e-13)


def test_a_count_of_lanes_means_whole_vectors() -> None:
    @lane_loops
    def double(clock, inputs, w, n):
        for l in range(n):  # noqa: E741
            w[16 + l] = 2.0 * w[0 + l]

    w = np.arange(32.0)
    called(double)(np.zeros(1), np.zeros(1), w, 3)
    np.testing.assert_array_equal(w[16:24], 2.0 * np.arange(8.0))
    np.testing.assert_array_equal(w[24:], np.arange(24.0, 32.0))


def test_turns_end_when_no_lane_goes_on() -> None:
    @lane_loops
    def halve(clock, inputs, w, n):
        for _ in range(50):
            for l in range(n):  # noqa: E741
                w[0 + l] = 0.5 * w[0 + l] if w[0 + l] > 1.0 else w[0 + l]
                w[16 + l] = w[16 + l] + 1.0
            going = 0
            for l in range(n):  # noqa: E741
                going |= np.int64(w[0 + l] > 1.0)
            if going == 0:
                break

    w = np.zeros(32)
    w[:8] = 2.0 ** np.arange(8)
    called(halve)(np.zeros(1), np.zeros(1), w, 8)
    np.testing.assert_array_equal(w[:8], 1.0)
    np.testing.assert_array_equal(w[16:24], 7.0)


def test_what_is_never_printed_is_refused() -> None:
    @lane_loops
    def endless(clock, inputs, w, n):
        while n > 0:
            n = n - 1

    with pytest.raises(ModelError, match=r"while n > 0.*cannot be compiled for lanes"):
        called(endless)(np.zeros(1), np.zeros(1), np.zeros(8), 8)
