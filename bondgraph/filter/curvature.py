"""Exact second derivatives of the likelihood of a log: the filter on numbers that carry their derivatives.

The equations of a model are differentiated on their tape, forward over the tangents: in one direction, and what comes
out in another. So laws bend as they are written, algebraic loops by the implicit function theorem. Everything else, the
sigma points, the Runge-Kutta steps and the Cholesky factors, is the same computation on jets
(:mod:`bondgraph.filter.second_order`). It is done in numpy, all pairs of directions at once, in some milliseconds for
each sample: for looking closely at an optimum, not for a search.

Stiff methods take the Jacobian of a model along, whose second derivatives are the third ones of every law; they, robust
losses and appended parameters have none here. :func:`bondgraph.estimate.analysis.hessian.hessian` differences exact
gradients there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.compile.front.model_program import Equations
from bondgraph.compile.ir.tape import Program
from bondgraph.compile.passes.tangent import tangents
from bondgraph.errors import FilterError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.samples import MeasuredLog, Samples
from bondgraph.filter.second_order import Jet, drawn, factor, joined, logarithm, moments, product, solved
from bondgraph.simulate.inputs import InputSegment
from bondgraph.simulate.model import Model
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


def has_exact_curvature(filter_model: FilterModel) -> bool:
    """Whether there are exact second derivatives: Runge-Kutta steps, Gaussian noise, no appended parameters."""
    return filter_model.method == "rk4" and not filter_model.appended and not filter_model.robust


def curvature(filter_model: FilterModel, log: MeasuredLog, member: MovingMember) -> Curvature:
    """The likelihood of a log with its first and second derivatives.

    Parameters
    ----------
    filter_model
        With fixed steps of ``"rk4"``, without robust losses and appended parameters.
    log
        A parameter that it knows does not move.
    member
        The numbers, and how they move.

    Raises
    ------
    FilterError
        If the filter model has no exact second derivatives, or the log does not fit it.

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
    if not has_exact_curvature(filter_model):
        raise FilterError(
            f"{filter_model.model.name}: exact second derivatives need method 'rk4' without robust losses and appended "
            f"parameters, not {filter_model!r} - difference exact gradients instead (hessian)",
            where=(filter_model.model.name, "method"),
        )
    samples = Samples.of(filter_model, log)
    with np.errstate(all="ignore"):  # what overflows is told by the outcome
        return _Filter(filter_model, samples, member).run()


class _Filter:
    """The filter over one log; ``nll`` is gathered on the way."""

    def __init__(self, filter_model: FilterModel, samples: Samples, member: MovingMember) -> None:
        self._points, self._samples = filter_model.points, samples
        count = member.theta.d.shape[-1]
        known = np.ones(member.theta.v.size, dtype=np.bool_)
        for name in samples.theta_overrides:
            known[filter_model.model.index("parameter", name)] = False
        theta = samples.theta(filter_model, member.theta.v)
        self._theta = Jet(
            theta, member.theta.d * known[:, np.newaxis], member.theta.h * known[:, np.newaxis, np.newaxis]
        )
        self._model = _MovingModel(filter_model.model, self._theta)
        self._process = _scaled(filter_model.process_correlations, member.process_std)
        noise = Jet(*(np.nan_to_num(getattr(member.noise_std, name)) for name in ("v", "d", "h")))
        self._noise = _scaled(filter_model.noise_correlations, noise)
        root = np.asarray(np.linalg.cholesky(filter_model.start_correlations), dtype=np.float64)
        self._mean, self._lower = member.x0, product("i,ij->ij", member.initial_std, Jet.still(root, count))
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
        moved = self._model.moved(points, samples.segment(k), int(samples.substeps[k - 1]))
        self._mean, cov, _ = moments(self._points, moved)
        self._lower, outcome = factor(cov + self._process * float(samples.noise_end[k - 1]))
        return outcome

    def _update(self, k: int, measured: np.ndarray[Any, np.dtype[np.intp]]) -> Outcome:
        """Condition on the measured channels, by one factor of their joint covariance with the state."""
        samples, n, m = self._samples, self._mean.v.size, measured.size
        points = drawn(self._points, self._mean, self._lower)
        seen = self._model.evaluated("output", float(samples.time[k]), points, samples.u[:, k])[measured]
        expected, cov, deviations = moments(self._points, seen)
        cov = cov + self._noise[np.ix_(measured, measured)]
        slopes = (deviations[:, 1 : n + 1] - deviations[:, n + 1 :]) * (0.5 / self._points.spread)
        cross = product("ij,aj->ia", self._lower, slopes)
        own = product("ij,kj->ik", self._lower, self._lower)
        turned = cross.map(lambda array: np.swapaxes(array, 0, 1))
        joint = joined([joined([cov, turned], axis=1), joined([cross, own], axis=1)])
        lower, outcome = factor(joint, required=m)
        if outcome is not Outcome.OK:
            return outcome
        innovation = Jet.still(samples.y[measured, k], self._nll.d.size) - expected
        z = solved(lower[:m, :m], innovation)
        scales = logarithm(lower[np.arange(m), np.arange(m)])
        total = product("a,a->", z, z) * 0.5 + scales.map(lambda array: array.sum(axis=0))
        self._nll = self._nll + total + Jet.still(np.array(0.5 * m * math.log(2.0 * math.pi)), self._nll.d.size)
        self._mean = self._mean + product("ia,a->i", lower[m:, :m], z)
        self._lower = lower[m:, m:]
        return outcome


class _MovingModel:
    """The equations of a model with first and second derivatives, along states and parameters that move."""

    def __init__(self, model: Model, theta: Jet) -> None:
        self._program, self._theta, self._size = model.program.anew(), theta, len(model.states)
        self._moving = [int(row) for row in np.flatnonzero(theta.d.any(axis=1))]
        self._programs = {equations: self._differentiated(equations) for equations in _EQUATIONS}
        behind = theta.d.shape[-1]
        self._parameters = {
            "theta": theta.v[:, np.newaxis, np.newaxis, np.newaxis],
            "theta_1": theta.d[:, np.newaxis, :, np.newaxis], "theta_2": theta.d[:, np.newaxis, np.newaxis, :],
            "theta_12": theta.h[:, np.newaxis],
        }  # fmt: skip
        self._directions = behind

    def _differentiated(self, equations: Equations) -> Program:
        """Rows, their derivatives in one direction, and the derivatives of those in another."""
        program = self._program
        tape, rows = program.tape, program.rows[equations]
        places = [("x", i) for i in range(self._size)] + [("theta", i) for i in self._moving]
        one = {tape.leaf(name, i): tape.leaf(f"{name}_1", i) for name, i in places}
        other = {tape.leaf(name, i): tape.leaf(f"{name}_2", i) for name, i in places}
        both = {tape.leaf(f"{name}_1", i): tape.leaf(f"{name}_12", i) for name, i in places}
        first = tangents(program.reader, rows, one)
        return tape.program([*rows, *first, *tangents(program.reader, first, {**other, **both})])

    def evaluated(self, equations: Equations, t: float, x: Jet, u: FloatArray) -> Jet:
        """Rows (rows, points) at states (n_x, points) and inputs (n_u,)."""
        leaves = {
            "t": (t,), "u": u, "x": x.v[..., np.newaxis, np.newaxis],
            "x_1": x.d[..., :, np.newaxis], "x_2": x.d[..., np.newaxis, :], "x_12": x.h, **self._parameters,
        }  # fmt: skip
        batch = (x.v.shape[1], self._directions, self._directions)
        found = self._program.evaluate(self._programs[equations], leaves, batch)
        count = found.shape[0] // 3
        return Jet(found[:count, :, 0, 0], found[count : 2 * count, :, :, 0], found[2 * count :])

    def moved(self, x: Jet, segment: InputSegment, substeps: int) -> Jet:
        """States after a segment of the inputs, by the steps of :class:`bondgraph.simulate.integrators.RK4`."""
        step = (segment.end - segment.start) / substeps
        for k in range(substeps):
            t = segment.start + k * step
            left, middle, right = (segment.at(t + share * step) for share in (0.0, 0.5, 1.0))
            slope_1 = self.evaluated("rhs", t, x, left)
            slope_2 = self.evaluated("rhs", t + 0.5 * step, x + slope_1 * (0.5 * step), middle)
            slope_3 = self.evaluated("rhs", t + 0.5 * step, x + slope_2 * (0.5 * step), middle)
            slope_4 = self.evaluated("rhs", t + step, x + slope_3 * step, right)
            x = x + (slope_1 + (slope_2 + slope_3) * 2.0 + slope_4) * (step / 6.0)
        return x


_EQUATIONS: tuple[Equations, ...] = ("rhs", "output")


def _scaled(correlation: FloatArray, std: Jet) -> Jet:
    """Covariance (k, k) of a correlation and standard deviations (k,)."""
    return product("ij,ij->ij", Jet.still(correlation, std.d.shape[-1]), product("i,j->ij", std, std))
