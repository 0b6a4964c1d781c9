"""Scenarios: manoeuvres declared beside a machine, as inputs over time, a start and an end; and panels to show them in.

A module of graphs may have a mapping ``SCENARIOS`` of names to scenarios and a tuple ``PANELS``; the command line finds
both by these names.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.errors import ModelError
from bondgraph.simulate.inputs import InputSignal
from bondgraph.simulate.model import Model

#: An input: constant, or corner points (time in s, value) with straight lines between them; held inputs step there.
Course: TypeAlias = float | str | Sequence[tuple[float, float | str]]

_NOTHING: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class Panel:
    """One panel of a picture: its title and unit, and what it shows as pairs of label and quantity.

    Quantities are states, outputs, inputs or named signals, converted into the unit.
    """

    title: str
    unit: str
    curves: Mapping[str, str]


@dataclass(frozen=True)
class Scenario:
    """A manoeuvre.

    Parameters
    ----------
    meaning
        What happens, in a line.
    duration
        End of time in s; it starts at zero.
    inputs
        Courses of inputs by name, in the units in which they are declared; any other input keeps its default.
    initial
        Start values of states by name, in their declared units; any other state has that of the model.

    Raises
    ------
    ModelError
        If the duration is not positive, or the corners of a course are not in order.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> push = Scenario("a push", 2.0, {"drive": [(0.0, 0.0), (0.5, 1.0), (0.5, 0.0)]}, {"angle": 0.1})
    >>> signal = push.signal(pendulum())
    >>> signal.at([0.25, 0.5, 1.0])
    array([[0.5, 0. , 0. ]])
    """

    meaning: str
    duration: float
    inputs: Mapping[str, Course]
    initial: Mapping[str, float] = field(default_factory=lambda: _NOTHING)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise ModelError(f"scenario {self.meaning!r}: duration {self.duration!r} s - it must be positive")
        for name, course in self.inputs.items():
            times = [time for time, _ in _corners(course)]
            if not times or times[0] < 0 or any(b < a for a, b in itertools.pairwise(times)):
                raise ModelError(
                    f"scenario {self.meaning!r}: corners of {name} at {times} s - give times from zero on, in order"
                )

    def times(self, step: float = 0.025) -> FloatArray:
        """Times from zero to the end, ``step`` apart."""
        times: FloatArray = step * np.arange(int(np.floor(self.duration / step + 1e-9)) + 1, dtype=np.float64)
        return times

    def left_out(self, model: Model) -> tuple[str, ...]:
        """Inputs and states of the scenario that a (reduced) model does not have."""
        known = {*model.names("input"), *model.names("state")}
        return tuple(name for name in (*self.inputs, *self.initial) if name not in known)

    def signal(self, model: Model) -> InputSignal:
        """The inputs of a model over time."""
        courses = {name: _corners(course) for name, course in self.inputs.items() if name in model.names("input")}
        times = np.unique([0.0, self.duration, *(time for course in courses.values() for time, _ in course)])
        grid = np.repeat(times, 2)  # the values before and after each time
        values = {
            name: _course(grid, [(time, _number(model, name, value)) for time, value in course], model, name)
            for name, course in courses.items()
        }
        return InputSignal.of(model, grid, **values)

    def start(self, model: Model) -> dict[str, float]:
        """Start values of the states that the model has."""
        states = {info.name: info for info in model.states}
        return {name: states[name].coherent(float(value)) for name, value in self.initial.items() if name in states}


def _corners(course: Course) -> list[tuple[float, float | str]]:
    return [(0.0, course)] if isinstance(course, str | float | int) else [(float(t), value) for t, value in course]


def _number(model: Model, name: str, value: float | str) -> float:
    if isinstance(value, str):
        return model.input_value(name, value)
    return model.inputs[model.index("input", name)].coherent(float(value))


def _course(grid: FloatArray, corners: Sequence[tuple[float, float]], model: Model, name: str) -> FloatArray:
    """Values at times each given twice: first those before a jump, then those after it."""
    held = model.inputs[model.index("input", name)].interpolation == "hold"
    times, values = np.array(corners, dtype=np.float64).T
    found = np.empty(grid.size)
    for side, part in (("left", slice(0, None, 2)), ("right", slice(1, None, 2))):
        after = np.clip(np.searchsorted(times, grid[part], side="left" if side == "left" else "right"), 0, times.size)
        before, behind = np.maximum(after - 1, 0), np.minimum(after, times.size - 1)
        length = times[behind] - times[before]
        share = np.where(length > 0, (grid[part] - times[before]) / np.where(length > 0, length, 1.0), 0.0)
        line = values[before] + np.clip(share, 0.0, 1.0) * (values[behind] - values[before])
        found[part] = values[before] if held else line
    return found
