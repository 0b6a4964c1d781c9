"""The same filter as an object of filterpy, for comparison and for those who know it.

filterpy is an optional dependency. Version 2.0.0 or later is needed: earlier ones do not draw the sigma points anew
after the process noise is added (its issues 172 and 180), which shifts likelihoods and biases estimates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import FloatArray
from bondgraph.errors import FilterError, require_kind
from bondgraph.filter.belief import PointFunction
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.members import MemberValues, member_batches
from bondgraph.filter.online_given import given_member
from bondgraph.filter.samples import MeasuredLog, Samples, uniform_steps
from bondgraph.filter.sigma_points import lower_factor
from bondgraph.filter.ukf import Member, measured_at, measurement, moved_along, transition
from bondgraph.simulate.inputs import InputSegment

if TYPE_CHECKING:
    from bondgraph.simulate.task import Vector

#: Inputs of a model (n_u,) or some by name, the others at their defaults.
Inputs = Mapping[str, float | str] | npt.ArrayLike | None


@dataclass(frozen=True)
class FilterpyRun:
    """What filterpy gives for a log: filtered means (n_s, n), covariances (n_s, n_s, n), negative log-likelihood."""

    filtered_mean: FloatArray
    filtered_cov: FloatArray
    nll: float


class _Functions:
    """Transition and measurement of a filter model as filterpy calls them, point by point."""

    def __init__(self, filter_model: FilterModel, theta: FloatArray, dt: float, u: Inputs) -> None:
        self._filter_model, self._theta, self._dt, self.u = filter_model, theta, dt, u
        self._used = np.flatnonzero(~np.isnan(filter_model.noise_std))

    def check(self) -> None:
        """Refuse inputs that do not fit the model, before the first prediction does."""
        self._inputs(None)

    def move(self, x: FloatArray, dt: float, u: Inputs = None, u_end: Inputs = None, t: float = 0.0) -> FloatArray:
        """A point (n_s,) after ``dt``, inputs held at ``u`` or running straight from there to ``u_end``."""
        begin = self._inputs(u)
        segment = InputSegment(t, t + dt, begin, begin if u_end is None else self._inputs(u_end))
        steps = uniform_steps(self._filter_model, np.array([dt / self._dt]))
        own = (int(steps.substeps[0]), float(steps.grading[0]))
        moved: FloatArray = moved_along(self._filter_model, segment, *own, self._theta)(x[:, np.newaxis])[:, 0]
        return moved

    def measure(self, x: FloatArray, u: Inputs = None, t: float = 0.0) -> FloatArray:
        """The outputs that are used of a point (n_s,), shape (n_used,)."""
        every = measured_at(self._filter_model, t, self._inputs(u), self._theta)(x[:, np.newaxis])
        measured: FloatArray = every[self._used, 0]
        return measured

    def _inputs(self, given: Inputs) -> FloatArray:
        model, known = self._filter_model.model, self.u if given is None else given
        if known is None or isinstance(known, Mapping):
            return model.u0(**(known or {}))
        u = np.array(known, dtype=np.float64)
        if u.shape != (len(model.inputs),):
            raise FilterError(
                f"{model.name}: inputs of shape {u.shape} - give {len(model.inputs)} numbers in the order"
                f" {', '.join(model.names('input'))}, or some by name",
                where=(model.name, "u"),
            )
        return u


def filterpy_filter(filter_model: FilterModel, dt: float, theta: Vector = None, u: Inputs = None) -> Any:
    """A ``filterpy.kalman.UnscentedKalmanFilter`` of a filter model, for scripts that are written for filterpy.

    ``predict()``, ``predict(dt)``, ``update(z)``, ``batch_filter`` and ``rts_smoother`` work as in any such script.
    Measurements are the outputs that the filter model uses, in the order of the model. Transition and measurement take
    keyword arguments: ``predict(u=..., u_end=..., t=...)`` and ``update(z, u=..., t=...)`` with inputs (n_u,) or some
    by name, held over the step or running straight to ``u_end``, and the time where the equations depend on it.
    Without a prediction before it, the first measurement is used at the time of the prior, as in a run of the toolkit.

    Process noise enters as a whole at the end of a step, as filterpy has it and ``noise_scheme="sampled"`` too: ``Q``
    is that of a step of ``dt``. For a step of another length set ``ukf.Q = step * ukf.noise_per_second`` before it.

    Parameters
    ----------
    filter_model
        Model, noises and sigma points. Longer steps than ``dt`` get proportionally more of its integration steps.
    dt
        Seconds of a step where ``predict`` is given none.
    theta
        Parameters by name or as a vector (n_theta,); None: declared values.
    u
        Inputs where a call gives none; None: their defaults.

    Raises
    ------
    FilterError, ModelError
        If filterpy 2.0.0 or later is not installed, measurements are robust, the integration method is not decided,
        ``dt`` is no positive number, a name is unknown, or a shape does not fit.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> ukf = filterpy_filter(swing, dt=0.05)
    >>> for z in (0.02, 0.05, 0.03):
    ...     ukf.predict()
    ...     ukf.update(z)
    >>> ukf.x.shape, round(float(ukf.log_likelihood), 1)
    ((2,), 1.7)
    """
    kalman = _import_filterpy()
    _refuse(filter_model, dt)
    member = given_member(filter_model, theta, None)
    functions = _Functions(filter_model, member.theta, dt, u)
    functions.check()
    n_s, n_z = len(filter_model.state_names), len(filter_model.measurement_noise)
    spread = (filter_model.alpha, filter_model.beta, filter_model.kappa)
    points = kalman.MerweScaledSigmaPoints(n_s, *spread, sqrt_method=_upper_factor)
    ukf = kalman.UnscentedKalmanFilter(n_s, n_z, dt=dt, hx=functions.measure, fx=functions.move, points=points)
    used = np.flatnonzero(~np.isnan(filter_model.noise_std))
    ukf.R = member.noise_cov[np.ix_(used, used)]
    ukf.noise_per_second = member.process_cov
    ukf.Q = dt * member.process_cov
    ukf.x = filter_model.start_mean(member.theta, member.x0)
    ukf.P = member.initial_lower @ member.initial_lower.T
    ukf.sigmas_f = ukf.points_fn.sigma_points(ukf.x, ukf.P)
    return ukf


def _upper_factor(matrix: FloatArray) -> FloatArray:
    """Upper factor of a covariance as filterpy's own; states that are known exactly make one singular."""
    try:
        return np.asarray(np.linalg.cholesky(matrix).T, dtype=np.float64)
    except np.linalg.LinAlgError:
        return lower_factor(matrix).lower.T


def _refuse(filter_model: FilterModel, dt: float) -> None:
    require_kind("filterpy_filter", filter_model, FilterModel, "filter model")
    name = filter_model.model.name
    if filter_model.robust:
        raise FilterError(
            f"{name}: filterpy has no robust={filter_model.robust.kind!r} - leave it out to compare",
            where=(name, "robust"),
        )
    if filter_model.method == "auto":
        raise FilterError(
            f"{name}: the integration method 'auto' is decided by logs - give choose_method(filter_model, logs)",
            where=(name, "method"),
        )
    if not (math.isfinite(dt) and dt > 0.0):
        raise FilterError(f"{name}: dt = {dt!r} - give the seconds of a step, above zero", where=(name, "dt"))


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
    ukf = filterpy_filter(filter_model, 1.0, member.theta)
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
            ukf.predict(dt=interval, fx=_pointwise(transition(filter_model, samples, k, member.theta)))
        nll -= _update(ukf, filter_model, samples, k, member)
        means[:, k], covs[..., k] = ukf.x, ukf.P
    return FilterpyRun(means[:, samples.sample], covs[..., samples.sample], nll)


def _update(ukf: Any, filter_model: FilterModel, samples: Samples, k: int, member: Member) -> float:
    """Update with the channels measured at sample ``k``; their log-likelihood."""
    measured = np.flatnonzero(~np.isnan(samples.y[:, k]))
    if not measured.size:
        ukf.update(None)
        return 0.0
    measure = _pointwise(measurement(filter_model, samples, k, member.theta))
    noise_cov = member.noise_cov[np.ix_(measured, measured)]
    ukf.update(samples.y[measured, k], R=noise_cov, hx=lambda x: measure(x)[measured])
    return float(ukf.log_likelihood)


def _pointwise(function: PointFunction) -> Callable[..., FloatArray]:
    """A function of points (n_s, 1) as filterpy calls it, of one (n_s,)."""

    def one(x: FloatArray, *_: float) -> FloatArray:
        found: FloatArray = function(x[:, np.newaxis])[:, 0]
        return found

    return one


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
