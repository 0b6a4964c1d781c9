"""Published results of filters, smoothers and sigma points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.filter.belief import Belief, Prediction, predict, update
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.online import OnlineFilter
from bondgraph.filter.runs import run
from bondgraph.filter.sigma_points import MerweScaled, lower_factor
from bondgraph.filter.smoother import smooth, smooth_step
from tests.verification import machines
from tests.verification.claims import Answer, Claim, Published, own, within

#: The filter in compiled form and in numpy; claims hold for both.
FORMS = (True, False)


def log_of(time: np.ndarray, *rows: np.ndarray) -> MatchedLog:
    """A log of these measurements, without inputs."""
    return MatchedLog("published", time, np.zeros((0, time.size)), np.array(rows))


def after_start(values: np.ndarray) -> np.ndarray:
    """Measurements of a run that predicts before its first: the sample at the start has none."""
    return np.concatenate([[np.nan], values])


# Random walks: the speed of a free mass.


def walking(process: float, noise: float, **settings: Any) -> FilterModel:
    return FilterModel(machines.free_mass(), {"v_cart": process}, {"speed": noise}, {"v_cart": 1.0}, **settings)


def steady_covariance(case: Published) -> Answer:
    model = walking(np.sqrt(case["inputs"]["Q"]), np.sqrt(case["inputs"]["R"]))
    log = log_of(np.arange(400.0), np.zeros(400))
    runs = [run(model, log, compiled=compiled) for compiled in FORMS]
    got = [[walk.predicted_cov[0, 0, -1], walk.filtered_cov[0, 0, -1]] for walk in runs]
    return Answer([case["expected"]["P_predicted"], case["expected"]["P_filtered"]], got)


def streamed(model: FilterModel, log: MatchedLog, x0: list[float] | None = None, compiled: bool = True) -> FilterRun:
    """The run of a filter that is given the samples one by one."""
    interval = float(np.median(np.diff(log.time)))
    return OnlineFilter(model, interval=interval, x0=x0, compiled=compiled).follow(log)


def redrawn_points(case: Published, run: Callable[..., FilterRun] = run) -> Answer:
    inputs, table = case["inputs"], case.table()
    model = walking(1.0, 1.0, **{name: inputs[name] for name in ("alpha", "beta", "kappa")})
    log = log_of(np.arange(table.size + 1.0), after_start(table["z"]))
    runs = [run(model, log, compiled=compiled) for compiled in FORMS]
    got = [[walk.filtered_mean[0, 1:], walk.filtered_cov[0, 0, 1:]] for walk in runs]
    return Answer([table["x"], table["P"]], got)


# Machines.


def cannonball(case: Published, run: Callable[..., FilterRun] = run) -> Answer:
    table = case.table()
    speed = 100.0 * np.sqrt(0.5)
    spread = {"x": 30.0, "v_along": np.sqrt(1e-3), "y": 30.0, "v_up": np.sqrt(1e-3)}
    model = FilterModel(machines.cannonball(case["inputs"]["g"]), {}, {"seen_x": 30.0, "seen_y": 30.0}, spread, alpha=1)
    time = case["inputs"]["dt"] * np.arange(table.size + 1.0)
    start = dict(zip(model.state_names, np.zeros(4), strict=True)) | {"v_along": speed, "v_up": speed}
    log = log_of(time, after_start(table["zx"]), after_start(table["zy"]))
    flights = [run(model, log, x0=list(start.values()), compiled=compiled) for compiled in FORMS]
    states = ("x", "v_along", "y", "v_up")
    rows = [model.state_names.index(name) for name in states]
    pairs = [(i, j) for i in range(4) for j in range(i, 4)]
    expected = [table[name] for name in ("x", "vx", "y", "vy")] + [table[f"P{i}{j}"] for i, j in pairs]
    got = [
        [*flight.filtered_mean[rows, 1:], *(flight.filtered_cov[rows[i], rows[j], 1:] for i, j in pairs)]
        for flight in flights
    ]
    return Answer(expected, got)


def constant_velocity(case: Published) -> Answer:
    inputs, table = case["inputs"], case.table()
    # Their process noise is that of a continuous one on the speed, of intensity 0.1, integrated over a step.
    spread = {"x": np.sqrt(inputs["P0"][0][0]), "v_cart": np.sqrt(inputs["P0"][1][1])}
    points = {name: inputs[name] for name in ("alpha", "beta", "kappa")}
    noise = {"place": np.sqrt(inputs["R"])}
    model = FilterModel(machines.cart(), {"v_cart": np.sqrt(0.1)}, noise, spread, **points)
    runs = [smooth(run(model, log_of(table["t"], table["z"]), compiled=compiled)) for compiled in FORMS]
    place, speed = (model.state_names.index(name) for name in ("x", "v_cart"))
    pairs = ((place, place), (place, speed), (speed, speed))
    got = [
        [*smoothed.smoothed_mean[[place, speed]], *(smoothed.smoothed_cov[i, j] for i, j in pairs)] for smoothed in runs
    ]
    return Answer([table[name] for name in ("x0", "x1", "P00", "P01", "P11")], got)


# The pendulum of Sarkka and Svensson.


def stepped(case: Published, points: MerweScaled) -> tuple[np.ndarray, np.ndarray, float]:
    """Filtered and smoothed angles (n,) and the log-likelihood: the published transition in the filter's steps."""
    inputs = case["inputs"]
    dt, gravity, noise = inputs["dt"], inputs["g"], np.array([[inputs["R"]]])
    beliefs = [Belief.of(np.array(inputs["m0"], float), np.array(inputs["P0"], float))]
    predictions: list[Prediction] = []
    log_likelihood = 0.0
    for measured in case.table()["y"]:
        predictions.append(
            predict(
                beliefs[-1],
                lambda x: np.array([x[0] + dt * x[1], x[1] - gravity * dt * np.sin(x[0])]),
                np.array(inputs["Q"]),
                points,
            )
        )
        updated = update(predictions[-1].belief, np.array([measured]), lambda x: np.sin(x[:1]), noise, points)
        beliefs.append(updated.belief)
        log_likelihood += updated.log_likelihood
    return np.array([belief.mean[0] for belief in beliefs[1:]]), smoothed_angles(beliefs, predictions), log_likelihood


def smoothed_angles(beliefs: Sequence[Belief], predictions: Sequence[Prediction]) -> np.ndarray:
    """Smoothed angles after the start, from the last one backwards."""
    mean, cov = beliefs[-1].mean, beliefs[-1].cov
    angles = [mean[0]]
    for belief, prediction in zip(beliefs[-2:0:-1], predictions[:0:-1], strict=True):
        ahead = prediction.belief
        mean, cov = smooth_step(belief.mean, belief.cov, prediction.cross_cov, ahead.mean, ahead.cov, mean, cov)
        angles.insert(0, mean[0])
    return np.array(angles)


def rmse(case: Published, angles: np.ndarray) -> float:
    return float(np.sqrt(np.mean((angles - case.table()["x1"]) ** 2)))


def unscented_pendulum(case: Published) -> Answer:
    filtered, smoothed, _ = stepped(case, MerweScaled(2, **case["inputs"]["ukf"]))
    expected = [case["expected"]["UKF"], case["expected"]["URTS"]]
    return Answer(expected, [rmse(case, filtered), rmse(case, smoothed)])


def cubature_pendulum(case: Published) -> Answer:
    # Cubature points are sigma points without the central one.
    filtered, smoothed, _ = stepped(case, MerweScaled(2, alpha=1.0, beta=0.0, kappa=0.0))
    return Answer([case["expected"]["CKF"], case["expected"]["CRTS"]], [rmse(case, filtered), rmse(case, smoothed)])


def pendulum_likelihood(case: Published) -> Answer:
    *_, log_likelihood = stepped(case, MerweScaled(2, **case["inputs"]["ukf"]))
    return Answer(case["extra"]["loglik_ukf_ours"], log_likelihood)


def integrated_pendulum(case: Published) -> Answer:
    inputs, table = case["inputs"], case.table()
    model = FilterModel(
        machines.pendulum(inputs["g"]),
        {"omega_bob": 0.1},  # their Q is that of a noise of intensity 0.01 on the speed, integrated over a step
        {"deflection": np.sqrt(inputs["R"])},
        {"angle": 1.0, "omega_bob": 1.0},
        **inputs["ukf"],
    )
    filtered = run(model, log_of(inputs["dt"] * np.arange(table.size + 1.0), after_start(table["y"])))
    smoothed = smooth(filtered).smoothed_mean[model.state_names.index("angle")]
    expected = [case["expected"]["UKF"], case["expected"]["URTS"]]
    return Answer(expected, [rmse(case, filtered.mean("angle")[1:]), rmse(case, smoothed[1:])])


# Sigma points.


def polar_mean(case: Published) -> Answer:
    (range_std, angle_std) = np.sqrt(np.diag(case["inputs"]["P"]))
    model = FilterModel(
        machines.polar(), {}, {"y1": 1.0}, {"r": range_std, "angle": angle_std}, alpha=1.0, beta=0.0, kappa=1.0
    )
    log = log_of(np.zeros(1), np.full(1, np.nan), np.full(1, np.nan))
    runs: list[FilterRun] = [run(model, log, x0=case["inputs"]["m"], compiled=compiled) for compiled in FORMS]
    return Answer(case["expected"]["mean"], [seen.output_mean[:, 0] for seen in runs])


def moments_of_points(case: Published) -> Answer:
    mean, cov = np.array(case["inputs"]["mean"], float), np.array(case["inputs"]["cov"])
    points = MerweScaled(4, alpha=0.5, beta=2.0, kappa=-1.0)
    moments = points.moments(points.draw(mean, lower_factor(cov).lower))
    expected = np.concatenate([mean, cov.ravel(), [1.0]])
    return Answer(expected, np.concatenate([moments.mean, moments.cov.ravel(), [points.mean_weights.sum()]]))


_SARKKA = "sarkka_pendulum_rmse"
_STEPS = (predict, update)

CLAIMS = (
    Claim(
        "scalar_random_walk_riccati", "steady variances", (run,), steady_covariance, within("abs"),
        ("P_predicted", "P_filtered"),
    ),
    Claim("filterpy_172_ukf_equals_kf", "means and variances", (run,), redrawn_points, within("abs")),
    Claim(
        "filterpy_172_ukf_equals_kf", "the same by the on-line filter", (OnlineFilter.step,),
        partial(redrawn_points, run=streamed), within("abs"),
    ),
    Claim("hipparchus_cannonball_zero_process_noise", "means and covariances", (run,), cannonball, within("abs")),
    Claim(
        "hipparchus_cannonball_zero_process_noise", "the same by the on-line filter", (OnlineFilter.step,),
        partial(cannonball, run=streamed), within("abs"),
    ),
    Claim("hipparchus_cv_rts", "smoothed means and covariances", (run, smooth), constant_velocity, within("abs")),
    Claim(
        _SARKKA, "unscented filter and smoother, RMSE", (*_STEPS, smooth_step), unscented_pendulum, within("abs"),
        ("UKF", "URTS"),
    ),
    Claim(
        _SARKKA, "cubature filter and smoother, RMSE", (*_STEPS, smooth_step), cubature_pendulum, within("abs"),
        ("CKF", "CRTS"),
    ),
    # Not published but recomputed with the case; sums 500 terms.
    Claim(_SARKKA, "log-likelihood (recomputed)", _STEPS, pendulum_likelihood, own(absolute=1e-9)),
    Claim(
        _SARKKA, "the same by FilterModel, RMSE", (run, smooth), integrated_pendulum, within("abs"),
        reason="the published transition is one Euler step of the pendulum; a FilterModel integrates its equations",
    ),
    Claim(
        _SARKKA, "other filters", covers=("EKF", "ERTS", "GHKF", "GHRTS", "IEKF", "IERTS", "IPLF", "IPLS"),
        reason="the toolkit has one filter, the unscented one; extended, Gauss-Hermite and iterated ones are not in it",
    ),
    Claim(
        _SARKKA, "particle filter", covers=("PF_montecarlo",),
        reason="the toolkit has no particle filter",
    ),
    Claim("julier_polar_to_cartesian", "mean", (run,), polar_mean, within("ukf_mean_abs"), ("mean",)),
    Claim(
        "julier_polar_to_cartesian", "covariance", covers=("cov_xx", "cov_yy"),
        reason="exact moments of the transformation; sigma points approximate them, with no published error",
    ),
    Claim(
        "filterpy_simplex_points_moments", "mean, covariance and sum of weights",
        (MerweScaled.draw, MerweScaled.moments), moments_of_points, within("abs"),
    ),
)  # fmt: skip
