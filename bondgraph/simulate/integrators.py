"""Integrators with one interface: immutable settings, a state record that ``init`` makes and ``step`` returns.

An integrator advances over one stretch of time in which the inputs are straight lines. It knows nothing of logs, models
or break points; the loop over stretches belongs to :func:`bondgraph.simulate.simulation.simulate`.

| settings | method | use |
|---|---|---|
| ``RK4(substeps)`` | classical Runge-Kutta, order 4, equal steps, any batch | filters, swarms |
| ``Adaptive("LSODA")`` | Adams / BDF with automatic change (Petzold 1983) | reference, the default |
| ``Adaptive("Radau")``, ``Adaptive("BDF")`` | implicit | stiff models |
| ``Adaptive("RK45")``, ``Adaptive("DOP853")`` | explicit | smooth, not stiff |
"""

from __future__ import annotations

import abc
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.errors import OptionError, suggest
from bondgraph.simulate.inputs import InputSegment
from bondgraph.simulate.outcome import Outcome

#: ``rhs(t, x, u)`` with the parameters already bound.
Equations = Callable[[float, FloatArray, FloatArray], FloatArray]

#: Classes of scipy.
_SOLVERS = ("LSODA", "Radau", "BDF", "RK45", "DOP853")

#: Where to stop within a step from ``start`` to ``end`` with states ``dense(times)``; None: nowhere.
Until = Callable[[float, float, Callable[[FloatArray], FloatArray]], float | None]

#: A state beyond this multiple of its scale has diverged.
_DIVERGED = 1e12


@dataclass(frozen=True)
class IntegratorState:
    """Where an integration stands: time, state (n_x, *batch), steps taken so far, and how it goes."""

    time: float
    x: FloatArray
    steps: int = 0
    outcome: Outcome = Outcome.OK


class AbstractIntegrator(abc.ABC):
    """Settings of one method.

    ``step(rhs, segment, times, state)`` advances from ``state.time`` to ``segment.end`` and returns the states at
    ``times`` (k increasing times in the segment after its start, the last one its end), shape (n_x, k, *batch), and the
    next state. After a failure the remaining values are NaN and ``state.outcome`` says what happened.
    """

    def init(self, time: float, x: FloatArray) -> IntegratorState:
        """The state before the first step."""
        return IntegratorState(time, x)

    @abc.abstractmethod
    def step(
        self, rhs: Equations, segment: InputSegment, times: FloatArray, state: IntegratorState
    ) -> tuple[FloatArray, IntegratorState]:
        """Advance over one segment; see the class."""


@dataclass(frozen=True)
class RK4(AbstractIntegrator):
    """The classical Runge-Kutta method of order 4 with equal steps (Kutta 1901).

    Parameters
    ----------
    substeps
        Steps between neighbouring times. Stable while step times the fastest rate stays below 2.7.

    Examples
    --------
    >>> decay = lambda t, x, u: -x
    >>> rest = InputSegment(0.0, 1.0, np.empty(0), np.empty(0))
    >>> x, _ = RK4(substeps=10).step(decay, rest, np.array([1.0]), IntegratorState(0.0, np.array([1.0])))
    >>> bool(abs(x[0, 0] - np.exp(-1.0)) < 1e-6)
    True
    """

    substeps: int = 1

    def step(
        self, rhs: Equations, segment: InputSegment, times: FloatArray, state: IntegratorState
    ) -> tuple[FloatArray, IntegratorState]:
        """Advance with equal steps between the times; see the abstract class."""
        t, x = state.time, state.x
        values = np.empty((x.shape[0], times.size, *x.shape[1:]))
        for k, end in enumerate(times):
            step = (float(end) - t) / self.substeps
            for now in (t + i * step for i in range(self.substeps)):
                u_left, u_middle, u_right = (segment.at(now + share * step) for share in (0.0, 0.5, 1.0))
                slope_1 = rhs(now, x, u_left)
                slope_2 = rhs(now + 0.5 * step, x + 0.5 * step * slope_1, u_middle)
                slope_3 = rhs(now + 0.5 * step, x + 0.5 * step * slope_2, u_middle)
                slope_4 = rhs(now + step, x + step * slope_3, u_right)
                x = x + step / 6.0 * (slope_1 + 2.0 * (slope_2 + slope_3) + slope_4)
            values[:, k] = x
            t = float(end)
        outcome = state.outcome if np.isfinite(x).all() else Outcome.DIVERGED
        return values, IntegratorState(t, x, state.steps + self.substeps * times.size, outcome)


@dataclass(frozen=True)
class Adaptive(AbstractIntegrator):
    """A method of scipy that chooses its own steps, for one state at a time.

    Parameters
    ----------
    method
        ``"LSODA"``, ``"Radau"``, ``"BDF"``, ``"RK45"`` or ``"DOP853"``.
    rtol
        Error of a step relative to the state. The default keeps whole trajectories within about 1e-6.
    atol
        Error of a step in units of each state, a number or one per state; None: ``rtol`` times the state's scale.
    scale
        Typical size of each state, a number or one per state; None: 1, unless ``simulate`` finds it by a pilot run.
    max_steps
        Steps after which the integration gives up.

    Raises
    ------
    OptionError
        If the method is unknown or a tolerance is not positive.

    References
    ----------
    Petzold (1983), SIAM J. Sci. Stat. Comput. 4(1); Hairer & Wanner (1996), Solving Ordinary Differential Equations II.
    """

    method: str = "LSODA"
    rtol: float = 1e-9
    atol: float | tuple[float, ...] | None = None
    scale: float | tuple[float, ...] | None = None
    max_steps: int = 1_000_000

    def __post_init__(self) -> None:
        if self.method not in _SOLVERS:
            raise OptionError(
                f"integration method {self.method!r} is not known{suggest(self.method, _SOLVERS)}"
                f" - choose rk4, adaptive, {', '.join(_SOLVERS)}",
                where=(self.method,),
            )
        if not self.rtol > 0 or (self.atol is not None and not np.all(np.asarray(self.atol) > 0)):
            raise OptionError(f"rtol={self.rtol!r}, atol={self.atol!r}: tolerances must be positive")

    def step(
        self,
        rhs: Equations,
        segment: InputSegment,
        times: FloatArray,
        state: IntegratorState,
        until: Until | None = None,
    ) -> tuple[FloatArray, IntegratorState]:
        """Advance with steps of the method's own choice; see the abstract class.

        ``until(start, end, dense)`` is asked after every step where to stop within it, with the states over the step as
        a function of times; then the remaining values are NaN and ``state.time`` is before the end.
        """
        watched = _Watched(rhs, segment)
        values = np.full((state.x.size, times.size), np.nan)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # failures are told by the outcome
            try:
                state = self._run(watched, segment.end, times, state, values, until)
            except (ValueError, FloatingPointError, np.linalg.LinAlgError):  # implicit methods refuse NaN matrices
                state = replace(state, outcome=Outcome.NON_FINITE)
        if state.outcome is Outcome.DIVERGED and watched.met_non_finite:
            state = replace(state, outcome=Outcome.NON_FINITE)
        return values, state

    def _run(
        self,
        rhs: _Watched,
        end: float,
        times: FloatArray,
        state: IntegratorState,
        values: FloatArray,
        until: Until | None,
    ) -> IntegratorState:
        scale = np.broadcast_to(1.0 if self.scale is None else np.asarray(self.scale), state.x.shape)
        atol = self.rtol * scale if self.atol is None else self.atol
        if not np.isfinite(rhs(state.time, state.x)).all():
            return replace(state, outcome=Outcome.NON_FINITE)
        import scipy.integrate  # here: it takes longer to load than all of a filter

        solver = getattr(scipy.integrate, self.method)(rhs, state.time, state.x, end, rtol=self.rtol, atol=atol)
        filled, steps = 0, state.steps
        beyond = _DIVERGED * np.maximum(scale, 1.0)
        while solver.status == "running":
            if steps >= self.max_steps:
                return IntegratorState(float(solver.t), solver.y, steps, Outcome.STEP_LIMIT)
            solver.step()
            steps += 1
            if solver.status == "failed" or not (np.abs(solver.y) < beyond).all():
                return IntegratorState(float(solver.t), solver.y, steps, Outcome.DIVERGED)
            is_asked = filled < times.size and times[filled] <= solver.t
            dense: Any = solver.dense_output() if is_asked or until is not None else None
            stop = None if until is None else until(float(solver.t_old), float(solver.t), dense)
            reached = int(times.searchsorted(solver.t if stop is None else stop, side="right"))
            if reached > filled:
                values[:, filled:reached] = dense(times[filled:reached])
                filled = reached
            if stop is not None:
                return IntegratorState(stop, np.asarray(dense(stop)), steps, state.outcome)
        values[:, -1] = solver.y
        return IntegratorState(end, solver.y, steps, state.outcome)


class _Watched:
    """The equations over one segment, noting whether they ever gave a value that is not finite."""

    def __init__(self, rhs: Equations, segment: InputSegment) -> None:
        self._rhs = rhs
        self._segment = segment
        self.met_non_finite = False

    def __call__(self, t: float, x: FloatArray) -> FloatArray:
        slope = self._rhs(t, x, self._segment.at(t))
        self.met_non_finite |= not np.isfinite(slope).all()
        return slope
