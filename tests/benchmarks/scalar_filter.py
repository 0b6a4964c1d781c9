"""A filter as one would write it for numba: scalar equations with the functions of the mathematical library.

What the kernel with lanes is compared with. It computes the same likelihood for logs without gaps, one sigma point
after another.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.samples import MeasuredLog, Samples


def scalar_filter(
    filter_model: FilterModel, log: MeasuredLog, theta: np.ndarray, x0: np.ndarray
) -> Callable[[], float]:
    """A function without arguments that computes the negative log-likelihood."""
    functions = filter_model.model.compiled
    rhs, output = functions.rhs_into, functions.output_into
    samples, points = Samples.of(filter_model, log), filter_model.points
    q, r = filter_model.process_std**2, filter_model.noise_std**2

    @njit(error_model="numpy", fastmath={"contract"})
    def advance(t, h, steps, left, right, theta, x, k, total, stage, u):
        n = x.size
        step = h / steps
        for s in range(steps):
            for i in range(n):
                stage[i] = x[i]
                total[i] = 0.0
            for part in range(4):
                node = 0.0 if part == 0 else (1.0 if part == 3 else 0.5)
                for i in range(u.size):
                    u[i] = left[i] + (s + node) / steps * (right[i] - left[i])
                rhs(t + (s + node) * step, stage, u, theta, k)
                for i in range(n):
                    total[i] += (1.0 if part in (0, 3) else 2.0) * k[i]
                    stage[i] = x[i] + (step if part == 2 else 0.5 * step) * k[i]
            for i in range(n):
                x[i] += step / 6.0 * total[i]

    @njit(error_model="numpy", fastmath={"contract"})
    def moments(moved, weight, correction):
        deviations = moved[1:] - moved[0]
        shift = weight * deviations.sum(axis=0)
        return moved[0] + shift, weight * (deviations.T @ deviations) + correction * np.outer(shift, shift), deviations

    @njit(error_model="numpy", fastmath={"contract"})
    def run(time, u, left, right, y, substeps, theta, mean, std, q, r, spread, weight, correction):
        n, n_y = mean.size, y.shape[1]
        cov, nll = np.diag(std**2), 0.0
        work, inputs = np.empty((3, n)), np.empty(u.shape[1])
        points, outputs = np.empty((2 * n + 1, n)), np.empty((2 * n + 1, n_y))
        for k in range(time.size):
            for again in range(2 if k > 0 else 1):
                lower = np.linalg.cholesky(cov + 1e-18 * np.eye(n))
                points[0] = mean
                for j in range(n):
                    points[1 + j] = mean + spread * lower[:, j]
                    points[1 + n + j] = mean - spread * lower[:, j]
                if again == 0 and k > 0:
                    for p in range(2 * n + 1):
                        advance(
                            time[k - 1], time[k] - time[k - 1], substeps[k - 1], left[k - 1], right[k - 1], theta,
                            points[p], work[0], work[1], work[2], inputs,
                        )  # fmt: skip
                    mean, cov, _ = moments(points, weight, correction)
                    cov += np.diag(q) * (time[k] - time[k - 1])
            for p in range(2 * n + 1):
                output(time[k], points[p], u[k], theta, outputs[p])
            expected, innovation_cov, deviations = moments(outputs, weight, correction)
            innovation_cov += np.diag(r)
            half = (deviations[:n] - deviations[n:]) / (2.0 * spread)
            cross = lower @ half
            innovation = y[k] - expected
            gain = np.linalg.solve(innovation_cov, cross.T).T
            scaled = np.linalg.solve(innovation_cov, innovation)
            nll += 0.5 * (innovation @ scaled + np.log(np.linalg.det(innovation_cov)) + n_y * np.log(2.0 * np.pi))
            mean = mean + gain @ innovation
            cov = cov - gain @ innovation_cov @ gain.T
            cov = 0.5 * (cov + cov.T)
        return nll

    rows = [np.ascontiguousarray(part.T) for part in (samples.u, samples.u_left, samples.u_right, samples.y)]
    numbers = (theta, x0, filter_model.start_std, q, r, points.spread, points.weight, points.correction)
    return lambda: float(run(samples.time, *rows, samples.substeps, *numbers))
