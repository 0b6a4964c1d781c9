"""The unscented Kalman filter over a log, in plain numpy: the readable form of what ``kernel.py`` compiles.

The prior is the belief at the time of the first sample: that sample is used without a prediction. Before every later
sample comes a prediction over the interval. Sigma points are drawn from the belief after the process noise was added,
and again from the belief after the measurement (filterpy >= 2.0.0 does the same).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bondgraph.filter.belief import Belief, PointFunction, Prediction, Update, predict, update
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.samples import Samples
from bondgraph.simulate.arrays import FloatArray
from bondgraph.simulate.integrators import RK4
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.stiff import ModelEquations, Rosenbrock


@dataclass(frozen=True)
class Member:
    """One set of numbers to filter with.

    theta (n_theta,), x0 (n_x,), initial_std and process_std (n_s,), noise_std (n_y,).
    """

    theta: FloatArray
    x0: FloatArray
    initial_std: FloatArray
    process_std: FloatArray
    noise_std: FloatArray


def transition(filter_model: FilterModel, samples: Samples, k: int, theta: FloatArray) -> PointFunction:
    """Moves points of the filter's state over the interval that ends at sample ``k``; appended parameters stay."""
    model = filter_model.model
    n_x = len(model.states)
    substeps = int(samples.substeps[k - 1])
    stiff = filter_model.is_stiff
    integrator = Rosenbrock(filter_model.method, substeps, float(samples.grading[k - 1])) if stiff else RK4(substeps)

    def move(points: FloatArray) -> FloatArray:
        parameters = _point_parameters(filter_model, points, theta)

        rhs = ModelEquations(model, parameters)
        state = integrator.init(float(samples.time[k - 1]), points[:n_x])
        moved, _ = integrator.step(rhs, samples.segment(k), samples.time[k : k + 1], state)
        return np.vstack([moved[:, 0], points[n_x:]])

    return move


def measurement(filter_model: FilterModel, samples: Samples, k: int, theta: FloatArray) -> PointFunction:
    """Outputs of points of the filter's state at sample ``k``."""
    model = filter_model.model
    n_x = len(model.states)

    def measure(points: FloatArray) -> FloatArray:
        parameters = _point_parameters(filter_model, points, theta)
        return model.output(float(samples.time[k]), points[:n_x], samples.u[:, k], parameters)

    return measure


def reference_run(
    filter_model: FilterModel, samples: Samples, member: Member, highest: FloatArray | None = None
) -> FilterRun:
    """Filter one log with one set of numbers, in numpy.

    Parameters
    ----------
    filter_model, samples, member
        The filter, the log, and the numbers.
    highest
        The run is given up before a sample where its negative log-likelihood so far is higher than this, shape (n,).
    """
    with np.errstate(all="ignore"):  # what overflows is told by the outcome
        return _run(filter_model, samples, member, np.full(samples.time.size, np.inf) if highest is None else highest)


def _run(filter_model: FilterModel, samples: Samples, member: Member, highest: FloatArray) -> FilterRun:
    start = filter_model.start_mean(member.theta, member.x0)
    belief = Belief.of(start, np.diag(member.initial_std**2))
    record = Recorder(filter_model, samples)
    noise_cov = np.diag(np.nan_to_num(member.noise_std) ** 2)
    gathered = 0.0
    for k in range(samples.time.size):
        if gathered > highest[k]:
            return record.finish(Outcome.ABANDONED)
        if k > 0:
            interval = samples.time[k] - samples.time[k - 1]
            process_cov = np.diag(member.process_std**2 * interval)
            move = transition(filter_model, samples, k, member.theta)
            prediction = predict(belief, move, process_cov, filter_model.points)
        else:
            prediction = Prediction(belief, np.full(belief.cov.shape, np.nan), 0, Outcome.OK)
        if prediction.outcome is not Outcome.OK:
            return record.finish(prediction.outcome)
        measure = measurement(filter_model, samples, k, member.theta)
        updated = update(prediction.belief, samples.y[:, k], measure, noise_cov, filter_model.points)
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
            **self.arrays,
        )


def _point_parameters(filter_model: FilterModel, points: FloatArray, theta: FloatArray) -> FloatArray:
    """Parameters of each point: the appended ones are part of it, (n_theta,) or (n_theta, 2 n + 1)."""
    if not filter_model.appended:
        return theta
    parameters = np.repeat(theta[:, np.newaxis], points.shape[1], axis=1)
    parameters[filter_model.appended_index] = points[len(filter_model.model.states) :]
    return parameters
