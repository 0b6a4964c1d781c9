"""The rule for what decays: a quadrature rule, Lobatto's where nothing is fast, and right for every rate it reaches."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.filter.decay_rule import MOST_INSIDE, decay_rule


@given(st.integers(0, MOST_INSIDE), st.one_of(st.just(0.0), st.floats(1e-3, 1e4)))
@settings(deadline=None, max_examples=30)
def test_it_is_a_rule_with_both_ends_and_positive_weights(inside: int, reach: float) -> None:
    before, weights = decay_rule(inside, reach)
    assert before.shape == weights.shape == (inside + 2,)
    assert before[0] == 0.0 and before[-1] == 1.0 and np.all(np.diff(before) > 0.0)
    assert np.all(weights > 0.0) and weights.sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("inside", range(MOST_INSIDE + 1))
def test_without_a_reach_polynomials_are_integrated_exactly(inside: int) -> None:
    before, weights = decay_rule(inside, 0.0)
    for power in range(2 * inside + 2):
        assert weights @ before**power == pytest.approx(1.0 / (power + 1), rel=1e-11)
    assert abs(weights @ before ** (2 * inside + 2) - 1.0 / (2 * inside + 3)) > 1e-12


@given(st.integers(1, 6), st.floats(1.0, 1000.0), st.floats(0.0, 1.0))
@settings(deadline=None, max_examples=40)
def test_rates_within_its_reach_are_integrated(inside: int, reach: float, share: float) -> None:
    """The error falls with the nodes as that of the best sums of exponentials does (Braess and Hackbusch 2005)."""
    before, weights = decay_rule(inside, reach)
    rate = reach**share
    error = abs(np.exp(-rate * before) @ weights / (-math.expm1(-rate) / rate) - 1.0)
    assert error < 4.0 * math.exp(-(math.pi**2) * inside / math.log(8.0 * max(reach, 3.0)))


@pytest.mark.parametrize("reach", [30.0, 100.0, 300.0])
def test_four_nodes_do_what_seven_of_simpsons_did(reach: float) -> None:
    """Simpson's rule on four panels that halve towards the end has seven nodes inside."""
    edges = 1.0 - np.cumsum([0.0, *(2.0 ** -np.arange(4) / (2.0 ** -np.arange(4)).sum())])
    at = np.concatenate([[a, (a + b) / 2, b] for a, b in itertools.pairwise(edges)])
    parts = np.concatenate([(a - b) * np.array([1.0, 4.0, 1.0]) / 6.0 for a, b in itertools.pairwise(edges)])
    rates = np.geomspace(0.01, reach, 200)
    exact = -np.expm1(-rates) / rates

    def worst(before: np.ndarray, weights: np.ndarray) -> float:
        return float(np.abs(np.exp(-rates[:, np.newaxis] * before) @ weights / exact - 1.0).max())

    assert worst(*decay_rule(4, reach)) < worst(at, parts)
