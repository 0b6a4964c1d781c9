"""Recovery of the truth: an honest estimator passes, a biased and an over-confident one are seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.estimate import Settings, estimate
from bondgraph.estimate.problem import pose
from bondgraph.estimate.recovery import recovery, recovery_table
from bondgraph.estimate.result import Estimate
from bondgraph.filter.draw import draw_logs
from tests.estimate.linear import lag

TRUTH = {"mass": 2.5, "drag": 3.5}
REPETITIONS = 30


@pytest.fixture(scope="module")
def estimates() -> tuple[Estimate, ...]:
    filter_model = lag()
    time = np.arange(300) * 0.05
    pattern = MatchedLog("drive", time, 5.0 * np.sign(np.sin(time))[np.newaxis], np.zeros((2, 300)))
    theta = filter_model.model.theta(**TRUTH)
    logs = draw_logs(filter_model, pattern, REPETITIONS, seed=7, theta=theta, substeps=4).logs

    settings = Settings(method="gradient", starts=1)
    return tuple(estimate(pose(filter_model, log, ["mass", "drag"]), settings) for log in logs)


def test_an_honest_estimator_is_unbiased_and_covers(estimates: tuple[Estimate, ...]) -> None:
    found = recovery(estimates, [TRUTH] * REPETITIONS)
    assert not any(row.biased for row in found.parameters)
    assert 0.88 <= found.coverage <= 1.0
    for row in found.parameters:
        assert row.scatter == pytest.approx(row.stated, rel=0.4)
    assert "biased" not in recovery_table(found)


def test_a_bias_is_seen(estimates: tuple[Estimate, ...]) -> None:
    shifted = [TRUTH | {"drag": TRUTH["drag"] + one.std["drag"]} for one in estimates]
    found = recovery(estimates, shifted)
    assert found.parameter("drag").biased and not found.parameter("mass").biased
    assert found.parameter("drag").coverage < 0.95
    assert recovery_table(found).count("biased") == 1


def test_over_confidence_is_seen(estimates: tuple[Estimate, ...]) -> None:
    boastful = [replace(one, covariance=one.covariance / 25.0) for one in estimates]
    found = recovery(boastful, [TRUTH] * REPETITIONS)
    assert found.coverage < 0.6
    assert found.parameter("mass").scatter > 2.0 * found.parameter("mass").stated


def test_failures_are_counted_and_named(estimates: tuple[Estimate, ...]) -> None:
    failed = replace(estimates[0], outcome=type(estimates[0].outcome).NO_FINITE_POINT)
    found = recovery([failed, *estimates[1:4]], [TRUTH] * 4)
    assert found.parameters[0].repetitions == 3
    assert found.failures[0].startswith("repetition 1: failed")
    with pytest.raises(EstimationError, match="1 of 2 estimates succeeded"):
        recovery([failed, estimates[1]], [TRUTH] * 2)
    with pytest.raises(EstimationError, match="was not estimated"):
        found.parameter("gain")
