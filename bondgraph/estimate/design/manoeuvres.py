"""Planned manoeuvres: times, inputs and starts of logs that nobody has measured yet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.data.log import MatchedLog
from bondgraph.estimate.free_simulation import expected_problem
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.reduced import reduced
from bondgraph.simulate.inputs import InputSignal
from bondgraph.simulate.late import given_rows, inputs_of
from bondgraph.simulate.model import Model
from bondgraph.simulate.scenario import Scenario

#: Samples of a manoeuvre of steps, at the rate of the logs, and the share of inputs left out at both ends of a range.
_SAMPLES, _TAIL = 400, 2.0
#: Intervals between two steps, of which the second lets the machine nearly settle.
_STEPS = (40.0, 120.0)


@dataclass(frozen=True)
class Manoeuvre:
    """A planned log.

    Parameters
    ----------
    name
        In words.
    time
        Sample times, shape (n,), s.
    u
        Inputs there, shape (n_u, n), in coherent SI.
    initial
        Start values of states by name, in the units of the model; others start as declared.
    measured
        Which samples of which output are measured, shape (n_y, n); None: all of those that have a noise.
    """

    name: str
    time: FloatArray
    u: FloatArray
    initial: Mapping[str, float] = field(default_factory=dict)
    measured: np.ndarray | None = None

    @property
    def duration(self) -> float:
        """Length in s."""
        return float(self.time[-1] - self.time[0])

    @classmethod
    def of_scenario(cls, name: str, scenario: Scenario, model: Model, step: float = 0.025) -> Manoeuvre:
        """A scenario sampled every ``step`` s.

        Examples
        --------
        >>> from bondgraph.simulate.example import pendulum
        >>> push = Scenario("a push", 2.0, {"drive": [(0.0, 0.0), (0.5, 1.0)]}, {"angle": 0.1})
        >>> Manoeuvre.of_scenario("push", push, pendulum(), 0.5).u
        array([[0., 1., 1., 1., 1.]])
        """
        time = scenario.times(step)
        return cls(name, time, scenario.signal(model).at(time), scenario.start(model))

    @classmethod
    def of_log(cls, log: MatchedLog, initial: Mapping[str, float] | None = None) -> Manoeuvre:
        """Times and inputs of a log, and its gaps; what it measured counts for nothing but for where it did."""
        measured = None if np.isnan(log.y).all() else ~np.isnan(log.y)
        return cls(log.name, log.time, log.u, dict(initial or {}), measured)


def blank_log(model: Model, step: float = 0.025) -> MatchedLog:
    """A log of two samples, ``step`` s apart, without a measurement: for a problem that has no log yet.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> blank_log(pendulum()).y
    array([[nan, nan]])
    """
    u = np.repeat(model.u0()[:, np.newaxis], 2, axis=1)
    return MatchedLog("planned", np.array([0.0, step]), u, np.full((len(model.outputs), 2), np.nan))


def planned_problem(problem: EstimationProblem, manoeuvre: Manoeuvre, point: FloatArray) -> EstimationProblem:
    """The problem of a manoeuvre: what its sensors would show without noise at a point (n,), as a log.

    Raises
    ------
    EstimationError
        If the model diverges in the manoeuvre.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> log = bg.MatchedLog("swing", np.arange(60) * 0.05, np.zeros((1, 60)), np.zeros((1, 60)))
    >>> problem = bg.pose(swing, log, ["length"], initial="model")
    >>> still = Manoeuvre("still", np.arange(40) * 0.05, np.zeros((1, 40)), {"angle": 0.0})
    >>> planned_problem(problem, still, problem.start).logs[0].y.shape
    (1, 40)
    """
    model = problem.filter_model.model
    shape = (len(model.outputs), manoeuvre.time.size)
    measured = np.ones(shape, dtype=np.bool_) if manoeuvre.measured is None else manoeuvre.measured
    log = MatchedLog(manoeuvre.name, manoeuvre.time, manoeuvre.u, np.where(measured, 0.0, np.nan))
    starts = (dict(manoeuvre.initial),)
    silent = reduced(problem, lambda target: target.log is None, logs=(log,), initial=starts)
    return expected_problem(silent, np.asarray(point)[[problem.names.index(name) for name in silent.names]])


def step_manoeuvres(model: Model, logs: Sequence[MatchedLog]) -> tuple[Manoeuvre, ...]:
    """Manoeuvres within the range of inputs seen in logs: steps of one input while the others rest, or its end.

    Each input is stepped up and down while the others rest at their medians, and each is taken away.

    Parameters
    ----------
    model
        The model.
    logs
        At least one; their rate is that of the manoeuvres, twice as long as 200 samples.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> log = MatchedLog("swing", np.arange(60) * 0.05, np.sin(np.arange(60.0))[np.newaxis], np.zeros((1, 60)))
    >>> [one.name for one in step_manoeuvres(pendulum(), [log])][-1]
    'running out after drive is taken away'
    """
    first = logs[0]
    step = float(np.median(np.diff(first.time)))
    time = first.time[0] + step * np.arange(_SAMPLES)
    rows = given_rows(model)
    inputs = np.concatenate([inputs_of(model, one)[rows] for one in logs], axis=1)
    middle, low, high = (np.percentile(inputs, q, axis=1) for q in (50.0, _TAIL, 100.0 - _TAIL))
    found = []
    for row, info in enumerate(model.inputs[known] for known in rows):
        if info.rate_of or high[row] == low[row]:
            continue
        for seconds in (share * step for share in _STEPS):
            u = np.repeat(middle[:, np.newaxis], time.size, axis=1)
            up = ((time - time[0]) // seconds).astype(int) % 2 == 0
            u[row] = np.where(up, high[row], low[row])
            others = ", the other inputs at rest" if len(rows) > 1 else ""
            found.append((f"steps of {info.name} every {seconds:.3g} s{others}", u))
        u = np.repeat(middle[:, np.newaxis], time.size, axis=1)
        u[row] = np.where(np.arange(time.size) < time.size // 3, high[row], min(max(low[row], 0.0), high[row]))
        found.append((f"running out after {info.name} is taken away", u))
    return tuple(Manoeuvre(name, time, InputSignal.of_table(model, time, u, ()).values) for name, u in found)
