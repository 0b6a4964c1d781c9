"""Choose an integration method by how fast a model is along its logs.

An explicit method must resolve the fastest rate of the model, whether or not it matters; a stiff method need not. So
the logs are filtered once with a method that is stable for all rates, at the declared parameters. The largest magnitude
of an eigenvalue of the model's Jacobian along the filtered states tells how many explicit steps are needed; where these
are many, stiff steps are planned along that run (:mod:`bondgraph.filter.planning`), and the cheaper is taken.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Unpack

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.members import MemberValues
from bondgraph.filter.noise_choice import noise_nodes_along
from bondgraph.filter.plan import StepPlan
from bondgraph.filter.planning import FilteredLog, filtered_logs, plan_along, plan_cost
from bondgraph.filter.rates import fastest_rates
from bondgraph.filter.samples import MeasuredLog

#: With the classical Runge-Kutta method, step times rate stays below this: stable with a margin for other parameters.
STEP_TIMES_RATE = 1.5

#: So few explicit steps between two samples are cheaper than any stiff method.
_FEW_EXPLICIT = 10

#: Evaluations of the equations in a step of the classical Runge-Kutta method.
_RK4_SLOPES = 4

#: Methods whose steps are planned. RODAS4 would need fewer steps still, but the steps planned at one set of parameters
#: must do for others, and its stages overshoot where a law bends: on the vehicle with process noise in many states a
#: plan that was right to 0.003 nats moved the likelihood of a neighbour by 38 standard deviations of a parameter.
_PLANNED = ("ros3p",)

#: Stiff steps between two samples of the run along which steps are planned. They are equal: one that is long and starts
#: where a law is saturated jumps over the zone in which it is not. On the recorded drives 6 do so; from 8 on the plan
#: is that of a fine run in all but one interval of a thousand.
_FIRST_STEPS = 12

#: A first run is not made finer than this.
_FINEST_RUN = 48

#: Stiff steps between two samples of a log for which nothing was planned.
_UNPLANNED_STEPS = 32

#: Filters the logs with another filter model.
_Refilter = Callable[[FilterModel], tuple[FilteredLog, ...]]

#: A first run that is too coarse for its plan in a larger share of the intervals is repeated with twice the steps.
_MOST_OUTRUN = 0.1


def choose_method(filter_model: FilterModel, logs: Sequence[MeasuredLog], *, compiled: bool = True) -> FilterModel:
    """The filter model with a method in the place of ``"auto"``; one with a method is returned as it is.

    The same model and logs give the same choice, whatever parameters are tried later. ``substeps`` of the filter model
    is the least number of steps.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(
    ...     pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, method="auto"
    ... )
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> choose_method(swing, [log], compiled=False).method
    'rk4'
    """
    if filter_model.method != "auto":
        return filter_model
    return _chosen(_Question(_content(filter_model, logs), filter_model, tuple(logs), compiled))


def plan_again(
    filter_model: FilterModel,
    logs: Sequence[MeasuredLog],
    theta: FloatArray,
    *,
    compiled: bool = True,
    **values: Unpack[MemberValues],
) -> FilterModel:
    """A filter model whose steps were planned with them planned anew along logs filtered at other numbers.

    Parameters
    ----------
    filter_model
        With a plan, as :func:`choose_method` gives it; one without is returned as it is.
    logs
        Logs to plan for.
    theta
        Parameters (n_theta,).
    compiled
        Use the compiled model.
    **values
        Other numbers of that member, see :class:`bondgraph.filter.members.MemberValues`.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.filter.planning import plan_steps
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 8, "ros3p")
    >>> time = np.arange(20) * 0.2
    >>> log = MatchedLog("swing", time, np.zeros((1, 20)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> planned = plan_steps(swing, [log], methods=["ros3p"], compiled=False)
    >>> faster = plan_again(planned, [log], swing.model.theta(length=0.02), compiled=False)
    >>> faster.plan.mean_substeps > planned.plan.mean_substeps
    True
    """
    if filter_model.plan is None or filter_model.plan.method != filter_model.method:
        return filter_model

    def refilter(used: FilterModel) -> tuple[FilteredLog, ...]:
        return filtered_logs(used, logs, compiled, theta, **values)

    return _plan(filter_model, refilter(_first_run(filter_model, _FIRST_STEPS)), refilter, compiled)


def _first_run(filter_model: FilterModel, steps: int) -> FilterModel:
    """The filter along whose run steps are planned: stable for all rates, whatever steps another method needs."""
    return replace(filter_model, method=_PLANNED[0], substeps=steps, grading=1.0, plan=None)


def _plan(
    filter_model: FilterModel, filtered: Sequence[FilteredLog], refilter: _Refilter, compiled: bool
) -> FilterModel:
    """The filter with steps planned along a first run, or along a finer one where that was too coarse."""
    steps, coarse = _FIRST_STEPS, _first_run(filter_model, _FIRST_STEPS)
    planned = plan_along(coarse, filtered, methods=_PLANNED, compiled=compiled)
    while steps < _FINEST_RUN and planned.plan is not None and _outrun(planned.plan, filtered) > _MOST_OUTRUN:
        steps *= 2
        finer = _first_run(filter_model, steps)
        filtered = refilter(finer)
        planned = plan_along(finer, filtered, methods=_PLANNED, compiled=compiled)
    return replace(planned, substeps=_UNPLANNED_STEPS)


def _outrun(plan: StepPlan, filtered: Sequence[FilteredLog]) -> float:
    """Share of the steps from node to node for which over twice as many integration steps are planned as the run took.

    A plan is so strict that half its steps still leave a run within a few hundredths of a standard deviation.
    """
    more = [plan.logs[log.samples.key].substeps > 2 * log.samples.substeps for log in filtered]
    return float(np.mean(np.concatenate(more))) if sum(own.size for own in more) else 0.0


@dataclass(frozen=True)
class _Question:
    """What is asked, equal by content."""

    content: str
    filter_model: FilterModel = field(compare=False)
    logs: tuple[MeasuredLog, ...] = field(compare=False)
    compiled: bool


def _content(filter_model: FilterModel, logs: Sequence[MeasuredLog]) -> str:
    digest = hashlib.sha256(filter_model.digest.encode())
    for log in logs:
        for array in (log.time, log.u, log.y):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update(repr(sorted(log.theta_overrides.items())).encode())
    return digest.hexdigest()


@functools.lru_cache(maxsize=64)
def _chosen(question: _Question) -> FilterModel:
    def refilter(used: FilterModel) -> tuple[FilteredLog, ...]:
        return filtered_logs(used, question.logs, question.compiled)

    filter_model, filtered = _with_noise_nodes(question.filter_model, refilter)
    needed = max(
        rate * float(np.median(np.diff(log.run.time))) / STEP_TIMES_RATE if log.run.time.size > 1 else 0.0
        for log in filtered
        for rate in fastest_rates(log.run, log.samples, None)
    )
    steps = max(filter_model.substeps, math.ceil(needed)) if math.isfinite(needed) else math.inf
    explicit = replace(filter_model, method="rk4", substeps=int(steps), grading=1.0) if steps < math.inf else None
    if explicit is not None and steps <= max(_FEW_EXPLICIT, filter_model.substeps):
        return explicit
    planned = _plan(filter_model, filtered, refilter, question.compiled)
    dearer = planned.plan is None or _RK4_SLOPES * steps <= plan_cost(planned.model, planned.plan)
    return explicit if explicit is not None and dearer else planned


def _with_noise_nodes(filter_model: FilterModel, refilter: _Refilter) -> tuple[FilterModel, tuple[FilteredLog, ...]]:
    """The filter with as many nodes of process noise as its logs need, and its first run over them."""
    filtered = refilter(_first_run(filter_model, _FIRST_STEPS))
    if filter_model.noise_rule[0] == "sampled":
        return filter_model, filtered
    inside, reach = noise_nodes_along(filtered)
    chosen = replace(filter_model, noise_nodes=inside, noise_reach=reach)
    if chosen.noise_rule != filter_model.noise_rule:
        filtered = refilter(_first_run(chosen, _FIRST_STEPS))
    return chosen, filtered
