"""Is the integration step short enough? A fixed step that is too long does not crash: it shifts the likelihood.

Two figures tell: the change of the negative log-likelihood when every step is halved, in nats, and the product of step
and fastest rate along the data. An explicit Runge-Kutta step of order 4 is stable up to a product of about 2.7, and
accurate well below 1. A change of less than 0.1 nats cannot move an estimate noticeably.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Unpack

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import FloatArray
from bondgraph.filter.batch import run_batches
from bondgraph.filter.choice import choose_method
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.members import MemberValues, per_log
from bondgraph.filter.rates import fastest_rates, looked_at
from bondgraph.filter.runs import prepared, run
from bondgraph.filter.samples import MeasuredLog, Samples
from bondgraph.simulate.model import Model

#: Step times rate up to which the classical Runge-Kutta method is stable on the negative real axis.
STABLE = 2.78

#: How many of the longest steps of a log are looked at.
LONGEST = 25

#: A shift of the likelihood that does not matter, in nats.
NEGLIGIBLE = 0.1


@dataclass(frozen=True)
class DiscretisationError:
    """How much the integration step disturbs a likelihood.

    ``nats`` is the value with the steps as they are minus the value with half of them; ``step_times_rate`` the largest
    product of step and magnitude of an eigenvalue of the Jacobian along the filtered states.
    """

    nats: float
    step_times_rate: float
    substeps: int
    method: str = "rk4"

    @property
    def negligible(self) -> bool:
        """Whether the likelihood is free of it for all purposes."""
        return abs(self.nats) < NEGLIGIBLE

    def __str__(self) -> str:
        verdict = "negligible" if self.negligible else "too large - use more substeps or a stiff method"
        stable = self.method != "rk4" or self.step_times_rate < STABLE
        unstable = "" if stable else f", beyond the {STABLE} up to which the step is stable"
        return (
            f"with {self.substeps} substeps of {self.method} the likelihood is off by {self.nats:+.3g} nats"
            f" ({verdict}); step times fastest rate is {self.step_times_rate:.3g}{unstable}"
        )


def discretisation_error(
    filter_model: FilterModel,
    logs: MeasuredLog | Sequence[MeasuredLog],
    theta: npt.ArrayLike | None = None,
    *,
    compiled: bool = True,
    **values: Unpack[MemberValues],
) -> DiscretisationError:
    """Discretisation error of the likelihood of logs at one set of parameters.

    Parameters
    ----------
    filter_model, logs
        As for :func:`bondgraph.filter.likelihood.likelihood`.
    theta
        Parameters (n_theta,); None: declared values.
    **values
        Numbers of that member, see :class:`bondgraph.filter.members.MemberValues`.

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
    used = choose_method(filter_model, listed, compiled=compiled)
    finer = used.with_halved_steps()
    coarse, fine = (_nll(steps, listed, theta, values, compiled) for steps in (used, finer))
    nats = coarse - fine if np.isfinite(coarse) and np.isfinite(fine) else np.inf
    x0 = per_log("x0", values.get("x0"), len(listed))
    initial_std = per_log("initial_std", values.get("initial_std"), len(listed))
    rates = []
    for i, log in enumerate(listed):
        own: MemberValues = {**values, "x0": x0[i], "initial_std": initial_std[i]}
        rates.append(step_times_rate(run(used, log, theta, compiled=compiled, **own), log, theta))
    return DiscretisationError(nats, max(rates), used.typical_substeps, used.method)


def _nll(
    filter_model: FilterModel,
    logs: Sequence[MeasuredLog],
    theta: npt.ArrayLike | None,
    values: MemberValues,
    compiled: bool,
) -> float:
    """The value of the first member over all logs; infinite where it diverged."""
    used, samples, batches = prepared(filter_model, logs, theta, values, compiled)
    return float(sum(one.verdicts.nll[0] for one in run_batches(used, samples, batches, 0, None, compiled)))


def jacobian(model: Model, t: float, x: FloatArray, u: FloatArray, theta: FloatArray) -> FloatArray:
    """Derivative of the state equations with respect to the states, (n_x, n_x)."""
    return model.jacobian_x(t, x, u, theta)


def step_times_rate(filtered: FilterRun, log: MeasuredLog, theta: npt.ArrayLike | None) -> float:
    """Largest product of step and rate along one filtered log; infinite if it diverged.

    Looked at are evenly chosen steps and the longest ones: an unevenly sampled log diverges where it is sampled least.
    """
    samples = Samples.of(filtered.filter_model, log)
    if samples.time.size < 2:
        return 0.0
    parameters = None if theta is None else np.array(theta, dtype=np.float64)
    steps = _longest_steps(samples)
    chosen = np.union1d(looked_at(samples), np.argsort(-steps, kind="stable")[:LONGEST])
    return float(np.max(fastest_rates(filtered, samples, parameters, chosen) * steps[chosen]))


def explicit_substeps(filtered: FilterRun, log: MeasuredLog, theta: npt.ArrayLike | None, product: float) -> float:
    """Uniform steps between samples that keep step times rate at or below a product along one filtered log."""
    samples = Samples.of(filtered.filter_model, log)
    if samples.time.size < 2:
        return 1.0
    parameters = None if theta is None else np.array(theta, dtype=np.float64)
    interval = float(np.median(np.diff(log.time)))
    return float(np.max(fastest_rates(filtered, samples, parameters))) * interval / product


def _longest_steps(samples: Samples) -> FloatArray:
    """Longest integration step between nodes, (m-1,), s."""
    ratio = np.maximum(samples.grading, 1.0 / samples.grading)
    # the longest of steps in geometric progression, as a share of their sum
    share = np.divide(
        1.0 - 1.0 / ratio, 1.0 - ratio**-samples.substeps.astype(np.float64),
        out=1.0 / samples.substeps, where=ratio != 1.0,
    )  # fmt: skip
    longest: FloatArray = np.diff(samples.time) * share
    return longest
