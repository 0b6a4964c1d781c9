"""Published maximum-likelihood estimates of noisy processes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.result import Estimate
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import likelihood
from tests.verification import machines
from tests.verification.claims import Answer, Claim, Published, own, within
from tests.verification.filters import FORMS, log_of

#: One gradient search from the published start, ended by nothing but rounding.
ONE_SEARCH = Settings(
    method="gradient", starts=1, certify="none", gradient=GaussNewtonSettings(iterations=200, tolerance=1e-12)
)


def search(problem: EstimationProblem) -> Estimate:
    """The estimate, which must have converged."""
    fit = estimate(problem, ONE_SEARCH)
    assert fit.outcome is SearchOutcome.CONVERGED, fit.outcome
    return fit


# Two-dimensional Ornstein-Uhlenbeck process (ctsmTMB): every parameter and noise level is free.

#: Free parameters in the order of the case; all but the level mu are searched as logarithms, as published.
FREE = ("theta", "mu", "alpha", "process(x1)", "process(x2)", "std(y_x1)", "std(y_x2)")
#: All but the noise of the first sensor, which the data do not tell: its published standard deviation is over 20000.
KNOWN = [k for k, name in enumerate(FREE) if name != "std(y_x1)"]
#: How often the steps over a sample of 0.1 s are cut in two. Each time leaves a sixteenth of the error of the nll,
#: which is 2e-8 after four, enough to search, and 5e-12 after seven.
COARSE, FINE = 4, 7


def process_problem(case: Published, halvings: int = COARSE) -> EstimationProblem:
    inputs, table = case["inputs"], case.table()[: case["inputs"]["rows"]]
    spread = np.sqrt(0.1)
    model = FilterModel(
        machines.ornstein_uhlenbeck(inputs["input_hold"] == "zero order"),
        {"x1": 1.0, "x2": 1.0},
        {"y_x1": 0.1, "y_x2": 0.1},
        {"x1": spread, "x2": spread},
        alpha=1.0,
    )
    for _ in range(halvings):
        model = model.with_halved_steps()
    log = MatchedLog("ctsmTMB", table["t"], table["u"][np.newaxis], np.array([table["y1"], table["y2"]]))
    rows = zip(FREE, inputs["bounds_lo"], inputs["bounds_hi"], inputs["start"], strict=True)
    return pose(model, log, [_free(*row) for row in rows], initial="model")


def _free(name: str, *coordinates: float) -> FreeParameter:
    if name == "mu":
        return FreeParameter(name, *coordinates)
    return FreeParameter(name, *np.exp(coordinates), scale="log")


def process_nll(case: Published) -> Answer:
    problem = process_problem(case, FINE)
    values = problem.values(np.array(case["expected"]["par"]))
    at = dict(zip(FREE, values, strict=True))
    model = replace(
        problem.filter_model,
        process_noise={name: at[f"process({name})"] for name in ("x1", "x2")},
        measurement_noise={name: at[f"std({name})"] for name in ("y_x1", "y_x2")},
    )
    theta = model.model.theta(**{name: at[name] for name in ("theta", "mu", "alpha")})
    got = [likelihood(model, problem.logs, theta, compiled=compiled).nll[0] for compiled in FORMS]
    return Answer(case["expected"]["nll"], got)


def process_nll_exact(case: Published) -> Answer:
    noted = case["checked"]["nll_exact_discretisation_minus_theirs"]
    return Answer(case["expected"]["nll"] + noted, process_nll(case).got)


def process_estimate(case: Published) -> Answer:
    return Answer(np.array(case["expected"]["par"])[KNOWN], search(process_problem(case)).point[KNOWN])


def process_deviations(case: Published) -> Answer:
    covariance = search(process_problem(case)).coordinate_covariance
    return Answer(np.array(case["expected"]["sd"])[KNOWN], np.sqrt(np.diag(covariance)[KNOWN]))


def process_correlations(case: Published) -> Answer:
    covariance = search(process_problem(case)).coordinate_covariance
    return Answer(
        *(_correlation(c[np.ix_(KNOWN, KNOWN)]) for c in (np.linalg.inv(case["expected"]["hessian"]), covariance))
    )


def process_unknown(case: Published) -> Answer:
    told = search(process_problem(case)).not_identifiable
    deviations = np.array(case["expected"]["sd"])
    return Answer(deviations > 1e3, [(name,) in told for name in FREE])


def _correlation(covariance: np.ndarray) -> np.ndarray:
    deviations = np.sqrt(np.diag(covariance))
    return covariance / np.outer(deviations, deviations)


# Local level of the Nile: a random walk seen through noise, nothing known of its start.

#: Standard deviation of the level at the start, of which a diffuse start is the limit: seven hundred times the noise of
#: a year, which leaves 1e-6 of its variance.
DIFFUSE = 1e5


def nile_fit(case: Published) -> Estimate:
    volume = case.table()["volume"]
    model = FilterModel(machines.free_mass(), {"v_cart": 30.0}, {"speed": 100.0}, {"v_cart": DIFFUSE}, alpha=1.0)
    free = [
        FreeParameter("std(speed)", 1.0, 1000.0, 10.0, scale="log"),
        FreeParameter("process(v_cart)", 1.0, 1000.0, 500.0, scale="log"),
    ]
    return search(pose(model, log_of(np.arange(float(volume.size)), volume), free, initial="measured"))


def nile_variances(case: Published) -> Answer:
    values = nile_fit(case).values
    expected = [case["expected"]["sigma2_eps"], case["expected"]["sigma2_eta"]]
    return Answer(expected, [values["std(speed)"] ** 2, values["process(v_cart)"] ** 2])


def nile_likelihood(case: Published) -> Answer:
    # The diffuse likelihood leaves out the density of the first value, at which the level is taken to start.
    fit = nile_fit(case)
    first = 0.5 * np.log(2.0 * np.pi * (DIFFUSE**2 + fit.values["std(speed)"] ** 2))
    return Answer(float(case["extra"]["statsmodels"][0]), first - fit.nll)


_ONE_STEP = (
    "the published covariance is one Runge-Kutta step of the moment equations per sample, which the case notes as"
    " inexact; a FilterModel carries sigma points, and more steps bring it to the exact one"
)


def _process(name: str) -> tuple[Claim, ...]:
    """Claims about an exactly discretised process."""
    return (
        Claim(name, "nll at the published optimum", (likelihood,), process_nll, within("nll"), ("nll",)),
        # Their search ended within 1e-9 of the least nll: with curvatures from 13 on that leaves 1e-5 in a coordinate.
        Claim(name, "estimate", (estimate,), process_estimate, own(absolute=1e-5), ("par",)),
        # Theirs is the curvature at the optimum, the toolkit's that over a third of a standard deviation.
        Claim(name, "standard deviations", (estimate,), process_deviations, own(relative=0.01), ("sd",)),
        Claim(name, "correlations", (estimate,), process_correlations, own(absolute=0.01), ("hessian",)),
        Claim(name, "parameter that the data do not tell", (estimate,), process_unknown),
    )


CLAIMS = (
    *_process("ctsmTMB_ou2d_lkf"),
    *_process("ctsmTMB_ou2d_lkf_foh"),
    *(
        claim
        for name in ("ctsmTMB_ou2d_ekf", "ctsmTMB_ou2d_ekf_foh")
        for claim in (
            Claim(
                name, "nll and estimate", (likelihood,), process_nll, within("nll"),
                ("nll", "par", "sd", "hessian"), _ONE_STEP,
            ),
            Claim(name, "nll, exact as the case notes", (likelihood,), process_nll_exact, within("nll")),
        )
    ),
    Claim(
        "nile_local_level", "variances", (estimate,), nile_variances, within("rel", "relative"),
        ("sigma2_eps", "sigma2_eta"),
    ),
    # Not published with the variances but computed by statsmodels; the start's variance is finite here.
    Claim("nile_local_level", "diffuse log-likelihood", (estimate,), nile_likelihood, own(absolute=1e-6)),
)  # fmt: skip
