"""Estimates: closed forms, recovery within stated intervals, resumption and what is reported."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError, OptionError
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.handover import distinct_starts, spread_starts
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.objective import SearchOutcome, TraceRow
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings
from bondgraph.estimate.solvers.particle_swarm import SwarmSettings, particle_swarm
from bondgraph.estimate.uncertainty import UncertaintyOutcome
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.example import pendulum
from tests.estimate.linear import ExactLikelihood, lag, simulated
from tests.lift import TRUE, lift, lift_logs

ONE = Settings(method="gradient", starts=1)
TRUTH = {"mass": 2.6, "drag": 2.2, "process": 0.15, "speed": 0.08}
FREE = ["mass", "drag", "std(speed)", "process(v)"]


def lag_problem(seed: int = 0, free: list | None = None, samples: int = 60) -> EstimationProblem:
    logs = [
        simulated("run1", seed, TRUTH, samples),
        simulated("run2", seed + 100, TRUTH, samples, x0=1.0, load=1.5),
        simulated("run3", seed + 200, TRUTH, samples, x0=-1.0),
    ]
    return pose(lag(), logs, free or FREE)


def truth_of(problem: EstimationProblem) -> np.ndarray:
    names = {"std(speed)": "speed", "process(v)": "process"}
    return np.array([TRUTH[names.get(name, name)] for name in problem.names])


def test_linear_gaussian_model_has_its_closed_form() -> None:
    # Without drag, process noise and initial uncertainty, speed is x0 + gain * impulse / mass: a regression on gain.
    model = lag(process_noise={}, initial_std={}, measurement_noise={"speed": 0.05, "speed_rpm": 3.0}, substeps=1)
    time = np.arange(12) * 0.1
    force = 1.0 + 0.5 * np.sin(3.0 * time)
    impulse = np.concatenate([[0.0], np.cumsum(0.1 * force[:-1])])
    measured = 1.4 * impulse / 2.0 + 0.05 * np.random.default_rng(2).normal(size=12)
    log = MatchedLog("coast", time, force[np.newaxis], np.array([measured, np.full(12, np.nan)]), {"drag": 0.0})
    problem = pose(model, log, ["gain"], initial="model", likelihood=FilterLikelihood(compiled=False))
    fit = estimate(problem, ONE)
    regressor = impulse / 2.0
    assert fit.values["gain"] == pytest.approx(float(regressor @ measured / (regressor @ regressor)), rel=1e-6)
    assert fit.std["gain"] == pytest.approx(0.05 / float(np.sqrt(regressor @ regressor)), rel=1e-4)
    assert fit.outcome is SearchOutcome.CONVERGED and fit.uncertainty_outcome is UncertaintyOutcome.CURVATURE


def test_truth_lies_within_the_stated_uncertainty() -> None:
    distances, inside = [], []
    for seed in range(16):
        problem = lag_problem(seed, samples=50)
        fit = estimate(problem, ONE)
        assert fit.outcome is SearchOutcome.CONVERGED
        error = np.array(list(fit.values.values())) - truth_of(problem)
        distances.append(float(error @ np.linalg.solve(fit.covariance, error)))
        inside += [
            low <= value <= high for (low, high), value in zip(fit.ci95.values(), truth_of(problem), strict=True)
        ]
    # The sum of 16 chi-square values of 4 degrees of freedom is within 29 to 113 in all but one of 10^4 trials.
    assert 29.0 < sum(distances) < 113.0
    assert np.mean(inside) > 0.85


def test_swarm_gradient_and_both_agree() -> None:
    problem = lag_problem(samples=30)
    fine = SwarmSettings(members=30, iterations=120, tolerance=1e-6)
    swarm = estimate(problem, Settings(method="pso", swarm=fine))
    gradient = estimate(problem, Settings(method="gradient", starts=2))
    both = estimate(problem, Settings(swarm=SwarmSettings(members=12, iterations=6), starts=2))
    assert [row.stage for row in both.trace].count("swarm") == 7 and both.trace[-1].stage == "gauss-newton"
    for fit in (swarm, gradient):
        assert fit.nll == pytest.approx(both.nll, abs=0.02)
        for name, value in both.values.items():
            assert fit.values[name] == pytest.approx(value, abs=0.2 * both.std[name])
            assert fit.std[name] == pytest.approx(both.std[name], rel=0.1)
    assert both.optima[0].starts == 2


def test_values_known_to_a_log_hold_there_only() -> None:
    # Freeing the payload must leave run2's, which it knows, alone: the others carry none.
    problem = lag_problem(3, ["mass", FreeParameter("load", 0.0, 3.0, 1.0)])
    mass_and_load = estimate(problem, ONE)
    assert mass_and_load.values["load"] < 0.5
    assert mass_and_load.not_identifiable == ()
    wrong = replace(problem, logs=tuple(replace(log, theta_overrides={}) for log in problem.logs))
    assert estimate(wrong, ONE).nll > mass_and_load.nll + 10.0


def test_a_pair_that_only_acts_together_is_named() -> None:
    # Mass, drag and gain only act as ratios.
    fit = estimate(lag_problem(1, ["mass", "drag", "gain", "std(speed)"], samples=40), ONE)
    alone = replace(lag_problem(1).logs[0], theta_overrides={})
    ratios = estimate(pose(lag(), alone, ["mass", "drag", "gain", "std(speed)"]), ONE)
    assert ratios.not_identifiable == (("mass", "drag", "gain"),)
    assert ratios.ci95["mass"] == (0.5, 8.0)
    assert np.isfinite(ratios.std["std(speed)"])
    # A log with a known payload gives the scale.
    assert fit.not_identifiable == ()


def test_a_parameter_without_effect_is_named_alone() -> None:
    fit = estimate(lag_problem(1, ["mass", "colour"], samples=30), ONE)
    assert fit.not_identifiable == (("colour",),)
    assert np.isfinite(fit.std["mass"]) and np.isnan(fit.std["colour"])


def test_a_prior_identifies_what_data_do_not() -> None:
    known = FreeParameter("colour", 0.5, 2.0, 1.0, prior_mean=1.2, prior_std=0.1)
    fit = estimate(lag_problem(1, ["mass", known], samples=30), ONE)
    assert fit.not_identifiable == ()
    assert (fit.values["colour"], fit.std["colour"]) == pytest.approx((1.2, 0.1), rel=1e-4)


def test_an_optimum_outside_the_bounds_is_said() -> None:
    fit = estimate(lag_problem(1, [FreeParameter("mass", 0.5, 2.0, 1.0), "drag"]), ONE)
    assert fit.at_bound == ("mass",) and fit.values["mass"] == 2.0
    assert fit.to_dict()["parameters"]["mass"]["at_bound"] is True
    assert fit.ci95["mass"][1] == 2.0


def test_result_has_the_agreed_form_and_is_json() -> None:
    fit = estimate(lag_problem(1, ["mass", "colour", "std(speed)", "x0(v)", "process(v)"], samples=30), ONE)
    innovations = {"speed": {"rmse": 0.1, "nis_mean": 1.0, "nis_band": [0.8, 1.2], "whiteness_p": 0.4}}
    result = json.loads(json.dumps(fit.to_dict(innovations), allow_nan=False))
    asked = {"parameters", "nll", "evaluations", "seconds", "innovations", "correlation", "not_identifiable", "outcome"}
    assert asked <= set(result)
    assert set(result["parameters"]["mass"]) == {"value", "unit", "std", "ci95", "bounds", "at_bound"}
    units = {name: entry["unit"] for name, entry in result["parameters"].items()}
    assert units == {"mass": "kg", "colour": "1", "std(speed)": "m/s", "x0(v)": "m/s", "process(v)": "(m/s)/s^0.5"}
    assert result["parameters"]["colour"]["std"] is None
    assert result["not_identifiable"] == [["colour"]]
    assert result["innovations"] == innovations
    assert result["correlation"]["mass"]["mass"] == pytest.approx(1.0)
    assert result["converged"] is True


def test_profiles_agree_with_wald_intervals_where_the_likelihood_is_a_parabola() -> None:
    fit = estimate(lag_problem(1, ["mass", "std(speed)", "colour"], samples=40), ONE)
    for name in ("mass", "std(speed)"):
        assert fit.profile(name) == pytest.approx(fit.ci95[name], rel=0.03)
    for name in ("colour", "masss"):
        with pytest.raises(EstimationError, match="is not an identified parameter"):
            fit.profile(name)


def same(first: object, second: object) -> None:
    assert first.trace == second.trace
    assert first.evaluations == second.evaluations
    assert first.values == second.values
    np.testing.assert_array_equal(first.covariance, second.covariance)


@pytest.mark.parametrize("stop_after", [1, 4, 9, 11])
def test_an_interrupted_estimation_continues_as_if_never_stopped(tmp_path: Path, stop_after: int) -> None:
    settings = Settings(swarm=SwarmSettings(members=10, iterations=6, patience=6, tolerance=0.0), starts=2, seed=5)
    straight = estimate(lag_problem(samples=25), settings)
    rows: list[TraceRow] = []

    def stop(row: TraceRow) -> None:
        rows.append(row)
        if len(rows) == stop_after:
            raise KeyboardInterrupt

    partial = estimate(lag_problem(samples=25), settings, progress=stop, folder=tmp_path)
    assert partial.outcome is SearchOutcome.INTERRUPTED
    assert partial.nll == rows[-1].nll and len(partial.trace) == stop_after
    resumed = estimate(lag_problem(samples=25), settings, folder=tmp_path, resume=True)
    same(resumed, straight)
    same(estimate(lag_problem(samples=25), settings, folder=tmp_path, resume=True), straight)


@pytest.mark.parametrize("stage", ["uncertainty", "certification"])
def test_an_interruption_after_the_search_keeps_what_it_found(stage: str) -> None:
    def stop(row: TraceRow) -> None:
        if row.stage == stage:
            raise KeyboardInterrupt

    whole = estimate(lag_problem(samples=25), ONE)
    fit = estimate(lag_problem(samples=25), ONE, progress=stop)
    assert fit.values == whole.values and fit.certification.checks == ()
    assert (fit.outcome is SearchOutcome.INTERRUPTED) == (stage == "uncertainty")
    assert all(np.isfinite(std) for std in fit.std.values())


def test_resuming_something_else_is_refused(tmp_path: Path) -> None:
    problem = lag_problem(samples=25)
    estimate(problem, ONE, folder=tmp_path)
    for other, settings in ((lag_problem(9, samples=25), ONE), (problem, replace(ONE, seed=1))):
        with pytest.raises(EstimationError, match="belongs to another estimation"):
            estimate(other, settings, folder=tmp_path, resume=True)
    with pytest.raises(OptionError, match="resume needs the folder"):
        estimate(problem, ONE, resume=True)
    (tmp_path / "checkpoint.npz").write_bytes(b"broken")
    with pytest.raises(EstimationError, match=r"cannot be read .* delete it to start anew"):
        estimate(problem, ONE, folder=tmp_path, resume=True)


def test_without_a_checkpoint_resume_starts_anew(tmp_path: Path) -> None:
    problem = lag_problem(samples=25)
    same(estimate(problem, ONE, folder=tmp_path / "new", resume=True), estimate(problem, ONE))


def test_a_model_that_always_diverges_gives_an_outcome() -> None:
    class Never(ExactLikelihood):
        def nll(self, filter_model: object, logs: object, batch: object) -> np.ndarray:
            return np.full(batch.theta.shape[1], np.inf)

    problem = replace(lag_problem(samples=25), likelihood=Never())
    for settings in (ONE, Settings(swarm=SwarmSettings(members=4, iterations=3))):
        fit = estimate(problem, settings)
        assert fit.outcome is SearchOutcome.NO_FINITE_POINT
        result = json.loads(json.dumps(fit.to_dict(), allow_nan=False))
        assert result["nll"] is None and result["converged"] is False


def test_unknown_methods_are_refused() -> None:
    with pytest.raises(OptionError, match="method 'psoo' is not known; did you mean 'pso'"):
        Settings(method="psoo")  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="starts = 0 must be at least 1"):
        Settings(starts=0)


def test_starts_are_spread_or_taken_from_the_swarm() -> None:
    problem = lag_problem(samples=25)
    spread = spread_starts(problem, 5, seed=1)
    np.testing.assert_array_equal(spread[:, 0], problem.start)
    near = np.where(problem.noise_levels, np.log(100.0), np.inf)  # levels scatter within a factor of 100
    lower, upper = np.maximum(problem.lower, problem.start - near), np.minimum(problem.upper, problem.start + near)
    shares = (spread[:, 1:] - lower[:, None]) / (upper - lower)[:, None]
    np.testing.assert_array_equal(np.sort(np.floor(4.0 * shares), axis=1), np.tile(np.arange(4.0), (4, 1)))
    state, _ = particle_swarm(problem, problem.start, 1, SwarmSettings(members=10, iterations=3))
    starts = distinct_starts(problem, state.personal_best, state.personal_best_nll, 3)
    np.testing.assert_array_equal(starts[:, 0], state.swarm_best)
    assert starts.shape == (4, 3)


def test_the_compiled_filter_recovers_a_pendulum_from_several_logs() -> None:
    model = pendulum()
    truth = {"length": 1.3, "damping": 0.4}
    rng = np.random.default_rng(8)
    logs = []
    for number, (angle, rate) in enumerate([(0.5, 0.0), (-0.3, 1.0), (0.0, 1.5)]):
        time = np.arange(120) * 0.05
        x, theta = np.array([angle, rate]), model.theta(**truth)
        path = []
        for _ in time:
            path.append(float(model.output(0.0, x, model.u0(), theta)[0]))
            for _ in range(10):
                middle = x + 0.0025 * model.rhs(0.0, x, model.u0(), theta)
                x = x + 0.005 * model.rhs(0.0, middle, model.u0(), theta)
            x[1] += 0.02 * np.sqrt(0.05) * rng.normal()
        y = np.array(path) + 0.03 * rng.normal(size=time.size)
        logs.append(MatchedLog(f"swing{number}", time, np.zeros((1, time.size)), y[np.newaxis]))
    swing = FilterModel(model, {"rate": 0.02}, {"deflection": 0.1}, {"angle": 0.6, "rate": 1.5}, substeps=2)
    free = ["length", "damping", "std(deflection)"]
    settings = Settings(swarm=SwarmSettings(members=16, iterations=8), gradient=GaussNewtonSettings(), starts=2, seed=1)
    fits = [estimate(pose(swing, logs, free, likelihood=FilterLikelihood(threads=n)), settings) for n in (1, 3)]
    same(*fits)
    for name, value in (truth | {"std(deflection)": 0.03}).items():
        assert abs(fits[0].values[name] - value) < 3.5 * fits[0].std[name]
    assert fits[0].std["length"] < 0.02


@pytest.mark.parametrize("seed", [0, 6])
def test_an_estimate_finds_the_period_of_what_swings(seed: int) -> None:
    """By default one ended a thousand nats behind: 790 kN/m, where 400 kN/m is true."""
    found = bg.estimate(bg.build(lift()), lift_logs(seed))
    assert abs(found.values["k"] - TRUE["k"]) < 4.0 * found.std["k"] < 0.05 * TRUE["k"]
