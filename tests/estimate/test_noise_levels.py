"""Levels of sensors' noise: where searches of them begin, and how small they can be."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.noise_bounds import sensor_rounding, step_shown
from bondgraph.estimate.noise_starts import matched_levels
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.simulate.example import pendulum
from tests.correct.sled import fitted, pull, sled


@given(st.floats(1e-6, 1e3), st.floats(-1e3, 1e3), st.integers(0, 10_000))
@settings(max_examples=50, deadline=None)
def test_the_step_of_a_channel_is_seen_whatever_it_is_and_whatever_its_offset(
    step: float, offset: float, seed: int
) -> None:
    counts = np.random.default_rng(seed).integers(0, 50, 300)
    assert step_shown(step * (counts + offset)) == pytest.approx(step, rel=1e-6)


@given(st.integers(0, 10_000), st.integers(8, 400))
@settings(max_examples=50, deadline=None)
def test_a_channel_of_any_numbers_has_no_step(seed: int, size: int) -> None:
    assert step_shown(np.random.default_rng(seed).standard_normal(size)) == 0.0


def test_a_sensor_is_at_least_as_noisy_as_its_rounding() -> None:
    """A speed in steps of 0.01 km/h was taken as known to a twelfth of its rounding."""
    time = 0.1 * np.arange(400)
    angle = 0.05 * np.round(4.0 * np.sin(0.9 * time) + 0.3 * np.random.default_rng(1).standard_normal(400))
    log = MatchedLog("swing", time, np.zeros((1, 400)), angle[np.newaxis])
    assert sensor_rounding([log], 0) == pytest.approx(0.05 / math.sqrt(12.0))
    (level,) = [one for one in filter_setup(pendulum(), ["rate"], [log]).noise if one.target.kind == "std"]
    assert level.lower == pytest.approx(0.05 / math.sqrt(12.0)) and level.start >= level.lower


def test_levels_matched_to_innovations_are_likelier_than_any_multiple_of_them() -> None:
    """With a quiet process and sensors taken for a thousand times better than they are."""
    base = fitted([pull(sled(), 1)])
    problem = base.problem
    kinds = np.array([one.target.kind for one in problem.free])
    point = np.where(kinds == "process", problem.lower, base.point)
    point = np.where(kinds == "std", np.maximum(point - np.log(1e3), problem.lower), point)
    matched = matched_levels(problem, point)
    assert np.array_equal(matched[kinds != "std"], point[kinds != "std"])
    value = _nll(problem, matched)
    assert value < _nll(problem, point) - 1e3
    for factor in (0.2, 0.5, 2.0, 5.0):
        assert value < _nll(problem, np.where(kinds == "std", matched + np.log(factor), matched))


def _nll(problem: EstimationProblem, point: np.ndarray) -> float:
    return float(problem.nll(point[:, np.newaxis])[0])
