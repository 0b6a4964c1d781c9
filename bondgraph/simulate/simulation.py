"""Integrate a model over its inputs, with any method, to one trajectory."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import FloatArray
from bondgraph.compile.rosenbrock import TABLEAUS
from bondgraph.errors import ModelError
from bondgraph.simulate.batch import simulate_batch
from bondgraph.simulate.hybrid import integrate_hybrid
from bondgraph.simulate.inputs import InputSegment
from bondgraph.simulate.integrators import RK4, AbstractIntegrator, Adaptive, Equations
from bondgraph.simulate.model import Model
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.stiff import Rosenbrock
from bondgraph.simulate.task import Inputs, Task, Vector, refusal, refuse_modes
from bondgraph.simulate.trajectory import Trajectory
from bondgraph.simulate.watched import WatchedEquations

#: Tolerance of the pilot run that finds the size of each state.
_PILOT_RTOL = 1e-4
#: The same of a run with events, which a coarse error may produce; after so many it has seen enough.
_PILOT_EVENT_RTOL, _PILOT_EVENTS = 1e-6, 50


def simulate(
    model: Model,
    time: npt.ArrayLike | None = None,
    inputs: Inputs = None,
    theta: Vector = None,
    x0: Vector = None,
    method: str | AbstractIntegrator = "adaptive",
    *,
    substeps: int = 1,
    rtol: float = 1e-9,
    atol: float | tuple[float, ...] | None = None,
    compiled: bool = False,
) -> Trajectory:
    """Integrate a model over ``time``.

    A model with modes (of an exactly derived graph) is integrated from event to event by an adaptive method; what
    happened is in ``Trajectory.events``.

    Parameters
    ----------
    model
        The model.
    time
        Increasing times (n,), s; the initial state is at the first. None: those of a log.
    inputs
        A log as read, matched, a file or a data frame; an ``InputSignal``, values by input name, or an array (n_u, n)
        at ``time``; None: defaults. Parameters that a log knows have its values unless ``theta`` gives others.
    theta, x0
        Parameters and initial state: by name, or whole vectors; None: declared values.
    method
        ``"adaptive"`` (LSODA), ``"rk4"``, ``"ros2"``, ``"ros3p"`` or ``"rodas4"`` (stiff, fixed steps), the name of a
        method of scipy, or an integrator.
    substeps
        Steps of the methods with fixed steps between neighbouring times.
    rtol, atol
        Tolerances of the adaptive methods; without ``atol`` errors count relative to the size each state reaches.
    compiled
        Use compiled equations: worth it for long runs, at the price of a compilation on the first use of a model.

    Returns
    -------
    Trajectory
        With an outcome; a failure is told there and not raised.

    Raises
    ------
    ModelError, OptionError
        If names, shapes or options are wrong.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.simulate(pendulum(), np.linspace(0.0, 1.0, 5), theta={"damping": 0.0}, x0={"angle": 1e-4})
    >>> bool(abs(swing.state("angle")[-1] - 1e-4 * np.cos(np.sqrt(9.81))) < 1e-10)
    True
    """
    task = Task.of(model, time, inputs, theta, x0)
    if task.theta.ndim > 1 or task.x0.ndim > 1:
        raise ModelError(f"{model.name}: simulate takes one member - use simulate_batch for many", where=(model.name,))
    if method == "rk4" or isinstance(method, RK4):
        refuse_modes(model)
        return _fixed(task, method if isinstance(method, RK4) else RK4(substeps), compiled)
    if model.modes:
        return _hybrid(task, method, rtol, atol, compiled)
    if method in TABLEAUS:
        method = Rosenbrock(str(method), substeps)
    if isinstance(method, Rosenbrock):
        return _fixed(task, method, compiled)
    integrator = method if isinstance(method, AbstractIntegrator) else _named(method, rtol, atol)
    rhs = _compiled_equations(task) if compiled else _equations(task)
    if isinstance(integrator, Adaptive) and integrator.atol is None and integrator.scale is None:
        integrator = replace(integrator, scale=_reached_sizes(rhs, integrator, task))
    x, outcome, ended_at = _integrate(rhs, integrator, task)
    return _trajectory(task, integrator, x, outcome, ended_at)


def _hybrid(
    task: Task, method: str | AbstractIntegrator, rtol: float, atol: float | tuple[float, ...] | None, compiled: bool
) -> Trajectory:
    """A model with modes: events are located, modes are held between them."""
    if method in TABLEAUS:
        raise refusal(task.model, f"{method} does not locate events")
    integrator = method if isinstance(method, AbstractIntegrator) else _named(method, rtol, atol)
    if not isinstance(integrator, Adaptive):
        raise refusal(task.model, f"{type(integrator).__name__} does not locate events")
    rhs = _compiled_equations(task) if compiled else _equations(task)
    if integrator.atol is None and integrator.scale is None:
        pilot = integrate_hybrid(
            rhs, replace(integrator, rtol=max(_PILOT_EVENT_RTOL, integrator.rtol)), task, _PILOT_EVENTS
        )
        integrator = replace(integrator, scale=_sizes(task, pilot.x))
    run = integrate_hybrid(rhs, integrator, task)
    y = task.model.output(task.times, run.x, run.u, task.theta)
    y[:, ~np.isfinite(run.x).all(axis=0)] = np.nan
    return Trajectory(task.model, task.times, run.x, y, run.u, run.outcome, run.ended_at, run.events)


def _named(method: str, rtol: float, atol: float | tuple[float, ...] | None) -> Adaptive:
    return Adaptive("LSODA" if method == "adaptive" else method, rtol=rtol, atol=atol)


def _fixed(task: Task, integrator: RK4 | Rosenbrock, compiled: bool) -> Trajectory:
    method = integrator if isinstance(integrator, Rosenbrock) else "rk4"
    batch = simulate_batch(
        task.model, task.times, task.signal, task.theta, task.x0,
        method=method, substeps=integrator.substeps, compiled=compiled,
    )  # fmt: skip
    return _trajectory(task, integrator, batch.x[..., 0], batch.outcomes[0], float(batch.ended_at[0]))


def _trajectory(
    task: Task, integrator: AbstractIntegrator, x: FloatArray, outcome: Outcome, ended_at: float
) -> Trajectory:
    u = task.signal.at(task.times)
    y = task.model.output(task.times, x, u, task.theta)
    y[:, ~np.isfinite(x).all(axis=0)] = np.nan
    cause = _cause(task, integrator, x, ended_at) if outcome in (Outcome.DIVERGED, Outcome.NON_FINITE) else ""
    return Trajectory(task.model, task.times, x, y, u, outcome, ended_at, cause=cause)


def _cause(task: Task, integrator: AbstractIntegrator, x: FloatArray, ended_at: float) -> str:
    """The law without a value that ended an integration, in words; empty where it was none.

    The same integrator goes once more from the last finite sample to the one after the end, with equations that watch.
    """
    last = max(int(np.isfinite(x).all(axis=0).cumprod().sum()) - 1, 0)
    beyond = min(int(np.searchsorted(task.times, ended_at, side="right")), task.times.size - 1)
    watched = WatchedEquations(task.model, task.theta)
    with np.errstate(all="ignore"):
        if beyond > last:
            _integrate(watched, integrator, replace(task, times=task.times[last : beyond + 1], x0=x[:, last]))
    if not watched.found:
        return ""
    return (
        f"a law has no value, after t = {float(task.times[last]):.6g} s: {watched.found[0]} - write a law that goes on"
        " beyond (as sign(x)*sqrt(abs(x)) does for sqrt(x)), or other parameters, inputs or initial state"
    )


def _reached_sizes(rhs: Equations, integrator: Adaptive, task: Task) -> tuple[float, ...]:
    """Largest magnitude of each state in a coarse pilot run; 1 for a state that stays at zero."""
    x, _, _ = _integrate(rhs, replace(integrator, rtol=max(_PILOT_RTOL, integrator.rtol)), task)
    return _sizes(task, x)


def _sizes(task: Task, x: FloatArray) -> tuple[float, ...]:
    size = np.nanmax(np.abs(np.column_stack([task.x0, x])), axis=1)
    return tuple(float(value) if value > 0 else 1.0 for value in size)


def _integrate(rhs: Equations, integrator: AbstractIntegrator, task: Task) -> tuple[FloatArray, Outcome, float]:
    """From break point to break point of the inputs; states at the times, outcome and time of the end."""
    times = task.times
    breaks = task.signal.break_points(times[0], times[-1])
    edges = np.unique(np.concatenate([times[:1], breaks, times[-1:]]))
    starts, ends = task.signal.intervals(edges)
    first, *last = np.searchsorted(times, edges, side="right").tolist()
    x = np.full((task.x0.size, times.size), np.nan)
    x[:, 0] = task.x0
    state = integrator.init(float(times[0]), task.x0)
    for k, (left, right) in enumerate(itertools.pairwise(edges.tolist())):
        inside = times[first : last[k]]
        asked = inside if inside.size and inside[-1] == right else np.append(inside, right)
        segment = InputSegment(left, right, starts[:, k], ends[:, k])
        values, state = integrator.step(rhs, segment, asked, state)
        x[:, first : last[k]] = values[:, : inside.size]
        first = last[k]
        if state.outcome is not Outcome.OK:
            break
    return x, state.outcome, state.time


def _equations(task: Task) -> Equations:
    def rhs(t: float, x: FloatArray, u: FloatArray) -> FloatArray:
        return task.model.rhs(t, x, u, task.theta)

    return rhs


def _compiled_equations(task: Task) -> Equations:
    rhs_into = task.model.compiled.rhs_into

    def rhs(t: float, x: FloatArray, u: FloatArray) -> FloatArray:
        dx = np.empty(x.size)
        rhs_into(float(t), np.ascontiguousarray(x), np.ascontiguousarray(u), task.theta, dx)
        return dx

    return rhs
