"""Priors as distributions: densities are those of scipy, estimates the posterior of a linear Gaussian model."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.derivatives.exact import exact_expansion
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.priors import LogNormal, MultivariateNormal, Normal, Prior, Uniform
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings
from tests.estimate.linear import ExactLikelihood, lag, simulated

ONE = Settings(method="gradient", starts=1, gradient=GaussNewtonSettings(tolerance=1e-12))
LOGS = (simulated("run1", 1, {}), simulated("run2", 2, {}, x0=1.0, load=0.5))
MEAN, COVARIANCE = np.array([2.5, 2.0]), np.array([[0.09, 0.05], [0.05, 0.16]])
POSITIVE = st.floats(0.3, 4.0)


def value(prior: Prior, *values: float) -> float:
    return 0.5 * float(np.sum(prior.terms(np.array(values)[:, np.newaxis]) ** 2))


@given(POSITIVE, POSITIVE, POSITIVE, POSITIVE)
def test_differences_of_priors_are_those_of_the_densities_of_scipy(a: float, b: float, c: float, d: float) -> None:
    """Everything but the constant of a density."""
    normal, lognormal = Normal("m", 2.0, 0.5), LogNormal("m", 2.0, 0.5)
    assert value(normal, a) - value(normal, b) == pytest.approx(
        stats.norm.logpdf(b, 2.0, 0.5) - stats.norm.logpdf(a, 2.0, 0.5), abs=1e-9
    )
    density = stats.lognorm(0.5, scale=2.0)
    assert value(lognormal, a) - value(lognormal, b) == pytest.approx(density.logpdf(b) - density.logpdf(a), abs=1e-9)
    several = MultivariateNormal.of(("m", "n"), MEAN, COVARIANCE)
    density = stats.multivariate_normal(MEAN, COVARIANCE)
    expected = density.logpdf([c, d]) - density.logpdf([a, b])
    assert value(several, a, b) - value(several, c, d) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    logs = MultivariateNormal.of(("m", "n"), MEAN, COVARIANCE, ("log", "log"))
    assert value(logs, a, b) == pytest.approx(value(several, np.log(a), np.log(b)), rel=1e-12)


@pytest.mark.parametrize("prior", [LogNormal("m", 2.0, 0.5), MultivariateNormal.of(("m", "n"), MEAN, COVARIANCE),
                                   MultivariateNormal.of(("m", "n"), MEAN, COVARIANCE, ("linear", "log"))])  # fmt: skip
def test_slopes_of_priors_are_differences_of_their_terms(prior: Prior) -> None:
    at, step = np.array([1.3, 0.7])[: len(prior.names)], 1e-6
    moves = np.array([at + sign * step * row for row in np.eye(at.size) for sign in (1.0, -1.0)]).T
    terms = prior.terms(moves)
    np.testing.assert_allclose(prior.slopes(at), (terms[:, ::2] - terms[:, 1::2]) / (2.0 * step), rtol=1e-7, atol=1e-9)


def regression(priors: list[Prior]) -> tuple[EstimationProblem, np.ndarray, np.ndarray]:
    """Speed = x0 + gain * impulse / mass without drag: linear in gain and start. The problem, regressors, measured."""
    model = lag(process_noise={}, initial_std={}, measurement_noise={"speed": 0.05, "speed_rpm": 3.0}, substeps=1)
    time = np.arange(12) * 0.1
    force = 1.0 + 0.5 * np.sin(3.0 * time)
    impulse = np.concatenate([[0.0], np.cumsum(0.1 * force[:-1])])
    regressors = np.array([impulse / 2.0, np.ones(12)]).T
    measured = regressors @ [1.4, 0.3] + 0.05 * np.random.default_rng(2).normal(size=12)
    log = MatchedLog("coast", time, force[np.newaxis], np.array([measured, np.full(12, np.nan)]), {"drag": 0.0})
    likelihood = FilterLikelihood(compiled=False)
    free = ["gain", FreeParameter("x0(v)", -2.0, 2.0, 0.0)]
    return pose(model, log, free, initial="model", likelihood=likelihood, priors=priors), regressors, measured


def test_the_estimate_is_the_posterior_of_a_linear_gaussian_model() -> None:
    """Closed form: information and right-hand sides of data and prior add up."""
    mean, covariance = np.array([1.1, 0.1]), np.array([[0.02, -0.006], [-0.006, 0.004]])
    problem, regressors, measured = regression([MultivariateNormal.of(("gain", "x0(v)"), mean, covariance)])
    fit = estimate(problem, ONE)
    information = regressors.T @ regressors / 0.05**2 + np.linalg.inv(covariance)
    posterior = np.linalg.solve(information, regressors.T @ measured / 0.05**2 + np.linalg.solve(covariance, mean))
    np.testing.assert_allclose(list(fit.values.values()), posterior, rtol=1e-6)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(information), rtol=1e-3)


def test_a_stage_after_another_is_the_posterior_of_both() -> None:
    """Of a linear model the likelihood of the first stage is the prior of the second, exactly."""
    first, regressors, measured = regression([])
    stage = estimate(first, ONE).as_prior(("gain", "x0(v)"))
    second, _, _ = regression([stage])
    fit = estimate(second, ONE)
    information = 2.0 * regressors.T @ regressors / 0.05**2
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(information), rtol=1e-3)
    expected = np.linalg.lstsq(regressors, measured, rcond=None)[0]
    np.testing.assert_allclose(list(fit.values.values()), expected, rtol=1e-5)


def test_priors_are_exact_in_gradient_and_information() -> None:
    priors = [LogNormal("gain", 1.1, 0.2), MultivariateNormal.of(("mass", "drag"), MEAN, COVARIANCE)]
    problem = pose(lag(substeps=2), LOGS, ["mass", "drag", "gain"], initial="model", priors=priors)
    point = problem.start * np.array([1.05, 0.95, 1.0])
    found = exact_expansion(problem, point)
    (expected,) = central_differences(problem, point[:, np.newaxis], np.full((3, 1), 1e-5))
    assert found is not None
    np.testing.assert_allclose(found.gradient, expected.gradient, rtol=1e-6)
    np.testing.assert_allclose(found.information, expected.information, rtol=1e-6)
    plain = exact_expansion(pose(lag(substeps=2), LOGS, problem.free, initial="model"), point)
    added = found.information - plain.information
    gain = problem.names.index("gain")
    assert added[gain, gain] == pytest.approx((problem.slopes(point)[gain] / (0.2 * problem.values(point)[gain])) ** 2)
    slopes = problem.slopes(point)[:2]
    np.testing.assert_allclose(added[:2, :2] / np.outer(slopes, slopes), np.linalg.inv(COVARIANCE), rtol=1e-6)


def test_a_uniform_prior_is_bounds() -> None:
    problem = pose(lag(), LOGS, ["mass"], likelihood=ExactLikelihood(), priors=[Uniform("mass", 2.5, 3.5)])
    assert (problem.free[0].lower, problem.free[0].upper, problem.free[0].start) == (2.5, 3.5, 2.5)
    plain = pose(lag(), LOGS, ["mass"], likelihood=ExactLikelihood())
    np.testing.assert_array_equal(problem.nll(np.array([[2.7]])), plain.nll(np.array([[2.7]])))


REFUSED = {
    "not free": (Normal("gian", 1.0, 0.1), "prior of 'gian': it is not free; did you mean 'gain'"),
    "nothing left": (Uniform("gain", 100.0, 200.0), "leaves nothing of the bounds"),
    "two": (MultivariateNormal.of(("gain", "mass"), MEAN, COVARIANCE), "prior of 'mass': it has two"),
}


@pytest.mark.parametrize("case", REFUSED.values(), ids=REFUSED)
def test_contradicting_priors_are_refused(case: tuple[Prior, str]) -> None:
    with pytest.raises(EstimationError, match=case[1]):
        pose(lag(), LOGS, ["gain", "mass"], priors=[Normal("mass", 2.0, 0.1), case[0]])


@pytest.mark.parametrize("make", [
    lambda: Normal("m", 1.0, 0.0), lambda: LogNormal("m", -1.0, 0.1), lambda: Uniform("m", 2.0, 1.0),
    lambda: MultivariateNormal.of(("m", "n"), MEAN, np.ones((2, 2))),
    lambda: MultivariateNormal.of(("m",), MEAN, COVARIANCE),
])  # fmt: skip
def test_no_distributions_are_refused(make: object) -> None:
    with pytest.raises(EstimationError, match="prior of 'm"):
        make()  # type: ignore[operator]
