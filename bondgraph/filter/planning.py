"""Plan integration steps along logs: as many from node to node as the sigma points need, at one set of parameters.

A model with clutches, stops and saturating laws is smooth almost everywhere and bends in a few places. A fixed number
of steps that is fine for these is many times too fine for the rest, and steps chosen anew at every evaluation would
make the likelihood rough. So the log is filtered once; in every interval the sigma points of that run are moved with
more and more steps, equal and graded ones, until halving the steps changes their mean and covariance by less than a
share of the state's own uncertainty. The plan then serves for all parameters, and likelihoods stay smooth in them.
Events move with the parameters: an interval takes the steps of its neighbours if these are more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Unpack

import numpy as np

from bondgraph.arrays import FloatArray, IntArray
from bondgraph.compile.lanes.load import load_lanes
from bondgraph.compile.machine_code import has_numba, load_translated
from bondgraph.compile.rosenbrock import TABLEAUS, Tableau
from bondgraph.filter import plan_kernel
from bondgraph.filter.batch import run_batches
from bondgraph.filter.compiled import filter_rules, log_rows
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.members import MemberBatch, MemberValues, member_batches
from bondgraph.filter.plan import IntervalSteps, StepPlan
from bondgraph.filter.samples import MeasuredLog, Samples, filter_nodes
from bondgraph.filter.sigma_points import MerweScaled, lower_factors
from bondgraph.filter.ukf import transition
from bondgraph.simulate.model import Model

#: Change of a mean or covariance by halved steps, over the standard deviation of the state, that is small enough.
TOLERANCE = 5e-3

#: A standard deviation counts at least as this share of the largest value of its state: no steps for rounding errors.
_FLOOR = 1e-4

#: First numbers of steps and gradings of the sequences that are tried, each halved again and again.
_SEQUENCES = ((2, 1.0), (2, 3.0), (3, 1.0), (3, 2.5), (4, 2.0), (6, 2.0))

_MOST = 64

#: How many neighbours on either side must be content with the steps of an interval.
_REACH = 2

#: Cost of the linear algebra of a stage over that of a slope, about.
_STAGE_COST = 0.3


@dataclass(frozen=True)
class FilteredLog:
    """A log with the run of the filter along which steps are planned, and the numbers of that run."""

    samples: Samples
    run: FilterRun
    batch: MemberBatch


def plan_steps(
    filter_model: FilterModel,
    logs: Sequence[MeasuredLog],
    *,
    methods: Sequence[str] = tuple(TABLEAUS),
    tolerance: float = TOLERANCE,
    compiled: bool = True,
) -> FilterModel:
    """The filter model with the cheapest of some stiff methods and a plan of its steps for these logs.

    Parameters
    ----------
    filter_model
        With the uniform stiff steps that the first run takes, and that logs outside of the plan get.
    logs
        Logs to plan for, at the declared parameters and those known for each log.
    methods
        Stiff methods to choose from.
    tolerance
        Largest change by halved steps, in standard deviations of the state.
    compiled
        Use the compiled model.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 8, "rodas4")
    >>> time = np.arange(20) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 20)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> planned = plan_steps(swing, [log], compiled=False)
    >>> planned.plan.mean_substeps
    2.0
    """
    filtered = filtered_logs(filter_model, logs, compiled)
    return plan_along(filter_model, filtered, methods=methods, tolerance=tolerance, compiled=compiled)


def filtered_logs(
    filter_model: FilterModel,
    logs: Sequence[MeasuredLog],
    compiled: bool,
    theta: FloatArray | None = None,
    **values: Unpack[MemberValues],
) -> tuple[FilteredLog, ...]:
    """Logs filtered at one set of numbers, by default the declared ones."""
    samples = [Samples.of(filter_model, log) for log in logs]
    batches = member_batches(filter_model, samples, theta, values)
    runs = run_batches(filter_model, samples, batches, 2, 1, compiled)
    return tuple(
        FilteredLog(own, run.filter_run(filter_model, 0), batch)
        for own, run, batch in zip(samples, runs, batches, strict=True)
    )


def plan_along(
    filter_model: FilterModel,
    filtered: Sequence[FilteredLog],
    *,
    methods: Sequence[str] = tuple(TABLEAUS),
    tolerance: float = TOLERANCE,
    compiled: bool = True,
) -> FilterModel:
    """As :func:`plan_steps`, along runs that are there already."""
    plans: dict[str, StepPlan] = {}
    for method in methods:
        model = replace(filter_model, method=method, plan=None)
        steps = {log.samples.key: _plan_log(model, log, tolerance, compiled) for log in filtered}
        plans[method] = StepPlan.of(method, steps, model.noise_rule)
    best = min(methods, key=lambda method: plan_cost(filter_model.model, plans[method]))
    return replace(filter_model, method=best, plan=plans[best])


def plan_cost(model: Model, plan: StepPlan) -> float:
    """Work per interval in evaluations of the state equations, about."""
    return plan.mean_substeps * step_cost(model, TABLEAUS[plan.method])


def step_cost(model: Model, tableau: Tableau) -> float:
    """Work of one step in evaluations of the state equations, about: by the operations of the Jacobian."""
    equations = model.program
    slopes = equations.tape.program(equations.rows["rhs"]).count()
    share = equations.jacobian("rhs", "x").program.count() / max(slopes, 1)
    return share + sum(tableau.is_new(s) for s in range(tableau.stages)) + _STAGE_COST * tableau.stages


class _Moments(NamedTuple):
    """Means (intervals, n) and covariances (intervals, n, n)."""

    mean: FloatArray
    cov: FloatArray


def _plan_log(filter_model: FilterModel, log: FilteredLog, tolerance: float, compiled: bool) -> IntervalSteps:
    """Steps of one log."""
    nodes = filter_nodes(filter_model.model, filter_model.noise_rule, log.run.time)
    multiples = np.maximum(1, np.ceil(nodes.share)).astype(np.int64)
    count = multiples.size
    best, grading = np.full(count, _MOST), np.ones(count)
    start = _sigma_points(filter_model, log)
    usable = np.isfinite(start).all(axis=(1, 2))
    floor = _FLOOR * np.max(np.abs(np.nan_to_num(log.run.filtered_mean)), axis=1, initial=0.0)
    noise = (log.batch.process_std[:, 0] ** 2)[np.newaxis] * nodes.end[:, np.newaxis] + floor**2
    move = _mover(filter_model, log, compiled)
    for first, ratio in _SEQUENCES:
        steps, pending = first, np.flatnonzero(usable & (best > first))
        coarse = _moved(filter_model.points, move, start, pending, steps * multiples[pending], ratio)
        while pending.size and steps < _MOST:
            halved = float(np.sqrt(ratio))
            fine = _moved(filter_model.points, move, start, pending, 2 * steps * multiples[pending], halved)
            good = _defects(coarse, fine, noise[pending]) < tolerance
            best[pending[good]], grading[pending[good]] = steps, ratio
            steps, ratio = 2 * steps, halved
            left = ~good & (best[pending] > steps)
            pending, coarse = pending[left], _Moments(fine.mean[left], fine.cov[left])
    return _spread(best, grading, multiples)


def _sigma_points(filter_model: FilterModel, log: FilteredLog) -> FloatArray:
    """Sigma points at the start of each step from node to node, (m-1, n_s, points)."""
    assert log.run.nodes is not None
    centre = log.run.nodes.run.filtered_mean[:, :-1].T[:, :, np.newaxis]
    with np.errstate(all="ignore"):  # a filter that failed leaves NaN
        steps = filter_model.points.spread * lower_factors(log.run.nodes.driven_cov())
    return np.concatenate([centre, centre + steps, centre - steps], axis=2)


#: Moves points of intervals: ``move(points, intervals, substeps, grading)``.
Move = Callable[[FloatArray, IntArray, IntArray, float], FloatArray]


def _moved(
    points: MerweScaled, move: Move, start: FloatArray, intervals: IntArray, substeps: IntArray, grading: float
) -> _Moments:
    """Mean and covariance at the end of intervals."""
    ends = move(start[intervals], intervals, substeps, grading)
    with np.errstate(all="ignore"):  # what has diverged is not a number in the comparison that follows
        deviations = ends - ends[:, :, :1]
        shift = points.weight * deviations.sum(axis=2)
        cov = points.weight * deviations @ np.swapaxes(deviations, 1, 2)
        cov += points.correction * shift[:, :, np.newaxis] * shift[:, np.newaxis, :]
        return _Moments(ends[:, :, 0] + shift, cov)


def _defects(coarse: _Moments, fine: _Moments, noise: FloatArray) -> FloatArray:
    """Largest difference of moments over standard deviations, (intervals,); infinite where one is not finite."""
    with np.errstate(all="ignore"):
        std = np.sqrt(np.diagonal(fine.cov, axis1=1, axis2=2) + noise)
        std = np.where(std > 0.0, std, np.inf)
        means = np.max(np.abs(coarse.mean - fine.mean) / std, axis=1, initial=0.0)
        scales = std[:, :, np.newaxis] * std[:, np.newaxis, :]
        covs = np.max(np.abs(coarse.cov - fine.cov) / scales, axis=(1, 2), initial=0.0)
        worst = np.maximum(means, covs)
    return np.where(np.isfinite(worst), worst, np.inf)


def _spread(best: IntArray, grading: FloatArray, multiples: IntArray) -> IntervalSteps:
    """Steps with those of the neighbours where these are more."""
    substeps, ratios = best.copy(), grading.copy()
    for shift in (s for s in range(-_REACH, _REACH + 1) if s):
        there = np.clip(np.arange(best.size) + shift, 0, best.size - 1)
        more = best[there] > substeps
        substeps[more], ratios[more] = best[there][more], grading[there][more]
    # a gap of several intervals is longer, and its steps are no more graded than those of one
    return IntervalSteps(substeps * multiples, np.where(multiples > 1, 1.0, ratios))


def _mover(filter_model: FilterModel, log: FilteredLog, compiled: bool) -> Move:
    """The function that moves points, compiled or in numpy."""
    samples = log.samples
    size = samples.time.size - 1

    def with_steps(intervals: IntArray, substeps: IntArray, grading: float) -> Samples:
        whole = np.ones(size, dtype=np.int64)
        whole[intervals] = substeps
        return replace(samples, substeps=whole, grading=np.full(size, grading))

    if not (compiled and has_numba()):
        theta = log.batch.theta[:, 0]

        def in_numpy(points: FloatArray, intervals: IntArray, substeps: IntArray, grading: float) -> FloatArray:
            own = with_steps(intervals, substeps, grading)
            moved = [
                transition(filter_model, own, int(k) + 1, theta)(p) for k, p in zip(intervals, points, strict=True)
            ]
            return np.array(moved).reshape(points.shape)

        return in_numpy
    move_points = load_translated("move_points", plan_kernel)
    lanes = load_lanes(filter_model.model, filter_model.is_stiff)
    rules = filter_rules(filter_model, lanes)
    clock, inputs = np.zeros(2), np.zeros(2 * len(filter_model.model.inputs))
    movement = plan_kernel.Movement(lanes.prepare, lanes.advance, lanes.buffer(), clock, inputs)
    parameters = np.ascontiguousarray(log.batch.theta[:, 0])

    def in_kernel(points: FloatArray, intervals: IntArray, substeps: IntArray, grading: float) -> FloatArray:
        moved = np.ascontiguousarray(points)
        rows = log_rows(with_steps(intervals, substeps, grading))
        move_points(movement, rows, rules, parameters, intervals, moved)
        return moved

    return in_kernel
