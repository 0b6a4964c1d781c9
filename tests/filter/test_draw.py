"""Drawn logs: the statistics that the filter model promises, and filters that are consistent on them."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.errors import FilterError
from bondgraph.filter.draw import draw_logs
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.runs import run
from bondgraph.simulate.example import pendulum
from tests.estimate.linear import lag


def pattern(samples: int, outputs: int, step: float = 0.05) -> MatchedLog:
    time = np.arange(samples) * step
    return MatchedLog("drive", time, np.sin(time)[np.newaxis], np.zeros((outputs, samples)))


def test_noises_have_the_sizes_that_the_model_states() -> None:
    filter_model = lag()
    drawn = draw_logs(filter_model, pattern(40, 2), 4000, seed=1, theta=filter_model.model.theta(drag=0.1, mass=8.0))
    first = drawn.states[0, 0]
    assert np.std(first) == pytest.approx(0.1, rel=0.05)
    decay = np.exp(-0.1 / 8.0 * 0.05)
    jumps = drawn.states[0, 1:] - decay * drawn.states[0, :-1]
    assert np.std(jumps, axis=1) == pytest.approx(0.1 * np.sqrt(0.05), rel=0.06)
    y = np.stack([log.y for log in drawn.logs], axis=-1)
    assert np.std(y[0] - drawn.states[0]) == pytest.approx(0.05, rel=0.01)
    assert np.std(y[1] - 30.0 * drawn.states[0]) == pytest.approx(3.0, rel=0.01)


def test_the_filter_is_consistent_on_drawn_logs_of_a_nonlinear_model() -> None:
    swing = FilterModel(
        pendulum(), {"rate": 0.2}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1}, substeps=2,
        appended={"damping": 0.02},
    )  # fmt: skip
    drawn = draw_logs(swing, pattern(200, 1), 20, seed=2)
    runs = [run(swing, log) for log in drawn.logs]
    nis = np.concatenate([(record.whitened**2).ravel() for record in runs])
    assert nis.mean() == pytest.approx(1.0, abs=0.08)
    assert np.ptp(drawn.states[2], axis=0).min() > 0.0  # the appended parameter wanders


def test_gaps_stay_gaps_and_the_seed_decides() -> None:
    holes = pattern(30, 2)
    holes.y[0, 5:9] = np.nan
    one, again, other = (draw_logs(lag(), holes, 1, seed=seed).logs[0].y for seed in (3, 3, 4))
    assert np.isnan(one[0, 5:9]).all() and np.isfinite(one[1]).all()
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other, equal_nan=True)


def test_a_model_that_diverges_is_named_with_the_time() -> None:
    filter_model = lag()
    unstable = filter_model.model.theta(mass=1e-5, drag=30.0)
    with pytest.raises(FilterError, match="drive: the model diverges between"):
        draw_logs(filter_model, pattern(400, 2), 2, seed=1, theta=unstable)
