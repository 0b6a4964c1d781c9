"""Is the integration step short enough? A fixed step that is too long does not crash: it shifts the likelihood.

Two figures tell: the change of the negative log-likelihood when every step is halved, in nats, and the product of step
and fastest rate along the data. An explicit Runge-Kutta step of order 4 is stable up to a product of about 2.7, and
accurate well below 1. A change of less than 0.1 nats cannot move an estimate noticeably.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.likelihood import likelihood, run
from bondgraph.filter.samples import MeasuredLog, Samples
from bondgraph.simulate.arrays import FloatArray
from bondgraph.simulate.model import Model

#: Step times rate up to which the classical Runge-Kutta method is stable on the negative real axis.
STABLE = 2.78

#: A shift of the likelihood that does not matter, in nats.
NEGLIGIBLE = 0.1

#: Points along each log at which rates are looked at.
_POINTS = 40


@dataclass(frozen=True)
class DiscretisationError:
    """How much the integration step disturbs a likelihood.

    ``nats`` is the value with the steps as they are minus the value with half of them; ``step_times_rate`` the largest
    product of step and magnitude of an eigenvalue of the Jacobian along the filtered states.
    """

    nats: float
    step_times_rate: float
    substeps: int

    @property
    def negligible(self) -> bool:
        """Whether the likelihood is free of it for all purposes."""
        return abs(self.nats) < NEGLIGIBLE

    def __str__(self) -> str:
        verdict = "negligible" if self.negligible else "too large - use more substeps or a stiff method"
        unstable = "" if self.step_times_rate < STABLE else f", beyond the {STABLE} up to which the step is stable"
        return (
            f"with {self.substeps} substeps the likelihood is off by {self.nats:+.3g} nats ({verdict});"
            f" step times fastest rate is {self.step_times_rate:.3g}{unstable}"
        )


def discretisation_error(
    filter_model: FilterModel,
    logs: MeasuredLog | Sequence[MeasuredLog],
    theta: npt.ArrayLike | None = None,
    *,
    compiled: bool = True,
) -> DiscretisationError:
    """Discretisation error of the likelihood of logs at one set of parameters.

    Parameters
    ----------
    filter_model, logs
        As for :func:`bondgraph.filter.likelihood.likelihood`.
    theta
        Parameters (n_theta,); None: declared values.

    Returns
    -------
    DiscretisationError
        Infinite where the filter diverges.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1})
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> discretisation_error(swing, log, compiled=False).negligible
    True
    """
    listed = logs if isinstance(logs, Sequence) else (logs,)
    finer = replace(filter_model, substeps=2 * filter_model.substeps)
    coarse = likelihood(filter_model, listed, theta, compiled=compiled).nll[0]
    fine = likelihood(finer, listed, theta, compiled=compiled).nll[0]
    nats = float(coarse - fine) if np.isfinite(coarse) and np.isfinite(fine) else np.inf
    rates = [step_times_rate(run(filter_model, log, theta, compiled=compiled), log, theta) for log in listed]
    return DiscretisationError(nats, max(rates), filter_model.substeps)


def jacobian(model: Model, t: float, x: FloatArray, u: FloatArray, theta: FloatArray) -> FloatArray:
    """Derivative of the state equations with respect to the states, (n_x, n_x), by central differences."""
    step = np.cbrt(np.finfo(np.float64).eps) * np.maximum(np.abs(x), 1e-3)
    above = model.rhs(t, x[:, np.newaxis] + np.diag(step), u, theta)
    below = model.rhs(t, x[:, np.newaxis] - np.diag(step), u, theta)
    slopes: FloatArray = (above - below) / (2.0 * step)
    return slopes


def step_times_rate(filtered: FilterRun, log: MeasuredLog, theta: npt.ArrayLike | None) -> float:
    """Largest product of step and rate along one filtered log, at evenly chosen samples; infinite if it diverged."""
    filter_model = filtered.filter_model
    model = filter_model.model
    samples = Samples.of(filter_model, log)
    if samples.time.size < 2:
        return 0.0
    parameters = samples.theta(filter_model, np.array(model.theta() if theta is None else theta, dtype=np.float64))
    steps = np.diff(samples.time) / samples.substeps
    largest = 0.0
    for k in np.unique(np.linspace(0, steps.size - 1, _POINTS).astype(int)):
        state = filtered.filtered_mean[:, k]
        if not np.isfinite(state).all():
            return float("inf")
        known = parameters.copy()
        known[filter_model.appended_index] = state[len(model.states) :]
        with np.errstate(all="ignore"):  # what is not finite is told as infinite
            slopes = jacobian(model, float(samples.time[k]), state[: len(model.states)], samples.u[:, k], known)
        if not np.isfinite(slopes).all():
            return float("inf")
        largest = max(largest, float(steps[k] * np.max(np.abs(np.linalg.eigvals(slopes)), initial=0.0)))
    return largest
