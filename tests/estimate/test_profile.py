"""Profiles by the exact gradient, likelihood ratios, and their tables."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.likelihood_profile import (
    LikelihoodProfile,
    likelihood_ratio,
    profile_frame,
    profile_likelihood,
    profile_table,
)
from bondgraph.estimate.pinned import constrained_minimum
from bondgraph.estimate.problem import pose
from bondgraph.estimate.result import Estimate
from bondgraph.report.profiles import ProfileAnswer
from tests.estimate.lag_covariance import covariance, one_sensor, pushed, unit_course
from tests.estimate.linear import ExactLikelihood, lag, simulated

ONE = Settings(method="gradient", starts=1, certify="none")


def of_gain() -> Estimate:
    """A gain of 1.1 is the estimate, its law is normal."""
    log = pushed()
    log.y[0] = 1.1 * unit_course(log)
    return estimate(pose(one_sensor(), log, [FreeParameter("gain", 0.2, 5.0, 1.5)], initial="model"), ONE)


def std_of_gain() -> float:
    course = unit_course(pushed())
    return float(1.0 / np.sqrt(course @ np.linalg.solve(covariance(pushed()), course)))


def test_the_profile_of_a_normal_law_is_a_parabola() -> None:
    (found,) = profile_likelihood(of_gain(), "gain")
    std = std_of_gain()
    np.testing.assert_allclose(found.interval, [1.1 - 1.959964 * std, 1.1 + 1.959964 * std], rtol=2e-3)
    np.testing.assert_allclose(found.deviance, ((found.values - 1.1) / std) ** 2, atol=1e-4)
    assert found.verdict == "" and not any(found.bounded)


def test_the_likelihood_ratio_of_a_value_is_its_squared_distance() -> None:
    found = likelihood_ratio(of_gain(), {"gain": 1.1 + 2.5 * std_of_gain()})
    assert found.statistic == pytest.approx(6.25, rel=1e-4) and found.degrees == 1
    assert found.p_value == pytest.approx(math.erfc(2.5 / math.sqrt(2.0)), rel=1e-3)


@pytest.fixture(scope="module")
def fit() -> Estimate:
    return estimate(pose(lag(), simulated("run", 3, {}, 60), ["mass", "drag"], likelihood=ExactLikelihood()), ONE)


def test_other_parameters_are_estimated_anew_under_a_held_value(fit: Estimate) -> None:
    mass = fit.values["mass"] + 2.0 * fit.std["mass"]
    found = likelihood_ratio(fit, {"mass": mass})
    drags = np.linspace(fit.values["drag"] - 0.5, fit.values["drag"] + 0.5, 2001)
    every = fit.problem.nll(np.array([np.full(drags.size, mass), [fit.problem.free[1].coordinate(d) for d in drags]]))
    assert found.statistic == pytest.approx(2.0 * (every.min() - fit.nll), abs=1e-3)
    assert found.values["drag"] == pytest.approx(float(drags[np.argmin(every)]), abs=2e-3)
    both = likelihood_ratio(fit, {"mass": mass, "drag": fit.values["drag"]})
    assert both.degrees == 2 and both.statistic >= found.statistic


def test_tables_and_pictures_of_several_profiles(fit: Estimate) -> None:
    profiles = profile_likelihood(fit)
    header, rows = profile_table(profiles)
    assert [row[0] for row in rows] == ["mass", "drag"] and all(len(row) == len(header) for row in rows)
    assert set(profile_frame(profiles)["parameter"]) == {"mass", "drag"}
    assert profiles[0].plot().get_xlabel() == "mass [kg]"


def test_the_curvature_of_a_logarithmic_scale_is_the_interval_of_the_estimate() -> None:
    """A level of noise, normal in its logarithm, counted as skewed beside an interval that no estimate shows."""
    log = pushed()
    log.y[0] = 1.1 * unit_course(log) + 0.1 * np.random.default_rng(3).standard_normal(log.y.shape[1])
    free = [FreeParameter("gain", 0.2, 5.0, 1.5), FreeParameter("std(speed)", 0.01, 1.0, 0.1, scale="log")]
    found = estimate(pose(one_sensor(), log, free, initial="model"), ONE)
    noise = profile_likelihood(found, "std(speed)")[0]
    np.testing.assert_allclose(noise.curvature, found.ci95["std(speed)"], rtol=1e-12)
    assert noise.verdict == ""
    (parabola,) = (line for line in noise.plot().get_lines() if line.get_label() == "covariance")
    end = np.interp(noise.curvature[1], *map(np.asarray, parabola.get_data()))
    assert end == pytest.approx(1.959964**2, rel=0.02)


def test_a_profile_that_finds_a_better_point_says_so(fit: Estimate) -> None:
    away = replace(fit, point=fit.point + np.array([0.0, 3.0 * fit.std["drag"]]))
    away = replace(away, nll=float(away.problem.nll(away.point[:, np.newaxis])[0]))
    (found,) = profile_likelihood(away, "mass")
    assert found.better == pytest.approx(away.nll - fit.nll, rel=0.2)
    assert "the estimate is no optimum" in " ".join(ProfileAnswer(away, (found,)).sentences())
    assert profile_likelihood(fit, "mass")[0].better == 0.0


def test_a_profile_that_the_curvature_does_not_tell_is_written_as_json() -> None:
    """Bounds of noises that logs give are numpy's, whose bool is none of JSON: the command ended after all its work."""
    found = of_gain()
    (profile,) = profile_likelihood(found)
    bounds = FreeParameter("gain", np.float64(profile.interval[0]), np.float64(5.0), 1.5)
    answer = ProfileAnswer(found, (replace(profile, std=math.nan, parameter=bounds),))
    told = json.loads(json.dumps(answer.to_dict()))["parameters"]["gain"]
    assert told["differs"] == [False, True] and told["curvature"] == [None, None]


def test_progress_counts_finished_profiles_and_they_come_back_from_files(fit: Estimate, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    mass, _ = profile_likelihood(fit, ["mass", "drag"], progress=lambda done, total: told.append((done, total)))
    assert told == [(0, 2), (1, 2), (2, 2)]
    again = LikelihoodProfile.load(mass.save(tmp_path / "mass.npz"))
    assert again.interval == mass.interval and profile_table([again]) == profile_table([mass])


@pytest.mark.parametrize(("nll", "name", "said"), [(0.0, "mas", "did you mean 'mass'"), (math.inf, "mass", "no likel")])
def test_impossible_profiles_are_refused(fit: Estimate, nll: float, name: str, said: str) -> None:
    with pytest.raises(EstimationError, match=said):
        profile_likelihood(replace(fit, nll=nll), name)


def test_held_coordinates_keep_the_exact_gradient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A profile fell back to differences, since what it searched was no estimation problem any more."""
    problem = pose(one_sensor(), pushed(), [FreeParameter("gain", 0.2, 5.0, 1.5), "std(speed)"], initial="model")
    searched = []

    def exact(objective: object, points: np.ndarray, steps: np.ndarray) -> object:
        searched.append(objective)
        return exact_derivatives(objective, points, steps)  # type: ignore[arg-type]

    found = constrained_minimum(problem, problem.start, {0: 1.0}, exact)  # type: ignore[arg-type]
    assert searched and all(one is problem for one in searched)
    other = constrained_minimum(problem, problem.start, {0: 1.0}, central_differences)
    assert found.point[0] == 1.0 and found.value == pytest.approx(other.value, abs=1e-4)


@pytest.mark.parametrize(
    ("given", "said"),
    [({}, "no values are given"), ({"mas": 2.0}, "did you mean 'mass'"), ({"mass": 99.0}, "lies outside its bounds")],
)
def test_impossible_wishes_are_refused(fit: Estimate, given: dict[str, float], said: str) -> None:
    with pytest.raises(EstimationError, match=said):
        likelihood_ratio(fit, given)
