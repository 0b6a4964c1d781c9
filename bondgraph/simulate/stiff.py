"""Fixed-step Rosenbrock methods in numpy, for one state or a batch: bounded steps where rates are fast.

| settings | method | use |
|---|---|---|
| ``Rosenbrock("ros2", substeps)`` | Verwer et al. (1999), order 2, L-stable, two slopes | sensitivities |
| ``Rosenbrock("ros3p", substeps)`` | Lang and Verwer (2001), order 3, A-stable, two slopes | search |
| ``Rosenbrock("rodas4", substeps)`` | Hairer and Wanner (1996), order 4, L-stable, six slopes | certification |

With ``grading`` each substep is that much longer than the one before it. Inputs bend at samples, and so a stiff state
relaxes anew after each: short first steps resolve that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.compile.rosenbrock import TABLEAUS, Tableau
from bondgraph.errors import OptionError, suggest
from bondgraph.simulate.inputs import InputSegment
from bondgraph.simulate.integrators import AbstractIntegrator, Equations, IntegratorState
from bondgraph.simulate.model import Model
from bondgraph.simulate.outcome import Outcome


@dataclass(frozen=True)
class ModelEquations:
    """The equations of a model with its parameters bound, and their derivatives."""

    model: Model
    theta: FloatArray

    def __call__(self, t: float, x: FloatArray, u: FloatArray) -> FloatArray:
        """dx/dt, shape (n_x, *batch)."""
        return self.model.rhs(t, x, u, self.theta)

    def jacobian(self, t: float, x: FloatArray, u: FloatArray) -> FloatArray:
        """Derivatives with respect to the states, shape (n_x, n_x, *batch)."""
        return self.model.jacobian_x(t, x, u, self.theta)

    def trend(self, t: float, x: FloatArray, u: FloatArray, slopes: FloatArray) -> FloatArray:
        """Derivatives with respect to time while inputs change at ``slopes`` (n_u,), shape (n_x, *batch)."""
        equations = self.model.program
        leaves = {"t": (t,), "x": x, "u": u, "theta": self.theta, "du": slopes}
        return equations.evaluate(equations.trend, leaves, x.shape[1:])


@dataclass(frozen=True)
class Rosenbrock(AbstractIntegrator):
    """A Rosenbrock method with a fixed number of steps.

    Parameters
    ----------
    method
        ``"ros2"``, ``"ros3p"`` or ``"rodas4"``.
    substeps
        Steps between neighbouring times.
    grading
        Length of each of these steps over that of the one before.

    Raises
    ------
    OptionError
        If the method is unknown or a number is out of range.

    Examples
    --------
    >>> fast = lambda t, x, u: -1e6 * (x - 1.0)
    >>> rest = InputSegment(0.0, 1.0, np.empty(0), np.empty(0))
    >>> x, _ = Rosenbrock("rodas4", 4).step(fast, rest, np.array([1.0]), IntegratorState(0.0, np.array([5.0])))
    >>> bool(abs(x[0, 0] - 1.0) < 1e-3)
    True
    """

    method: str = "ros3p"
    substeps: int = 4
    grading: float = 1.0

    def __post_init__(self) -> None:
        if self.method not in TABLEAUS:
            raise OptionError(
                f"stiff method {self.method!r} is not known{suggest(self.method, TABLEAUS)}"
                f" - choose {', '.join(TABLEAUS)}",
                where=(self.method,),
            )
        if self.substeps < 1 or not self.grading > 0:
            raise OptionError(f"substeps={self.substeps}, grading={self.grading!r}: both must be positive")

    def step(
        self, rhs: Equations, segment: InputSegment, times: FloatArray, state: IntegratorState
    ) -> tuple[FloatArray, IntegratorState]:
        """Advance with the same steps between all times; see the abstract class.

        ``rhs`` may have methods ``jacobian(t, x, u)`` and ``trend(t, x, u, slopes)``, as :class:`ModelEquations` has;
        else both are taken by central differences.
        """
        t, x = state.time, state.x
        values = np.empty((x.shape[0], times.size, *x.shape[1:]))
        with np.errstate(all="ignore"):  # what overflows is told by the outcome
            for k, end in enumerate(times):
                for length in step_lengths(float(end) - t, self.substeps, self.grading):
                    x = _one_step(TABLEAUS[self.method], rhs, segment, t, float(length), x)
                    t += float(length)
                values[:, k] = x
                t = float(end)
        outcome = state.outcome if np.isfinite(x).all() else Outcome.DIVERGED
        return values, IntegratorState(t, x, state.steps + self.substeps * times.size, outcome)


def step_lengths(length: float, substeps: int, grading: float) -> FloatArray:
    """Lengths of the steps of an interval, each ``grading`` times the one before.

    Examples
    --------
    >>> step_lengths(7.0, 3, 2.0).tolist()
    [1.0, 2.0, 4.0]
    """
    shares = grading ** np.arange(substeps, dtype=np.float64)
    lengths: FloatArray = length * shares / shares.sum()
    return lengths


def _one_step(
    tableau: Tableau, rhs: Equations, segment: InputSegment, t: float, step: float, x: FloatArray
) -> FloatArray:
    u = segment.at(t)
    slopes = (segment.right - segment.left) / (segment.end - segment.start)
    matrix = _matrix(_jacobian(rhs, t, x, u), 1.0 / (tableau.gamma * step))
    trend = _trend(rhs, t, x, u, slopes)
    stages: list[FloatArray] = []
    slope = np.empty(0)
    for s in range(tableau.stages):
        if tableau.is_new(s):
            point = x + sum(a * stage for a, stage in zip(tableau.a[s], stages, strict=True))
            now = t + tableau.alpha[s] * step
            slope = rhs(now, point, segment.at(now))
        right = slope + tableau.gammas[s] * step * trend
        right = right + sum(c / step * stage for c, stage in zip(tableau.c[s], stages, strict=True))
        stages.append(_solve(matrix, right))
    total: FloatArray = x + sum(m * stage for m, stage in zip(tableau.m, stages, strict=True))
    return total


def _matrix(jacobian: FloatArray, diagonal: float) -> FloatArray:
    """Diagonal minus Jacobian with the batch axes first, as numpy solves it."""
    moved = np.moveaxis(jacobian, (0, 1), (-2, -1))
    return diagonal * np.eye(jacobian.shape[0]) - moved


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solutions (n, *batch); nan where the matrix is singular or not finite."""
    columns = np.moveaxis(right, 0, -1)[..., np.newaxis]
    usable = np.isfinite(matrix).all(axis=(-2, -1)) & (np.abs(np.linalg.det(matrix)) > 0)
    safe = np.where(usable[..., np.newaxis, np.newaxis], matrix, np.eye(matrix.shape[-1]))
    solution = np.linalg.solve(safe, columns)[..., 0]
    solved: FloatArray = np.moveaxis(np.where(usable[..., np.newaxis], solution, np.nan), -1, 0)
    return solved


def _jacobian(rhs: Equations, t: float, x: FloatArray, u: FloatArray) -> FloatArray:
    if hasattr(rhs, "jacobian"):
        exact: FloatArray = rhs.jacobian(t, x, u)
        return exact
    columns = []
    for j in range(x.shape[0]):
        step = np.zeros_like(x)
        step[j] = np.cbrt(np.finfo(np.float64).eps) * np.maximum(np.abs(x[j]), 1e-3)
        columns.append((rhs(t, x + step, u) - rhs(t, x - step, u)) / (2.0 * step[j]))
    return np.stack(columns, axis=1)


def _trend(rhs: Equations, t: float, x: FloatArray, u: FloatArray, slopes: FloatArray) -> FloatArray:
    if hasattr(rhs, "trend"):
        exact: FloatArray = rhs.trend(t, x, u, slopes)
        return exact
    step = np.cbrt(np.finfo(np.float64).eps) * max(abs(t), 1e-3)
    change = rhs(t + step, x, u + step * slopes) - rhs(t - step, x, u - step * slopes)
    trend: FloatArray = change / (2.0 * step)
    return trend
