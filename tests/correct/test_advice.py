"""How alike two responses are, however large they get."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.estimate.design.likeness import likeness


def test_alike_is_the_correlation_of_what_the_others_leave() -> None:
    rng = np.random.default_rng(1)
    free, first, own = rng.standard_normal((3, 4000))
    columns = np.array([free, 2.0 * free + first, 0.6 * first + 0.8 * own - free]).T
    assert likeness(columns) == pytest.approx(0.6, abs=0.03)
    assert likeness(columns * np.array([1.0, 1e200, 1e-200])) == pytest.approx(likeness(columns), rel=1e-9)


@pytest.mark.parametrize("wild", [np.inf, -np.inf, np.nan])
def test_a_response_that_runs_away_separates_nothing(wild: float) -> None:
    columns = np.random.default_rng(2).standard_normal((50, 3))
    columns[-1, 2] = wild
    assert likeness(columns) == 1.0
