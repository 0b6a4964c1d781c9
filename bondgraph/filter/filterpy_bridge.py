"""The same filter as an object of filterpy, for comparison and for those who know it.

filterpy is an optional dependency. Version 2.0.0 or later is needed: earlier ones do not draw the sigma points anew
after the process noise is added (its issues 172 and 180), which shifts likelihoods and biases estimates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import FloatArray
from bondgraph.errors import FilterError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.members import MemberValues, member_batches
from bondgraph.filter.samples import MeasuredLog, Samples
from bondgraph.filter.ukf import Member, measurement, transition


@dataclass(frozen=True)
class FilterpyRun:
    """What filterpy gives for a log: filtered means (n_s, n), covariances (n_s, n_s, n), negative log-likelihood."""

    filtered_mean: FloatArray
    filtered_cov: FloatArray
    nll: float


def filterpy_filter(filter_model: FilterModel, theta: npt.ArrayLike | None = None) -> Any:
    """A ``filterpy.kalman.UnscentedKalmanFilter`` with the prior, noises and sigma points of a filter model.

    Its transition and measurement take keyword arguments, which :func:`filterpy_run` passes for every sample:
    ``fx(x, dt, move=...)`` and ``hx(x, measure=...)``, both functions of points (n_s, 1).

    Raises
    ------
    FilterError
        If filterpy 2.0.0 or later is not installed, or measurements are robust.
    """
    kalman = _import_filterpy()
    if filter_model.robust:
        raise FilterError(
            f"{filter_model.model.name}: filterpy has no robust={filter_model.robust.kind!r} - leave it out to compare",
            where=(filter_model.model.name, "robust"),
        )
    n_s, n_y = len(filter_model.state_names), len(filter_model.model.outputs)
    points = kalman.MerweScaledSigmaPoints(n_s, filter_model.alpha, filter_model.beta, filter_model.kappa)
    ukf = kalman.UnscentedKalmanFilter(n_s, n_y, dt=0.0, hx=_measure, fx=_move, points=points)
    parameters = np.array(filter_model.model.theta() if theta is None else theta, dtype=np.float64)
    ukf.x = filter_model.start_mean(parameters, filter_model.model.x0())
    member = Member.of(filter_model, parameters)
    ukf.P, ukf.R = member.initial_lower @ member.initial_lower.T, member.noise_cov
    return ukf


def filterpy_run(
    filter_model: FilterModel, log: MeasuredLog, theta: npt.ArrayLike | None = None, **values: Unpack[MemberValues]
) -> FilterpyRun:
    """Filter one log with filterpy; arguments as for :func:`bondgraph.filter.runs.run`.

    Samples where some channels are missing are updated with those that are there.

    Raises
    ------
    FilterError
        If filterpy 2.0.0 or later is not installed, or the log does not fit the model.
    """
    samples = Samples.of(filter_model, log)
    (batch,) = member_batches(filter_model, [samples], theta, values)
    member = batch.member(0)
    ukf = filterpy_filter(filter_model, member.theta)
    ukf.x = filter_model.start_mean(member.theta, member.x0)
    ukf.P = member.initial_lower @ member.initial_lower.T
    ukf.sigmas_f = ukf.points_fn.sigma_points(ukf.x, ukf.P)
    n = samples.time.size
    means, covs = np.empty((ukf.x.size, n)), np.empty((ukf.x.size, ukf.x.size, n))
    nll = 0.0
    for k in range(n):
        if k > 0:
            interval = float(samples.time[k] - samples.time[k - 1])
            ukf.P = ukf.P + member.process_cov * samples.noise_start[k - 1]
            ukf.Q = member.process_cov * samples.noise_end[k - 1]
            ukf.predict(dt=interval, move=transition(filter_model, samples, k, member.theta))
        nll -= _update(ukf, filter_model, samples, k, member)
        means[:, k], covs[..., k] = ukf.x, ukf.P
    return FilterpyRun(means[:, samples.sample], covs[..., samples.sample], nll)


def _update(ukf: Any, filter_model: FilterModel, samples: Samples, k: int, member: Member) -> float:
    """Update with the channels measured at sample ``k``; their log-likelihood."""
    measured = np.flatnonzero(~np.isnan(samples.y[:, k]))
    if not measured.size:
        ukf.update(None)
        return 0.0
    measure = measurement(filter_model, samples, k, member.theta)
    noise_cov = member.noise_cov[np.ix_(measured, measured)]
    ukf.update(samples.y[measured, k], R=noise_cov, measure=lambda points: measure(points)[measured])
    return float(ukf.log_likelihood)


def _move(x: FloatArray, dt: float, move: Any) -> FloatArray:
    moved: FloatArray = move(x[:, np.newaxis])[:, 0]
    return moved


def _measure(x: FloatArray, measure: Any) -> FloatArray:
    measured: FloatArray = measure(x[:, np.newaxis])[:, 0]
    return measured


def _import_filterpy() -> Any:
    try:
        import filterpy
        from filterpy import kalman
    except ImportError:
        raise FilterError("filterpy is not installed - install 'filterpy>=2.0.0' to compare with it") from None
    if int(filterpy.__version__.split(".")[0]) < 2:
        raise FilterError(
            f"filterpy {filterpy.__version__} does not draw the sigma points anew after the process noise is added"
            " - install 'filterpy>=2.0.0'"
        )
    return kalman
