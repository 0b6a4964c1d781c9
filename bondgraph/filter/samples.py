"""Measured logs in the form in which filters read them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.data.band_limited import PIECES, finer, finer_times, is_even
from bondgraph.errors import FilterError, suggest
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.noise_nodes import NoiseNodes, continuous_nodes, finer_nodes, sampled_nodes
from bondgraph.filter.plan import IntervalSteps, NoiseRule, cut_steps, log_key, transferred
from bondgraph.simulate.inputs import InputSegment, hold_flags, limited_rates, limited_rows, rate_rows
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.model import Model


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


@dataclass(frozen=True, repr=False)
class Samples:
    """A log checked against a filter model, on its nodes: its samples and, between them, those of noise and inputs.

    ``time`` (m,), ``u`` (n_u, m), ``y`` (n_y, m), NaN at nodes that are no sample; ``sample`` (n,) are the positions of
    the samples. ``u_left`` and ``u_right`` (n_u, m-1) are the inputs at the two ends of each step from node to node.
    An input that is the rate of another is constant over each interval of the log; ``u`` has the mean of both sides of
    a sample. ``substeps`` (m-1,) are integration steps, ``grading`` (m-1,) the length of each over the one before;
    ``noise_start`` and ``noise_end`` (m-1,) the seconds of process noise that enter before and after. ``key`` tells
    logs apart by content.
    """

    name: str
    time: FloatArray
    u: FloatArray
    u_left: FloatArray
    u_right: FloatArray
    y: FloatArray
    substeps: IntArray
    grading: FloatArray
    noise_start: FloatArray
    noise_end: FloatArray
    sample: IntArray
    theta_overrides: Mapping[str, float]
    key: str

    @classmethod
    def of(cls, filter_model: FilterModel, log: MeasuredLog) -> Samples:
        """Check a log and bring it into the form filters read.

        Raises
        ------
        FilterError
            If shapes do not fit the model, times do not increase, an input is missing somewhere, an output is infinite,
            a channel is measured whose noise is not declared, or a parameter known for the log does not exist.
        """
        _check(filter_model, log)
        return cls._on(filter_model, log, filter_nodes(filter_model.model, filter_model.noise_rule, log.time))

    @classmethod
    def _on(cls, filter_model: FilterModel, log: MeasuredLog, nodes: NoiseNodes) -> Samples:
        """A log on the given nodes."""
        u = inputs_of(filter_model.model, log)
        left, right = inputs_between(filter_model.model, nodes, log.time, u)
        key = log_key(log.time, log.u, log.y, log.theta_overrides)
        steps = _steps(filter_model, log.time, nodes, key)
        return cls(
            log.name, nodes.time, _inputs(filter_model.model, nodes, u, left), left, right,
            _at_samples(nodes, log.y),
            steps.substeps, steps.grading, nodes.start, nodes.end, nodes.sample, dict(log.theta_overrides), key,
        )  # fmt: skip

    @classmethod
    def whole(cls, filter_model: FilterModel, log: MeasuredLog) -> Samples:
        """A log on its samples alone, without nodes between them."""
        _check(filter_model, log)
        return cls._on(replace(filter_model, noise_scheme="sampled"), log, sampled_nodes(log.time))

    def segment(self, k: int) -> InputSegment:
        """Inputs of the step that ends at node ``k``."""
        start, end = float(self.time[k - 1]), float(self.time[k])
        return InputSegment(start, end, self.u_left[:, k - 1], self.u_right[:, k - 1])

    def theta(self, filter_model: FilterModel, theta: FloatArray) -> FloatArray:
        """Parameters (n_theta, *batch) with those known for this log in their place."""
        known = theta.copy()
        for name, value in self.theta_overrides.items():
            known[filter_model.model.index("parameter", name)] = value
        return known


def noise_nodes(rule: NoiseRule, time: FloatArray) -> NoiseNodes:
    """The nodes at which process noise enters along a log with these times (n,)."""
    scheme, inside, reach = rule
    return sampled_nodes(time) if scheme == "sampled" else continuous_nodes(time, inside, reach)


def filter_nodes(model: Model, rule: NoiseRule, time: FloatArray) -> NoiseNodes:
    """The nodes of a log with these times (n,): those of the process noise, and those of band-limited inputs."""
    nodes = noise_nodes(rule, time)
    return finer_nodes(nodes, time, PIECES) if limited_rows(model) and time.size > 1 else nodes


def inputs_between(model: Model, nodes: NoiseNodes, time: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inputs (n_u, m-1) at both ends of the steps from node to node, of samples at times (n,) with inputs (n_u, n).

    Inputs that are band limited are so at the nodes, however many there are; on the samples alone they run straight.
    """
    left, right = _straight(model, nodes, time, u)
    limited = list(limited_rows(model))
    if limited and nodes.time.size > time.size:
        at = np.array([np.interp(nodes.time, finer_times(time), row) for row in finer(u[limited])])
        left[limited], right[limited] = at[:, :-1], at[:, 1:]
        for row, source in limited_rates(model):
            left[row] = right[row] = (right[source] - left[source]) / np.diff(nodes.time)
    return left, right


def _straight(model: Model, nodes: NoiseNodes, time: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inputs at both ends of the steps where each is held or runs linearly between samples."""
    hold = hold_flags(model)[:, np.newaxis]
    left = u[:, :-1]
    right = np.where(hold, left, u[:, 1:])
    if nodes.time.size == time.size:
        return left, right
    lengths = np.diff(time)[nodes.interval]
    begin = (nodes.time[:-1] - time[nodes.interval]) / lengths
    last = nodes.sample[1:] - 1
    end = np.append(begin[1:], 1.0)
    end[last] = 1.0
    bend = (right - left)[:, nodes.interval]
    u_left, u_right = (left[:, nodes.interval] + share * bend for share in (begin, end))
    u_right[:, last] = right
    return u_left, u_right


def _inputs(model: Model, nodes: NoiseNodes, u: FloatArray, left: FloatArray) -> FloatArray:
    """Inputs (n_u, m) at the nodes; of one that is the rate of another the mean of both sides of a sample."""
    inputs = u.copy()
    for row in rate_rows(model):
        inputs[row, 1:-1] = 0.5 * (u[row, :-2] + u[row, 1:-1])
    every = np.concatenate([left, inputs[:, -1:]], axis=1)
    every[:, nodes.sample] = inputs
    return every


def _at_samples(nodes: NoiseNodes, y: FloatArray) -> FloatArray:
    """Measurements (n_y, m) on the nodes."""
    if nodes.time.size == y.shape[1]:
        return y
    every = np.full((y.shape[0], nodes.time.size), np.nan)
    every[:, nodes.sample] = y
    return every


def _steps(filter_model: FilterModel, time: FloatArray, nodes: NoiseNodes, key: str) -> IntervalSteps:
    """The steps planned for the log with this key, else uniform ones."""
    plan = filter_model.plan
    if plan is not None and plan.method == filter_model.method and key in plan.logs:
        planned = plan.logs[key]
        if plan.rule == filter_model.noise_rule:
            return planned
        return transferred(planned, filter_nodes(filter_model.model, plan.rule, time).time, nodes.time)
    return uniform_steps(filter_model, nodes.share)


def uniform_steps(filter_model: FilterModel, share: FloatArray) -> IntervalSteps:
    """Steps of a filter model that plans none, between nodes (m-1,) that are such shares of a median interval apart.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {}, substeps=8)
    >>> uniform_steps(swing, np.array([0.5, 3.0])).substeps.tolist()
    [4, 24]
    """
    grading = np.full(share.size, filter_model.grading if filter_model.is_stiff else 1.0)
    whole = np.full(share.size, filter_model.substeps, dtype=np.int64)
    parts = cut_steps(whole, grading, np.minimum(share, 1.0))
    # a step longer than a median interval takes more, and no steps grow beyond those of one
    long = share > 1.0
    return IntervalSteps(
        np.where(long, np.ceil(whole * share - 1e-9).astype(np.int64), parts), np.where(long, 1.0, grading)
    )


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
    model, u = filter_model.model, inputs_of(filter_model.model, log)

    def require(condition: bool, problem: str, *where: str) -> None:
        if not condition:
            raise FilterError(f"{log.name}: {problem}", where=(log.name, *where))

    n = log.time.size
    require(n > 0 and bool(np.all(np.diff(log.time) > 0)), "times must increase - sort the samples")
    for array, names, kind in ((u, model.names("input"), "input"), (log.y, model.names("output"), "output")):
        require(
            array.shape == (len(names), n),
            f"{kind}s have shape {array.shape}, {model.name} needs ({len(names)}, {n}) - match the log to the model",
        )
    for name, row in zip(model.names("input"), u, strict=True):
        bad = np.flatnonzero(~np.isfinite(row))
        at = log.time[bad[0]] if bad.size else 0.0
        require(not bad.size, f"input {name!r} has no value at t = {at:.6g} s - fill or cut the gap", name)
    limited = [model.names("input")[row] for row in limited_rows(model)]
    require(
        not limited or is_even(log.time),
        f"input {limited[0] if limited else ''!r} is band limited, which its samples tell only at even times - "
        "resample the log, or declare the input linear",
        *limited,
    )
    for name, row in zip(model.names("output"), log.y, strict=True):
        infinite = np.flatnonzero(np.isinf(row))
        at = log.time[infinite[0]] if infinite.size else 0.0
        require(not infinite.size, f"output {name!r} is infinite at t = {at:.6g} s - clear that value", name)
        require(
            name in filter_model.measurement_noise or bool(np.isnan(row).all()),
            f"output {name!r} is measured but measurement_noise does not name it - name it, or clear the channel",
            name,
        )
    for name in log.theta_overrides:
        known = model.names("parameter")
        require(name in known, f"no parameter {name!r} in {model.name}{suggest(name, known)}", name)
