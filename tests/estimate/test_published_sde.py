"""A published maximum-likelihood estimate of a two-dimensional stochastic differential equation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from bondgraph.estimate.gauss_newton import GaussNewtonSettings, gauss_newton
from bondgraph.estimate.objective import SearchOutcome, Terms, central_differences
from bondgraph.estimate.uncertainty import UncertaintyOutcome, uncertainty


class OrnsteinUhlenbeck:
    """dx1 = a (m + u - x1) dt + s1 dw1, dx2 = b (x1 - x2) dt + s2 dw2, both measured; u held between samples.

    Coordinates: log a, m, log b, log s1, log s2, and the logarithms of the two measurement noises. Discretised exactly
    (Van Loan 1978, Computing integrals involving the matrix exponential, IEEE Trans. Automatic Control 23(3)).
    """

    def __init__(self, case: dict, folder: Path) -> None:
        table = np.genfromtxt(folder / case["data"], delimiter=",", names=True)[: case["inputs"]["rows"]]
        self.y, self.u = np.array([table["y1"], table["y2"]]), table["u"]
        self.step = float(table["t"][1] - table["t"][0])
        self.x0 = np.array(case["inputs"]["x0"], float)
        self.lower = np.array(case["inputs"]["bounds_lo"])
        self.upper = np.array(case["inputs"]["bounds_hi"])

    def terms(self, points: np.ndarray) -> Terms:
        pairs = [self._one(point) for point in points.T]
        return Terms(*(np.array(rows).T for rows in zip(*pairs, strict=True)))

    def nll(self, points: np.ndarray) -> np.ndarray:
        return self.terms(points).sums() + 0.5 * np.log(2.0 * np.pi) * self.y.size

    def _one(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, _, b, s1, s2, *noises = np.exp(point)
        level = point[1]
        drift = np.array([[-a, 0.0, a], [b, -b, 0.0], [0.0, 0.0, 0.0]])
        loan = np.zeros((4, 4))
        loan[:2, :2], loan[:2, 2:], loan[2:, 2:] = -drift[:2, :2], np.diag([s1**2, s2**2]), drift[:2, :2].T
        move, blocks = expm(drift * self.step), expm(loan * self.step)
        process = blocks[2:, 2:].T @ blocks[:2, 2:]
        mean, cov = self.x0.copy(), 0.1 * np.eye(2)
        z, s = np.zeros(self.y.shape), np.zeros(self.y.shape)
        for k in range(self.u.size):
            if k > 0:
                mean = move[:2, :2] @ mean + move[:2, 2] * (level + self.u[k - 1])
                cov = move[:2, :2] @ cov @ move[:2, :2].T + process
            for row in (0, 1):
                spread = cov[row, row] + noises[row] ** 2
                z[row, k], s[row, k] = (self.y[row, k] - mean[row]) / np.sqrt(spread), 0.5 * np.log(spread)
                mean = mean + cov[row] / spread * (self.y[row, k] - mean[row])
                cov = cov - np.outer(cov[row], cov[row]) / spread
        return z.ravel(), s.ravel()


def test_estimate_and_standard_deviations_are_those_published(shared_data: Path) -> None:
    folder = shared_data / "published"
    cases = json.loads((folder / "cases.json").read_text())["cases"]
    case = next(case for case in cases if case["id"] == "ctsmTMB_ou2d_lkf")
    problem, expected = OrnsteinUhlenbeck(case, folder), case["expected"]
    published = np.array(expected["par"])
    assert problem.nll(published[:, None])[0] == pytest.approx(expected["nll"], abs=1e-9)
    state = gauss_newton(problem, np.array(case["inputs"]["start"]), GaussNewtonSettings(tolerance=1e-12))
    point = state.points[:, 0]
    assert state.outcomes == (SearchOutcome.CONVERGED,)
    assert state.values[0] == pytest.approx(expected["nll"], abs=1e-6)
    # The data only say that the first measurement noise is small: its published standard deviation is 20489.
    told = np.arange(7) != 5
    np.testing.assert_allclose(point[told], published[told], atol=2e-4)
    (expansion,) = central_differences(problem, point[:, None], state.steps)
    known = uncertainty(problem, point, expansion)
    assert known.groups == ((5,),)
    assert known.outcome is UncertaintyOutcome.CURVATURE
    np.testing.assert_allclose(np.sqrt(np.diag(known.covariance))[told], np.array(expected["sd"])[told], rtol=0.03)
