"""Recovery of the truth: an honest estimator passes, a biased and an over-confident one are seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.problem import pose
from bondgraph.estimate.recovery import Trial, recovery, recovery_table
from bondgraph.filter.draw import draw_logs
from tests.estimate.linear import lag

TRUTH = {"mass": 2.5, "drag": 3.5}
REPETITIONS = 30


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    filter_model = lag()
    time = np.arange(300) * 0.05
    pattern = MatchedLog("drive", time, 5.0 * np.sign(np.sin(time))[np.newaxis], np.zeros((2, 300)))
    theta = filter_model.model.theta(**TRUTH)
    logs = draw_logs(filter_model, pattern, REPETITIONS, seed=7, theta=theta, substeps=4).logs

    settings = Settings(method="gradient", starts=1)
    return [Trial.of(estimate(pose(filter_model, log, ["mass", "drag"]), settings), TRUTH) for log in logs]


def test_an_honest_estimator_is_unbiased_and_covers(trials: list[Trial]) -> None:
    found = recovery(trials)
    assert not any(row.biased for row in found.parameters)
    assert 0.88 <= found.coverage <= 1.0
    for row in found.parameters:
        assert row.scatter == pytest.approx(row.stated, rel=0.4)
    assert "biased" not in recovery_table(found)


def test_a_bias_is_seen(trials: list[Trial]) -> None:
    shifted = [replace(trial, truth=TRUTH | {"drag": TRUTH["drag"] + trial.std["drag"]}) for trial in trials]
    found = recovery(shifted)
    assert found.parameter("drag").biased and not found.parameter("mass").biased
    assert found.parameter("drag").coverage < 0.95
    assert recovery_table(found).count("biased") == 1


def test_over_confidence_is_seen(trials: list[Trial]) -> None:
    def narrow(trial: Trial) -> Trial:
        std = {name: value / 5.0 for name, value in trial.std.items()}
        return replace(
            trial, std=std, ci95={n: (v - 1.96 * std[n], v + 1.96 * std[n]) for n, v in trial.values.items()}
        )

    found = recovery([narrow(trial) for trial in trials])
    assert found.coverage < 0.6
    assert found.parameter("mass").scatter > 2.0 * found.parameter("mass").stated


def test_failures_are_counted_and_named(trials: list[Trial]) -> None:
    failed = replace(trials[0], failure="stopped at the limit")
    found = recovery([failed, *trials[1:4]])
    assert found.parameters[0].repetitions == 3
    assert found.failures == ("repetition 1: stopped at the limit",)
    with pytest.raises(EstimationError, match="1 of 2 estimates succeeded"):
        recovery([failed, trials[1]])
    with pytest.raises(EstimationError, match="was not estimated"):
        found.parameter("gain")
