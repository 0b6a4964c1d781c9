"""What outputs say about parameters, and what the filter's innovations say at an estimate."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from bondgraph.errors import EstimationError
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.innovation_summary import fitted_runs, innovation_summary
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.objective import Terms
from bondgraph.estimate.problem import pose
from bondgraph.estimate.sensitivities import sensitivity
from tests.estimate.linear import ExactLikelihood, lag, simulated

LOGS = (simulated("run1", 1, {}, 40), simulated("run2", 2, {}, 40, x0=1.0, load=0.5))
ONE = Settings(method="gradient", starts=1)


def test_every_noise_level_is_known_from_its_own_output() -> None:
    table = sensitivity(pose(lag(), LOGS, ["mass", "std(speed)", "std(speed_rpm)"]))
    assert table.outputs == ("speed", "speed_rpm")
    np.testing.assert_allclose(table.share.sum(axis=0), 1.0)
    assert table.share[0, 1] > 0.6 and table.share[1, 2] > 0.6
    assert (table.std_joint >= table.std_alone * (1.0 - 1e-9)).all()


def test_an_output_that_is_not_measured_says_nothing() -> None:
    logs = [replace(log, y=np.where(np.arange(2)[:, None] == 1, np.nan, log.y)) for log in LOGS]
    table = sensitivity(pose(lag(), logs, ["mass", "drag"]))
    assert table.outputs == ("speed",)
    np.testing.assert_allclose(table.share, 1.0)


def test_predicted_uncertainty_is_that_of_the_estimate() -> None:
    problem = pose(lag(), LOGS, ["mass", "drag", "std(speed)"])
    fit = estimate(problem, ONE)
    table = sensitivity(problem, fit.point)
    np.testing.assert_allclose(table.std_joint, list(fit.std.values()), rtol=0.25)
    np.testing.assert_allclose(table.correlation, fit.correlation, atol=0.25)


def test_priors_and_silent_parameters_stand_in_the_table() -> None:
    known = FreeParameter("gain", 0.2, 5.0, 1.0, prior_mean=1.0, prior_std=0.05)
    table = sensitivity(pose(lag(), LOGS, ["mass", known, "colour"]))
    assert table.outputs[-1] == "prior"
    assert table.share[-1, 0] == 0.0 and table.share[-1, 1] > 0.0
    assert table.not_identifiable == (("colour",),)
    written = json.loads(json.dumps(table.to_dict(), allow_nan=False))
    assert written["parameters"]["colour"]["std_joint"] is None
    assert written["parameters"]["mass"]["correlation"]["mass"] == pytest.approx(1.0)


def test_a_point_at_which_the_model_diverges_is_refused() -> None:
    class Never(ExactLikelihood):
        def terms(self, filter_model: object, logs: object, batch: object) -> Terms:
            nothing = np.full((160, batch.theta.shape[1]), np.nan)
            return Terms(nothing, nothing)

    with pytest.raises(EstimationError, match="the model diverges there"):
        sensitivity(pose(lag(), LOGS, ["mass"], likelihood=Never()))


def test_innovations_at_the_estimate_are_consistent_and_fit_the_report() -> None:
    logs = [log.rows(log.time < 3.0) for log in LOGS]
    problem = pose(lag(substeps=2), logs, ["mass", "std(speed)"], likelihood=FilterLikelihood(compiled=False))
    fit = estimate(problem, ONE)
    runs = fitted_runs(fit, compiled=False)
    assert sum(one.nll for one in runs) == pytest.approx(fit.nll, rel=1e-9)
    summary = innovation_summary(runs)
    assert list(summary) == ["speed", "speed_rpm"]
    for channel in summary.values():
        assert set(channel) == {"rmse", "nis_mean", "nis_band", "whiteness_p", "unit"}
        low, high = channel["nis_band"]
        assert 0.8 * low < channel["nis_mean"] < 1.2 * high
    assert fit.filter_model.measurement_noise["speed"] == fit.values["std(speed)"]
    assert fit.to_dict(summary)["innovations"] == summary
