"""Free simulation of an estimation problem: its model along its logs without noise, with exact sensitivities.

A filter that believes in no process noise and knows its start carries a belief of no width along the log, so that its
mean is the simulation. With sensors of unit noise that read zero its innovations are minus the outputs, and the exact
derivatives of innovations are those of the outputs. So what is predicted moves with every parameter just as the
integration steps of the estimation move it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.free import Target
from bondgraph.estimate.objective import fitted_expansion
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.reduced import reduced
from bondgraph.filter.choice import choose_method
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.linear.intervals import integrator, simulation_steps
from bondgraph.filter.samples import Samples
from bondgraph.filter.smoother import smoothed_start
from bondgraph.simulate.batch import simulate_batch
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.simulation import simulate
from bondgraph.simulate.starts import BEGINNING
from bondgraph.simulate.stiff import Rosenbrock
from bondgraph.simulate.trajectory import Trajectory

#: Of fourth order, as the classical Runge-Kutta method (Hairer and Wanner 1996, Solving ODEs II, section IV.10).
_STABLE = "rodas4"


@dataclass(frozen=True)
class SimulatedLog:
    """Outputs of a model along a log: ``y`` (n_y, n), and their derivatives by values of parameters (n_y, n, m).

    ``names`` are the m free parameters and initial states; noise levels move no simulation.
    """

    log: MatchedLog
    names: tuple[str, ...]
    y: FloatArray
    slopes: FloatArray


def noise_free(filter_model: FilterModel) -> FilterModel:
    """A filter that knows its start, believes in no process noise, and reads every output with unit noise."""
    return replace(
        filter_model,
        process_noise={}, initial_std={}, measurement_noise=dict.fromkeys(filter_model.model.names("output"), 1.0),
        process_correlation={}, initial_correlation={}, measurement_correlation={},
    )  # fmt: skip


def simulation_problem(
    problem: EstimationProblem,
    logs: Sequence[MatchedLog] | None = None,
    starts: Sequence[Mapping[str, float]] | None = None,
) -> EstimationProblem:
    """The problem whose innovations are minus the simulated outputs along logs.

    Parameters
    ----------
    problem
        Free parameters, filter model and start rule.
    logs
        Times and inputs; None: those of the problem.
    starts
        Initial states by name for each log; None: by the rule of the problem.

    Raises
    ------
    EstimationError
        If no parameter or initial state is free.
    """
    own = tuple(problem.logs if logs is None else logs)
    named = (None, *(log.name for log in own))

    def moves(target: Target) -> bool:
        return target.kind in ("parameter", "x0") and target.log in named

    if not any(moves(target) for target, _ in problem.numbers(problem.start)):
        raise EstimationError(
            f"{problem.filter_model.model.name}: no parameter and no initial state is free, so no simulation moves",
            where=problem.names,
        )
    states = problem.filter_model.model.names("state")
    there = reduced(problem, moves, logs=own)
    if starts is None:
        begun = zip(there.initial_states, there.beginnings.logs, strict=True)
        starts = [
            {name: float(x0[k]) for k, name in enumerate(states) if k not in log.at_parameters} for x0, log in begun
        ]
    silent = tuple(replace(log, y=np.zeros_like(log.y)) for log in own)
    plain = tuple(replace(one, prior_mean=None, prior_std=None) for one in there.free)
    filter_model = noise_free(problem.filter_model)
    return EstimationProblem(filter_model, silent, plain, initial=tuple(starts), ties=there.ties)


def simulated_logs(
    problem: EstimationProblem,
    point: FloatArray,
    logs: Sequence[MatchedLog] | None = None,
    starts: Sequence[Mapping[str, float]] | None = None,
) -> tuple[SimulatedLog, ...]:
    """Outputs along logs with their exact derivatives by the values of free parameters and initial states.

    Parameters
    ----------
    problem, logs, starts
        As for :func:`simulation_problem`.
    point
        Coordinates of the problem, shape (n,).

    Raises
    ------
    EstimationError
        If the model diverges, or nothing is free that moves it.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(60) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 60)), np.zeros((1, 60)))
    >>> problem = bg.pose(swing, log, ["length", "damping"], initial="model")
    >>> (run,) = simulated_logs(problem, problem.start)
    >>> run.names, run.slopes.shape
    (('length', 'damping'), (1, 60, 2))
    """
    silent = simulation_problem(problem, logs, starts)
    rows = [problem.names.index(name) for name in silent.names]
    where = np.asarray(point, dtype=np.float64)[rows]
    terms = fitted_expansion(silent, where, exact_derivatives).terms
    if terms is None or not np.isfinite(terms.innovations).all():
        raise EstimationError(
            f"{problem.filter_model.model.name}: the simulation diverges at these values"
            " - use more substeps, or check parameters, start and inputs",
            where=silent.names,
        )
    slopes = np.array([one.slope(value) for one, value in zip(silent.free, silent.values(where), strict=True)])
    found, first = [], 0
    for log in silent.logs:
        shape = log.y.shape
        some = -terms.innovations[first : first + log.y.size]
        found.append(
            SimulatedLog(log, silent.names, some[:, 0].reshape(shape), some[:, 1:].reshape(*shape, -1) / slopes)
        )
        first += log.y.size
    return tuple(found)


def simulated_members(problem: EstimationProblem, points: FloatArray) -> tuple[FloatArray, ...]:
    """Outputs (n_y, n, members) along each log of a problem at coordinates (n, members); NaN where a member diverges.

    Explicit steps that are stable at the start of a search may not be so elsewhere in the bounds, so an L-stable method
    of the same order takes their place.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> log = bg.MatchedLog("swing", np.arange(60) * 0.05, np.zeros((1, 60)), np.zeros((1, 60)))
    >>> (y,) = simulated_members(bg.pose(swing, log, ["length"], initial="model"), np.array([[0.8, 1.0, 1.2]]))
    >>> y.shape
    (1, 60, 3)
    """
    filter_model = choose_method(noise_free(problem.filter_model), problem.logs)
    batch, model = problem.batch(points), problem.filter_model.model
    found = []
    for log, x0 in zip(problem.logs, batch.x0, strict=True):
        theta = batch.theta.copy()
        for name, value in log.theta_overrides.items():
            theta[model.index("parameter", name)] = value
        steps = int(Samples.of(filter_model, log).substeps.max(initial=1))
        method = filter_model.method if filter_model.is_stiff else _STABLE
        chosen = Rosenbrock(method, steps, filter_model.grading)
        run = simulate_batch(model, log.time, log.u, theta, x0, method=chosen)
        found.append(run.y)
    return tuple(found)


def expected_problem(problem: EstimationProblem, point: FloatArray) -> EstimationProblem:
    """The problem on what its sensors would show without noise were a point (n,) the truth.

    Times, inputs, starts and gaps of the logs stay; outputs without a noise are not measured. The Fisher information
    there is that which such logs hold on average, to first order in the noise.

    Raises
    ------
    EstimationError
        If the model diverges along a log.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> log = bg.MatchedLog("swing", np.arange(60) * 0.05, np.zeros((1, 60)), np.zeros((1, 60)))
    >>> problem = bg.pose(swing, log, ["length"], initial="model")
    >>> expected_problem(problem, problem.start).logs[0].y[0, :2].round(3).tolist()
    [0.479, 0.474]
    """
    batch, declared = problem.batch(np.asarray(point)[:, np.newaxis]), problem.filter_model
    model, logs, starts = declared.model, [], []
    for log, x0 in zip(problem.logs, batch.x0, strict=True):
        theta = batch.theta[:, 0].copy()
        for name, value in log.theta_overrides.items():
            theta[model.index("parameter", name)] = value
        run = simulate(model, log.time, inputs_of(model, log), theta, x0[:, 0], compiled=True)
        if not np.isfinite(run.y).all():
            raise EstimationError(
                f"{model.name}: the model diverges along {log.name!r} at t = {run.ended_at:.6g} s"
                " - take a gentler manoeuvre, or check the values of the parameters",
                where=(log.name,),
            )
        seen = np.isfinite(declared.noise_std)[:, np.newaxis] & ~np.isnan(log.y)
        logs.append(replace(log, y=np.where(seen, run.y, np.nan)))
        starts.append(dict(zip(model.names("state"), map(float, x0[:, 0]), strict=True)))
    return replace(problem, logs=tuple(logs), initial=tuple(starts))


def left_alone(filtered: FilterRun, theta: FloatArray, log: MatchedLog) -> Trajectory:
    """A model left alone along a log: given are its inputs, and what the log's beginning says of where it starts.

    Its integration is that of the filter. Where it diverges from the start that a smoother takes from the first
    twentieth of the log, it starts from what the first sample alone says. One sample says nothing of a state that no
    sensor shows. Reference: Ljung (1999), System Identification, chapter 4.

    Parameters
    ----------
    filtered
        The filter's run along the log.
    theta
        Parameters, shape (n_theta,); those that are known for the log count.
    log
        The log.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> log = bg.MatchedLog("swing", np.arange(60) * 0.05, np.zeros((1, 60)), np.zeros((1, 60)))
    >>> left_alone(bg.filter_log(swing, log), swing.model.theta(), log).y.shape
    (1, 60)
    """
    filter_model, model = filtered.filter_model, filtered.filter_model.model
    own = theta.copy()
    for name, value in log.theta_overrides.items():
        own[model.index("parameter", name)] = value
    method, steps = integrator(filter_model), simulation_steps(filter_model, log.time)

    def simulated(start: FloatArray) -> Trajectory:
        x0 = start[: len(model.states)]
        return simulate(model, log.time, inputs_of(model, log), own, x0, method=method, substeps=steps, compiled=True)

    begun = simulated(smoothed_start(filtered, float(log.time[0] + BEGINNING * np.ptp(log.time))))
    return begun if begun.outcome is Outcome.OK else simulated(filtered.filtered_mean[:, 0])
