"""Certified regressions: NIST Statistical Reference Datasets, nonlinear regression."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from bondgraph.estimate.objective import Expansion, SearchOutcome, Terms
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings, GaussNewtonState, gauss_newton
from bondgraph.estimate.uncertainty import uncertainty
from tests.verification.claims import Answer, Claim, Published, within

EXACT = GaussNewtonSettings(iterations=1000, tolerance=1e-15, difference=1e-5)

NAMES = (
    *("Bennett5", "BoxBOD", "Chwirut1", "Chwirut2", "DanWood", "ENSO", "Eckerle4", "Gauss1", "Gauss2", "Gauss3"),
    *("Hahn1", "Kirby2", "Lanczos1", "Lanczos2", "Lanczos3", "MGH09", "MGH10", "MGH17", "Misra1a", "Misra1b"),
    *("Misra1c", "Misra1d", "Nelson", "Rat42", "Rat43", "Roszman1", "Thurber"),
)
#: A line of this model is not in the file of cases; it is in NIST's.
ENSO = (
    "y = b1 + b2*cos(2*pi*x/12) + b3*sin(2*pi*x/12) + b5*cos(2*pi*x/b4) + b6*sin(2*pi*x/b4)"
    " + b8*cos(2*pi*x/b7) + b9*sin(2*pi*x/b7)"
)
FUNCTIONS = {name: getattr(np, name) for name in ("exp", "log", "cos", "sin", "arctan", "pi")}
#: From the first start of this one every descent ends in another minimum; of both starts the better is compared.
DECEPTIVE = "MGH17"
#: The data of this one are exact to 14 digits.
EXACT_DATA = "Lanczos1"
ROUNDED = (
    "residuals of 1e-13 between values near 1 are rounding in double precision; the certified ones are of 128 bits"
)


class Regression:
    """Residuals of a function over the certified noise, in a box ten times as wide as starts and answer span."""

    def __init__(self, data: dict[str, Any], case: Published) -> None:
        text = ENSO if data["name"] == "ENSO" else " ".join(data["model"]).replace("+  e", "").replace("+ e", "")
        sides = text.translate(str.maketrans("[]", "()")).split("=")
        self.left, self.right = (compile(side.strip(), "", "eval") for side in sides)
        table = case.table(data["data"])
        self.columns = {name: table[name][:, None] for name in table.dtype.names}
        self.noise = data["resid_sd"]
        known = np.array([data["certified"], data["start1"], data["start2"]])
        widest = 3.0 * np.abs(known).max(axis=0)
        self.lower = np.where((known > 0).all(axis=0), 0.1 * known.min(axis=0), -widest)
        self.upper = np.where((known < 0).all(axis=0), 0.1 * known.max(axis=0), widest)

    def terms(self, points: np.ndarray) -> Terms:
        names = FUNCTIONS | self.columns | {f"b{k + 1}": row for k, row in enumerate(points)}
        with np.errstate(all="ignore"):  # a search may try what overflows
            z = (eval(self.left, names) - eval(self.right, names)) / self.noise
        return Terms(z, np.zeros(z.shape))

    def nll(self, points: np.ndarray) -> np.ndarray:
        return self.terms(points).sums()

    def expansion(self, point: np.ndarray) -> Expansion:
        """Exact gradient and information at a point, by steps into the imaginary direction."""
        z = self.terms(point[:, None]).innovations[:, 0]
        moved = self.terms(point[:, None] + 1e-30j * np.eye(point.size)).innovations
        slopes = moved.imag / 1e-30
        return Expansion(slopes.T @ z, slopes.T @ slopes, point.size)


def dataset(case: Published, name: str) -> dict[str, Any]:
    return next(data for data in case["inputs"] if data["name"] == name)


def searched(problem: Regression, data: dict[str, Any]) -> GaussNewtonState:
    """The search from both starts, which must have converged where its ends are compared."""
    state = gauss_newton(problem, np.array([data["start1"], data["start2"]]).T, EXACT)
    assert all(state.outcomes[column] is SearchOutcome.CONVERGED for column in compared(state, data)), state.outcomes
    return state


def compared(state: GaussNewtonState, data: dict[str, Any]) -> list[int]:
    return [state.best] if data["name"] == DECEPTIVE else [0, 1]


def estimates(name: str, case: Published) -> Answer:
    data = dataset(case, name)
    problem = Regression(data, case)
    state = searched(problem, data)
    return Answer(data["certified"], state.points[:, compared(state, data)].T)


def squares(name: str, case: Published) -> Answer:
    data = dataset(case, name)
    problem = Regression(data, case)
    state = searched(problem, data)
    return Answer(data["rss"], 2.0 * state.values[compared(state, data)] * problem.noise**2)


def deviations(name: str, case: Published) -> Answer:
    data = dataset(case, name)
    problem = Regression(data, case)
    point = np.array(data["certified"])
    # NIST's are those of the linearised model, so the Fisher information is asked and not the curvature.
    known = uncertainty(problem, point, problem.expansion(point), curvature=False)
    return Answer(data["std"], np.sqrt(np.diag(known.covariance)))


def _claim(name: str, about: str, where: Any, answer: Callable[[str, Published], Answer]) -> Claim:
    reason = ROUNDED if (name, answer) == (EXACT_DATA, squares) else ""
    tolerance = within("rel", "relative")
    return Claim("nist_strd_nonlinear", f"{name}, {about}", where, partial(answer, name), tolerance, reason=reason)


CLAIMS = tuple(
    claim
    for name in NAMES
    for claim in (
        _claim(name, "parameters from both starts", (gauss_newton,), estimates),
        _claim(name, "residual sum of squares", (gauss_newton,), squares),
        _claim(name, "standard deviations at the certified parameters", (uncertainty,), deviations),
    )
)
