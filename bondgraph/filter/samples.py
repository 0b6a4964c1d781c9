"""Measured logs in the form in which filters read them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bondgraph.errors import FilterError, suggest
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.plan import IntervalSteps, log_key
from bondgraph.simulate.arrays import FloatArray, IntArray
from bondgraph.simulate.inputs import InputSegment, hold_flags, rate_rows


class MeasuredLog(Protocol):
    """What a filter needs of a log, in the order and units of its model (``bondgraph.data.log.MatchedLog`` has it)."""

    @property
    def name(self) -> str:
        """Name, for messages."""

    @property
    def time(self) -> FloatArray:
        """Increasing times, shape (n,), s."""

    @property
    def u(self) -> FloatArray:
        """Inputs, shape (n_u, n), complete."""

    @property
    def y(self) -> FloatArray:
        """Measured outputs, shape (n_y, n), NaN where missing."""

    @property
    def theta_overrides(self) -> Mapping[str, float]:
        """Parameters known for this log, by name."""


@dataclass(frozen=True)
class Samples:
    """A log checked against a filter model.

    ``time`` (n,), ``u`` (n_u, n), ``y`` (n_y, n); ``u_left`` and ``u_right`` (n_u, n-1) are the inputs at the two ends
    of each interval and ``substeps`` (n-1,) its integration steps. An input that is the rate of another is constant
    over each interval; ``u`` has the mean of both sides of a sample.
    ``grading`` (n-1,) is the length of each of these over the one before, ``key`` tells logs apart by content.
    """

    name: str
    time: FloatArray
    u: FloatArray
    u_left: FloatArray
    u_right: FloatArray
    y: FloatArray
    substeps: IntArray
    grading: FloatArray
    theta_overrides: Mapping[str, float]
    key: str

    @classmethod
    def of(cls, filter_model: FilterModel, log: MeasuredLog) -> Samples:
        """Check a log and bring it into the form filters read.

        Raises
        ------
        FilterError
            If shapes do not fit the model, times do not increase, an input is missing somewhere, a channel is measured
            whose noise is not declared, or a parameter known for the log does not exist.
        """
        _check(filter_model, log)
        hold = hold_flags(filter_model.model)[:, np.newaxis]
        left = log.u[:, :-1]
        right = np.where(hold, left, log.u[:, 1:])
        inputs = log.u.copy()
        for row in rate_rows(filter_model.model):
            inputs[row, 1:-1] = 0.5 * (log.u[row, :-2] + log.u[row, 1:-1])
        key = log_key(log.time, log.u, log.y, log.theta_overrides)
        steps = _steps(filter_model, log.time, key)
        arrays = (log.time, inputs, left, right, log.y, steps.substeps, steps.grading)
        return cls(log.name, *arrays, dict(log.theta_overrides), key)

    def segment(self, k: int) -> InputSegment:
        """Inputs of the interval that ends at sample ``k``."""
        start, end = float(self.time[k - 1]), float(self.time[k])
        return InputSegment(start, end, self.u_left[:, k - 1], self.u_right[:, k - 1])

    def theta(self, filter_model: FilterModel, theta: FloatArray) -> FloatArray:
        """Parameters (n_theta, *batch) with those known for this log in their place."""
        known = theta.copy()
        for name, value in self.theta_overrides.items():
            known[filter_model.model.index("parameter", name)] = value
        return known


def _steps(filter_model: FilterModel, time: FloatArray, key: str) -> IntervalSteps:
    """The steps planned for the log with this key, else uniform ones."""
    plan = filter_model.plan
    if plan is not None and plan.method == filter_model.method and key in plan.logs:
        return plan.logs[key]
    substeps = interval_substeps(time, filter_model.substeps)
    return IntervalSteps(substeps, np.full(substeps.size, filter_model.grading if filter_model.is_stiff else 1.0))


def interval_substeps(time: FloatArray, substeps: int) -> IntArray:
    """Integration steps of each interval, shape (n-1,): a gap of k median intervals gets k times as many.

    Examples
    --------
    >>> interval_substeps(np.array([0.0, 0.1, 0.2, 0.5]), substeps=4).tolist()
    [4, 4, 12]
    """
    lengths = np.diff(time)
    if not lengths.size:
        return np.zeros(0, dtype=np.int64)
    multiples = np.maximum(1, np.rint(lengths / np.median(lengths)))
    return substeps * multiples.astype(np.int64)


def _check(filter_model: FilterModel, log: MeasuredLog) -> None:
    model = filter_model.model

    def require(condition: bool, problem: str, *where: str) -> None:
        if not condition:
            raise FilterError(f"{log.name}: {problem}", where=(log.name, *where))

    n = log.time.size
    require(n > 0 and bool(np.all(np.diff(log.time) > 0)), "times must increase - sort the samples")
    for array, names, kind in ((log.u, model.names("input"), "input"), (log.y, model.names("output"), "output")):
        require(
            array.shape == (len(names), n),
            f"{kind}s have shape {array.shape}, {model.name} needs ({len(names)}, {n}) - match the log to the model",
        )
    for name, row in zip(model.names("input"), log.u, strict=True):
        bad = np.flatnonzero(~np.isfinite(row))
        at = log.time[bad[0]] if bad.size else 0.0
        require(not bad.size, f"input {name!r} has no value at t = {at:.6g} s - fill or cut the gap", name)
    for name, row in zip(model.names("output"), log.y, strict=True):
        require(
            name in filter_model.measurement_noise or bool(np.isnan(row).all()),
            f"output {name!r} is measured but measurement_noise does not name it - name it, or clear the channel",
            name,
        )
    for name in log.theta_overrides:
        known = model.names("parameter")
        require(name in known, f"no parameter {name!r} in {model.name}{suggest(name, known)}", name)
