"""The modes of a model: which zero functions watch them, and what happens when one of them crosses zero.

A switch changes its side. A friction whose flow has come to zero locks if it can carry the effort that keeps it there,
else it slips the other way; one that is locked slips as soon as that effort exceeds what it can carry, in its direction
(Karnopp 1985, J. Dyn. Syst. Meas. Control 107(1)). Where several could be locked, which of them are follows by pivoting
on the first whose assumption fails, which ends because the gains between their efforts and flows are those of a
symmetric mass matrix (Murty 1974, Opsearch 11(2)). An impact reverses its speed, and comes to rest where the next
flight would be too short to matter.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.errors import ModelError
from bondgraph.simulate.model import Model
from bondgraph.simulate.outcome import Outcome

#: Relative change of states, inputs and time by which rounding is told from a value of a zero function.
_ROUNDING = 1e-13
#: A rebound with less than this share of the speed of an impact is none.
_NO_REBOUND = 1e-12
#: A moment, s: long enough that a flow changes by more than rounding.
_MOMENT = 1e-9
#: Pivots per element after which the search for consistent modes gives up.
_PIVOTS = 20


class NoConsistentModeError(Exception):
    """No combination of locked and slipping elements fits the equations."""


@dataclass(frozen=True)
class Point:
    """Where a trajectory stands: time, states, inputs with the modes in their places."""

    t: float
    x: FloatArray
    u: FloatArray


@dataclass(frozen=True)
class Watch:
    """One zero function that is watched now: its row, and the sign with which it is positive while the mode holds."""

    mode: int
    row: int
    sign: float


class Modes:
    """The modes of a model with given parameters; ``shortest`` is the shortest flight between two impacts, s."""

    def __init__(self, model: Model, theta: FloatArray, shortest: float) -> None:
        self.model, self.theta, self.shortest = model, theta, shortest
        self.places = [model.index("input", mode.input) for mode in model.modes]
        self.kinds = [mode.kind for mode in model.modes]
        rows = [row.mode for row in model.event_rows]
        self.first = [rows.index(mode.input) for mode in model.modes]

    # ------------------------------------------------------------------ what is watched

    def with_modes(self, u: FloatArray, modes: FloatArray) -> FloatArray:
        """Inputs (n_u,) or (n_u, k) with the modes in their places."""
        filled = np.array(u, dtype=np.float64)
        filled[self.places] = modes if u.ndim == 1 else modes[:, np.newaxis]
        return filled

    def watches(self, modes: FloatArray) -> list[Watch]:
        """The zero functions that may end the modes."""
        found = []
        for i, (kind, mode, first) in enumerate(zip(self.kinds, modes, self.first, strict=True)):
            if kind == "switch" or (kind == "friction" and mode != 0):
                found.append(Watch(i, first, float(mode)))
            elif kind == "friction":
                found += [Watch(i, first + 1, 1.0), Watch(i, first + 2, 1.0)]
            else:
                found.append(Watch(i, first + int(mode), 1.0))
        return found

    def is_flow(self, watch: Watch) -> bool:
        """Whether a watched function is the flow of a friction that slips."""
        return self.kinds[watch.mode] == "friction" and watch.row == self.first[watch.mode]

    def values(self, at: Point, modes: FloatArray) -> FloatArray:
        """All zero functions (n_events,) at a point, in the given modes."""
        return self.model.events(at.t, at.x, self.with_modes(at.u, modes), self.theta)

    def rounding(self, at: Point, modes: FloatArray) -> FloatArray:
        """How much each zero function changes if states, inputs and time change by rounding, shape (n_events,)."""
        signs = _SIGNS[np.arange(1, at.x.size + at.u.size + 1) % len(_SIGNS)]
        x = at.x[:, np.newaxis] * (1.0 + _ROUNDING * signs[: at.x.size])
        u = at.u[:, np.newaxis] * (1.0 + _ROUNDING * signs[at.x.size :])
        changed = self.model.events(at.t, x, self.with_modes(u, modes), self.theta)
        found: FloatArray = np.max(np.abs(changed - self.values(at, modes)[:, np.newaxis]), axis=1, initial=0.0)
        return found

    # ------------------------------------------------------------------ start

    def start(self, at: Point) -> FloatArray:
        """The modes in which a trajectory begins.

        Raises
        ------
        ModelError
            If bodies overlap at the start.
        """
        modes = np.array([1.0 if kind == "friction" else 0.0 for kind in self.kinds])
        still: list[int] = []
        for _ in range(3):  # a side may decide about the value of another
            values, rounding = self.values(at, modes), self.rounding(at, modes)
            ahead = self._ahead(at, modes)
            for i, (kind, first) in enumerate(zip(self.kinds, self.first, strict=True)):
                value, small = values[first], rounding[first]
                if kind == "switch":
                    modes[i] = np.sign(value if abs(value) > small else ahead[first]) or -1.0
                elif kind == "friction":
                    modes[i] = np.sign(value) if abs(value) > small else 0.0
                elif value < -small:
                    raise ModelError(
                        f"{self.model.name}: {self.model.event_rows[first].meaning} is {value:.6g} at the start, which"
                        " is less than nothing - start with the gap open or closed",
                        where=(self.model.name, self.model.modes[i].element),
                    )
                elif value <= small and abs(values[first + 2]) <= rounding[first + 2]:
                    modes[i] = 1.0
            still = [i for i in range(modes.size) if self._is_constrained(i, modes)]
        return self._settled(at, modes, still, frozenset())

    def _ahead(self, at: Point, modes: FloatArray) -> FloatArray:
        """Zero functions a moment later."""
        step = self.shortest
        u = self.with_modes(at.u, modes)
        x = at.x + step * self.model.rhs(at.t, at.x, u, self.theta)
        return self.model.events(at.t + step, x, u, self.theta)

    def _is_constrained(self, i: int, modes: FloatArray) -> bool:
        return bool(self.kinds[i] != "switch" and modes[i] == (0.0 if self.kinds[i] == "friction" else 1.0))

    # ------------------------------------------------------------------ events

    def fire(self, watch: Watch, at: Point, modes: FloatArray) -> tuple[FloatArray, FloatArray, str]:
        """States, modes and what happened, after a watched function has crossed zero."""
        i, kind = watch.mode, self.kinds[watch.mode]
        new = modes.copy()
        if kind == "switch":
            new[i] = -modes[i]
            side = "positive" if new[i] > 0 else "negative"
            return at.x, new, f"switches, {self.model.event_rows[watch.row].meaning} becomes {side}"
        if kind == "impact" and modes[i] == 0.0:
            return self._hit(i, at, new)
        if kind == "impact":
            new[i] = 0.0
            return at.x, self._settled(at, new, self._constrained(new), frozenset()), "opens"
        if modes[i] == 0.0:
            new[i] = 1.0 if watch.row == self.first[i] + 1 else -1.0
            settled = self._settled(at, new, self._constrained(new), frozenset([i]))
            return at.x, settled, f"slips {_direction(new[i])}"
        return self._stop(i, at, new)

    def _reset(self, i: int, at: Point, modes: FloatArray) -> FloatArray:
        return self.model.reset(self.model.modes[i].input, at.t, at.x, self.with_modes(at.u, modes), self.theta)

    def _constrained(self, modes: FloatArray) -> list[int]:
        return [i for i in range(modes.size) if self._is_constrained(i, modes)]

    def _stop(self, i: int, at: Point, modes: FloatArray) -> tuple[FloatArray, FloatArray, str]:
        """A slipping friction whose flow has come to zero."""
        before = modes[i]
        modes[i] = 0.0
        settled = self._settled(at, modes, self._constrained(modes), frozenset())
        if settled[i] == 0.0:
            return self._reset(i, at, modes), settled, "locks"
        if settled[i] == before:
            return at.x, settled, f"goes on slipping {_direction(before)}"
        return at.x, settled, f"slips {_direction(settled[i])}"

    def _hit(self, i: int, at: Point, modes: FloatArray) -> tuple[FloatArray, FloatArray, str]:
        """A gap has closed: rebound, or rest where the next flight would be too short."""
        speed_row = self.first[i] + 2
        before = self.values(at, modes)[speed_row]
        rebound = self._reset(i, at, modes)
        after = Point(at.t, rebound, at.u)
        speed = self.values(after, modes)[speed_row]
        acceleration = (self._ahead(after, modes)[speed_row] - speed) / self.shortest
        flies = 2.0 * speed >= -acceleration * self.shortest and speed > -_NO_REBOUND * before
        if before < 0.0 and flies:
            return rebound, self._released(after, modes, i), "rebounds"
        rest = at.x if before == speed else at.x + (rebound - at.x) * before / (before - speed)
        still = Point(at.t, rest, at.u)
        modes[i] = 1.0
        modes = self._released(still, modes, i)
        return rest, self._settled(still, modes, self._constrained(modes), frozenset()), "comes to rest"

    def _released(self, at: Point, modes: FloatArray, hit: int) -> FloatArray:
        """The modes after an impulse: what it has set in motion slips that way, or is not at rest any more."""
        new, values = modes.copy(), self.values(at, modes)
        rounding = self.rounding(at, modes)
        for i, kind in enumerate(self.kinds):
            row = self.first[i] + (2 if kind == "impact" else 0)
            moves = abs(values[row]) > 1e3 * rounding[row] + self._slow(values)
            if kind != "switch" and i != hit and moves:
                new[i] = np.sign(values[row]) if kind == "friction" else 0.0
        return new

    def _slow(self, values: FloatArray) -> float:
        """Speeds below this share of the fastest are rounding of the impulse."""
        return float(1e-12 * np.max(np.abs(values[[self.first[i] + 2 for i in self._impacts()]]), initial=0.0))

    def _impacts(self) -> list[int]:
        return [i for i, kind in enumerate(self.kinds) if kind == "impact"]

    # ------------------------------------------------------------------ which are locked

    def _settled(self, at: Point, modes: FloatArray, still: Iterable[int], released: frozenset[int]) -> FloatArray:
        """Modes in which the elements without flow are locked where they can be.

        ``still`` are those without flow; ``released`` are those that have just begun to slip.
        """
        modes = modes.copy()
        candidates = sorted(set(still) - released)
        for i in candidates:
            modes[i] = 0.0 if self.kinds[i] == "friction" else 1.0
        for _ in range(_PIVOTS * (len(candidates) + 1)):
            for i in candidates:
                wanted = self._wanted(i, at, modes)
                if wanted != modes[i]:
                    modes[i] = wanted
                    break
            else:
                return modes
        raise NoConsistentModeError

    def _wanted(self, i: int, at: Point, modes: FloatArray) -> float:
        """The mode of an element without flow, the modes of all others given."""
        locked = 0.0 if self.kinds[i] == "friction" else 1.0
        trial = modes.copy()
        trial[i] = locked
        values, rounding = self.values(at, trial), self.rounding(at, trial)
        row = self.first[i] + 1
        if values[row] < -rounding[row]:
            return 1.0 if self.kinds[i] == "friction" else 0.0
        if self.kinds[i] == "friction" and values[row + 1] < -rounding[row + 1]:
            return -1.0
        return locked


def consistent_inputs(model: Model, t: float, x: FloatArray, u: FloatArray, theta: FloatArray) -> FloatArray:
    """Inputs (n_u,) with the modes in which a trajectory would begin at a point.

    Raises
    ------
    ModelError
        If bodies overlap there, or no modes fit.
    """
    modes = Modes(model, theta, _MOMENT)
    try:
        return modes.with_modes(u, modes.start(Point(t, x, u)))
    except NoConsistentModeError:
        raise ModelError(f"{model.name}: {Outcome.NO_MODE.value}", where=(model.name,)) from None


def _direction(mode: float) -> str:
    return "forward" if mode > 0 else "backward"


#: Signs of the changes by which rounding is estimated: rows of a Hadamard matrix, so that no two quantities always
#: change together.
_SIGNS = np.array([[1.0 if bin(i & j).count("1") % 2 == 0 else -1.0 for j in range(8)] for i in range(8)])
