"""The unscented Kalman filter over a log, in plain numpy: the readable form of what ``kernel.py`` compiles.

The prior is the belief at the time of the first sample: that sample is used without a prediction. Before every later
sample comes a prediction from node to node, see :mod:`bondgraph.filter.noise_nodes`. Sigma points are drawn from the
belief after the process noise was added, and again from the belief after the measurement (filterpy >= 2.0.0 does the
same).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter.belief import Belief, PointFunction, Prediction, Update, predict, update
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.samples import Samples
from bondgraph.simulate.inputs import InputSegment
from bondgraph.simulate.integrators import RK4
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.stiff import ModelEquations, Rosenbrock


@dataclass(frozen=True)
class Member:
    """One set of numbers to filter with.

    theta (n_theta,), x0 (n_x,), initial_std and process_std (n_s,), noise_std (n_y,), NaN where an output is not used;
    correlations of initial state and process noise (n_s, n_s) and of the sensors (n_y, n_y).
    """

    theta: FloatArray
    x0: FloatArray
    initial_std: FloatArray
    process_std: FloatArray
    noise_std: FloatArray
    initial_correlation: FloatArray
    process_correlation: FloatArray
    noise_correlation: FloatArray

    @classmethod
    def of(cls, filter_model: FilterModel, theta: FloatArray | None = None, x0: FloatArray | None = None) -> Member:
        """The numbers that a filter model declares; theta (n_theta,) and x0 (n_x,) may be others.

        Examples
        --------
        >>> from bondgraph.simulate.example import pendulum
        >>> Member.of(FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1})).process_cov.tolist()
        [[0.0, 0.0], [0.0, 0.010000000000000002]]
        """
        model = filter_model.model
        known = model.theta() if theta is None else theta
        return cls(
            known, model.x0(known) if x0 is None else x0,
            filter_model.start_std, filter_model.process_std, filter_model.noise_std,
            filter_model.start_correlations, filter_model.process_correlations, filter_model.noise_correlations,
        )  # fmt: skip

    @functools.cached_property
    def process_cov(self) -> FloatArray:
        """Covariance per second of the process noise, (n_s, n_s)."""
        return scaled(self.process_correlation, self.process_std)

    @functools.cached_property
    def noise_cov(self) -> FloatArray:
        """Covariance of the sensors' noise, (n_y, n_y); zero for outputs that are not used."""
        return scaled(self.noise_correlation, np.nan_to_num(self.noise_std))

    @functools.cached_property
    def initial_lower(self) -> FloatArray:
        """Lower factor of the covariance of the initial state, (n_s, n_s)."""
        lower: FloatArray = self.initial_std[:, np.newaxis] * np.linalg.cholesky(self.initial_correlation)
        return lower


def scaled(correlation: FloatArray, std: FloatArray) -> FloatArray:
    """Covariance (k, k, *batch) of a correlation and standard deviations (k, *batch).

    Examples
    --------
    >>> scaled(np.array([[1.0, 0.5], [0.5, 1.0]]), np.array([1.0, 4.0]))
    array([[ 1.,  2.],
           [ 2., 16.]])
    """
    cov: FloatArray = correlation * (std[:, np.newaxis] * std[np.newaxis])
    return cov


def transition(filter_model: FilterModel, samples: Samples, k: int, theta: FloatArray) -> PointFunction:
    """Moves points of the filter's state over the step that ends at node ``k``; appended parameters stay."""
    steps = (int(samples.substeps[k - 1]), float(samples.grading[k - 1]))
    return moved_along(filter_model, samples.segment(k), *steps, theta)


def moved_along(
    filter_model: FilterModel, segment: InputSegment, substeps: int, grading: float, theta: FloatArray
) -> PointFunction:
    """Moves points of the filter's state along a segment of the inputs, with so many steps."""
    model = filter_model.model
    n_x = len(model.states)
    stiff = filter_model.is_stiff
    integrator = Rosenbrock(filter_model.method, substeps, grading) if stiff else RK4(substeps)

    def move(points: FloatArray) -> FloatArray:
        parameters = _point_parameters(filter_model, points, theta)

        rhs = ModelEquations(model, parameters)
        state = integrator.init(segment.start, points[:n_x])
        moved, _ = integrator.step(rhs, segment, np.array([segment.end]), state)
        return np.vstack([moved[:, 0], points[n_x:]])

    return move


def measurement(filter_model: FilterModel, samples: Samples, k: int, theta: FloatArray) -> PointFunction:
    """Outputs of points of the filter's state at sample ``k``."""
    return measured_at(filter_model, float(samples.time[k]), samples.u[:, k], theta)


def measured_at(filter_model: FilterModel, time: float, u: FloatArray, theta: FloatArray) -> PointFunction:
    """Outputs of points of the filter's state at a time, with inputs u (n_u,)."""
    model = filter_model.model
    n_x = len(model.states)

    def measure(points: FloatArray) -> FloatArray:
        return model.output(time, points[:n_x], u, _point_parameters(filter_model, points, theta))

    return measure


@np.errstate(all="ignore")  # what overflows is told by the outcome
def reference_run(
    filter_model: FilterModel, samples: Samples, member: Member, highest: FloatArray | None = None
) -> FilterRun:
    """Filter one log with one set of numbers, in numpy; the record holds every node.

    Parameters
    ----------
    filter_model, samples, member
        The filter, the log, and the numbers.
    highest
        The run is given up before a sample where its negative log-likelihood so far is higher than this, shape (n,).
    """
    limits = np.full(samples.time.size, np.inf) if highest is None else highest
    start = filter_model.start_mean(member.theta, member.x0)
    belief = Belief(start, member.initial_lower @ member.initial_lower.T, member.initial_lower)
    record = Recorder(filter_model, samples)
    gathered = 0.0
    for k in range(samples.time.size):
        if gathered > limits[k]:
            return record.finish(Outcome.ABANDONED)
        if k > 0:
            if samples.noise_start[k - 1] > 0.0:
                belief = Belief.of(belief.mean, belief.cov + member.process_cov * samples.noise_start[k - 1])
            move = transition(filter_model, samples, k, member.theta)
            prediction = predict(belief, move, member.process_cov * samples.noise_end[k - 1], filter_model.points)
        else:
            prediction = Prediction(belief, np.full(belief.cov.shape, np.nan), 0, Outcome.OK)
        if prediction.outcome is not Outcome.OK:
            return record.finish(prediction.outcome)
        measure = measurement(filter_model, samples, k, member.theta)
        updated = update(
            prediction.belief, samples.y[:, k], measure, member.noise_cov, filter_model.points, filter_model.robustness
        )
        if updated.outcome is not Outcome.OK:
            return record.finish(updated.outcome)
        record.add(k, prediction, updated)
        gathered -= updated.log_likelihood
        belief = updated.belief
    return record.finish(Outcome.OK)


class Recorder:
    """Gathers predictions and updates into a :class:`FilterRun`."""

    def __init__(self, filter_model: FilterModel, samples: Samples) -> None:
        n_s, n_y, n = len(filter_model.state_names), samples.y.shape[0], samples.time.size
        self._filter_model = filter_model
        self._samples = samples
        self.arrays: dict[str, FloatArray] = {
            "predicted_mean": np.full((n_s, n), np.nan),
            "predicted_cov": np.full((n_s, n_s, n), np.nan),
            "filtered_mean": np.full((n_s, n), np.nan),
            "filtered_cov": np.full((n_s, n_s, n), np.nan),
            "cross_cov": np.full((n_s, n_s, n), np.nan),
            "output_mean": np.full((n_y, n), np.nan),
            "output_cov": np.full((n_y, n_y, n), np.nan),
            "whitened": np.full((n_y, n), np.nan),
            "log_scales": np.full((n_y, n), np.nan),
        }
        self._floored = 0
        self._last = -1

    def add(self, k: int, prediction: Prediction, updated: Update) -> None:
        """Note what happened at sample ``k``."""
        values = {
            "predicted_mean": prediction.belief.mean,
            "predicted_cov": prediction.belief.cov,
            "filtered_mean": updated.belief.mean,
            "filtered_cov": updated.belief.cov,
            "cross_cov": prediction.cross_cov,
            "output_mean": updated.output_mean,
            "output_cov": updated.output_cov,
            "whitened": updated.whitened,
            "log_scales": updated.log_scales,
        }
        for name, value in values.items():
            self.arrays[name][..., k] = value
        self._floored += prediction.floored + updated.floored
        self._last = k

    def finish(self, outcome: Outcome) -> FilterRun:
        """The run so far."""
        samples = self._samples
        return FilterRun(
            filter_model=self._filter_model,
            log_name=samples.name,
            time=samples.time,
            y=samples.y,
            floored_pivots=self._floored,
            outcome=outcome,
            ended_at=float(samples.time[max(self._last, 0)]),
            cause="",
            **self.arrays,  # type: ignore[arg-type]
        )


def _point_parameters(filter_model: FilterModel, points: FloatArray, theta: FloatArray) -> FloatArray:
    """Parameters of each point: the appended ones are part of it, (n_theta,) or (n_theta, 2 n + 1)."""
    if not filter_model.appended:
        return theta
    parameters = np.repeat(theta[:, np.newaxis], points.shape[1], axis=1)
    parameters[filter_model.appended_index] = points[len(filter_model.model.states) :]
    return parameters
