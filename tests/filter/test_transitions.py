"""Transitions of a filter over its steps, where some directions are known exactly and others to rounding."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bondgraph.filter.filter_run import solved


@given(st.integers(0, 2**31), st.integers(0, 3), st.booleans())
def test_each_covariance_is_solved_as_if_it_were_alone(seed: int, known: int, same: bool) -> None:
    """One with states that are known exactly, or are one, changes nothing of what the others give."""
    chance = np.random.default_rng(seed)
    turned = np.linalg.qr(chance.standard_normal((5, 4, 4)))[0]
    sizes = 10.0 ** chance.integers(-3, 4, 4)
    cov = turned @ np.diag([1.0, 2.0, 3.0, 4.0]) @ np.swapaxes(turned, 1, 2) * np.outer(sizes, sizes)
    moves = chance.standard_normal((5, 4, 4)) / sizes[:, np.newaxis]
    cross = cov @ moves
    plain = solved(cov, cross)
    assert np.abs((plain - moves) * sizes[:, np.newaxis]).max() < 1e-9
    cov[1, :known] = cov[1, :, :known] = cross[1, :known] = 0.0
    if same:  # two of them are one and the same
        cov[2] = np.ones((4, 4))
        cross[2] = 1.0
    found = solved(cov, cross)
    assert np.all(found[1, :known] == 0.0)
    assert np.abs((found - plain)[[0, 3, 4]] * sizes[:, np.newaxis]).max() < 1e-9
    if same:  # what they tell together is shared
        assert found[2] == pytest.approx(np.full((4, 4), 0.25))


def test_what_is_no_number_stays_none() -> None:
    cov, cross = np.tile(np.eye(2), (3, 1, 1)), np.ones((3, 2, 2))
    cov[1, 0, 0] = np.nan
    found = solved(cov, cross)
    assert np.isnan(found[1]).all() and np.array_equal(found[[0, 2]], cross[[0, 2]])
