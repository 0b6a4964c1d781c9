"""Exact second derivatives of the likelihood of a log: the filter on numbers that carry their derivatives.

The equations of a model are differentiated on their tape, forward over the tangents: in one direction, and what comes
out in another. So laws bend as they are written, algebraic loops by the implicit function theorem. Everything else, the
sigma points, the integration steps (:mod:`bondgraph.filter.moving_model`) and the Cholesky factors, is the same
computation on jets (:mod:`bondgraph.filter.second_order`). It is done in numpy, all pairs of directions at once, in
some milliseconds for each step of a small model and 40 ms for one of a vehicle: for looking closely at an optimum.

Where a robust loss has a kink (Huber, gate) they are those of the branch taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.errors import FilterError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.moving_model import MovingModel
from bondgraph.filter.samples import MeasuredLog, Samples
from bondgraph.filter.second_order import Jet, drawn, factor, joined, moments, product
from bondgraph.filter.second_order_channels import Channels
from bondgraph.simulate.outcome import Outcome


@dataclass(frozen=True)
class MovingMember:
    """The numbers of a member with their derivatives in D directions.

    theta (n_theta,), x0 (n_x,), standard deviations of initial states and process noise (n_s,) and of the sensors'
    noise (n_y,). Correlations are those of the filter model and do not move.
    """

    theta: Jet
    x0: Jet
    initial_std: Jet
    process_std: Jet
    noise_std: Jet


@dataclass(frozen=True)
class Curvature:
    """Negative log-likelihood of a log, its gradient (D,) and second derivatives (D, D); NaN where the filter fails."""

    nll: float
    gradient: FloatArray
    hessian: FloatArray
    outcome: Outcome


def curvature(filter_model: FilterModel, log: MeasuredLog, member: MovingMember) -> Curvature:
    """The likelihood of a log with its first and second derivatives.

    Parameters
    ----------
    filter_model
        With any method but ``"auto"``, see :func:`bondgraph.filter.choice.choose_method`.
    log
        A parameter that it knows does not move.
    member
        The numbers, and how they move.

    Raises
    ------
    FilterError
        If no method is chosen, or the log does not fit the filter model.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.simulate.example import pendulum
    >>> model = pendulum()
    >>> swing = FilterModel(model, {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> length = Jet(model.theta(), np.eye(3)[:, :1], np.zeros((3, 1, 1)))
    >>> still = [Jet.still(a, 1) for a in (model.x0(), swing.start_std, swing.process_std, swing.noise_std)]
    >>> found = curvature(swing, log, MovingMember(length, *still))
    >>> found.gradient.shape, found.hessian.shape
    ((1,), (1, 1))
    """
    if filter_model.method == "auto":
        raise FilterError(
            f"{filter_model.model.name}: second derivatives along a log with method 'auto' - choose one before"
            " (choose_method)",
            where=(filter_model.model.name, "method"),
        )
    samples = Samples.of(filter_model, log)
    with np.errstate(all="ignore"):  # what overflows is told by the outcome
        return _Filter(filter_model, samples, member).run()


class _Filter:
    """The filter over one log; ``nll`` is gathered on the way."""

    def __init__(self, filter_model: FilterModel, samples: Samples, member: MovingMember) -> None:
        self._points, self._samples, self._robustness = filter_model.points, samples, filter_model.robustness
        count = member.theta.d.shape[-1]
        known = np.ones(member.theta.v.size, dtype=np.bool_)
        for name in samples.theta_overrides:
            known[filter_model.model.index("parameter", name)] = False
        theta = samples.theta(filter_model, member.theta.v)
        self._theta = Jet(
            theta, member.theta.d * known[:, np.newaxis], member.theta.h * known[:, np.newaxis, np.newaxis]
        )
        self._model = MovingModel(filter_model, self._theta)
        self._process = _scaled(filter_model.process_correlations, member.process_std)
        noise = Jet(*(np.nan_to_num(getattr(member.noise_std, name)) for name in ("v", "d", "h")))
        self._noise = _scaled(filter_model.noise_correlations, noise)
        root = np.asarray(np.linalg.cholesky(filter_model.start_correlations), dtype=np.float64)
        self._mean = joined([member.x0, self._theta[filter_model.appended_index]])
        self._lower = product("i,ij->ij", member.initial_std, Jet.still(root, count))
        self._nll = Jet.still(np.array(0.0), count)

    def run(self) -> Curvature:
        """All samples."""
        outcome = Outcome.OK
        for k in range(self._samples.time.size):
            outcome = self._predict(k) if k else Outcome.OK
            measured = np.flatnonzero(~np.isnan(self._samples.y[:, k]))
            if outcome is Outcome.OK and measured.size:
                outcome = self._update(k, measured)
            if outcome is not Outcome.OK:
                break
        if outcome is not Outcome.OK or not np.isfinite(self._nll.h).all():
            lost = self._nll.map(lambda array: np.full_like(array, np.nan))
            return Curvature(math.inf, lost.d, lost.h, outcome if outcome is not Outcome.OK else Outcome.DIVERGED)
        return Curvature(float(self._nll.v), self._nll.d, self._nll.h, outcome)

    def _predict(self, k: int) -> Outcome:
        samples, outcome = self._samples, Outcome.OK
        if samples.noise_start[k - 1] > 0.0:
            before = product("ij,kj->ik", self._lower, self._lower)
            self._lower, outcome = factor(before + self._process * float(samples.noise_start[k - 1]))
        if outcome is not Outcome.OK:
            return outcome
        points = drawn(self._points, self._mean, self._lower)
        steps = (int(samples.substeps[k - 1]), float(samples.grading[k - 1]))
        moved = self._model.moved(points, samples.segment(k), *steps)
        self._mean, cov, _ = moments(self._points, moved)
        self._lower, outcome = factor(cov + self._process * float(samples.noise_end[k - 1]))
        return outcome

    def _update(self, k: int, measured: np.ndarray[Any, np.dtype[np.intp]]) -> Outcome:
        """Condition on the measured channels, by one factor of their joint covariance with the state."""
        samples, n, m = self._samples, self._mean.v.size, measured.size
        points = drawn(self._points, self._mean, self._lower)
        seen = self._model.outputs(float(samples.time[k]), points, samples.u[:, k])[measured]
        expected, cov, deviations = moments(self._points, seen)
        noise = self._noise[np.ix_(measured, measured)]
        cov = cov + noise
        slopes = (deviations[:, 1 : n + 1] - deviations[:, n + 1 :]) * (0.5 / self._points.spread)
        cross = product("ij,aj->ia", self._lower, slopes)
        own = product("ij,kj->ik", self._lower, self._lower)
        turned = cross.map(lambda array: np.swapaxes(array, 0, 1))
        joint = joined([joined([cov, turned], axis=1), joined([cross, own], axis=1)])
        innovation = Jet.still(samples.y[measured, k], self._nll.d.size) - expected
        channels = Channels(self._robustness, innovation, noise)
        lower, outcome = factor(joint, m, channels.scale)
        if outcome is not Outcome.OK:
            return outcome
        self._nll = self._nll + channels.nll
        self._mean = self._mean + product("ia,a->i", lower[m:, :m], channels.scores)
        self._lower = lower[m:, m:]
        return outcome


def _scaled(correlation: FloatArray, std: Jet) -> Jet:
    """Covariance (k, k) of a correlation and standard deviations (k,)."""
    return product("ij,ij->ij", Jet.still(correlation, std.d.shape[-1]), product("i,j->ij", std, std))
