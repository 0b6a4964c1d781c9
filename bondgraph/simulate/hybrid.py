"""Integrate a model with modes: from event to event, the modes held between them.

The equations are smooth between events, so that the integrator may look beyond one; the event is then found on its
dense output, the step is cut there, the mode changes, and integration starts anew (Shampine and Thompson 2000, Comput.
Math. Appl. 39(5-6)). A multistep method would begin each stretch with steps of low order and lose accuracy at every
event, so LSODA leaves the beginning to the one-step method DOP853 and takes over where that needs many steps, as in a
stiff model. What would never end is recognised: events that follow each other ever faster, and switches that
return to their surface at once.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.simulate.crossing import Crossing, first_crossing
from bondgraph.simulate.inputs import InputSegment
from bondgraph.simulate.integrators import Adaptive, Equations, IntegratorState
from bondgraph.simulate.modes import Modes, NoConsistentModeError, Point, Watch
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.task import Task
from bondgraph.simulate.trajectory import EventRecord

#: The shortest flight between two impacts that is followed, as a share of the whole time.
_SHORTEST = 1e-9
#: What a zero function lacks at the start of a stretch, as a share of its largest value so far, is left over from the
#: event before.
_ROUNDING = 1e-12
#: Steps of the one-step method after which LSODA takes over, and how often, after which it begins too.
_BEGINNING, _HANDED_OVER = 300, 3
#: Events of one element at one instant after which its mode does not settle: impacts pass a push on many times.
_AT_ONE_INSTANT = {"switch": 20, "friction": 20, "impact": 300}
#: So many events within the given share of the whole time have no end.
_MANY, _WITHIN = 500, 1e-7
#: Switches that change in turn within this share of the whole time converge to a point; one alone slides.
_NEARBY = 1e-6


@dataclass(frozen=True)
class HybridRun:
    """States and inputs at the times of a task (n_x, n) and (n_u, n), how it ended and what happened.

    The inputs hold the modes in their places.
    """

    x: FloatArray
    u: FloatArray
    outcome: Outcome
    ended_at: float
    events: tuple[EventRecord, ...]


def integrate_hybrid(rhs: Equations, integrator: Adaptive, task: Task, most_events: int | None = None) -> HybridRun:
    """From event to event and from break point to break point of the inputs, or only so far as ``most_events``.

    Raises
    ------
    ModelError
        If bodies overlap at the start.
    """
    return _Run(rhs, integrator, task, most_events).run()


class _Run:
    """One run: where it stands, in which modes, and what has happened."""

    def __init__(self, rhs: Equations, integrator: Adaptive, task: Task, most_events: int | None) -> None:
        self.rhs, self.integrator, self.task, self.most_events = rhs, integrator, task, most_events
        self.span = float(task.times[-1] - task.times[0])
        self.modes = Modes(task.model, task.theta, max(_SHORTEST * self.span, np.finfo(float).tiny))
        self.state = integrator.init(float(task.times[0]), task.x0)
        self.now = np.zeros(len(task.model.modes))
        self.x = np.full((task.x0.size, task.times.size), np.nan)
        self.u = task.signal.at(task.times)
        self.largest = np.zeros(len(task.model.event_rows))
        self.is_handed_over, self.times_handed_over = False, 0
        self.events: list[EventRecord] = []
        self.instants: list[tuple[float, int]] = []

    def run(self) -> HybridRun:
        times = self.task.times
        self.x[:, 0] = self.task.x0
        breaks = self.task.signal.break_points(times[0], times[-1])
        edges = np.unique(np.concatenate([times[:1], breaks, times[-1:]])).tolist()
        try:
            self._begin(edges)
            for left, right in itertools.pairwise(edges):
                self._stretch(self.task.signal.segment(left, right))
                if self.state.outcome is not Outcome.OK or self._has_enough():
                    break
        except NoConsistentModeError:
            self.state = replace(self.state, outcome=Outcome.NO_MODE)
        return HybridRun(self.x, self.u, self.state.outcome, self.state.time, tuple(self.events))

    def _begin(self, edges: list[float]) -> None:
        first = self.task.signal.segment(*edges[:2]).left if len(edges) > 1 else self.u[:, 0]
        self.now = self.modes.start(Point(self.state.time, self.state.x, first))
        self.u[:, 0] = self.modes.with_modes(first, self.now)

    # ------------------------------------------------------------------ between break points of the inputs

    def _stretch(self, segment: InputSegment) -> None:
        while self.state.outcome is Outcome.OK and self.state.time < segment.end and not self._has_enough():
            watch = self._violated(segment)
            if watch is None:
                watch = self._advance(segment)
            if watch is not None and self.state.outcome is Outcome.OK:
                self._fire(watch, segment)

    def _has_enough(self) -> bool:
        return self.most_events is not None and len(self.events) >= self.most_events

    def _violated(self, segment: InputSegment) -> Watch | None:
        """A watched function that is below zero already, because an input jumped or another event changed it."""
        at = self._point(segment)
        values, rounding = self.modes.values(at, self.now), self.modes.rounding(at, self.now)
        for watch in self.modes.watches(self.now):
            zero = max(rounding[watch.row], _ROUNDING * self.largest[watch.row], np.finfo(float).tiny)
            if watch.sign * values[watch.row] < -zero:
                return watch
        return None

    def _point(self, segment: InputSegment) -> Point:
        return Point(self.state.time, self.state.x, segment.at(self.state.time))

    def _advance(self, segment: InputSegment) -> Watch | None:
        """Integrate to the next event, or to the end of the segment."""
        times, start = self.task.times, self.state.time
        inside = np.flatnonzero((times > start) & (times <= segment.end))
        asked = np.union1d(times[inside], segment.end)
        watches = self.modes.watches(self.now)
        hit: list[Crossing] = []
        functions = self._functions(segment, watches)
        rows = [watch.row for watch in watches]
        start_values = functions(np.array([start]), self.state.x[:, np.newaxis])
        above = np.maximum(0.0, -start_values)  # rounding of the last event is no distance that must be made up first
        tolerance = self.modes.rounding(self._point(segment), self.now)[rows]
        is_flow = [self.modes.is_flow(watch) for watch in watches]  # it may be held at zero by another element
        tolerance = np.maximum(tolerance, np.where(is_flow, _ROUNDING * self.largest[rows], 0.0))

        def until(left: float, right: float, dense: Callable[[FloatArray], FloatArray]) -> float | None:
            ends = np.array([left, right])
            self.largest[rows] = np.maximum(self.largest[rows], np.max(np.abs(functions(ends, dense(ends))), axis=1))
            found = first_crossing(lambda t: functions(t, dense(t)) + above, left, right, tolerance)
            if found is None:
                return None
            hit.append(found)
            return found.time

        held = replace(
            segment,
            left=self.modes.with_modes(segment.left, self.now),
            right=self.modes.with_modes(segment.right, self.now),
        )
        values, self.state = self._integrator().step(self.rhs, held, asked, self.state, until)
        if self.state.outcome is Outcome.STEP_LIMIT and not self.is_handed_over:
            self.is_handed_over, self.times_handed_over = True, self.times_handed_over + 1
            self.state = replace(self.state, outcome=Outcome.OK)
        else:
            self.is_handed_over = False
        filled = np.isfinite(values[:, : inside.size]).all(axis=0)
        self.x[:, inside[filled]] = values[:, : inside.size][:, filled]
        for rate in self.task.signal.rates:  # where it jumps it is that of the modes that end there
            self.u[rate, inside] = segment.left[rate]
        for place, mode in zip(self.modes.places, self.now, strict=True):
            self.u[place, inside] = mode
        return watches[hit[0].row] if hit else None

    def _integrator(self) -> Adaptive:
        if self.integrator.method != "LSODA" or self.is_handed_over or self.times_handed_over >= _HANDED_OVER:
            self.is_handed_over = True  # the method asked for goes on until its own limit
            return self.integrator
        return replace(self.integrator, method="DOP853", max_steps=self.state.steps + _BEGINNING)

    def _functions(self, segment: InputSegment, watches: list[Watch]) -> Callable[[FloatArray, FloatArray], FloatArray]:
        rows = [watch.row for watch in watches]
        signs = np.array([watch.sign for watch in watches])[:, np.newaxis]
        task, now = self.task, self.now

        def functions(times: FloatArray, x: FloatArray) -> FloatArray:
            share = (times - segment.start) / (segment.end - segment.start)
            u = segment.left[:, np.newaxis] + np.multiply.outer(segment.right - segment.left, share)
            found: FloatArray = signs * task.model.events(times, x, self.modes.with_modes(u, now), task.theta)[rows]
            return found

        return functions

    # ------------------------------------------------------------------ events

    def _fire(self, watch: Watch, segment: InputSegment) -> None:
        x, self.now, said = self.modes.fire(watch, self._point(segment), self.now)
        self.state = IntegratorState(self.state.time, x, self.state.steps)
        self.events.append(EventRecord(self.state.time, self.task.model.modes[watch.mode].element, said))
        self.instants.append((self.state.time, watch.mode))
        self.state = replace(self.state, outcome=self._endless(watch))

    def _endless(self, watch: Watch) -> Outcome:
        """Whether events have no end: at one instant, or ever faster."""
        time = self.state.time
        lately = [mode for t, mode in self.instants[-3 * _MANY :] if time - t <= 1e-14 * max(abs(time), self.span)]
        kind = self.modes.kinds[watch.mode]
        if lately.count(watch.mode) > _AT_ONE_INSTANT[kind]:
            nearby = {mode for t, mode in self.instants[-_MANY:] if time - t <= _NEARBY * self.span}
            return Outcome.CHATTER if kind == "switch" and len(nearby) == 1 else Outcome.ZENO
        if len(self.instants) > _MANY and time - self.instants[-_MANY][0] < _WITHIN * self.span:
            return Outcome.ZENO
        return Outcome.OK
