"""A Kalman filter written for the tests, from the textbook formulas, for linear models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter.filter_model import FilterModel
from tests.filter.logs import PlainLog


@dataclass(frozen=True)
class KalmanRun:
    mean: FloatArray
    cov: FloatArray
    nll: float


def runge_kutta_map(filter_model: FilterModel, log: PlainLog, k: int, substeps: int) -> tuple[FloatArray, FloatArray]:
    """Matrix and offset of the affine map that Runge-Kutta steps make of a linear model over an interval."""
    model = filter_model.model
    theta = model.theta()
    start, end = log.time[k - 1], log.time[k]
    step = (end - start) / substeps

    def advance(x: FloatArray) -> FloatArray:
        for i in range(substeps):
            shares = [(i + offset) / substeps for offset in (0.0, 0.5, 1.0)]
            u = [log.u[:, k - 1] * (1 - share) + log.u[:, k] * share for share in shares]
            k1 = model.rhs(0.0, x, u[0], theta)
            k2 = model.rhs(0.0, x + step / 2 * k1, u[1], theta)
            k3 = model.rhs(0.0, x + step / 2 * k2, u[1], theta)
            k4 = model.rhs(0.0, x + step * k3, u[2], theta)
            x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return x

    n = len(model.states)
    offset = advance(np.zeros(n))
    return np.column_stack([advance(column) - offset for column in np.eye(n)]), offset


def kalman_run(filter_model: FilterModel, log: PlainLog, substeps: FloatArray) -> KalmanRun:
    model = filter_model.model
    n = len(model.states)
    h = np.column_stack([model.output(0.0, column, model.u0() * 0, model.theta()) for column in np.eye(n)])
    mean, cov = model.x0(), np.diag(filter_model.start_std**2)
    means, covs, nll = np.empty((n, log.time.size)), np.empty((n, n, log.time.size)), 0.0
    for k in range(log.time.size):
        if k > 0:
            f, offset = runge_kutta_map(filter_model, log, k, int(substeps[k - 1]))
            mean = f @ mean + offset
            cov = f @ cov @ f.T + np.diag(filter_model.process_std**2 * (log.time[k] - log.time[k - 1]))
        there = ~np.isnan(log.y[:, k])
        if there.any():
            hk, noise = h[there], np.diag(filter_model.noise_std[there] ** 2)
            s = hk @ cov @ hk.T + noise
            innovation = log.y[there, k] - hk @ mean
            gain = cov @ hk.T @ np.linalg.inv(s)
            mean, cov = mean + gain @ innovation, cov - gain @ s @ gain.T
            quadratic = innovation @ np.linalg.solve(s, innovation)
            nll += 0.5 * (quadratic + np.linalg.slogdet(s)[1] + there.sum() * np.log(2 * np.pi))
        means[:, k], covs[..., k] = mean, cov
    return KalmanRun(means, covs, nll)
